//! The spanning tree of rooms: doors in shared walls, corridors elsewhere.

use super::draft::Draft;
use super::raster::Rect;
use super::rooms::{BLOCK, Owner, draw_index};
use crate::convert::LATTICE_PHASE;
use crate::doom_map::LATTICE_UNITS;
use nbp_env::Rng;
use rand::RngExt as _;
use rand::seq::{IndexedRandom as _, SliceRandom as _};
use std::collections::{BTreeMap, VecDeque};

const STEPS: [[i32; 2]; 4] = [[1, 0], [0, 1], [-1, 0], [0, -1]];

/// Corridors longer than this many lattice cells are only dug to reach a room that is left over.
const USUAL_CORRIDOR: usize = 5;

/// Share of shared walls that get an arch rather than a door, where there is room for one.
const ARCH_SHARE: f64 = 0.8;

/// Arches are wider than doors, map units.
const NARROWEST_ARCH: i32 = 160;

/// A way from a room to another: lattice cells, the first in the one and the last in the other.
#[derive(Clone, Debug)]
struct Way {
    to: usize,
    cells: Vec<[i32; 2]>,
}

/// Connects all rooms by a tree, grown depth-first with probability `depth_first`, else from a random room.
pub(crate) fn connect(draft: &mut Draft, depth_first: f64, rng: &mut Rng) {
    let count = draft.site.rooms.len();
    if count == 0 {
        return;
    }
    let mut is_linked = vec![false; count];
    let first = rng.random_range(0..count);
    is_linked[first] = true;
    let mut active = vec![first];
    while let Some(last) = active.len().checked_sub(1) {
        let pick = if rng.random_bool(depth_first) { last } else { rng.random_range(0..active.len()) };
        match link_once(draft, active[pick], &mut is_linked, USUAL_CORRIDOR, rng) {
            Some(room) => active.push(room),
            None => {
                active.remove(pick);
            }
        }
    }
    // Rooms that no short corridor reaches.
    for room in 0..count {
        if is_linked[room] && is_linked.contains(&false) {
            while link_once(draft, room, &mut is_linked, usize::MAX, rng).is_some() {}
        }
    }
}

/// Links one more room to `from` and names it.
fn link_once(draft: &mut Draft, from: usize, is_linked: &mut [bool], longest: usize, rng: &mut Rng) -> Option<usize> {
    let mut ways = ways_from(draft, from, is_linked, longest, rng);
    while !ways.is_empty() {
        let weights: Vec<f64> = ways.iter().map(|way| if way.cells.len() == 2 { 1.0 } else { 0.5 }).collect();
        let way = ways.swap_remove(draw_index(&weights, rng));
        let is_dug = if way.cells.len() == 2 { dig_door(draft, &way, rng) } else { dig_corridor(draft, &way, rng) };
        if is_dug {
            is_linked[way.to] = true;
            return Some(way.to);
        }
    }
    None
}

/// Ways from a room to rooms that are not linked yet: a few doors for each neighbour and one corridor for each other room.
fn ways_from(draft: &Draft, from: usize, is_linked: &[bool], longest: usize, rng: &mut Rng) -> Vec<Way> {
    let site = &draft.site;
    let mut doors: BTreeMap<usize, Vec<Way>> = BTreeMap::new();
    let mut corridors: BTreeMap<usize, Way> = BTreeMap::new();
    // Cell → the cell it was reached from, and its distance; the search starts on the room's own cells.
    let mut seen: BTreeMap<[i32; 2], ([i32; 2], usize)> = BTreeMap::new();
    let mut blocks = site.rooms[from].blocks.clone();
    blocks.shuffle(rng);
    // One order for the whole search: corridors turn seldom.
    let mut steps = STEPS;
    steps.shuffle(rng);
    let mut queue: VecDeque<[i32; 2]> = blocks.iter().copied().collect();
    seen.extend(blocks.iter().map(|&b| (b, (b, 0))));
    while let Some(cell) = queue.pop_front() {
        let distance = seen.get(&cell).map_or(0, |s| s.1);
        for step in steps {
            let next = [cell[0] + step[0], cell[1] + step[1]];
            match site.owner(next) {
                Some(Owner::Room(to)) if to != from && !is_linked[to] => {
                    if distance == 0 {
                        doors.entry(to).or_default().push(Way { to, cells: vec![cell, next] });
                    } else {
                        corridors.entry(to).or_insert_with(|| Way { to, cells: trace(&seen, cell, next) });
                    }
                }
                Some(Owner::Nobody | Owner::Corridor) if distance < longest && !seen.contains_key(&next) => {
                    seen.insert(next, (cell, distance + 1));
                    queue.push_back(next);
                }
                _ => {}
            }
        }
    }
    let mut ways: Vec<Way> = Vec::new();
    for (to, mut choice) in doors {
        corridors.remove(&to);
        choice.shuffle(rng);
        ways.extend(choice.into_iter().take(3));
    }
    ways.extend(corridors.into_values());
    ways
}

