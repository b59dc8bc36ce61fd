//! Rays against the mesh: collision, clearance, inside tests, and the oracle that checks the rasteriser.
//!
//! Watertight in the sense of Woop, Benthin and Wald, "Watertight Ray/Triangle Intersection" (JCGT 2013): each corner is
//! sheared along the ray and rounded once, so triangles that share a corner see the same point, and the three edge
//! functions, products of two `f32` in `f64`, have exact signs. A ray through a shared edge or corner hits at least one
//! of the triangles around it. Both faces count.

use super::mesh::Mesh;
use glam::{DVec3, Vec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2;
use obvhs::ray::{Ray, RayHit};
use std::time::Duration;

/// Share of the scene's size by which boxes are padded. The slab test of obvhs errs by a few units in the last place of
/// the distance, and replaces direction components under `f32::EPSILON`: both stay below this for origins inside or
/// near the scene.
const PADDING: f32 = 4e-6;

/// Crossings nearer to each other than this, in metres and as a share of their distance, are one surface.
const SAME_SURFACE: f32 = 1e-5;

/// From 0 to 1, unlike the last number's. Of thousands of boxes that are the same, the builder of obvhs joins one pair a
/// round: quadratic time and a tree as deep as they are many. Boxes that are grown by shares of a hair are not the same.
pub(crate) fn unlike(number: u32) -> f32 {
    number.wrapping_mul(0x9e37_79b9) as f32 / u32::MAX as f32
}

/// A surface met by a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance in lengths of the direction that was asked for.
    pub t: f32,
    /// Index of the triangle in the mesh.
    pub triangle: u32,
}

/// A bounding volume hierarchy over the triangles of a mesh.
#[derive(Clone)]
pub struct RayIndex {
    bvh: Bvh2,
    /// In the order of the leaves.
    corners: Vec<[Vec3; 3]>,
}

impl RayIndex {
    /// Sorts the triangles of a mesh into a hierarchy; the same mesh gives the same hierarchy.
    pub fn build(mesh: &Mesh) -> Self {
        let [low, high] = mesh.bounds();
        let size = low.abs().max(high.abs()).max_element().max((high - low).max_element());
        let boxed = |(number, [a, b, c]): (u32, [Vec3; 3])| {
            let pad = Vec3A::splat(size * PADDING * (1.0 + unlike(number)));
            Aabb::new(Vec3A::from(a.min(b).min(c)) - pad, Vec3A::from(a.max(b).max(c)) + pad)
        };
        let boxes: Vec<Aabb> = (0..).zip(mesh.iter_corners()).map(boxed).collect();
        let bvh = build_bvh2(&boxes, BvhBuildParams::medium_build(), &mut Duration::default());
        let corners = bvh.primitive_indices.iter().map(|&t| mesh.corners(t as usize)).collect();
        Self { bvh, corners }
    }

    /// The nearest surface on `origin + t · direction` for `0 ≤ t < max_t`. The direction needs no unit length.
    pub fn nearest(&self, origin: Vec3, direction: Vec3, max_t: f32) -> Option<Hit> {
        self.nearest_between(origin, direction, 0.0, max_t)
    }

    /// The nearest surface on `origin + t · direction` for `min_t ≤ t < max_t`.
    pub fn nearest_between(&self, origin: Vec3, direction: Vec3, min_t: f32, max_t: f32) -> Option<Hit> {
        let ray = Sheared::new(origin, direction)?;
        let mut best = Hit { t: max_t, triangle: u32::MAX };
        self.bvh.ray_traverse(ray.bounds(max_t), &mut RayHit::none(), |_, leaf_index| {
            match ray.meets(&self.corners[leaf_index]) {
                Some(t) if t >= min_t && t < best.t => {
                    best = Hit { t, triangle: self.bvh.primitive_indices[leaf_index] };
                    t * ray.length
                }
                _ => f32::INFINITY,
            }
        });
        (best.triangle != u32::MAX).then_some(best)
    }

    /// Whether any surface touches the closed segment from `a` to `b`, its ends included.
    pub fn segment_is_blocked(&self, a: Vec3, b: Vec3) -> bool {
        let Some(ray) = Sheared::new(a, b - a) else { return false };
        // The box test is strict at its far end, the segment is not.
        !self.bvh.ray_traverse_miss(ray.bounds(1.0 + f32::EPSILON), |_, leaf_index| {
            match ray.meets(&self.corners[leaf_index]) {
                Some(t) if (0.0..=1.0).contains(&t) => 0.0,
                _ => f32::INFINITY,
            }
        })
    }

