//! Triangles in the image: which columns of a row lie inside, and how deep.

use super::pyramid::TILE;
use super::view::Extent;
use super::{high, low};
use crate::sensor::Camera;
use std::hint::black_box;

/// Rows whose spans are found at once: those of a tile.
pub(super) const ROWS: usize = TILE;

/// One boundary of a triangle, for finding the columns inside it row by row.
///
/// Inside is where `a·x + b·y + c ≥ 0`, pixels from the image's centre, so a row crosses it at `(b·y + c) · k` with
/// `k = -1/a`. An edge and its opposite cross at the same bits: between two triangles no pixel is lost.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Edge {
    pub(super) b: f32,
    pub(super) c: f32,
    pub(super) k: f32,
    /// Added to the crossing where it bounds from the left: 0 or, if it does not, a large negative number.
    pub(super) from_left: f32,
    /// Added to the crossing where it bounds from the right.
    pub(super) from_right: f32,
}

/// A slope, as a share of the other coefficients, too small to divide by: such an edge bounds rows as a whole. Crossings
/// stay below 10²⁴ then, and unless a row lies on the edge, above 10¹¹.
const LEVEL: f32 = 1e-20;

/// More than any crossing.
const FAR_OUT: f32 = 1e38;

impl Edge {
    #[inline(always)]
    pub(super) fn new(a: f32, b: f32, c: f32) -> Self {
        let slope = LEVEL * (b.abs() + c.abs()) + f32::MIN_POSITIVE;
        let level = a.abs() < slope;
        let a = if level { slope } else { a };
        // A level edge bounds from the left: rows outside cross it far to the right, rows inside far to the left, and
        // the row that it lies on, which belongs inside, at 0: that one is moved out of the image.
        let from_left = if level {
            -1e9
        } else if a > 0.0 {
            0.0
        } else {
            -FAR_OUT
        };
        let from_right = if a > 0.0 { FAR_OUT } else { 0.0 };
        Self { b, c, k: -1.0 / a, from_left, from_right }
    }

    #[inline(always)]
    fn cross(&self, y: f32) -> f32 {
        (self.b * y + self.c) * self.k
    }
}

/// 1/depth over the image: `x·dx + y·dy + at`, pixels from the image's centre.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Inverse {
    pub(super) x: f32,
    pub(super) y: f32,
    pub(super) at: f32,
}

/// A triangle, ready to be drawn.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Triangle {
    pub(super) edges: [Edge; 3],
    pub(super) inverse: Inverse,
    /// Pixels that it may cover, and its largest 1/depth.
    pub(super) extent: Extent,
    /// Whether a part of it may lie before the near plane.
    pub(super) near: bool,
}

/// Where a triangle lies in a few rows.
pub(super) struct Spans {
    /// First column inside, from the image's centre. Where there is none, it lies beyond the last.
    pub(super) left: [f32; ROWS],
    /// Last column inside.
    pub(super) right: [f32; ROWS],
    /// 1/depth where the row meets the image's vertical axis.
    pub(super) along: [f32; ROWS],
}

impl Spans {
    /// For rows from `top`; `border` is the last column of the image. Both from its centre.
    #[inline(always)]
    pub(super) fn new(triangle: &Triangle, top: f32, border: f32) -> Self {
        let mut spans = Self { left: [0.0; ROWS], right: [0.0; ROWS], along: [0.0; ROWS] };
        let [e0, e1, e2] = &triangle.edges;
        let inverse = &triangle.inverse;
        for i in 0..ROWS {
            let y = top + i as f32;
            let (t0, t1, t2) = (e0.cross(y), e1.cross(y), e2.cross(y));
            spans.left[i] = high(high(t0 + e0.from_left, t1 + e1.from_left), t2 + e2.from_left);
            spans.right[i] = low(low(t0 + e0.from_right, t1 + e1.from_right), low(t2 + e2.from_right, border));
            spans.along[i] = inverse.y * y + inverse.at;
        }
        if triangle.near {
            // The near plane is one more edge: where 1/depth is too large.
            let edge = Edge::new(-inverse.x, -inverse.y, 1.0 / Camera::NEAR - inverse.at);
            for i in 0..ROWS {
                let t = edge.cross(top + i as f32);
                spans.left[i] = high(spans.left[i], t + edge.from_left);
                spans.right[i] = low(spans.right[i], t + edge.from_right);
            }
        }
        spans
    }

    /// The first and the last column inside in any row; the first lies beyond the last if there is none.
    #[inline(always)]
    pub(super) fn bounds(&self) -> [f32; 2] {
        let (mut left, mut right) = ([0.0; ROWS], [0.0; ROWS]);
        for i in 0..ROWS {
            let empty = self.left[i] > self.right[i];
            left[i] = if empty { FAR_OUT } else { self.left[i] };
            right[i] = if empty { FAR_OUT } else { -self.right[i] };
        }
        [smallest(left), -smallest(right)]
    }

    /// A bound on 1/depth in these rows, over the columns from `first` to `last`.
    ///
    /// Rounding keeps products and sums monotonic, so the value at a corner bounds all pixels exactly.
    #[inline(always)]
    pub(super) fn nearest(&self, inverse: &Inverse, first: f32, last: f32) -> f32 {
        let x = if inverse.x > 0.0 { last } else { first };
        inverse.x * x + if inverse.y > 0.0 { self.along[ROWS - 1] } else { self.along[0] }
    }
}

/// The smallest number for a row or a column of a tile.
#[inline(always)]
pub(super) fn smallest(values: [f32; TILE]) -> f32 {
    // Through memory: the compiler would otherwise shape the loop that made the values after the order of comparisons
    // here, and that loop is the one that counts.
    let values = black_box(values);
    let halves: [f32; TILE / 2] = std::array::from_fn(|i| low(values[i], values[i + TILE / 2]));
    low(low(halves[0], halves[2]), low(halves[1], halves[3]))
}
