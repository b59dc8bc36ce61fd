//! The square, agent-centred, north-up image that the network sees and answers in.
//!
//! Axes, for every image of the project: seen from above, `row` grows towards `-z` and `col` towards `-x` (so `+z` is up
//! and `+x` left), which is the released code's layout: its weights work unchanged. There is no rotation to the heading.
//! The world is cut into a fixed grid of pixels, and a window is a crop of it: the agent's pixel is `(S/2, S/2)`, so the
//! window's centre is off by at most half a pixel, the same for inputs, obstacle maps and labels.

use crate::map::grid::cell_of;
use glam::Vec3;
use serde::{Deserialize, Serialize};

/// Pixels of the input for each cell of the value map, along each axis.
pub const VALUE_STRIDE: usize = 4;

/// Size and range of a window (paper: 256 pixels over 40 m).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WindowSize {
    /// Side in pixels, a multiple of 16.
    pub pixels: usize,
    /// Side in metres.
    pub metres: f32,
}

impl Default for WindowSize {
    fn default() -> Self {
        Self { pixels: 256, metres: 40.0 }
    }
}

impl WindowSize {
    /// Side of a pixel, metres.
    pub fn pixel(&self) -> f32 {
        self.metres / self.pixels as f32
    }

    /// The world pixel, `[x, z]`, of a position.
    pub fn world_pixel(&self, position: Vec3) -> [i32; 2] {
        [cell_of(position.x / self.pixel()), cell_of(position.z / self.pixel())]
    }

    /// The window around a position.
    pub fn around(&self, position: Vec3) -> Window {
        Window { size: *self, centre: self.world_pixel(position), height: position.y }
    }
}

/// A window at a place of the world.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Window {
    /// Size and range.
    pub size: WindowSize,
    /// World pixel `[x, z]` shown at `(S/2, S/2)`.
    pub centre: [i32; 2],
    /// Camera plane, metres.
    pub height: f32,
}

impl Window {
    /// World pixel shown at `(row, col)`.
    pub fn world_pixel(&self, row: usize, col: usize) -> [i32; 2] {
        let half = (self.size.pixels / 2) as i32;
        [self.centre[0] + half - col as i32, self.centre[1] + half - row as i32]
    }

    /// `(row, col)` of a world pixel, if the window shows it.
    pub fn pixel_of(&self, world: [i32; 2]) -> Option<(usize, usize)> {
        let half = (self.size.pixels / 2) as i32;
        let (row, col) = (half - (world[1] - self.centre[1]), half - (world[0] - self.centre[0]));
        let inside = 0..self.size.pixels as i32;
        (inside.contains(&row) && inside.contains(&col)).then_some((row as usize, col as usize))
    }

    /// `(row, col)` of a position, if the window shows it.
    pub fn pixel(&self, position: Vec3) -> Option<(usize, usize)> {
        self.pixel_of(self.size.world_pixel(position))
    }

    /// Cell of the value map, `(row, col)` in `0..S/4`, of a position.
    pub fn value_cell(&self, position: Vec3) -> Option<(usize, usize)> {
        self.pixel(position).map(|(row, col)| (row / VALUE_STRIDE, col / VALUE_STRIDE))
    }

    /// Position of the middle of a pixel, in the camera plane.
    pub fn position(&self, row: usize, col: usize) -> Vec3 {
        let [x, z] = self.world_pixel(row, col);
        Vec3::new((x as f32 + 0.5) * self.size.pixel(), self.height, (z as f32 + 0.5) * self.size.pixel())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plus_z_is_up_and_plus_x_is_left() {
        let window = WindowSize { pixels: 64, metres: 40.0 }.around(Vec3::new(3.0, 1.0, -7.0));
        assert_eq!(window.pixel(Vec3::new(3.0, 1.0, -7.0)), Some((32, 32)));
        let north = window.pixel(Vec3::new(3.0, 1.0, -2.0)).unwrap();
        let east = window.pixel(Vec3::new(8.0, 1.0, -7.0)).unwrap();
        assert_eq!(north, (24, 32));
        assert_eq!(east, (32, 24));
    }

    #[test]
    fn pixels_round_trip_through_positions() {
        let window = WindowSize { pixels: 32, metres: 20.0 }.around(Vec3::new(-3.2, 1.0, 9.9));
        for row in 0..32 {
            for col in 0..32 {
                assert_eq!(window.pixel(window.position(row, col)), Some((row, col)));
            }
        }
        assert_eq!(window.pixel(Vec3::new(100.0, 0.0, 0.0)), None);
    }
}
