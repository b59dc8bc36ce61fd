//! What a set of scenes is like: areas, navigation complexity, walls, clearance.
//!
//! Works on any scene that loads, published ones included. Lengths are metres, areas square metres of plan.

use crate::navigation::Navigation;
use glam::{Vec2, Vec3};
use nbp_env::check::Escape;
use nbp_env::pose::{CAMERA_HEIGHT, Lattice};
use nbp_env::scene::{Interior, LatticeGraph};
use nbp_env::{Node, Scene, SeedTree};
use serde::Serialize;
use std::collections::BTreeSet;

/// Resolution of the areas in the camera plane.
const FINE: f32 = 0.25;

/// Clearance is measured at about this many places.
const CLEARANCE_SAMPLES: usize = 4000;

/// Faces are looked at from this far.
const OFF_WALL: f32 = 0.01;

/// The floor of a scan lies within this of its usual height, metres; tables do not.
const FLOOR_RELIEF: f32 = 0.5;

/// The figures of one scene. Names are the keys of the JSON that `dataset stats --json` writes.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SceneStats {
    /// Scene.
    pub name: String,
    /// Area of the faces with free space above them.
    pub floor_area_m2: f64,
    /// Largest area that is connected in the camera plane.
    pub connected_area_m2: f64,
    /// Accessibility: the connected area over the floor area. The paper asks whether doors and windows can be passed; where
    /// one cannot, what lies behind it is missing here.
    pub accessible_share: f64,
    /// Connected positions on the 1.5 m lattice.
    pub positions: usize,
    /// Largest ratio of walking to straight distance, all pairs of these positions.
    pub navigation_complexity: f64,
    /// The same over a random share of the pairs, as the paper measures it: a lower bound.
    pub navigation_complexity_sampled: f64,
    /// Faces of the mesh.
    pub triangles: usize,
    /// Share of rays from inside that meet no surface: 0 for a closed mesh.
    pub escaping_ray_share: f64,
    /// Share of the surface that can be seen from reachable poses, see [`visible_share`](nbp_env::visible::visible_share);
    /// `None` where it was not measured.
    pub visible_share: Option<f64>,
    /// Floor area over the area of the bounding box.
    pub fill_share: f64,
    /// Wall length in the camera plane over the area that is connected there.
    pub wall_length_m_per_m2: f64,
    /// Share of that wall length that is not parallel to an axis.
    pub oblique_wall_share: f64,
    /// Median distance from a free place to the nearest wall.
    pub clearance_p50_m: f64,
    /// 90th percentile of the same.
    pub clearance_p90_m: f64,
    /// Wall outlines, other than the outer one, for each 100 m².
    pub islands_per_100_m2: f64,
}

/// Measures all but what can be seen, which takes far longer than the rest.
pub fn measure(scene: &Scene) -> SceneStats {
    let navigation = Navigation::of(scene.graph());
    let floor_area = floor_area(scene);
    let [low, high] = scene.mesh().bounds();
    let fine = fine_lattice(scene);
    let free: Vec<Vec2> = fine.largest_component().iter().map(|&n| flat(fine.lattice().position(n))).collect();
    let plane_area = free.len() as f64 * f64::from(FINE * FINE);
    let walls = walls_around(scene, &fine);
    let length = |wall: &[Vec2; 2]| f64::from(wall[0].distance(wall[1]));
    let wall_length: f64 = walls.iter().map(length).sum();
    let oblique: f64 = walls.iter().filter(|wall| is_oblique(**wall)).map(length).sum();
    let mut clearance = clearances(&free, &walls);
    clearance.sort_unstable_by(f32::total_cmp);
    let percentile = |p: usize| clearance.get(clearance.len() * p / 100).map_or(0.0, |&c| f64::from(c));
    SceneStats {
        name: scene.name().into(),
        floor_area_m2: floor_area,
        connected_area_m2: plane_area,
        accessible_share: ratio(plane_area, floor_area),
        positions: navigation.nodes().len(),
        navigation_complexity: navigation.complexity().ratio,
        navigation_complexity_sampled: navigation.sampled_complexity(published_share(plane_area), SeedTree::new(0)),
        triangles: scene.mesh().triangles().len(),
        escaping_ray_share: Escape::of(scene).share(),
        visible_share: None,
        fill_share: floor_area / f64::from((high.x - low.x) * (high.z - low.z)),
        wall_length_m_per_m2: ratio(wall_length, plane_area),
        oblique_wall_share: ratio(oblique, wall_length),
        clearance_p50_m: percentile(50),
        clearance_p90_m: percentile(90),
        islands_per_100_m2: ratio(100.0 * outlines(scene.walls(), &walls).saturating_sub(1) as f64, plane_area),
    }
}

/// Share of the pairs that the paper samples, by the size of the map: 1, 0.1, 0.05 and 0.02 % for its levels of 633, 1348,
/// 3214 and 5488 m².
fn published_share(area: f64) -> f64 {
    match area {
        a if a < 900.0 => 0.01,
        a if a < 2100.0 => 0.001,
        a if a < 4200.0 => 0.0005,
        _ => 0.0002,
    }
}

/// Whether a face is a floor with free space above it: a point just over it is inside, or in a scan, where that says little,
/// it is near the height of the floor and a camera over it is inside. Faces may be wound either way.
pub(crate) fn is_floor(scene: &Scene, [a, b, c]: [Vec3; 3]) -> bool {
    let normal = (b - a).cross(c - a);
    if normal.y.abs() < 0.5 * normal.length() {
        return false;
    }
    let above = (a + b + c) / 3.0 + OFF_WALL * Vec3::Y;
    match scene.graph().interior() {
        Interior::Closed => scene.rays().crossings(above, Vec3::NEG_Y).len() % 2 == 1,
        Interior::Open => {
            let eye = above + CAMERA_HEIGHT * Vec3::Y;
            (eye.y - scene.lattice().origin.y).abs() < FLOOR_RELIEF && Interior::Open.contains(scene.rays(), eye)
        }
    }
}

