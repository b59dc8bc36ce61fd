//! What the camera does not run into: ceilings with coffers, lamps and beams, floors let in or raised, ribs in corridors.

use super::draft::{Change, Draft, Host, Space};
use super::niche::decorate_walls;
use super::outline::{Polygon, bevelled, bounds, contains, inset, spans_along};
use super::raster::Rect;
use super::rooms::draw_index;
use nbp_env::Rng;
use rand::RngExt as _;
use rand::seq::IndexedRandom as _;

/// Ceilings do not come lower than this, map units: the camera is at 68.75.
const LOWEST_CEILING: i32 = 88;

/// Doors are shorter than this and corridors are not broader, map units.
const SHORT: i32 = 64;

/// Passages end this far inside of the spaces they join, map units.
const OVERLAP: i32 = 8;

/// How much is decorated.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TrimStyle {
    /// Share of the walls with recesses.
    pub(crate) walls: f64,
    /// Share of the rooms with a shaped ceiling.
    pub(crate) ceilings: f64,
    /// Share of the rooms with a shaped floor.
    pub(crate) floors: f64,
}

/// Shapes the floors, before anything stands on them.
pub(crate) fn shape_floors(draft: &mut Draft, style: &TrimStyle, rng: &mut Rng) {
    for number in 0..draft.site.rooms.len() {
        if rng.random_bool(style.floors) {
            floor(draft, number, rng);
        }
    }
}

/// Decorates walls and ceilings of all rooms and corridors.
pub(crate) fn decorate(draft: &mut Draft, style: &TrimStyle, rng: &mut Rng) {
    for number in 0..draft.site.rooms.len() {
        let room = draft.room(number);
        let space = Space { polygon: room.polygon.clone(), air: room.air };
        decorate_walls(draft, &space, style.walls, rng);
        if rng.random_bool(style.ceilings) {
            ceiling(draft, number, rng);
        }
    }
    for number in 0..draft.passages.len() {
        let space = draft.passages[number].clone();
        let [low, high] = bounds(&space.polygon);
        let rect = Rect { low, high };
        if rect.size()[0].min(rect.size()[1]) < SHORT {
            threshold(draft, number, rect);
        } else {
            decorate_walls(draft, &space, style.walls, rng);
            ribs(draft, number, rect, rng);
        }
    }
}

/// Shapes a room's ceiling.
fn ceiling(draft: &mut Draft, room: usize, rng: &mut Rng) {
    match draw_index(&[0.2, 0.2, 0.2, 0.2, 0.2], rng) {
        0 => tray(draft, room, rng),
        1 => lamps(draft, room, rng),
        2 => coffers(draft, room, rng),
        3 => beams(draft, room, rng),
        _ => {
            tray(draft, room, rng);
            lamps(draft, room, rng);
        }
    }
}

/// The middle of the ceiling in one to three steps up or down.
fn tray(draft: &mut Draft, room: usize, rng: &mut Rng) {
    let air = draft.room(room).air;
    let rise = *[-16, -8, 8, 16, 16, 24].choose(rng).unwrap_or(&16);
    let first = f64::from(rng.random_range(3..=8) * 8);
    let cut = f64::from(rng.random_range(0..=4) * 16);
    for step in 1..=rng.random_range(1..=3) {
        let height = air.ceiling.height + step * rise;
        let Some(outline) = inset(&draft.room(room).polygon, first + 16.0 * f64::from(step), 48.0) else { return };
        if height < LOWEST_CEILING {
            return;
        }
        let outline = if cut > 0.0 { bevelled(&outline, cut) } else { outline };
        let surface = draft.theme.trim(height, air.ceiling.flat);
        draft.decorate(Host::Room(room), outline, Change::Ceiling(surface, 16 * step as i16));
    }
}

