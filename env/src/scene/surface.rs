//! Ground-truth surface points: the cloud that coverage is measured against.

use crate::scene::Scene;
use crate::seed::SeedTree;
use glam::Vec3;
use rand::RngExt as _;

/// Slack around the scene's box, metres (0.2 units in the released code).
const BOX_SLACK: f32 = 0.1;

/// `count` points, uniform by area over the triangles that lie in the scene's box. The same scene
/// always gives the same points.
pub fn sample(scene: &Scene, count: usize) -> Vec<Vec3> {
    let cumulative = cumulative_areas(scene);
    let total = cumulative.last().map_or(0.0, |&(total, _)| total);
    if cumulative.is_empty() {
        return Vec::new();
    }
    let mut rng = SeedTree::new(0).child("surface", count as u64).rng();
    let mut at = 0;
    (0..count)
        .map(|n| {
            // One draw in each of `count` equal shares of the area: uniform, with less noise than independent draws.
            let target = (n as f64 + rng.random::<f64>()) / count as f64 * total;
            while at + 1 < cumulative.len() && cumulative[at].0 < target {
                at += 1;
            }
            let [a, b, c] = scene.mesh().corners(cumulative[at].1);
            let (u, v): (f32, f32) = (rng.random(), rng.random());
            let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
            a + u * (b - a) + v * (c - a)
        })
        .collect()
}

/// The area that points are drawn from, square metres.
pub fn area(scene: &Scene) -> f32 {
    cumulative_areas(scene).last().map_or(0.0, |&(total, _)| total / 2.0) as f32
}

/// Twice the area of the triangles in the scene's box, up to and with each of them.
fn cumulative_areas(scene: &Scene) -> Vec<(f64, usize)> {
    let [low, high] = scene.bounds();
    let inside = |v: &Vec3| v.cmpge(low - BOX_SLACK).all() && v.cmple(high + BOX_SLACK).all();
    let mut cumulative = Vec::new();
    let mut total = 0.0_f64;
    for (triangle, corners) in scene.mesh().iter_corners().enumerate() {
        if corners.iter().all(inside) {
            let [a, b, c] = corners;
            total += f64::from((b - a).cross(c - a).length());
            cumulative.push((total, triangle));
        }
    }
    cumulative
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_follow_the_area() {
        let scene = Scene::two_rooms();
        let points = sample(&scene, 10_000);
        assert_eq!(points, sample(&scene, 10_000));
        let whole: f32 = scene.mesh().iter_corners().map(|[a, b, c]| (b - a).cross(c - a).length() / 2.0).sum();
        assert!((area(&scene) - whole).abs() < 1e-3 * whole);
        let area = whole;
        let floor = points.iter().filter(|p| p.y.abs() < 1e-4).count() as f32 / 10_000.0;
        let expected = (2.0 * 5.9 * 9.0 + 0.2 * 2.0) / area;
        assert!((floor - expected).abs() < 0.01, "{floor} against {expected}");
    }
}