fn trace(seen: &BTreeMap<[i32; 2], ([i32; 2], usize)>, last: [i32; 2], goal: [i32; 2]) -> Vec<[i32; 2]> {
    let mut cells = vec![goal, last];
    let mut cell = last;
    while let Some(&(parent, distance)) = seen.get(&cell) {
        if distance == 0 {
            break;
        }
        cells.push(parent);
        cell = parent;
    }
    cells.reverse();
    cells
}

/// A door where two rooms share a wall, or a wide arch.
fn dig_door(draft: &mut Draft, way: &Way, rng: &mut Rng) -> bool {
    let [a, b] = [way.cells[0], way.cells[1]];
    let axis = usize::from(a[0] == b[0]);
    if rng.random_bool(ARCH_SHARE) && dig_arch(draft, a, b, axis, rng) {
        return true;
    }
    let width = draw_width(128, rng);
    let mut middle = centre(a);
    middle[axis] = a[axis].max(b[axis]) * BLOCK;
    let slack = (BLOCK - 16 - width).max(0) / 2 / 8;
    middle[1 - axis] += rng.random_range(-slack..=slack) * 8;
    middle[1 - axis] += shift_to_lattice(middle[1 - axis], width, 1 - axis);
    let Some(rect) = draft.bridge(middle, axis, width, reach_of(draft, a, b)) else { return false };
    let floor = meeting_floor(draft, a, b);
    draft.carve(rect, draft.theme.frame(floor, lintel(rng)));
    true
}

/// An opening along most of the wall that two rooms share, as high as a low room.
fn dig_arch(draft: &mut Draft, a: [i32; 2], b: [i32; 2], axis: usize, rng: &mut Rng) -> bool {
    let along = 1 - axis;
    let owners = [a, b].map(|cell| draft.site.owner(cell));
    let shared = |steps: i32| {
        [a, b].map(|mut cell| {
            cell[along] += steps;
            draft.site.owner(cell)
        }) == owners
    };
    let run = |sign: i32| (1..).find(|n| !shared(sign * n)).unwrap_or(1);
    let (low, high) = ((a[along] + 1 - run(-1)) * BLOCK, (a[along] + run(1)) * BLOCK);
    let mut middle = centre(a);
    middle[axis] = a[axis].max(b[axis]) * BLOCK;
    middle[along] = (low + high) / 2;
    let mut width = high - low - rng.random_range(2..=8) * 16;
    while width >= NARROWEST_ARCH {
        if let Some(rect) = draft.bridge(middle, axis, width, BLOCK) {
            let floor = meeting_floor(draft, a, b);
            draft.carve(rect, draft.theme.frame(floor, rng.random_range(12..=20) * 8));
            return true;
        }
        width -= 64;
    }
    false
}

