//! How near a way comes to the mesh: collision of an agent that is wider than a point.

use super::RayIndex;
use glam::{DVec3, Vec3};

impl RayIndex {
    /// Whether any surface comes nearer than `radius` metres to the segment from `a` to `b`. Exact; a radius of 0 asks
    /// whether the segment is blocked.
    pub fn is_near(&self, a: Vec3, b: Vec3, radius: f32) -> bool {
        let (low, high) = (a.min(b) - radius, a.max(b) + radius);
        let [p, q] = [a, b].map(Vec3::as_dvec3);
        let square = f64::from(radius).powi(2);
        self.segment_is_blocked(a, b)
            || (radius > 0.0
                && self.any_in_box(low, high, |corners| {
                    let corners = corners.map(Vec3::as_dvec3);
                    // The segment meets no triangle, so it is nearest to an edge, or one of its ends is to a face.
                    (0..3).any(|n| between_segments([p, q], [corners[n], corners[(n + 1) % 3]]) < square)
                        || [p, q].into_iter().any(|end| from_face(end, corners) < square)
                }))
    }
}

/// Squared distance of two segments (Ericson, "Real-Time Collision Detection", 5.1.9).
fn between_segments([p1, q1]: [DVec3; 2], [p2, q2]: [DVec3; 2]) -> f64 {
    let (d1, d2, r) = (q1 - p1, q2 - p2, p1 - p2);
    let (a, e, b) = (d1.length_squared(), d2.length_squared(), d1.dot(d2));
    let (c, f) = (d1.dot(r), d2.dot(r));
    let share = |of: f64, by: f64| if by > 0.0 { (of / by).clamp(0.0, 1.0) } else { 0.0 };
    let s = share(b * f - c * e, a * e - b * b);
    let t = share(b * s + f, e);
    // The first one's nearest point to the clamped point of the second: right whether or not that was clamped.
    let s = share(b * t - c, a);
    (p1 + s * d1).distance_squared(p2 + t * d2)
}

/// Squared distance of a point from the face of a triangle; infinite where its edges are nearer.
fn from_face(p: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
    let normal = (b - a).cross(c - a);
    let is_over = [(a, b), (b, c), (c, a)].into_iter().all(|(from, to)| (to - from).cross(p - from).dot(normal) >= 0.0);
    match is_over && normal != DVec3::ZERO {
        true => (p - a).dot(normal).powi(2) / normal.length_squared(),
        false => f64::INFINITY,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Mesh;
    use proptest::prelude::*;

    fn point() -> impl Strategy<Value = Vec3> {
        (-2.0_f32..2.0, -2.0_f32..2.0, -2.0_f32..2.0).prop_map(|(x, y, z)| Vec3::new(x, y, z))
    }

    proptest! {
        #[test]
        fn agrees_with_many_points(a in point(), b in point(), corners in [point(), point(), point()], radius in 0.05_f32..1.5) {
            let [p, q, r] = corners;
            let rays = RayIndex::build(&Mesh::new(corners.to_vec(), vec![[0, 1, 2]]).unwrap());
            let mut nearest = f32::INFINITY;
            const N: usize = 40;
            for n in 0..=N {
                for i in 0..=N {
                    for j in 0..=N - i {
                        let [u, v] = [i, j].map(|k| k as f32 / N as f32);
                        let on = p + u * (q - p) + v * (r - p);
                        nearest = nearest.min(on.distance(a.lerp(b, n as f32 / N as f32)));
                    }
                }
            }
            // Samples lie at most half a step from the true nearest points: 7 m of segment, 7 m of sides.
            let slack = 0.5 * 7.0 * 3.0 / N as f32;
            prop_assert!(rays.is_near(a, b, radius) || nearest >= radius);
            prop_assert!(!rays.is_near(a, b, radius) || nearest <= radius + slack);
        }
    }

    #[test]
    fn a_way_along_a_wall_is_as_near_as_the_wall() {
        let mesh = Mesh::new(
            vec![Vec3::ZERO, 9.0 * Vec3::X, 9.0 * Vec3::Y, Vec3::new(9.0, 9.0, 0.0)],
            vec![[0, 1, 2], [1, 3, 2]],
        );
        let rays = RayIndex::build(&mesh.unwrap());
        let way = |z| (Vec3::new(2.0, 1.25, z), Vec3::new(5.0, 1.25, z));
        assert!(rays.is_near(way(0.0999).0, way(0.0999).1, 0.1));
        assert!(!rays.is_near(way(0.1001).0, way(0.1001).1, 0.1));
        assert!(!rays.is_near(way(1e-3).0, way(1e-3).1, 0.0));
        assert!(rays.is_near(way(-1e-3).0, way(1e-3).1, 0.0));
        assert!(rays.is_near(way(0.05).0, way(0.05).0, 0.1), "standing");
    }
}
