//! What stands in the rooms and in their walls: pillars, crates, buttresses, alcoves.

use super::draft::{Change, Draft, Space};
use super::outline::{Polygon, area, bevelled, bounds};
use super::raster::{Cover, Rect};
use super::{bars, low, niche};
use nbp_env::Rng;
use rand::RngExt as _;
use rand::seq::IndexedRandom as _;

/// Square map units in 100 m².
const HUNDRED_SQUARE_METRES: f64 = 250_000.0;

/// Free ground that stays around an obstacle and before a door, map units.
const AISLE: i32 = 48;

/// Things for each 100 m² of floor.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DetailStyle {
    /// Pillars and crates that stand free and are taller than the camera.
    pub(crate) islands: f64,
    /// Crates, buttresses and cut corners that touch a wall.
    pub(crate) at_walls: f64,
    /// Steps, platforms and boxes under the camera.
    pub(crate) low: f64,
    /// Deep recesses in walls.
    pub(crate) alcoves: f64,
    /// Barred windows.
    pub(crate) bars: f64,
}

/// Furnishes all rooms.
pub(crate) fn furnish(draft: &mut Draft, style: &DetailStyle, rng: &mut Rng) {
    for room in 0..draft.site.rooms.len() {
        let hundreds = area(&draft.room(room).polygon) / HUNDRED_SQUARE_METRES;
        let mut count = |density: f64| (density * hundreds + rng.random::<f64>()).floor() as usize;
        let (low, at_walls, islands) = (count(style.low), count(style.at_walls), count(style.islands));
        let (alcoves, bars) = (count(style.alcoves), count(style.bars));
        for _ in 0..alcoves {
            let space = Space { polygon: draft.room(room).polygon.clone(), air: draft.room(room).air };
            niche::alcove(draft, &space, rng);
        }
        for _ in 0..bars {
            bars::window(draft, rng);
        }
        low::furnish(draft, room, low, rng);
        for _ in 0..at_walls {
            wall_piece(draft, room, rng);
        }
        for _ in 0..islands {
            island(draft, room, rng);
        }
    }
}

/// A random place of the room on the raster, for a box of a size.
pub(crate) fn draw_rect(draft: &Draft, room: usize, size: [i32; 2], rng: &mut Rng) -> Rect {
    let [low, high] = bounds(&draft.room(room).polygon);
    let low = [0, 1].map(|axis| {
        let slots = ((high[axis] - low[axis] - size[axis]) / 8).max(0);
        (low[axis] / 8 + rng.random_range(0..=slots)) * 8
    });
    Rect { low, high: [low[0] + size[0], low[1] + size[1]] }
}

/// Whether a place is free, with an aisle around it and no door before it.
pub(crate) fn is_clear(draft: &Draft, rect: Rect, aisle: i32) -> bool {
    draft.raster.all(rect.grown(aisle), |cover| cover == Cover::Free)
        && !draft.mouths.iter().any(|mouth| mouth.grown(AISLE).overlaps(rect))
}

/// A pillar from floor to ceiling or a crate over the camera's height, with an aisle all around.
fn island(draft: &mut Draft, room: usize, rng: &mut Rng) {
    for _ in 0..12 {
        let side = *[16, 16, 24, 32, 32, 48, 64].choose(rng).unwrap_or(&32);
        let is_crate = rng.random_bool(0.35);
        let size = if is_crate { [side.max(32), *[32, 48, 64].choose(rng).unwrap_or(&32)] } else { [side, side] };
        let rect = draw_rect(draft, room, size, rng);
        if !is_clear(draft, rect, AISLE) {
            continue;
        }
        let is_round = !is_crate && side >= 32 && rng.random_bool(0.4);
        let polygon = if is_round { bevelled(&rect.polygon(), f64::from(side) * 0.29) } else { rect.polygon() };
        let change = if is_crate { tall_crate(draft, room, rng) } else { Change::Solid(draft.theme.pillar(rng)) };
        draft.furnish(room, polygon, change);
        return;
    }
}

/// A crate that stands taller than the camera; up to the ceiling where that is low.
fn tall_crate(draft: &Draft, room: usize, rng: &mut Rng) -> Change {
    let air = &draft.room(room).air;
    let top = air.floor.height.max(0) + rng.random_range(9..=16) * 8;
    Change::Floor(draft.theme.crate_top(if top + 16 <= air.ceiling.height { top } else { air.ceiling.height }, rng))
}

/// A crate or buttress that touches a wall of the room, or a corner cut off.
fn wall_piece(draft: &mut Draft, room: usize, rng: &mut Rng) {
    for _ in 0..16 {
        let polygon = &draft.room(room).polygon;
        let at = rng.random_range(0..polygon.len());
        let [before, a, b] = [polygon.len() - 1, 0, 1].map(|step| polygon[(at + step) % polygon.len()]);
        let is_straight = |p: [i32; 2], q: [i32; 2]| p[0] == q[0] || p[1] == q[1];
        if !is_straight(a, b) {
            continue;
        }
        let along = [0, 1].map(|axis| (b[axis] - a[axis]).signum());
        // Outlines are counter-clockwise: the air lies to the left.
        let inward = [-along[1], along[0]];
        if rng.random_bool(0.6) && is_straight(before, a) && is_corner(before, a, b) {
            let cut = rng.random_range(6..=20) * 8;
            let corner: Polygon = vec![a, step(a, along, cut), step(a, inward, cut)];
            let wall = Change::Solid(draft.room(room).air.wall);
            if place_at_wall(draft, room, Rect::spanning(corner[1], corner[2]), corner, wall) {
                return;
            }
            continue;
        }
        let length = (b[0] - a[0]).abs() + (b[1] - a[1]).abs();
        let width = rng.random_range(2..=8) * 8;
        let depth = rng.random_range(2..=6) * 8;
        if length < width + 32 {
            continue;
        }
        let start = step(a, along, rng.random_range(0..=(length - width) / 8) * 8);
        let rect = Rect::spanning(start, step(step(start, along, width), inward, depth));
        let change =
            if rng.random_bool(0.5) { tall_crate(draft, room, rng) } else { Change::Solid(draft.theme.pillar(rng)) };
        if place_at_wall(draft, room, rect, rect.polygon(), change) {
            return;
        }
    }
}

fn place_at_wall(draft: &mut Draft, room: usize, rect: Rect, polygon: Polygon, change: Change) -> bool {
    let is_far_from_doors = !draft.mouths.iter().any(|mouth| mouth.grown(AISLE).overlaps(rect));
    if !is_far_from_doors || !draft.raster.all(rect, |cover| cover == Cover::Free) {
        return false;
    }
    // The aisle in front of it: all but the wall itself must be free.
    if !draft.raster.all(rect.grown(AISLE), |cover| cover != Cover::Blocked) {
        return false;
    }
    draft.furnish(room, polygon, change);
    true
}

fn is_corner(before: [i32; 2], a: [i32; 2], b: [i32; 2]) -> bool {
    (a[0] - before[0]) * (b[1] - a[1]) - (a[1] - before[1]) * (b[0] - a[0]) > 0
}

fn step(from: [i32; 2], direction: [i32; 2], distance: i32) -> [i32; 2] {
    [from[0] + direction[0] * distance, from[1] + direction[1] * distance]
}
