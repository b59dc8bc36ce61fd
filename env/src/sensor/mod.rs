//! What the agent sees: depth images of a scene, with colours where they are asked for.
//!
//! Second step of the flow, `scene → sensor → map`. [`RgbdCamera`] rasterises and is the one of rollouts: depths, and
//! colours if asked for. [`DepthCamera`] gives the same depths alone; [`RayCamera`] shoots one watertight ray per pixel, a
//! hundred times slower, and is the oracle that the tests hold both against.

pub mod camera;
pub mod colour;
pub mod raster;
#[cfg(test)]
#[path = "../../benches/scenes/mod.rs"]
#[allow(dead_code)]
pub(crate) mod test_scenes;
pub mod trace;

pub use camera::{Camera, CameraError, MAX_SIDE, PosedCamera};
pub use colour::{Colour, RgbdCamera};
pub use raster::{DepthCamera, RasterIndex, render};
pub use trace::{RayCamera, trace};

use crate::pose::Pose;
use crate::scene::Scene;
use glam::Vec3;

/// The number of the triangle that a pixel without a surface shows.
pub const NO_TRIANGLE: u32 = u32::MAX;

/// A depth image. Keep one and capture into it again: its memory is reused.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Frame {
    /// Pixels from left to right.
    pub width: usize,
    /// Pixels from top to bottom.
    pub height: usize,
    /// Row-major from the top-left pixel: depth along the optical axis in metres, 0 where no surface is within range.
    pub depth: Vec<f32>,
    /// sRGB, laid out like the depths, black where no surface is within range; empty where the sensor or the scene has no
    /// colours.
    pub colour: Vec<[u8; 3]>,
}

impl Frame {
    /// Depth of a pixel, metres; `None` where no surface is within range.
    pub fn at(&self, col: usize, row: usize) -> Option<f32> {
        Some(self.depth[row * self.width + col]).filter(|&depth| depth > 0.0)
    }

    /// The surface points, in the world, of all pixels that show a surface, seen through the camera that took them.
    pub fn points(&self, eye: PosedCamera) -> impl Iterator<Item = Vec3> + '_ {
        let pixels = self.depth.iter().enumerate().filter(|&(_, &depth)| depth > 0.0);
        pixels.map(move |(n, &depth)| eye.unproject(n % self.width, n / self.width, depth))
    }

    /// Takes the size of a camera's image. The depths keep arbitrary old values.
    fn resize(&mut self, camera: &Camera) {
        (self.width, self.height) = (camera.width, camera.height);
        self.depth.resize(camera.width * camera.height, 0.0);
        self.colour.clear();
    }
}

/// Something that takes depth images.
pub trait Sensor: Send + Sync {
    /// Size, field of view and range of the images.
    fn camera(&self) -> &Camera;

    /// Takes one image, and sizes `out` to fit. The same scene and pose give the same bits, on any thread.
    fn capture(&self, scene: &Scene, pose: &Pose, out: &mut Frame);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_cameras_see_the_same_room() {
        let scene = Scene::two_rooms();
        let camera = Camera { width: 91, height: 51, ..Camera::default() };
        let sensors: [Box<dyn Sensor>; 2] = [Box::new(DepthCamera(camera)), Box::new(RayCamera(camera))];
        for &start in scene.starts() {
            let pose = scene.lattice().pose(start);
            let [drawn, shot] = [0, 1].map(|i| {
                let mut frame = Frame::default();
                sensors[i].capture(&scene, &pose, &mut frame);
                assert_eq!(frame.depth.len(), camera.width * camera.height);
                frame
            });
            for (a, b) in drawn.depth.iter().zip(&shot.depth) {
                assert!((a - b).abs() <= 1e-4 * b, "{a} {b}");
            }
        }
    }
}
