//! A mesh looked at from above: what a plumb line meets at each place of the plan.

use glam::Vec3;
use nbp_env::scene::RayIndex;
use rayon::prelude::*;

/// What plumb lines on a square grid meet.
pub(super) struct Columns {
    /// Distance of the lines.
    pub(super) cell: f32,
    pub(super) columns: Vec<Column>,
}

/// One line.
pub(super) struct Column {
    pub(super) x: f32,
    pub(super) z: f32,
    /// Heights of the surfaces, ascending.
    pub(super) heights: Vec<f32>,
}

impl Columns {
    /// At most `side` lines along the longer side of a box.
    pub(super) fn of(rays: &RayIndex, bounds: [Vec3; 2], side: usize) -> Self {
        let [low, high] = bounds;
        let size = high - low;
        let cell = size.x.max(size.z) / side as f32;
        let count = |length: f32| (length / cell).ceil().clamp(1.0, side as f32) as usize;
        let (columns, rows) = (count(size.x), count(size.z));
        let below = low.y - 0.01 * size.max_element();
        let one = |at: usize| {
            // Not quite the middle: walls often stand there.
            let [x, z] = [(at / rows) as f32 + 0.47, (at % rows) as f32 + 0.53];
            let (x, z) = (low.x + x * size.x / columns as f32, low.z + z * size.z / rows as f32);
            let up = rays.crossings(Vec3::new(x, below, z), Vec3::Y);
            Column { x, z, heights: up.into_iter().map(|t| below + t).collect() }
        };
        Self { cell, columns: (0..columns * rows).into_par_iter().map(one).collect() }
    }

    /// Median over the lines of the largest free height between two surfaces; `None` where no line meets two.
    pub(super) fn room_height(&self) -> Option<f32> {
        let gap = |column: &Column| column.heights.windows(2).map(|pair| pair[1] - pair[0]).max_by(f32::total_cmp);
        median(self.columns.iter().filter_map(gap).collect())
    }
}

pub(super) fn median(mut values: Vec<f32>) -> Option<f32> {
    values.sort_unstable_by(f32::total_cmp);
    values.get(values.len() / 2).copied()
}