/// Lamps in rows.
fn lamps(draft: &mut Draft, room: usize, rng: &mut Rng) {
    let air = draft.room(room).air;
    let pitch = *[128, 160, 192].choose(rng).unwrap_or(&128);
    let side = *[24, 32, 48, 64].choose(rng).unwrap_or(&32);
    let is_round = rng.random_bool(0.4);
    let has_rim = rng.random_bool(0.6);
    let lamp = draft.theme.lamp(air.ceiling.height + if has_rim { 4 } else { 8 }, rng);
    let rim = draft.theme.trim((air.ceiling.height - 4).max(LOWEST_CEILING), air.ceiling.flat);
    let shape = |rect: Rect, side: i32| {
        if is_round { bevelled(&rect.polygon(), f64::from(side) * 0.29) } else { rect.polygon() }
    };
    for middle in grid(&draft.room(room).polygon, [pitch; 2], side + 32) {
        if has_rim {
            let rim_shape = shape(Rect::around(middle, [side + 16; 2]), side + 16);
            draft.decorate(Host::Room(room), rim_shape, Change::Ceiling(rim, 0));
        }
        draft.decorate(Host::Room(room), shape(Rect::around(middle, [side; 2]), side), Change::Ceiling(lamp, 48));
    }
}

/// Square hollows between beams that cross.
fn coffers(draft: &mut Draft, room: usize, rng: &mut Rng) {
    let air = draft.room(room).air;
    let pitch = *[96, 128, 160].choose(rng).unwrap_or(&128);
    let side = pitch - *[16, 24, 32].choose(rng).unwrap_or(&24);
    let hollow = draft.theme.trim(air.ceiling.height + rng.random_range(1..=3) * 8, air.ceiling.flat);
    let lamp = draft.theme.lamp(hollow.height - 4, rng);
    let has_lamp = rng.random_bool(0.4);
    for middle in grid(&draft.room(room).polygon, [pitch; 2], side + 16) {
        let change = Change::Ceiling(hollow, 0);
        draft.decorate(Host::Room(room), Rect::around(middle, [side; 2]).polygon(), change);
        if has_lamp {
            let change = Change::Ceiling(lamp, 32);
            draft.decorate(Host::Room(room), Rect::around(middle, [24; 2]).polygon(), change);
        }
    }
}

/// Middles of a grid whose squares of a side lie in a polygon.
fn grid(polygon: &Polygon, pitch: [i32; 2], side: i32) -> Vec<[i32; 2]> {
    let [low, high] = bounds(polygon);
    let counts = [0, 1].map(|axis| (high[axis] - low[axis]) / pitch[axis]);
    let first = [0, 1].map(|axis| (low[axis] + high[axis] - (counts[axis] - 1) * pitch[axis]) / 2);
    let all = (0..counts[1]).flat_map(|row| (0..counts[0]).map(move |column| [column, row]));
    let middles = all.map(|at| [0, 1].map(|axis| first[axis] + at[axis] * pitch[axis]));
    let is_inside = |middle: &[i32; 2]| {
        let square = Rect::around(*middle, [side; 2]).polygon();
        square.iter().all(|corner| contains(polygon, corner.map(f64::from)))
    };
    middles.filter(is_inside).collect()
}

/// Beams across the shorter extent, from wall to wall.
fn beams(draft: &mut Draft, room: usize, rng: &mut Rng) {
    let air = draft.room(room).air;
    let height = air.ceiling.height - rng.random_range(1..=3) * 8;
    if height < LOWEST_CEILING {
        return;
    }
    let width = *[16, 16, 24, 32].choose(rng).unwrap_or(&16);
    let pitch = *[96, 128, 128, 192].choose(rng).unwrap_or(&128);
    let polygon = draft.room(room).polygon.clone();
    let [low, high] = bounds(&polygon);
    let axis = usize::from(high[0] - low[0] > high[1] - low[1]);
    let across = 1 - axis;
    let count = (high[across] - low[across]) / pitch;
    let first = (low[across] + high[across] - (count - 1) * pitch - width) / 2;
    let beam = Change::Ceiling(draft.theme.trim(height, air.ceiling.flat), -16);
    for at in (0..count).map(|n| first + n * pitch) {
        let [near, far] = [at, at + width].map(|c| spans_along(&polygon, axis, f64::from(c) + 0.5));
        for (near, far) in near.iter().zip(&far) {
            // Ends that follow an oblique wall; a beam along a corner would not.
            if near.iter().zip(far).any(|(p, q)| (p - q).abs() > f64::from(2 * width)) {
                continue;
            }
            let corners =
                [(near[0] - 4.0, at), (far[0] - 4.0, at + width), (far[1] + 4.0, at + width), (near[1] + 4.0, at)];
            let outline = corners.map(|(along, c)| {
                let mut corner = [along.round() as i32; 2];
                corner[across] = c;
                corner
            });
            draft.decorate(Host::Room(room), outline.to_vec(), beam);
        }
    }
}

