//! Recesses in walls: bays between pilasters, panels, shelves, vents, high windows, alcoves.
//!
//! They lie under all other spaces and end 8 map units before the next one, so nothing is joined by them.

use super::draft::{Draft, Space};
use super::outline::{Polygon, direction, edges};
use super::raster::{CELL, Cover};
use super::theme::Air;
use crate::doom_map::CAMERA_UNITS;
use nbp_env::Rng;
use rand::RngExt as _;
use rand::seq::IndexedRandom as _;

/// A recess, seen from its front.
#[derive(Clone, Copy, Debug)]
struct Recess {
    width: f64,
    depth: f64,
    air: Air,
}

/// Decorates walls of a space. `share` is the part of its walls that gets something.
pub(crate) fn decorate_walls(draft: &mut Draft, space: &Space, share: f64, rng: &mut Rng) {
    // Two motifs a room.
    let motifs = [(); 2].map(|()| draw_motif(draft, &space.air, rng));
    let pitch = *[80.0, 96.0, 96.0, 128.0].choose(rng).unwrap_or(&96.0);
    let is_framed = rng.random_bool(0.6);
    for [a, b] in edges(&space.polygon) {
        if !rng.random_bool(share) {
            continue;
        }
        let Some(motif) = *motifs.choose(rng).unwrap_or(&None) else { continue };
        let length = f64::from(b[0] - a[0]).hypot(f64::from(b[1] - a[1]));
        let count = ((length - 16.0) / pitch).floor().max(0.0);
        let recess = Recess { width: motif.width.min(pitch - 16.0), ..motif };
        for n in 0..count as usize {
            let middle = length / 2.0 + pitch * (n as f64 - (count - 1.0) / 2.0);
            if dig(draft, [a, b], middle, recess) && is_framed {
                dig_deeper(draft, [a, b], middle, recess, rng);
            }
        }
    }
}

/// A deep recess at a random wall of a space, as high as a door.
pub(crate) fn alcove(draft: &mut Draft, space: &Space, rng: &mut Rng) {
    let sides: Vec<[[i32; 2]; 2]> = edges(&space.polygon).collect();
    for _ in 0..8 {
        let Some(&[a, b]) = sides.choose(rng) else { return };
        let length = f64::from(b[0] - a[0]).hypot(f64::from(b[1] - a[1]));
        let width = f64::from(rng.random_range(7..=16) * 8);
        if length < width + 32.0 {
            continue;
        }
        let rise = *[0, 0, 8, 16].choose(rng).unwrap_or(&0);
        let floor = (space.air.floor.height + rise).min(24);
        let ceiling = (rng.random_range(12..=16) * 8).min(space.air.ceiling.height);
        let air = space.air.between(floor, ceiling).with_wall(draft.theme.panel(rng));
        let depth = f64::from(rng.random_range(4..=12) * 8);
        let reach = (length - width) / 2.0 - 16.0;
        let middle = length / 2.0 + (rng.random_range(-1.0..=1.0) * reach / 8.0).round() * 8.0;
        if dig(draft, [a, b], middle, Recess { width, depth, air }) {
            return;
        }
    }
}

fn draw_motif(draft: &Draft, air: &Air, rng: &mut Rng) -> Option<Recess> {
    let (floor, ceiling) = (air.floor.height, air.ceiling.height);
    let step = |range: std::ops::RangeInclusive<i32>, rng: &mut Rng| rng.random_range(range) * 8;
    // Low, at the camera's height, high, whole.
    let (sill, lintel) = match rng.random_range(0.0..10.0) {
        ..3.5 => {
            let sill = floor + step(0..=2, rng);
            (sill, (sill + step(3..=5, rng)).min(64))
        }
        ..4.7 => (floor.max(0) + step(2..=4, rng), floor.max(0) + step(11..=14, rng)),
        ..9.0 => {
            let sill = floor.max(0) + step(10..=12, rng);
            (sill, sill + step(3..=6, rng))
        }
        _ => (floor, ceiling),
    };
    let is_whole = (sill, lintel) == (floor, ceiling);
    let width = if is_whole { 512.0 } else { *[32.0, 40.0, 48.0, 64.0].choose(rng).unwrap_or(&32.0) };
    let lintel = lintel.min(if is_whole { ceiling } else { ceiling - 8 });
    let wall = if is_whole { air.wall } else { draft.theme.panel(rng) };
    (lintel >= sill + 16).then(|| Recess { width, depth: 8.0, air: air.between(sill, lintel).with_wall(wall) })
}

/// Digs a recess with its middle at a distance along a wall; `false` where something is behind or before the wall.
fn dig(draft: &mut Draft, wall: [[i32; 2]; 2], middle: f64, recess: Recess) -> bool {
    let cell = f64::from(CELL);
    let half = recess.width / 2.0;
    let is_solid = draft.raster.is_all(&quad(wall, middle, half + cell, [0.0, recess.depth + cell]), Cover::Wall);
    if !is_solid || !draft.raster.is_all(&quad(wall, middle, half, [-2.0 * cell, 0.0]), Cover::Free) {
        return false;
    }
    let (low, high) = (f64::from(recess.air.floor.height), f64::from(recess.air.ceiling.height));
    let cover = if low < CAMERA_UNITS && CAMERA_UNITS < high { Cover::Free } else { Cover::Blocked };
    draft.raster.fill(&quad(wall, middle, half, [0.0, recess.depth]), cover);
    draft.niches.push(Space { polygon: quad(wall, middle, half, [-cell, recess.depth]), air: recess.air });
    true
}

/// A smaller recess in the back of another.
fn dig_deeper(draft: &mut Draft, wall: [[i32; 2]; 2], middle: f64, outer: Recess, rng: &mut Rng) {
    let (low, high) = (outer.air.floor.height, outer.air.ceiling.height);
    let half = outer.width / 2.0 - 8.0;
    if half < 8.0 || high - low < 32 {
        return;
    }
    let cell = f64::from(CELL);
    let depth = outer.depth + cell;
    let behind = quad(wall, middle, half + cell, [outer.depth, depth + cell]);
    if draft.raster.is_all(&behind, Cover::Wall) {
        let mut air = outer.air.between(low + 8, high - 8).with_wall(draft.theme.panel(rng));
        air.light = (air.light + 32).min(255);
        draft.raster.fill(&quad(wall, middle, half, [outer.depth, depth]), Cover::Blocked);
        draft.niches.push(Space { polygon: quad(wall, middle, half, [outer.depth - 1.0, depth]), air });
    }
}

/// A rectangle around a place of a wall; depths are measured from its air into the solid.
fn quad([a, b]: [[i32; 2]; 2], middle: f64, half: f64, [near, far]: [f64; 2]) -> Polygon {
    let along = direction(a, b);
    // Outlines are counter-clockwise: the solid lies to the right.
    let outward = [along[1], -along[0]];
    [(middle - half, near), (middle - half, far), (middle + half, far), (middle + half, near)]
        .map(|(s, d)| [0, 1].map(|axis| a[axis] + (s * along[axis] + d * outward[axis]).round() as i32))
        .to_vec()
}
