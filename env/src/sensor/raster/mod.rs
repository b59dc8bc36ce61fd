//! Depth images by rasterising, with occlusion culling.
//!
//! The walk opens the boxes of a BVH front to back. What a box holds is skipped when it lies behind pixels that are
//! already drawn, so the time of a frame follows what is visible, not the size of the scene.
//!
//! Sampling is exact: a pixel shows what the ray through its centre meets first, as [`trace`](super::trace::trace) has
//! it. Triangles have two faces. 1/depth is linear over the image and each pixel keeps its largest value, so the order of
//! triangles does not matter; and every instruction set computes the same bits.

mod dispatch;
mod image;
mod index;
mod packet;
mod pyramid;
mod spans;
mod view;
mod walk;

pub use dispatch::InstructionSet;
pub use index::RasterIndex;

use super::{Camera, Frame, Sensor};
use crate::pose::Pose;
use crate::scene::Scene;
use dispatch::Scratch;
use std::cell::RefCell;
use view::View;
pub(super) use view::nearest_whole;

/// The rasteriser as a sensor: the depths of [`RgbdCamera`](super::RgbdCamera), which rollouts use, and nothing else.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthCamera(pub Camera);

impl Sensor for DepthCamera {
    fn camera(&self) -> &Camera {
        &self.0
    }

    fn capture(&self, scene: &Scene, pose: &Pose, out: &mut Frame) {
        render(scene.raster(), &self.0, pose, out);
    }
}

thread_local! {
    static SCRATCH: RefCell<Scratch> = RefCell::default();
}

/// One depth image.
pub fn render(index: &RasterIndex, camera: &Camera, pose: &Pose, out: &mut Frame) {
    render_with(InstructionSet::best(), index, camera, pose, out);
}

/// One depth image by a chosen instruction set: the same bits, at another speed.
pub fn render_with(set: InstructionSet, index: &RasterIndex, camera: &Camera, pose: &Pose, out: &mut Frame) {
    let view = View::new(camera, pose);
    SCRATCH.with_borrow_mut(|scratch| set.draw::<false>(index, camera, &view, scratch, &mut Vec::new(), out));
}

/// One depth image, the same bits, and in `triangles` the number in the mesh of what each pixel shows,
/// [`NO_TRIANGLE`](super::NO_TRIANGLE) where it shows nothing.
pub fn render_marked(index: &RasterIndex, camera: &Camera, pose: &Pose, out: &mut Frame, triangles: &mut Vec<u32>) {
    render_marked_with(InstructionSet::best(), index, camera, pose, out, triangles);
}

/// The same by a chosen instruction set.
pub fn render_marked_with(
    set: InstructionSet,
    index: &RasterIndex,
    camera: &Camera,
    pose: &Pose,
    out: &mut Frame,
    triangles: &mut Vec<u32>,
) {
    let view = View::new(camera, pose);
    SCRATCH.with_borrow_mut(|scratch| set.draw::<true>(index, camera, &view, scratch, triangles, out));
}

/// The larger; the second if they do not compare. Unlike `f32::max`, one instruction.
#[inline(always)]
fn high(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

/// The smaller; the second if they do not compare.
#[inline(always)]
fn low(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[cfg(test)]
mod tests;