/// A corridor along lattice cells.
fn dig_corridor(draft: &mut Draft, way: &Way, rng: &mut Rng) -> bool {
    let cells = &way.cells;
    let width = *[64, 80, 96, 112, 112, 112].choose(rng).unwrap_or(&96);
    let (Some(&first), Some(&last)) = (cells.first(), cells.last()) else { return false };
    let reach = reach_of(draft, first, last);
    let mut points: Vec<[i32; 2]> = cells.iter().map(|&cell| centre(cell)).collect();
    // Points of a run share the coordinate across it, so they all shift alike.
    for point in &mut points {
        for (axis, c) in point.iter_mut().enumerate() {
            *c += shift_to_lattice(*c, width, axis);
        }
    }
    let end = points.len() - 1;
    // The ends reach into the rooms as far as needed for the whole width to be free.
    for (end, inner) in [(0, 1), (end, end - 1)] {
        let axis = usize::from(points[end][0] == points[inner][0]);
        let sign = (points[end][axis] - points[inner][axis]).signum();
        let Some(ahead) = draft.free_ahead(points[inner], axis, sign, width, reach + BLOCK) else { return false };
        points[end] = points[inner];
        points[end][axis] += sign * ahead;
    }
    let floor = meeting_floor(draft, first, last);
    let ceiling = rng.random_range(12..=20) * 8;
    for [a, b] in runs(&points) {
        let axis = usize::from(a[0] == b[0]);
        let mut rect = Rect::spanning(a, b);
        rect.low[1 - axis] -= width / 2;
        rect.high[1 - axis] += width / 2;
        // Corners are square: both runs cover the turn.
        for (is_end, point) in [(a == points[0], a), (b == points[end], b)] {
            if !is_end {
                let corner = Rect::around(point, [width; 2]);
                rect.low[axis] = rect.low[axis].min(corner.low[axis]);
                rect.high[axis] = rect.high[axis].max(corner.high[axis]);
            }
        }
        draft.carve(rect, draft.theme.corridor(floor, ceiling));
    }
    for &cell in &cells[1..end] {
        draft.site.claim(cell, Owner::Corridor);
    }
    true
}

/// Longest straight pieces of a polyline with right angles.
fn runs(points: &[[i32; 2]]) -> Vec<[[i32; 2]; 2]> {
    let mut runs: Vec<[[i32; 2]; 2]> = Vec::new();
    for pair in points.windows(2) {
        let [a, b] = [pair[0], pair[1]];
        match runs.last_mut() {
            Some([start, end]) if (start[0] == b[0] && a[0] == b[0]) || (start[1] == b[1] && a[1] == b[1]) => *end = b,
            _ => runs.push([a, b]),
        }
    }
    runs
}

/// Width of an opening: 64 to `widest` in steps of 16, narrow ones more often.
pub(crate) fn draw_width(widest: i32, rng: &mut Rng) -> i32 {
    let choice = [64, 64, 80, 96, 96, 112, 128];
    choice.choose(rng).copied().unwrap_or(64).min(widest)
}

/// Shift, in multiples of 8 map units, of the middle of a passage so that a line of the camera lattice runs through it:
/// lattice lines are farther apart than narrow doors are wide.
fn shift_to_lattice(middle: i32, width: i32, axis: usize) -> i32 {
    let from_line = (f64::from(middle) - LATTICE_PHASE[axis] + LATTICE_UNITS / 2.0).rem_euclid(LATTICE_UNITS);
    let off = LATTICE_UNITS / 2.0 - from_line;
    let excess = (off.abs() - f64::from(width / 2 - 8)).max(0.0);
    (excess / 8.0).ceil().copysign(off) as i32 * 8
}

/// Height of a door's lintel above the modal floor: the camera plane, at 68.75, stays free.
pub(crate) fn lintel(rng: &mut Rng) -> i32 {
    rng.random_range(10..=14) * 8
}

/// Floor of a passage: half-way, so that a player can take both steps (24 map units at most).
fn meeting_floor(draft: &Draft, a: [i32; 2], b: [i32; 2]) -> i32 {
    let floor = |cell| match draft.site.owner(cell) {
        Some(Owner::Room(room)) => draft.room(room).air.floor.height,
        _ => 0,
    };
    (floor(a) + floor(b)) / 16 * 8
}

/// How far a passage may reach into the rooms at its ends: half of the larger one.
fn reach_of(draft: &Draft, a: [i32; 2], b: [i32; 2]) -> i32 {
    let size = |cell| match draft.site.owner(cell) {
        Some(Owner::Room(room)) => {
            let [low, high] = super::outline::bounds(&draft.site.rooms[room].polygon);
            (high[0] - low[0]).max(high[1] - low[1])
        }
        _ => 0,
    };
    size(a).max(size(b)) / 2
}

fn centre(cell: [i32; 2]) -> [i32; 2] {
    cell.map(|c| c * BLOCK + BLOCK / 2)
}