/// The middle of the floor sunk or raised, with a rim.
fn floor(draft: &mut Draft, room: usize, rng: &mut Rng) {
    let air = draft.room(room).air;
    let limit = |height: i32| height.clamp(-24, 24);
    let first = f64::from(rng.random_range(3..=6) * 8);
    let cut = f64::from(rng.random_range(1..=4) * 16);
    let step = *[-8, -8, -8, 8].choose(rng).unwrap_or(&-8);
    let has_rim = rng.random_bool(0.6);
    let inner = draft.theme.inset(limit(air.floor.height + 2 * step), rng);
    let rim = draft.theme.trim(limit(air.floor.height + step), air.floor.flat);
    let steps = if has_rim { vec![(first, rim), (first + 16.0, inner)] } else { vec![(first, inner)] };
    for (distance, surface) in steps {
        let Some(outline) = inset(&draft.room(room).polygon, distance, 64.0) else { return };
        // Twice bevelled is nearly round.
        let outline = bevelled(&bevelled(&outline, cut), cut / 3.0);
        draft.decorate(Host::Room(room), outline, Change::Floor(surface));
    }
}

/// A lintel and a sill in the middle of a door in a thick wall.
fn threshold(draft: &mut Draft, passage: usize, rect: Rect) {
    let axis = usize::from(rect.size()[1] < rect.size()[0]);
    let mut strip = rect;
    strip.low[axis] += OVERLAP + 8;
    strip.high[axis] -= OVERLAP + 8;
    let air = draft.passages[passage].air;
    if strip.size()[axis] < 8 || air.ceiling.height - 8 < LOWEST_CEILING {
        return;
    }
    let lintel = draft.theme.trim(air.ceiling.height - 8, air.ceiling.flat);
    draft.decorate(Host::Passage(passage), strip.polygon(), Change::Ceiling(lintel, -16));
}

/// Ribs and lamps under the ceiling of a corridor.
fn ribs(draft: &mut Draft, passage: usize, rect: Rect, rng: &mut Rng) {
    let air = draft.passages[passage].air;
    let height = air.ceiling.height - 8;
    let axis = usize::from(rect.size()[0] < rect.size()[1]);
    let (length, width) = (rect.size()[axis], rect.size()[1 - axis]);
    let pitch = *[64, 96, 128].choose(rng).unwrap_or(&96);
    if height < LOWEST_CEILING || width > 256 {
        return;
    }
    let rib = Change::Ceiling(draft.theme.trim(height, air.ceiling.flat), -16);
    let lamp = Change::Ceiling(draft.theme.lamp(air.ceiling.height + 8, rng), 48);
    let count = length / pitch;
    let middle = [0, 1].map(|axis| (rect.low[axis] + rect.high[axis]) / 2);
    for n in 0..count {
        let mut at = middle;
        at[axis] += pitch * (2 * n + 1 - count) / 2;
        let mut size = [width; 2];
        size[axis] = 16;
        draft.decorate(Host::Passage(passage), Rect::around(at, size).polygon(), rib);
        at[axis] += pitch / 2;
        draft.decorate(Host::Passage(passage), Rect::around(at, [24; 2]).polygon(), lamp);
    }
}
