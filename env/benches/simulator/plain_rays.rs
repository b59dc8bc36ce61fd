//! Depth images by obvhs with nothing of ours, for comparison: one ray at a time, its own triangle test (which is not
//! watertight), triangles in the order of the leaves as its documentation advises.

use glam::Vec3A;
use nbp_env::Pose;
use nbp_env::scene::Mesh;
use nbp_env::sensor::Camera;
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2;
use obvhs::ray::{Ray, RayHit};
use obvhs::rt_triangle::RtTriangle;
use std::time::Duration;

/// Padding of boxes, metres. Those of walls along an axis are flat, and of flat boxes the builder makes a hierarchy that is 2
/// to 14 times slower.
const PADDING: f32 = 1e-4;

pub(crate) struct PlainRays {
    bvh: Bvh2,
    triangles: Vec<RtTriangle>,
}

impl PlainRays {
    pub(crate) fn build(mesh: &Mesh) -> Self {
        let triangles: Vec<_> = mesh.iter_corners().map(|corners| corners.map(Vec3A::from)).collect();
        let pad = |bounds: Aabb| Aabb::new(bounds.min - PADDING, bounds.max + PADDING);
        let boxes: Vec<Aabb> = triangles.iter().map(|corners| pad(Aabb::from_points(corners))).collect();
        let bvh = build_bvh2(&boxes, BvhBuildParams::medium_build(), &mut Duration::default());
        let in_order = bvh.primitive_indices.iter().map(|&number| triangles[number as usize]);
        Self { triangles: in_order.map(|[a, b, c]| RtTriangle::new(a, b, c)).collect(), bvh }
    }

    /// Depths along the optical axis, as those of the rasteriser.
    pub(crate) fn draw(&self, camera: &Camera, pose: &Pose, depth: &mut Vec<f32>) {
        let (eye, origin) = (camera.at(pose), Vec3A::from(pose.position));
        depth.clear();
        for row in 0..camera.height {
            for col in 0..camera.width {
                let ray = Ray::new(origin, eye.ray(col, row).into(), Camera::NEAR, camera.range);
                let mut hit = RayHit::none();
                let found = self.bvh.ray_traverse(ray, &mut hit, |ray, number| self.triangles[number].intersect(ray));
                depth.push(if found { hit.t } else { 0.0 });
            }
        }
    }
}
