//! Rooms on a lattice of 128 map units.

use super::outline::{Polygon, area};
use super::shape::Shape;
use super::theme::{Air, Theme};
use nbp_env::Rng;
use rand::RngExt as _;
use rand::seq::IndexedRandom as _;

/// Side of a lattice cell, map units.
pub(crate) const BLOCK: i32 = 128;

/// Shapes that find no place before a site counts as full.
const MAX_SHAPES: usize = 60;

/// Places tried for a shape.
const PLACES: usize = 60;

/// A room.
#[derive(Clone, Debug)]
pub(crate) struct Room {
    /// Outline of its air.
    pub(crate) polygon: Polygon,
    /// Lattice cells that belong to it.
    pub(crate) blocks: Vec<[i32; 2]>,
    /// What is in it.
    pub(crate) air: Air,
}

/// Who has a lattice cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Owner {
    /// Nobody.
    Nobody,
    /// The room with this number.
    Room(usize),
    /// A corridor.
    Corridor,
}

/// The lattice of a map under construction.
#[derive(Clone, Debug)]
pub(crate) struct Site {
    /// Lattice cells along `x` and `y`.
    pub(crate) size: [i32; 2],
    owners: Vec<Owner>,
    /// Rooms so far.
    pub(crate) rooms: Vec<Room>,
}

/// How rooms are drawn.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RoomStyle {
    /// Median side, lattice cells.
    pub(crate) side: f64,
    /// Standard deviation of the logarithm of the side.
    pub(crate) spread: f64,
    /// Share of closets, one or two lattice cells a side.
    pub(crate) closets: f64,
    /// Share of long rooms, one or two lattice cells broad, among the others.
    pub(crate) halls: f64,
    /// Share of chamfered, octagonal and turned rooms among those that are no closets.
    pub(crate) oblique: f64,
    /// Largest side, lattice cells.
    pub(crate) largest: i32,
    /// Probabilities of 0, 1, 2, 3 empty lattice cells between a new room and the one it is placed at.
    pub(crate) gaps: [f64; 4],
    /// Probability that a room is placed at the newest one rather than at any.
    pub(crate) sprawl: f64,
}

impl Site {
    /// An empty site.
    pub(crate) fn new(size: [i32; 2]) -> Self {
        Self { size, owners: vec![Owner::Nobody; (size[0] * size[1]).max(0) as usize], rooms: Vec::new() }
    }

    /// Who has a lattice cell; `None` outside.
    pub(crate) fn owner(&self, [x, y]: [i32; 2]) -> Option<Owner> {
        let inside = (0..self.size[0]).contains(&x) && (0..self.size[1]).contains(&y);
        inside.then(|| self.owners[(y * self.size[0] + x) as usize])
    }

    /// Gives a lattice cell of the site away.
    pub(crate) fn claim(&mut self, [x, y]: [i32; 2], owner: Owner) {
        if self.owner([x, y]).is_some() {
            self.owners[(y * self.size[0] + x) as usize] = owner;
        }
    }

    /// Places rooms until their floors reach `target` square map units or no place is found any more.
    pub(crate) fn place_rooms(&mut self, target: f64, style: &RoomStyle, theme: &Theme, rng: &mut Rng) {
        let mut built = 0.0;
        let mut failures = 0;
        while built < target && failures < MAX_SHAPES {
            let shape = Shape::draw(style, rng);
            let floor_area = area(&shape.polygon);
            if built + 0.5 * floor_area > target {
                failures += 1;
                continue;
            }
            // Many places for a shape before the next: otherwise small rooms, which fit more easily, would take over.
            match (0..PLACES).find_map(|_| self.free_place(&shape, style, rng)) {
                Some(at) => {
                    built += floor_area;
                    self.add_room(&shape, at, theme, rng);
                }
                None => failures += 1,
            }
        }
    }

    /// A random place, if the shape's cells are free there.
    fn free_place(&self, shape: &Shape, style: &RoomStyle, rng: &mut Rng) -> Option<[i32; 2]> {
        let at = self.draw_place(shape.size, style, rng);
        let is_free = |b: &[i32; 2]| self.owner([b[0] + at[0], b[1] + at[1]]) == Some(Owner::Nobody);
        shape.blocks.iter().all(is_free).then_some(at)
    }

    fn add_room(&mut self, shape: &Shape, at: [i32; 2], theme: &Theme, rng: &mut Rng) {
        let blocks: Vec<[i32; 2]> = shape.blocks.iter().map(|b| [b[0] + at[0], b[1] + at[1]]).collect();
        let number = self.rooms.len();
        blocks.iter().for_each(|&b| self.claim(b, Owner::Room(number)));
        let polygon = shape.polygon.iter().map(|p| [p[0] + at[0] * BLOCK, p[1] + at[1] * BLOCK]).collect();
        let (floor, ceiling) = draw_heights(rng);
        self.rooms.push(Room { polygon, blocks, air: theme.room(floor, ceiling, rng) });
    }

    /// A place beside a room that exists, or the middle for the first.
    fn draw_place(&self, size: [i32; 2], style: &RoomStyle, rng: &mut Rng) -> [i32; 2] {
        let newest = self.rooms.last().filter(|_| rng.random_bool(style.sprawl));
        let Some(host) = newest.or_else(|| self.rooms.choose(rng)) else {
            return [0, 1].map(|axis| (self.size[axis] - size[axis]) / 2);
        };
        let [mut low, mut high] = [[i32::MAX; 2], [i32::MIN; 2]];
        for block in &host.blocks {
            for axis in 0..2 {
                low[axis] = low[axis].min(block[axis]);
                high[axis] = high[axis].max(block[axis] + 1);
            }
        }
        let gap = draw_index(&style.gaps, rng) as i32;
        let axis = rng.random_range(0..2_usize);
        let along = 1 - axis;
        let mut at = [0; 2];
        at[axis] = if rng.random() { high[axis] + gap } else { low[axis] - gap - size[axis] };
        at[along] = rng.random_range(low[along] - size[along] + 1..high[along]);
        at
    }
}

/// Floor and ceiling of a room: six floors in ten at the modal height, ceilings 96–384 above it (10th, 50th and 90th
/// percentile near 120, 180 and 300).
fn draw_heights(rng: &mut Rng) -> (i32, i32) {
    let floor = if rng.random_bool(0.6) { 0 } else { *[-24, -16, -8, 8, 16, 24].choose(rng).unwrap_or(&0) };
    let height = (180.0_f64.ln() + 0.36 * normal(rng)).exp();
    (floor, ((height / 8.0).round() as i32 * 8).clamp(96, 384))
}

/// A standard normal number.
pub(crate) fn normal(rng: &mut Rng) -> f64 {
    let (u, v): (f64, f64) = (rng.random(), rng.random());
    (-2.0 * (1.0 - u).ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

/// An index with the given weights.
pub(crate) fn draw_index(weights: &[f64], rng: &mut Rng) -> usize {
    let mut left = rng.random::<f64>() * weights.iter().sum::<f64>();
    for (index, weight) in weights.iter().enumerate() {
        left -= weight;
        if left < 0.0 {
            return index;
        }
    }
    weights.len().saturating_sub(1)
}
