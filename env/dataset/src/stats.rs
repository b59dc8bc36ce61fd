//! What a set of scenes is like: areas, navigation complexity, walls, clearance (aimdoom.md, section 1).
//!
//! Works on any scene that loads, published ones included. Lengths are metres, areas square metres of plan.

use crate::navigation::Navigation;
use glam::{Vec2, Vec3};
use nbp_env::pose::Lattice;
use nbp_env::scene::LatticeGraph;
use nbp_env::{Scene, SeedTree};
use serde::Serialize;
use std::collections::BTreeMap;

/// Resolution of the areas in the camera plane.
const FINE: f32 = 0.25;

/// Clearance is measured at about this many places.
const CLEARANCE_SAMPLES: usize = 4000;

/// Walls within this of a free place belong to the scene's free space.
const NEAR_WALL: f32 = 0.3;

/// The figures of one scene.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SceneStats {
    /// Scene.
    pub name: String,
    /// Area of the faces that look up.
    pub floor_area: f64,
    /// Largest area that is connected in the camera plane.
    pub plane_area: f64,
    /// Connected positions on the 1.5 m lattice.
    pub nodes: usize,
    /// Largest ratio of walking to straight distance, all pairs of these positions.
    pub complexity: f64,
    /// The same over 1 % of the pairs: the paper's protocol for its smallest maps, a lower bound.
    pub sampled_complexity: f64,
    /// Faces of the mesh.
    pub triangles: usize,
    /// Floor area over the area of the bounding box.
    pub fill: f64,
    /// Wall length in the camera plane over the area that is connected there, m/m².
    pub wall_density: f64,
    /// Share of that wall length that is not parallel to an axis.
    pub oblique_share: f64,
    /// Median distance from a free place to the nearest wall.
    pub clearance_p50: f64,
    /// 90th percentile of the same.
    pub clearance_p90: f64,
    /// Wall outlines, other than the outer one, for each 100 m².
    pub islands: f64,
}

/// Measures a scene.
pub fn measure(scene: &Scene) -> SceneStats {
    let navigation = Navigation::of(scene.graph());
    let mut floor_area = 0.0_f64;
    for [a, b, c] in scene.mesh().iter_corners() {
        let normal = (b - a).cross(c - a);
        if normal.y > 0.5 * normal.length() {
            floor_area += f64::from(normal.y) / 2.0;
        }
    }
    let [low, high] = scene.mesh().bounds();
    let fine = fine_lattice(scene);
    let free: Vec<Vec2> = fine.largest_component().iter().map(|&n| flat(fine.lattice().position(n))).collect();
    let plane_area = free.len() as f64 * f64::from(FINE * FINE);
    let walls = walls_around(scene, &free);
    let length = |wall: &[Vec2; 2]| f64::from(wall[0].distance(wall[1]));
    let wall_length: f64 = walls.iter().map(length).sum();
    let oblique: f64 = walls.iter().filter(|wall| is_oblique(**wall)).map(length).sum();
    let mut clearance = clearances(&free, &walls);
    clearance.sort_unstable_by(f32::total_cmp);
    let percentile = |p: usize| clearance.get(clearance.len() * p / 100).map_or(0.0, |&c| f64::from(c));
    SceneStats {
        name: scene.name().into(),
        floor_area,
        plane_area,
        nodes: navigation.nodes().len(),
        complexity: navigation.complexity().ratio,
        sampled_complexity: navigation.sampled_complexity(0.01, SeedTree::new(0)),
        triangles: scene.mesh().triangles().len(),
        fill: floor_area / f64::from((high.x - low.x) * (high.z - low.z)),
        wall_density: ratio(wall_length, plane_area),
        oblique_share: ratio(oblique, wall_length),
        clearance_p50: percentile(50),
        clearance_p90: percentile(90),
        islands: ratio(100.0 * outlines(&walls).saturating_sub(1) as f64, plane_area),
    }
}

fn ratio(a: f64, b: f64) -> f64 {
    if b > 0.0 { a / b } else { 0.0 }
}

fn flat(p: Vec3) -> Vec2 {
    Vec2::new(p.x, p.z)
}

/// The camera plane at a finer step than the agent's, in phase with its lattice.
fn fine_lattice(scene: &Scene) -> LatticeGraph {
    let [low, high] = scene.mesh().bounds();
    let coarse = scene.lattice();
    let back = ((coarse.origin - low) / FINE).floor();
    let origin = Vec3::new(coarse.origin.x - back.x * FINE, coarse.origin.y, coarse.origin.z - back.z * FINE);
    let size = [(high.x - origin.x) / FINE, (high.z - origin.z) / FINE].map(|n| n.max(0.0) as i32 + 1);
    LatticeGraph::build(Lattice { origin, spacing: FINE, size }, scene.rays())
}

