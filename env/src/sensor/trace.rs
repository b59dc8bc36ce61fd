//! The ray twin of the rasteriser: slow, simple, and right.

use super::{Camera, Frame, NO_TRIANGLE, Sensor};
use crate::pose::Pose;
use crate::scene::{RayIndex, Scene};

/// A depth camera that shoots one watertight ray per pixel. The oracle for [`DepthCamera`](super::DepthCamera).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayCamera(pub Camera);

impl Sensor for RayCamera {
    fn camera(&self) -> &Camera {
        &self.0
    }

    fn capture(&self, scene: &Scene, pose: &Pose, out: &mut Frame) {
        trace(scene.rays(), &self.0, pose, out);
    }
}

/// One image by rays.
pub fn trace(rays: &RayIndex, camera: &Camera, pose: &Pose, out: &mut Frame) {
    trace_marked(rays, camera, pose, out, &mut Vec::new());
}

/// One image by rays, and in `triangles` the number of the triangle that each pixel shows, [`NO_TRIANGLE`] where it shows
/// nothing.
pub fn trace_marked(rays: &RayIndex, camera: &Camera, pose: &Pose, out: &mut Frame, triangles: &mut Vec<u32>) {
    let eye = camera.at(pose);
    out.resize(camera);
    triangles.clear();
    for (row, line) in out.depth.chunks_exact_mut(camera.width).enumerate() {
        for (col, depth) in line.iter_mut().enumerate() {
            // The ray advances 1 along the optical axis, so its parameter is the depth.
            let ray = eye.ray(col, row);
            let hit = rays.nearest_between(pose.position, ray, Camera::NEAR, camera.range);
            *depth = hit.map_or(0.0, |hit| hit.t);
            triangles.push(hit.map_or(NO_TRIANGLE, |hit| hit.triangle));
        }
    }
}
