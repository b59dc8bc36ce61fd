//! Whether a scene is closed: rays from inside that meet nothing.

use crate::scene::{Interior, Scene};
use crate::seed::SeedTree;
use glam::Vec3;
use rand::RngExt as _;
use std::f32::consts::TAU;

/// Points inside from which rays are shot.
const POINTS: usize = 1000;

/// Rays from each point.
const DIRECTIONS: usize = 64;

/// Places tried for each point, many more than even a sparse building needs.
const TRIES: usize = 1000;

/// What became of rays from inside.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Escape {
    /// Rays shot.
    pub rays: usize,
    /// Rays that met no surface.
    pub escaped: usize,
    /// Origin and direction of the first of these.
    pub first: Option<[Vec3; 2]>,
}

impl Escape {
    /// Shoots rays from 1,000 points inside a scene into 64 directions. The same scene always gives the same answer.
    pub fn of(scene: &Scene) -> Self {
        let seed = SeedTree::new(0).child("closed", 0);
        let mut rng = seed.child("turns", 0).rng();
        let mut found = Self { rays: 0, escaped: 0, first: None };
        for origin in inside_points(scene, POINTS, seed) {
            let turn = rng.random_range(0.0..TAU);
            for direction in directions(turn) {
                found.rays += 1;
                if scene.rays().nearest(origin, direction, f32::INFINITY).is_none() {
                    found.escaped += 1;
                    found.first.get_or_insert([origin, direction]);
                }
            }
        }
        found
    }

    /// Share of the rays that escaped; 1 without a point inside.
    pub fn share(&self) -> f64 {
        if self.rays == 0 { 1.0 } else { self.escaped as f64 / self.rays as f64 }
    }
}

/// `count` points uniform in the space inside a scene: an odd number of surfaces lies below them, or in a scan, a floor and
/// walls around. Fewer where there is hardly any such space.
fn inside_points(scene: &Scene, count: usize, seed: SeedTree) -> Vec<Vec3> {
    let [low, high] = scene.mesh().bounds();
    let mut rng = seed.rng();
    let mut draw = || low + (high - low) * Vec3::new(rng.random(), rng.random(), rng.random());
    let is_inside = |p: &Vec3| match scene.graph().interior() {
        Interior::Closed => scene.rays().crossings(*p, Vec3::NEG_Y).len() % 2 == 1,
        open => open.contains(scene.rays(), *p),
    };
    (0..TRIES * count).map(|_| draw()).filter(is_inside).take(count).collect()
}

/// Directions spread evenly over the sphere along a spiral that begins at an azimuth.
fn directions(turn: f32) -> impl Iterator<Item = Vec3> {
    /// Keeps neighbours on the spiral apart: 2π over the square of the golden ratio.
    const GOLDEN: f32 = 2.399_963;
    (0..DIRECTIONS).map(move |n| {
        let y = (2 * n + 1) as f32 / DIRECTIONS as f32 - 1.0;
        let (sin, cos) = (turn + GOLDEN * n as f32).sin_cos();
        let flat = (1.0 - y * y).sqrt();
        Vec3::new(flat * cos, y, flat * sin)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Mesh, Settings};

    #[test]
    fn a_closed_building_keeps_its_rays_and_an_open_one_does_not() {
        let closed = Scene::two_rooms();
        let found = Escape::of(&closed);
        assert_eq!((found.rays, found.escaped, found.first), (64_000, 0, None));
        let [low, high] = closed.mesh().bounds();
        let is_roof = |corners: &[Vec3; 3]| corners.iter().all(|c| c.y == high.y);
        let triangles = closed.mesh().triangles().iter().zip(closed.mesh().iter_corners());
        let open: Vec<_> = triangles.filter(|(_, corners)| !is_roof(corners)).map(|(t, _)| *t).collect();
        let mesh = Mesh::new(closed.mesh().vertices().to_vec(), open).unwrap();
        let open = Scene::new("open", mesh, &Settings::for_box([low, high], 0.0, glam::Vec2::splat(0.75))).unwrap();
        let found = Escape::of(&open);
        // Half of the rays go up, and the rooms are three times as wide as high.
        assert!((0.2..0.5).contains(&found.share()), "{found:?}");
        let [origin, direction] = found.first.unwrap();
        assert!(origin.cmpge(low).all() && origin.cmple(high).all() && direction.y > 0.0);
    }

    #[test]
    fn directions_are_even() {
        let sum: Vec3 = directions(1.0).sum();
        assert!(sum.length() < 1.0 && directions(1.0).all(|d| (d.length() - 1.0).abs() < 1e-5), "{sum}");
    }
}
