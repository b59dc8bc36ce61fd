//! Known, free and occupied cells of the camera plane, carved by the depth image's horizon: a planar range scan.
//!
//! The lattice agent moves in the plane of its camera, so only what stands in that plane can stop it; the rows of the
//! image next to the horizon measure exactly that.

use super::grid::{WorldGrid, cell_of, cells_between};
use crate::pose::Pose;
use crate::sensor::{Camera, Frame};
use crate::window::Window;
use glam::Vec3;

/// What is known of a cell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Cell {
    /// Never on a ray.
    #[default]
    Unknown,
    /// Crossed by a ray and never hit.
    Free,
    /// Hit at least once.
    Occupied,
}

/// Side of a cell, metres.
pub const CELL: f32 = 0.15;

/// The grid.
#[derive(Debug, Clone, Default)]
pub struct OccupancyGrid {
    cells: WorldGrid<Cell>,
}

impl OccupancyGrid {
    /// Cell of a position.
    pub fn cell_of(position: Vec3) -> [i32; 2] {
        [cell_of(position.x / CELL), cell_of(position.z / CELL)]
    }

    /// Middle of a cell, at height zero.
    pub fn middle(cell: [i32; 2]) -> Vec3 {
        Vec3::new(cell[0] as f32 + 0.5, 0.0, cell[1] as f32 + 0.5) * CELL
    }

    /// What is known of a cell.
    pub fn get(&self, cell: [i32; 2]) -> Cell {
        self.cells.get(cell)
    }

    /// Lowest cell and number of cells along `x` and `z`.
    pub fn extent(&self) -> ([i32; 2], [usize; 2]) {
        self.cells.extent()
    }

    /// Number of cells that something is known of.
    pub fn known(&self) -> usize {
        self.cells.count(|&cell| cell != Cell::Unknown)
    }

    /// Counts the free and the occupied cells whose middles lie in each pixel of a window, `S · S` each.
    pub fn crop(&self, window: &Window, free: &mut [u16], occupied: &mut [u16]) {
        let side = window.size.pixels;
        let (low, shape) = self.cells.extent();
        let columns: Vec<Option<usize>> = (0..shape[0] as i32)
            .map(|n| {
                let x = Self::middle([low[0] + n, 0]);
                window.pixel_of([window.size.world_pixel(x)[0], window.centre[1]]).map(|(_, col)| col)
            })
            .collect();
        for z in low[1]..low[1] + shape[1] as i32 {
            let pixel = window.size.world_pixel(Self::middle([0, z]));
            let Some((row, _)) = window.pixel_of([window.centre[0], pixel[1]]) else { continue };
            let (first, cells) = self.cells.row(z, low[0] + shape[0] as i32 - 1, low[0]);
            for (x, &cell) in (low[0]..=first).rev().zip(cells) {
                let Some(col) = columns[(x - low[0]) as usize] else { continue };
                let count = match cell {
                    Cell::Unknown => continue,
                    Cell::Free => &mut free[row * side + col],
                    Cell::Occupied => &mut occupied[row * side + col],
                };
                *count = count.saturating_add(1);
            }
        }
    }

    /// Memory that it holds, bytes.
    pub fn bytes(&self) -> usize {
        self.cells.bytes()
    }

    /// Carves the rays of one frame.
    pub fn carve(&mut self, camera: &Camera, pose: &Pose, frame: &Frame) {
        let (eye, row) = (camera.at(pose), frame.height / 2);
        let mut hits = Vec::with_capacity(frame.width);
        let [mut low, mut high] = [pose.position, pose.position];
        for col in 0..frame.width {
            let depth = frame.depth[row * frame.width + col];
            if depth > 0.0 && depth.is_finite() {
                let hit = eye.unproject(col, row, depth);
                // A surface on the border of two cells belongs to the farther one.
                let hit = hit + 0.02 * (hit - pose.position).normalize_or_zero();
                low = low.min(hit);
                high = high.max(hit);
                hits.push(hit);
            }
        }
        self.cells.include(Self::cell_of(low), Self::cell_of(high));
        for &hit in &hits {
            self.cells.change_between(pose.position, hit, CELL, |state| {
                *state = if *state == Cell::Unknown { Cell::Free } else { *state };
            });
        }
        // Hits last: a ray that grazes a wall must not erase it.
        for hit in hits {
            if let Some(state) = self.cells.get_mut(Self::cell_of(hit)) {
                *state = Cell::Occupied;
            }
        }
    }

    /// Whether a wall was seen between two positions. The cells of the positions themselves do not count: one can stand
    /// closer to a wall than a cell is wide.
    pub fn is_wall_between(&self, a: Vec3, b: Vec3) -> bool {
        let ends = [Self::cell_of(a), Self::cell_of(b)];
        cells_between(a, b, CELL).any(|cell| self.get(cell) == Cell::Occupied && !ends.contains(&cell))
    }
}