/// Walls at the camera plane that bound the free places.
fn walls_around(scene: &Scene, free: &[Vec2]) -> Vec<[Vec2; 2]> {
    let key = |p: Vec2| ((p / NEAR_WALL).floor().x as i32, (p / NEAR_WALL).floor().y as i32);
    let mut cells: Vec<(i32, i32)> = free.iter().map(|&p| key(p)).collect();
    cells.sort_unstable();
    cells.dedup();
    let is_near = |wall: &[Vec2; 2]| {
        let (x, z) = key((wall[0] + wall[1]) / 2.0);
        (-1..=1).any(|dx| (-1..=1).any(|dz| cells.binary_search(&(x + dx, z + dz)).is_ok()))
    };
    scene.walls().iter().copied().filter(is_near).collect()
}

fn is_oblique([a, b]: [Vec2; 2]) -> bool {
    let along = (b - a).abs();
    along.min_element() > 0.02 * along.max_element()
}

fn clearances(free: &[Vec2], walls: &[[Vec2; 2]]) -> Vec<f32> {
    let stride = (free.len() / CLEARANCE_SAMPLES).max(1);
    let distance = |p: Vec2, [a, b]: [Vec2; 2]| {
        let along = b - a;
        let t = ((p - a).dot(along) / along.length_squared().max(f32::MIN_POSITIVE)).clamp(0.0, 1.0);
        p.distance_squared(a + t * along)
    };
    let nearest = |&p: &Vec2| walls.iter().map(|&wall| distance(p, wall)).fold(f32::INFINITY, f32::min).sqrt();
    free.iter().step_by(stride).map(nearest).filter(|d| d.is_finite()).collect()
}

/// Number of connected chains of segments; ends are shared bit by bit.
fn outlines(walls: &[[Vec2; 2]]) -> usize {
    let mut numbers: BTreeMap<[u32; 2], usize> = BTreeMap::new();
    let mut parent: Vec<usize> = Vec::new();
    let root = |mut n: usize, parent: &mut Vec<usize>| {
        while parent[n] != n {
            parent[n] = parent[parent[n]];
            n = parent[n];
        }
        n
    };
    for wall in walls {
        let [a, b] = wall.map(|p| {
            *numbers.entry([p.x, p.y].map(|c| (c + 0.0).to_bits())).or_insert_with(|| {
                parent.push(parent.len());
                parent.len() - 1
            })
        });
        let (a, b) = (root(a, &mut parent), root(b, &mut parent));
        parent[a] = b;
    }
    (0..parent.len()).filter(|&n| parent[n] == n).count()
}

/// Mean and standard deviation of a figure.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Spread {
    /// Mean.
    pub mean: f64,
    /// Standard deviation of the sample; 0 for one value.
    pub deviation: f64,
}

/// Mean and standard deviation of some values.
pub fn spread(values: impl Iterator<Item = f64> + Clone) -> Spread {
    let count = values.clone().count().max(1) as f64;
    let mean = values.clone().sum::<f64>() / count;
    let squares: f64 = values.map(|v| (v - mean).powi(2)).sum();
    Spread { mean, deviation: (squares / (count - 1.0).max(1.0)).sqrt() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_rooms_have_known_figures() {
        let stats = measure(&Scene::two_rooms());
        let floor = 2.0 * 5.9 * 9.0 + 0.2 * 2.0;
        assert!((stats.floor_area - floor).abs() < 1e-3, "{stats:?}");
        assert!((stats.plane_area - floor).abs() < 2.0, "{stats:?}");
        assert_eq!(stats.nodes, 48);
        assert!((stats.islands - 100.0 / stats.plane_area).abs() < 1e-6, "the pillar is one island: {stats:?}");
        assert_eq!(stats.oblique_share, 0.0);
        assert!(stats.sampled_complexity <= stats.complexity + 1e-9);
        let walls = 2.0 * (5.9 + 9.0) * 2.0 - 2.0 * 2.0 + 2.0 * 0.2 + 4.0 * 0.6;
        assert!((stats.wall_density - walls / stats.plane_area).abs() < 0.02, "{stats:?}");
    }

    #[test]
    fn spreads() {
        assert_eq!(spread([1.0, 3.0].into_iter()), Spread { mean: 2.0, deviation: 2.0_f64.sqrt() });
        assert_eq!(spread([5.0].into_iter()).deviation, 0.0);
        assert_eq!(spread(std::iter::empty()).mean, 0.0);
    }
}