    /// Whether a triangle whose padded box meets the box from `low` to `high` passes a test.
    pub(super) fn any_in_box(&self, low: Vec3, high: Vec3, mut test: impl FnMut(&[Vec3; 3]) -> bool) -> bool {
        let mut found = false;
        self.bvh.aabb_traverse(Aabb::new(low.into(), high.into()), |bvh, node| {
            let node = &bvh.nodes[node as usize];
            let leaves = node.first_index as usize..(node.first_index + node.prim_count) as usize;
            found = self.corners[leaves].iter().any(&mut test);
            !found
        });
        found
    }

    /// Distances, ascending and in lengths of the direction, of all surfaces on `origin + t · direction`, `t ≥ 0`.
    ///
    /// Triangles met at the same distance (within 10 µm or 10⁻⁵ of it) count once, so a ray through a shared edge
    /// counts one surface. A ray that only touches an edge of the silhouette counts one too: for inside tests, aim at
    /// several directions.
    pub fn crossings(&self, origin: Vec3, direction: Vec3) -> Vec<f32> {
        let Some(ray) = Sheared::new(origin, direction) else { return Vec::new() };
        let mut all = Vec::new();
        self.bvh.ray_traverse_anyhit(ray.bounds(f32::INFINITY), |_, leaf_index| {
            all.extend(ray.meets(&self.corners[leaf_index]).filter(|&t| t >= 0.0));
        });
        all.sort_by(f32::total_cmp);
        all.dedup_by(|next, kept| (*next - *kept) * ray.length < SAME_SURFACE * (*next * ray.length).max(1.0));
        all
    }
}

impl std::fmt::Debug for RayIndex {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("RayIndex").field("triangles", &self.corners.len()).finish_non_exhaustive()
    }
}

/// A ray as the frame in which it runs along the third axis.
struct Sheared {
    origin: DVec3,
    direction: Vec3,
    length: f32,
    /// Axes with the direction's smaller components, then its largest.
    axes: [usize; 3],
    shear: [f64; 3],
}

impl Sheared {
    /// `None` for a direction without a length, or one that is not finite.
    fn new(origin: Vec3, direction: Vec3) -> Option<Self> {
        let length = direction.length();
        if !(length > 0.0 && length.is_finite() && origin.is_finite()) {
            return None;
        }
        let d = direction.as_dvec3().to_array();
        let last = direction.abs().max_position();
        let axes = [(last + 1) % 3, (last + 2) % 3, last];
        let shear = [d[axes[0]] / d[last], d[axes[1]] / d[last], 1.0 / d[last]];
        Some(Self { origin: origin.as_dvec3(), direction, length, axes, shear })
    }

    /// The ray for the boxes, in metres: obvhs replaces direction components that are small in absolute terms.
    fn bounds(&self, max_t: f32) -> Ray {
        let unit = Vec3A::from(self.direction) / self.length;
        Ray::new(self.origin.as_vec3a(), unit, 0.0, max_t * self.length)
    }

