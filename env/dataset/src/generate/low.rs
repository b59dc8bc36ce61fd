//! What stands under the camera: boxes, benches, pedestals, ledges with a step, pits.

use super::detail::{draw_rect, is_clear};
use super::draft::{Change, Draft, Host};
use super::outline::{Polygon, bevelled, edges};
use super::raster::{Cover, Rect};
use super::rooms::draw_index;
use nbp_env::Rng;
use rand::RngExt as _;
use rand::seq::IndexedRandom as _;

/// Floors that are walked on stay within this of the modal floor, map units.
const RELIEF: i32 = 24;

/// Boxes reach up to here, under the camera at 68.75.
const HIGHEST_BOX: i32 = 56;

/// Places some pieces in a room, beside each other.
pub(crate) fn furnish(draft: &mut Draft, room: usize, count: usize, rng: &mut Rng) {
    let mut taken: Vec<Rect> = Vec::new();
    for _ in 0..count {
        let placed = match draw_index(&[0.35, 0.25, 0.25, 0.15], rng) {
            0 => boxes(draft, room, &taken, rng),
            1 => pedestal(draft, room, &taken, rng),
            2 => ledge(draft, room, &taken, rng),
            _ => pit(draft, room, &taken, rng),
        };
        taken.extend(placed);
    }
}

/// A free place for a box of a size.
fn find_place(draft: &Draft, room: usize, size: [i32; 2], taken: &[Rect], rng: &mut Rng) -> Option<Rect> {
    (0..8)
        .map(|_| draw_rect(draft, room, size, rng))
        .find(|&rect| is_clear(draft, rect, 8) && !taken.iter().any(|other| other.grown(8).overlaps(rect)))
}

/// One to three boxes in a row, or a bench.
fn boxes(draft: &mut Draft, room: usize, taken: &[Rect], rng: &mut Rng) -> Option<Rect> {
    let side = *[24, 32, 32, 48, 64].choose(rng)?;
    let axis = rng.random_range(0..2_usize);
    let count = rng.random_range(1..=3);
    let mut size = [side; 2];
    size[axis] *= count;
    let all = find_place(draft, room, size, taken, rng)?;
    let floor = draft.room(room).air.floor.height;
    let mut top = draft.theme.crate_top(0, rng);
    for n in 0..count {
        top.height = (floor + rng.random_range(2..=6) * 8).min(HIGHEST_BOX);
        let mut one = all;
        one.low[axis] += n * side;
        one.high[axis] = one.low[axis] + side;
        draft.furnish(room, one.polygon(), Change::Floor(top));
    }
    Some(all)
}

/// A round or square stand in two steps, with a lamp above.
fn pedestal(draft: &mut Draft, room: usize, taken: &[Rect], rng: &mut Rng) -> Option<Rect> {
    let side = rng.random_range(6..=14) * 8;
    let rect = find_place(draft, room, [side; 2], taken, rng)?;
    let is_round = rng.random_bool(0.6);
    let shape = |margin: i32| {
        let square = rect.grown(-margin);
        if is_round { bevelled(&square.polygon(), f64::from(side - 2 * margin) * 0.29) } else { square.polygon() }
    };
    let air = draft.room(room).air;
    let rise = rng.random_range(1..=2) * 8;
    for (margin, height) in [(0, rise), (8, 2 * rise)] {
        let top = draft.theme.trim((air.floor.height + height).min(RELIEF), air.floor.flat);
        draft.furnish(room, shape(margin), Change::Floor(top));
    }
    let lamp = draft.theme.lamp(air.ceiling.height + 8, rng);
    draft.decorate(Host::Room(room), shape(16), Change::Ceiling(lamp, 32));
    Some(rect)
}

/// A platform along a wall with a step before it.
fn ledge(draft: &mut Draft, room: usize, taken: &[Rect], rng: &mut Rng) -> Option<Rect> {
    let sides: Vec<[[i32; 2]; 2]> = edges(&draft.room(room).polygon).collect();
    let &[a, b] = sides.choose(rng)?;
    let along = usize::from(a[0] == b[0]);
    let (low, high) = (a[along].min(b[along]), a[along].max(b[along]));
    if a[1 - along] != b[1 - along] || high - low < 96 {
        return None;
    }
    // Outlines are counter-clockwise: the air lies to the left.
    let inward = if along == 0 { (b[0] - a[0]).signum() } else { (a[1] - b[1]).signum() };
    let depth = rng.random_range(4..=10) * 8;
    let length = (high - low).min(rng.random_range(12..=40) * 8);
    let mut from = a;
    from[along] = low + rng.random_range(0..=(high - low - length) / 8) * 8;
    let platform = |depth: i32| {
        let mut to = from;
        (to[along], to[1 - along]) = (from[along] + length, from[1 - along] + inward * depth);
        Rect::spanning(from, to)
    };
    let whole = platform(depth + 16);
    let is_free = draft.raster.all(whole, |cover| cover == Cover::Free)
        && !draft.mouths.iter().chain(taken).any(|other| other.overlaps(whole));
    if !is_free {
        return None;
    }
    let floor = draft.room(room).air.floor;
    let rise = rng.random_range(1..=2) * 8;
    for (depth, height) in [(depth + 16, rise), (depth, 2 * rise)] {
        let top = draft.theme.trim((floor.height + height).min(RELIEF), floor.flat);
        draft.furnish(room, platform(depth).polygon(), Change::Floor(top));
    }
    Some(whole)
}

/// A hole in the floor with a rim.
fn pit(draft: &mut Draft, room: usize, taken: &[Rect], rng: &mut Rng) -> Option<Rect> {
    let size = [0, 1].map(|_| rng.random_range(8..=18) * 8);
    let rect = find_place(draft, room, size, taken, rng)?;
    let floor = draft.room(room).air.floor;
    let rim: Polygon = bevelled(&rect.polygon(), 16.0);
    let bottom = draft.theme.inset((floor.height - 16).max(-RELIEF), rng);
    draft.furnish(room, rim, Change::Floor(draft.theme.trim(floor.height + 4, floor.flat)));
    draft.furnish(room, bevelled(&rect.grown(-8).polygon(), 12.0), Change::Floor(bottom));
    Some(rect)
}
