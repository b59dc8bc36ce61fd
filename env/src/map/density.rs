//! Points per pixel and horizontal layer on the world's pixel grid: the reconstruction as the network sees it (paper,
//! appendix B).

use super::grid::{WorldGrid, cell_of};
use crate::window::{Window, WindowSize};
use glam::Vec3;
use serde::{Deserialize, Serialize};

/// Horizontal layers, relative to the floor under the camera: what the agent knows without the building's height.
///
/// The paper cuts a predefined bounding box of the scene in four; the default four layers of 1 m hold the floor, what
/// stands on it, the camera plane and what hangs above doors.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Layers {
    /// Number of layers `K` (paper: 4).
    pub count: usize,
    /// Bottom of the lowest layer, metres above the floor.
    pub bottom: f32,
    /// Top of the highest layer, metres above the floor.
    pub top: f32,
}

impl Default for Layers {
    fn default() -> Self {
        Self { count: 4, bottom: -0.5, top: 3.5 }
    }
}

impl Layers {
    /// Layer of a height in metres, given that of the floor.
    pub fn layer(&self, y: f32, floor: f32) -> Option<usize> {
        let share = (y - floor - self.bottom) / (self.top - self.bottom);
        (0.0..1.0).contains(&share).then(|| (cell_of(share * self.count as f32) as usize).min(self.count - 1))
    }
}

/// Counts of kept points.
#[derive(Debug, Clone)]
pub struct DensityGrid {
    size: WindowSize,
    layers: Layers,
    floor: f32,
    counts: Vec<WorldGrid<u16>>,
}

impl DensityGrid {
    /// An empty grid for windows of `size` and a camera that moves at one height above a floor.
    pub fn new(size: WindowSize, layers: Layers, floor: f32) -> Self {
        Self { size, layers, floor, counts: vec![WorldGrid::default(); layers.count] }
    }

    /// Window size that the grid is made for.
    pub fn window_size(&self) -> WindowSize {
        self.size
    }

    /// Number of layers.
    pub fn layer_count(&self) -> usize {
        self.counts.len()
    }

    /// Memory that it holds, bytes.
    pub fn bytes(&self) -> usize {
        self.counts.iter().map(WorldGrid::bytes).sum()
    }

    /// Adds the points of a frame; counts saturate.
    pub fn add(&mut self, points: &[Vec3]) {
        let Some(&first) = points.first() else { return };
        let [low, high] = points.iter().fold([first, first], |[lo, hi], &p| [lo.min(p), hi.max(p)]);
        let (low, high) = (self.size.world_pixel(low), self.size.world_pixel(high));
        self.counts.iter_mut().for_each(|grid| grid.include(low, high));
        for &point in points {
            if let Some(layer) = self.layers.layer(point.y, self.floor)
                && let Some(count) = self.counts[layer].get_mut(self.size.world_pixel(point))
            {
                *count = count.saturating_add(1);
            }
        }
    }

    /// Points in any layer of a world pixel.
    pub fn total(&self, pixel: [i32; 2]) -> u32 {
        self.counts.iter().map(|grid| u32::from(grid.get(pixel))).sum()
    }

    /// Writes the window's `K · S · S` counts into `out`.
    pub fn crop(&self, window: &Window, out: &mut [u16]) {
        let side = window.size.pixels;
        out.fill(0);
        let (first, last) = (window.world_pixel(0, 0), window.world_pixel(side - 1, side - 1));
        for (grid, image) in self.counts.iter().zip(out.chunks_exact_mut(side * side)) {
            for (z, line) in (last[1]..=first[1]).rev().zip(image.chunks_exact_mut(side)) {
                let (start, counts) = grid.row(z, first[0], last[0]);
                line[(first[0] - start) as usize..][..counts.len()].copy_from_slice(counts);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn crop_of(points: &[Vec3], around: Vec3) -> Vec<u16> {
        let size = WindowSize { pixels: 32, metres: 20.0 };
        let mut grid = DensityGrid::new(size, Layers::default(), around.y - 1.65);
        grid.add(points);
        let mut out = vec![0; 4 * 32 * 32];
        grid.crop(&size.around(around), &mut out);
        out
    }

    #[test]
    fn points_land_in_their_pixel_and_layer() {
        let camera = Vec3::new(2.0, 1.65, 3.0);
        let out = crop_of(&[Vec3::new(7.0, 0.0, 3.0), Vec3::new(2.0, 2.0, 8.0), Vec3::new(2.0, 9.0, 3.0)], camera);
        let pixel = |layer: usize, row: usize, col: usize| out[(layer * 32 + row) * 32 + col];
        assert_eq!(pixel(0, 16, 8), 1, "+x is left");
        assert_eq!(pixel(2, 8, 16), 1, "+z is up");
        assert_eq!(out.iter().sum::<u16>(), 2, "above the layers");
    }

    proptest! {
        #[test]
        fn crops_do_not_depend_on_where_the_world_begins(
            points in prop::collection::vec((-9.0_f32..9.0, -0.4_f32..3.4, -9.0_f32..9.0), 1..50),
            shift in (-40_i32..40, -40_i32..40),
        ) {
            // Whole pixels, and points in the middle of theirs, so that rounding plays no part.
            let pixel = 20.0 / 32.0;
            let middle = |v: f32| ((v / pixel).floor() + 0.5) * pixel;
            let at = |dx: i32, dz: i32| -> Vec<Vec3> {
                let offset = Vec3::new(dx as f32, 0.0, dz as f32) * pixel;
                points.iter().map(|&(x, y, z)| Vec3::new(middle(x), y, middle(z)) + offset).collect()
            };
            let camera = |dx: i32, dz: i32| Vec3::new(dx as f32 + 0.5, 0.0, dz as f32 + 0.5) * pixel + 1.65 * Vec3::Y;
            prop_assert_eq!(crop_of(&at(0, 0), camera(0, 0)), crop_of(&at(shift.0, shift.1), camera(shift.0, shift.1)));
        }
    }
}
