//! Doors and windows that bring the navigation complexity down to a target.

use super::draft::Draft;
use super::links::{draw_width, lintel};
use super::raster::{CELL, Cover, Rect};
use crate::convert::LATTICE_PHASE;
use crate::doom_map::LATTICE_UNITS;
use crate::navigation::{Distances, Navigation};
use nbp_env::Rng;
use rand::RngExt as _;

/// Pairs farther apart than this many lattice steps along an axis never set the complexity of a map.
const NEAR: i32 = 5;

/// An opening may bridge this many lattice steps.
const LONGEST_OPENING: i32 = 3;

/// Walls up to this thick get windows, map units.
const WINDOW_WALL: i32 = 80;

/// Openings in a map.
const MAX_OPENINGS: usize = 150;

/// Opens walls between the pair of positions with the largest ratio until all ratios are at or under `target`. Returns
/// the largest ratio left among near pairs.
pub(crate) fn reduce(draft: &mut Draft, target: f64, rng: &mut Rng) -> f64 {
    let lattice = navigation(draft);
    let mut distances = lattice.distances();
    for _ in 0..MAX_OPENINGS {
        let pairs = near_pairs(&lattice, &distances, target);
        let Some(&worst) = pairs.first() else { break };
        // The worst pair may lie across a corner: then the worst straight pair beside it is opened.
        let straight = |pair: &&Pair| {
            let [dx, dy] = pair.offset();
            (dx == 0 || dy == 0) && dx.abs().max(dy.abs()) <= LONGEST_OPENING
        };
        let beside = |pair: &&Pair| (0..2).all(|axis| (pair.nodes[0][axis] - worst.nodes[0][axis]).abs() <= 3);
        let near_first = pairs.iter().filter(straight).filter(beside).chain(pairs.iter().filter(straight));
        let mut tried = near_first.take(60);
        if !tried.any(|pair| open(draft, &lattice, &mut distances, pair, rng)) {
            break;
        }
    }
    near_pairs(&lattice, &distances, 1.0).first().map_or(1.0, |pair| pair.ratio)
}

/// The lattice that the converter will use, on the raster.
pub(crate) fn navigation(draft: &Draft) -> Navigation {
    let size = draft.raster.size();
    let count = size.map(|s| (f64::from(s) / LATTICE_UNITS) as i32 + 1);
    let all = (0..count[0]).flat_map(|i| (0..count[1]).map(move |k| [i, k]));
    let nodes = all.filter(|&node| {
        let [x, y] = position(node);
        draft.raster.at(x, y) == Cover::Free
    });
    Navigation::new(nodes.collect(), |a, b| is_clear(draft, a, b))
}

/// Map units of a node.
fn position(node: [i32; 2]) -> [f64; 2] {
    [0, 1].map(|axis| LATTICE_PHASE[axis] + LATTICE_UNITS * f64::from(node[axis]))
}

/// Whether the straight way between two nodes of a row or column is free.
fn is_clear(draft: &Draft, a: [i32; 2], b: [i32; 2]) -> bool {
    let [p, q] = [position(a), position(b)];
    let steps = ((q[0] - p[0]).abs().max((q[1] - p[1]).abs()) / (f64::from(CELL) / 2.0)).ceil() as i32;
    (0..=steps).all(|step| {
        let t = f64::from(step) / f64::from(steps.max(1));
        draft.raster.at(p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1])) == Cover::Free
    })
}

#[derive(Clone, Copy, Debug)]
struct Pair {
    nodes: [[i32; 2]; 2],
    numbers: [u32; 2],
    ratio: f64,
}

impl Pair {
    fn offset(&self) -> [i32; 2] {
        [0, 1].map(|axis| self.nodes[1][axis] - self.nodes[0][axis])
    }
}

/// Pairs with a ratio over `least`, the largest first.
fn near_pairs(lattice: &Navigation, distances: &Distances, least: f64) -> Vec<Pair> {
    let offsets: Vec<[i32; 2]> =
        (0..=NEAR).flat_map(|dx| (-NEAR..=NEAR).map(move |dy| [dx, dy])).filter(|&[dx, dy]| dx > 0 || dy > 0).collect();
    let mut pairs = Vec::new();
    for (number, &node) in lattice.nodes().iter().enumerate() {
        for offset in &offsets {
            let other = [node[0] + offset[0], node[1] + offset[1]];
            let Some(far) = lattice.number(other) else { continue };
            let Some(steps) = distances.between(number as u32, far) else { continue };
            let ratio = f64::from(steps) / f64::from(offset[0].pow(2) + offset[1].pow(2)).sqrt();
            if ratio > least {
                pairs.push(Pair { nodes: [node, other], numbers: [number as u32, far], ratio });
            }
        }
    }
    pairs.sort_by(|a, b| b.ratio.total_cmp(&a.ratio).then(a.nodes.cmp(&b.nodes)));
    pairs
}

/// Carves a door or window between two nodes of a row or column, if the wall allows one.
fn open(draft: &mut Draft, lattice: &Navigation, distances: &mut Distances, pair: &Pair, rng: &mut Rng) -> bool {
    let offset = pair.offset();
    let axis = usize::from(offset[0] == 0);
    let length = offset[axis].abs();
    let [p, q] = pair.nodes.map(position);
    let middle = [0, 1].map(|axis| ((p[axis] + q[axis]) / 2.0 / f64::from(CELL)).round() as i32 * CELL);
    let reach = length * LATTICE_UNITS as i32 / 2 + 2 * CELL;
    let width = draw_width(128, rng);
    for (width, shift) in [(width, 0), (64, 0), (64, 16), (64, -16), (48, 0)] {
        let mut middle = middle;
        middle[1 - axis] += shift;
        let Some(rect) = draft.bridge(middle, axis, width, reach) else { continue };
        let is_window = rect.size()[axis] - 2 * CELL <= WINDOW_WALL && rng.random_bool(0.45);
        let (floor, ceiling) =
            if is_window { (rng.random_range(3..=6) * 8, rng.random_range(12..=16) * 8) } else { (0, lintel(rng)) };
        draft.carve(rect, draft.theme.frame(floor, ceiling));
        if is_clear(draft, pair.nodes[0], pair.nodes[1]) {
            distances.connect(pair.numbers[0], pair.numbers[1], length as u16);
            connect_around(draft, lattice, distances, rect);
            return true;
        }
        return false;
    }
    false
}

/// A wide opening may free the lattice lines beside the one it was made for.
fn connect_around(draft: &Draft, lattice: &Navigation, distances: &mut Distances, rect: Rect) {
    let around = rect.grown(LATTICE_UNITS as i32);
    let node_at = |corner: [i32; 2]| {
        [0, 1].map(|axis| ((f64::from(corner[axis]) - LATTICE_PHASE[axis]) / LATTICE_UNITS).floor() as i32)
    };
    let (low, high) = (node_at(around.low), node_at(around.high));
    for (i, k) in (low[0]..=high[0]).flat_map(|i| (low[1]..=high[1]).map(move |k| (i, k))) {
        for next in [[i + 1, k], [i, k + 1]] {
            let (Some(a), Some(b)) = (lattice.number([i, k]), lattice.number(next)) else { continue };
            if distances.between(a, b) != Some(1) && is_clear(draft, [i, k], next) {
                distances.connect(a, b, 1);
            }
        }
    }
}
