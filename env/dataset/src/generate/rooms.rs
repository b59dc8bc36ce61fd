//! Rooms on a lattice of 128 map units (aimdoom.md, section 3, step 1).

use super::raster::{Polygon, area};
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
    /// Map units.
    pub(crate) floor: i32,
    /// Map units.
    pub(crate) ceiling: i32,
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
    /// Largest side, lattice cells.
    pub(crate) largest: i32,
    /// Probabilities of 0, 1, 2, 3 empty lattice cells between a new room and the one it is placed at.
    pub(crate) gaps: [f64; 4],
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
    pub(crate) fn place_rooms(&mut self, target: f64, style: &RoomStyle, rng: &mut Rng) {
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
                    self.add_room(&shape, at, rng);
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

    fn add_room(&mut self, shape: &Shape, at: [i32; 2], rng: &mut Rng) {
        let blocks: Vec<[i32; 2]> = shape.blocks.iter().map(|b| [b[0] + at[0], b[1] + at[1]]).collect();
        let number = self.rooms.len();
        blocks.iter().for_each(|&b| self.claim(b, Owner::Room(number)));
        let polygon = shape.polygon.iter().map(|p| [p[0] + at[0] * BLOCK, p[1] + at[1] * BLOCK]).collect();
        let (floor, ceiling) = draw_heights(rng);
        self.rooms.push(Room { polygon, blocks, floor, ceiling });
    }

    /// A place beside a room that exists, or the middle for the first.
    fn draw_place(&self, size: [i32; 2], style: &RoomStyle, rng: &mut Rng) -> [i32; 2] {
        let Some(host) = self.rooms.choose(rng) else {
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

/// An outline and the lattice cells under it, at the origin.
struct Shape {
    size: [i32; 2],
    blocks: Vec<[i32; 2]>,
    polygon: Polygon,
}

impl Shape {
    /// Rectangle 45 %, L or T 20 %, chamfered 15 %, octagon 10 %, rotated 10 %.
    fn draw(style: &RoomStyle, rng: &mut Rng) -> Self {
        // Half of the wall towards a neighbour.
        let inset = *[8, 8, 16, 16, 24].choose(rng).unwrap_or(&8);
        if rng.random_bool(style.closets) {
            let size = [0, 1].map(|_| rng.random_range(1..=2));
            return Self::whole(size, chamfered(size, inset, if rng.random_bool(0.3) { 24 } else { 0 }));
        }
        let mut side = || {
            let drawn = (style.side.ln() + style.spread * normal(rng)).exp().round() as i32;
            drawn.clamp(2, style.largest)
        };
        let size = [side(), side()];
        match draw_index(&[0.08, 0.36, 0.26, 0.15, 0.15], rng) {
            1 => Self::corner_room(size.map(|s| s.max(3)), inset, rng),
            2 => {
                let longest = (size[0].min(size[1]) * BLOCK - 2 * inset) * 2 / 5;
                let cut = rng.random_range(6..=(longest / 8).max(6)) * 8;
                Self::whole(size, chamfered(size, inset, cut))
            }
            3 => {
                let size = size.map(|s| s.max(3));
                let shorter = size[0].min(size[1]) * BLOCK - 2 * inset;
                // Near the regular octagon's 0.29 of the side.
                Self::whole(size, chamfered(size, inset, shorter * 29 / 100 / 8 * 8))
            }
            4 => {
                let size = size.map(|s| s.max(3));
                let angle = rng.random_range(15.0..75.0_f64).to_radians();
                Self::whole(size, rotated(size, inset, angle))
            }
            _ => Self::whole(size, chamfered(size, inset, 0)),
        }
    }

    fn whole(size: [i32; 2], polygon: Polygon) -> Self {
        Self { size, blocks: block_list(size, |_| true), polygon }
    }

    /// An L, or a T where two corners are missing.
    fn corner_room(size: [i32; 2], inset: i32, rng: &mut Rng) -> Self {
        let is_t = size[0] >= 4 && rng.random_bool(0.4);
        let missing_height = rng.random_range(1..size[1]);
        let widest = if is_t { (size[0] - 1) / 2 } else { size[0] - 1 };
        let missing_width = rng.random_range(1..=widest);
        let is_gone = |[x, y]: [i32; 2]| {
            y >= size[1] - missing_height && (x >= size[0] - missing_width || (is_t && x < missing_width))
        };
        let (right, top) = (size[0] * BLOCK - inset, size[1] * BLOCK - inset);
        let (step_x, step_y) = (right - missing_width * BLOCK, top - missing_height * BLOCK);
        let mut polygon = vec![[inset, inset], [right, inset], [right, step_y], [step_x, step_y], [step_x, top]];
        if is_t {
            let left = inset + missing_width * BLOCK;
            polygon.extend([[left, top], [left, step_y], [inset, step_y]]);
        } else {
            polygon.push([inset, top]);
        }
        let (flip_x, flip_y, turn) = (rng.random(), rng.random(), rng.random());
        let mut shape = Self { size, blocks: block_list(size, |b| !is_gone(b)), polygon };
        if flip_x {
            shape.mirror(0);
        }
        if flip_y {
            shape.mirror(1);
        }
        if turn {
            shape.transpose();
        }
        shape
    }

    fn mirror(&mut self, axis: usize) {
        let size = self.size[axis];
        self.blocks.iter_mut().for_each(|b| b[axis] = size - 1 - b[axis]);
        self.polygon.iter_mut().for_each(|p| p[axis] = size * BLOCK - p[axis]);
        self.polygon.reverse();
    }

    fn transpose(&mut self) {
        self.size.reverse();
        self.blocks.iter_mut().for_each(|b| b.reverse());
        self.polygon.iter_mut().for_each(|p| p.reverse());
        self.polygon.reverse();
    }
}

fn block_list(size: [i32; 2], keep: impl Fn([i32; 2]) -> bool) -> Vec<[i32; 2]> {
    (0..size[1]).flat_map(|y| (0..size[0]).map(move |x| [x, y])).filter(|&b| keep(b)).collect()
}

/// A rectangle whose corners are cut by `cut` map units; none are cut at 0.
fn chamfered(size: [i32; 2], inset: i32, cut: i32) -> Polygon {
    let (low, [right, top]) = (inset, size.map(|s| s * BLOCK - inset));
    if cut == 0 {
        return vec![[low, low], [right, low], [right, top], [low, top]];
    }
    vec![
        [low + cut, low],
        [right - cut, low],
        [right, low + cut],
        [right, top - cut],
        [right - cut, top],
        [low + cut, top],
        [low, top - cut],
        [low, low + cut],
    ]
}

/// The largest rectangle of the box's proportions that fits into it when turned.
fn rotated(size: [i32; 2], inset: i32, angle: f64) -> Polygon {
    let [width, height] = size.map(|s| f64::from(s * BLOCK - 2 * inset));
    let (sin, cos) = angle.sin_cos();
    let shrink = (width / (width * cos + height * sin)).min(height / (width * sin + height * cos));
    let [half_w, half_h] = [width * shrink / 2.0, height * shrink / 2.0];
    let middle = size.map(|s| f64::from(s * BLOCK) / 2.0);
    [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]
        .map(|[u, v]: [f64; 2]| {
            let (x, y) = (u * half_w, v * half_h);
            [middle[0] + x * cos - y * sin, middle[1] + x * sin + y * cos].map(|c| c.round() as i32)
        })
        .to_vec()
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
