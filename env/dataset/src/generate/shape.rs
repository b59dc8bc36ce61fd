//! Outlines of rooms: rectangles, L and T, chamfered, octagons, turned rectangles.

use super::outline::Polygon;
use super::rooms::{BLOCK, RoomStyle, draw_index, normal};
use nbp_env::Rng;
use rand::RngExt as _;
use rand::seq::IndexedRandom as _;

/// Weights of rectangles and L or T among rooms with right angles.
const STRAIGHT_SHAPES: [f64; 2] = [0.18, 0.82];

/// Weights of chamfered, octagonal and turned rooms among those with oblique walls.
const OBLIQUE_SHAPES: [f64; 3] = [0.46, 0.27, 0.27];

/// An outline and the lattice cells under it, at the origin.
pub(crate) struct Shape {
    /// Extent, lattice cells.
    pub(crate) size: [i32; 2],
    /// Lattice cells under it.
    pub(crate) blocks: Vec<[i32; 2]>,
    /// Map units, counter-clockwise.
    pub(crate) polygon: Polygon,
}

impl Shape {
    /// A closet, or a room of one of the shapes above.
    pub(crate) fn draw(style: &RoomStyle, rng: &mut Rng) -> Self {
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
        let size = if rng.random_bool(style.halls) { hall(size, rng) } else { size };
        let shape = match rng.random_bool(style.oblique) {
            true => STRAIGHT_SHAPES.len() + draw_index(&OBLIQUE_SHAPES, rng),
            false => draw_index(&STRAIGHT_SHAPES, rng),
        };
        match shape {
            1 => Self::corner_room(size.map(|s| s.max(3)), inset, rng),
            2 => {
                let longest = (size[0].min(size[1]) * BLOCK - 2 * inset) * 2 / 5 / 8;
                let cut = rng.random_range(longest.min(6)..=longest) * 8;
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

/// A long room instead of a broad one.
fn hall(size: [i32; 2], rng: &mut Rng) -> [i32; 2] {
    let mut hall = [rng.random_range(1..=2), size[0].max(size[1])];
    if rng.random() {
        hall.reverse();
    }
    hall
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
