//! What is kept of a frame: a random share of its pixels, as points.

use crate::pose::Pose;
use crate::seed::Rng;
use crate::sensor::{Camera, Frame};
use glam::Vec3;
use rand::RngExt as _;

/// What is kept of one frame.
#[derive(Debug, Default)]
pub struct Kept {
    /// Places of the pixels in the frame, ascending.
    pub pixels: Vec<u32>,
    /// The points that they show, metres.
    pub points: Vec<Vec3>,
}

impl Kept {
    /// A random share of a frame's valid pixels: one pixel at random out of each run of `1 / share`.
    pub fn draw(camera: &Camera, pose: &Pose, frame: &Frame, share: f32, rng: &mut Rng) -> Self {
        let run = (1.0 / share).round().max(1.0) as usize;
        let eye = camera.at(pose);
        let most = frame.depth.len() / run + 1;
        let mut kept = Kept { pixels: Vec::with_capacity(most), points: Vec::with_capacity(most) };
        for begin in (0..frame.depth.len()).step_by(run) {
            let index = begin + rng.random_range(0..run);
            if let Some(&depth) = frame.depth.get(index).filter(|&&depth| depth > 0.0 && depth.is_finite()) {
                kept.pixels.push(index as u32);
                kept.points.push(eye.unproject(index % frame.width, index / frame.width, depth));
            }
        }
        kept
    }
}