    /// Where the line of the ray meets a triangle, in lengths of the direction; may be negative.
    fn meets(&self, corners: &[Vec3; 3]) -> Option<f32> {
        let [kx, ky, kz] = self.axes;
        let [a, b, c] = corners.map(|corner| {
            let p = (corner.as_dvec3() - self.origin).to_array();
            // Rounded to f32: products of two of these are exact in f64, and so are the signs below.
            let round = |x: f64| f64::from(x as f32);
            [round(p[kx] - self.shear[0] * p[kz]), round(p[ky] - self.shear[1] * p[kz]), self.shear[2] * p[kz]]
        });
        let u = c[0] * b[1] - c[1] * b[0];
        let v = a[0] * c[1] - a[1] * c[0];
        let w = b[0] * a[1] - b[1] * a[0];
        let outside = (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0);
        let sum = u + v + w;
        // A sum of zero: the triangle is seen edge-on and has no inside.
        (!outside && sum != 0.0).then(|| ((u * a[2] + v * b[2] + w * c[2]) / sum) as f32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::test_scenes::{Dice, Soup, ball, crate_box, rooms};

    fn index((vertices, triangles): Soup) -> (Mesh, RayIndex) {
        let mesh = Mesh::new(vertices, triangles).unwrap();
        let rays = RayIndex::build(&mesh);
        (mesh, rays)
    }

    /// Points on corners and edges of every `step`-th triangle.
    fn seams(mesh: &Mesh, step: usize) -> impl Iterator<Item = Vec3> + '_ {
        mesh.iter_corners()
            .step_by(step)
            .flat_map(|[a, b, c]| [a, b, c, (a + b) / 2.0, b.lerp(c, 0.3), c.lerp(a, 0.123)].into_iter())
    }

    #[test]
    fn rays_at_edges_and_corners_of_a_closed_mesh_never_slip_through() {
        let house = index(rooms(12.0, 0.7, 1));
        let globe = index(ball(Vec3::new(3.0, 1.0, -2.0), 24, || 2.0));
        for ((mesh, rays), low, high) in [
            (&house, Vec3::new(0.1, 0.1, 0.1), Vec3::new(11.9, 3.1, 11.9)),
            (&globe, Vec3::new(2.1, 0.1, -2.9), Vec3::new(3.9, 1.9, -1.1)),
        ] {
            let mut dice = Dice(5);
            let mut origins = vec![(low + high) / 2.0, Vec3::new(3.0, 1.0, -2.0).clamp(low, high)];
            origins.extend((0..3).map(|_| dice.point(low, high)));
            // The origins lie inside a closed shell: whatever the aim, something is hit.
            let mut misses = 0;
            for origin in origins {
                for target in seams(mesh, 3) {
                    let away = target - origin;
                    misses += usize::from(rays.nearest(origin, away, f32::INFINITY).is_none());
                    misses += usize::from(rays.nearest(origin, away.normalize(), f32::INFINITY).is_none());
                }
            }
            assert_eq!(misses, 0);
        }
    }

    #[test]
    fn axis_parallel_rays_on_the_diagonals_of_a_grid_hit() {
        // Directions with exact zeros and origins on the planes of the boxes: the worst case of a slab test.
        let mut soup = Soup::default();
        crate_box(&mut soup, Vec3::ZERO, Vec3::splat(8.0), 1.0, true);
        let (_, rays) = index(soup);
        for i in 0..=32 {
            for k in 0..=32 {
                let origin = Vec3::new(i as f32 * 0.25, 4.0, k as f32 * 0.25);
                for direction in [Vec3::Y, Vec3::NEG_Y] {
                    let hit = rays.nearest(origin, direction, f32::INFINITY).unwrap();
                    assert!((hit.t - 4.0).abs() < 1e-5, "{origin} {direction} {hit:?}");
                    assert_eq!(rays.crossings(origin, direction).len(), 1);
                }
            }
        }
    }

    #[test]
    fn a_convex_body_is_crossed_once_from_inside_and_twice_from_outside() {
        let (mesh, rays) = index(ball(Vec3::ZERO, 12, || 1.0));
        for target in seams(&mesh, 1) {
            let target = target * 0.5;
            assert_eq!(rays.crossings(target, Vec3::new(0.3, 0.4, 0.5)).len(), 1);
            let far = Vec3::new(-9.0, 3.0, 1.0);
            let through = rays.crossings(far, target - far);
            assert_eq!(through.len(), 2, "{target}");
            assert!(through[0] < 1.0 && through[1] > 1.0);
        }
    }

    #[test]
    fn many_triangles_in_one_place_make_no_deep_tree() {
        let mesh = Mesh::new(vec![Vec3::ZERO, Vec3::X, Vec3::Z], vec![[0, 1, 2]; 5000]).unwrap();
        let rays = RayIndex::build(&mesh);
        assert!(rays.bvh.depth(0) < 400, "{}", rays.bvh.depth(0));
        assert!(crate::sensor::RasterIndex::build(&mesh).depth() < 400);
    }

    #[test]
    fn segments_are_closed_and_rays_name_the_triangle() {
        let mesh = Mesh::new(vec![Vec3::ZERO, Vec3::X, Vec3::Z], vec![[0, 1, 2]]).unwrap();
        let rays = RayIndex::build(&mesh);
        let (above, below) = (Vec3::new(0.2, 1.0, 0.2), Vec3::new(0.2, -1.0, 0.2));
        assert!(rays.segment_is_blocked(above, below));
        assert!(rays.segment_is_blocked(below, above));
        assert!(rays.segment_is_blocked(above, Vec3::new(0.2, 0.0, 0.2)));
        assert!(!rays.segment_is_blocked(above, Vec3::new(0.2, 0.001, 0.2)));
        assert!(!rays.segment_is_blocked(above, above));
        assert_eq!(rays.nearest(above, Vec3::NEG_Y * 2.0, 1.0), Some(Hit { t: 0.5, triangle: 0 }));
        assert_eq!(rays.nearest(above, Vec3::NEG_Y, 0.5), None);
        assert_eq!(rays.nearest_between(above, Vec3::NEG_Y, 1.1, 5.0), None);
    }
}