/// Area in plan of the faces with free space above them, m².
pub fn floor_area(scene: &Scene) -> f64 {
    let floors = scene.mesh().iter_corners().filter(|&corners| is_floor(scene, corners));
    floors.map(|[a, b, c]| f64::from((b - a).cross(c - a).y.abs()) / 2.0).sum()
}

/// Largest area that is connected in the camera plane, m².
pub fn connected_area(scene: &Scene) -> f64 {
    fine_lattice(scene).largest_component().len() as f64 * f64::from(FINE * FINE)
}

fn ratio(a: f64, b: f64) -> f64 {
    // Empty sums of floats are -0.
    if b > 0.0 { a / b + 0.0 } else { 0.0 }
}

fn flat(p: Vec3) -> Vec2 {
    Vec2::new(p.x, p.z)
}

/// The camera plane at a finer step than the agent's, half a fine step off its lattice: walls on round numbers, which are
/// common, then pass between the places and areas are not biased.
fn fine_lattice(scene: &Scene) -> LatticeGraph {
    let [low, high] = scene.mesh().bounds();
    let coarse = scene.lattice().origin;
    let first = |at: f32, low: f32| at - ((at - low) / FINE - 0.5).floor() * FINE - 0.5 * FINE;
    let origin = Vec3::new(first(coarse.x, low.x), coarse.y, first(coarse.z, low.z));
    let size = [(high.x - origin.x) / FINE, (high.z - origin.z) / FINE].map(|n| n.max(0.0) as i32 + 1);
    LatticeGraph::inside(scene.graph().interior(), Lattice { origin, spacing: FINE, size }, scene.rays())
}

/// Walls at the camera plane that a free place within reach sees, so that walls of closed-off pockets do not count.
fn walls_around(scene: &Scene, fine: &LatticeGraph) -> Vec<[Vec2; 2]> {
    let places: BTreeSet<Node> = fine.largest_component().iter().copied().collect();
    let height = fine.lattice().origin.y;
    let is_seen = |wall: &[Vec2; 2]| {
        let (middle, along) = ((wall[0] + wall[1]) / 2.0, (wall[1] - wall[0]).normalize_or_zero());
        [along.perp(), -along.perp()].into_iter().any(|out| {
            let eye = middle + OFF_WALL * out;
            let eye = Vec3::new(eye.x, height, eye.y);
            let near = fine.lattice().nearest(eye);
            let around = (-1..=1).flat_map(|di| (-1..=1).map(move |dk| Node { i: near.i + di, k: near.k + dk }));
            around
                .filter(|node| places.contains(node))
                .any(|node| !scene.rays().segment_is_blocked(eye, fine.lattice().position(node)))
        })
    };
    scene.walls().iter().copied().filter(is_seen).collect()
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

/// Number of outlines, connected chains of `all` segments, to which one of the `seen` belongs. Ends are shared bit by bit.
fn outlines(all: &[[Vec2; 2]], seen: &[[Vec2; 2]]) -> usize {
    let key = |p: Vec2| [p.x, p.y].map(|c| (c + 0.0).to_bits());
    let mut corners: Vec<[u32; 2]> = all.iter().flatten().map(|&p| key(p)).collect();
    corners.sort_unstable();
    corners.dedup();
    let number = |p: Vec2| corners.binary_search(&key(p)).unwrap_or(0);
    let mut parent: Vec<usize> = (0..corners.len()).collect();
    let root = |mut n: usize, parent: &mut [usize]| {
        while parent[n] != n {
            parent[n] = parent[parent[n]];
            n = parent[n];
        }
        n
    };
    for wall in all {
        let [a, b] = wall.map(|p| root(number(p), &mut parent));
        parent[a] = b;
    }
    let chains: BTreeSet<usize> = seen.iter().map(|wall| root(number(wall[0]), &mut parent)).collect();
    chains.len()
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
        assert!((stats.floor_area_m2 - floor).abs() < 1e-3, "{stats:?}");
        assert!((stats.connected_area_m2 - floor).abs() < 2.0, "{stats:?}");
        assert_eq!(stats.positions, 48);
        assert!(
            (stats.islands_per_100_m2 - 100.0 / stats.connected_area_m2).abs() < 1e-6,
            "the pillar is one island: {stats:?}"
        );
        assert_eq!(stats.oblique_wall_share, 0.0);
        assert!(stats.navigation_complexity_sampled <= stats.navigation_complexity + 1e-9);
        let walls = 2.0 * (5.9 + 9.0) * 2.0 - 2.0 * 2.0 + 2.0 * 0.2 + 4.0 * 0.6;
        assert_eq!(stats.escaping_ray_share, 0.0);
        assert!((stats.wall_length_m_per_m2 - walls / stats.connected_area_m2).abs() < 0.02, "{stats:?}");
    }

    #[test]
    fn spreads() {
        assert_eq!(spread([1.0, 3.0].into_iter()), Spread { mean: 2.0, deviation: 2.0_f64.sqrt() });
        assert_eq!(spread([5.0].into_iter()).deviation, 0.0);
        assert_eq!(spread(std::iter::empty()).mean, 0.0);
    }
}
