//! Where the camera may be in a storey: the best lattice, how to tell inside from outside, start positions.

use super::ImportError;
use glam::{Vec2, Vec3};
use nbp_env::SeedTree;
use nbp_env::pose::{CAMERA_HEIGHT, Lattice};
use nbp_env::scene::settings::LATTICE_STEP;
use nbp_env::scene::{Interior, LatticeGraph, Mesh, RayIndex, Settings};
use rayon::prelude::*;
use std::f32::consts::TAU;

/// Lattices tried along each axis of a small storey.
const PHASES: u16 = 6;

/// Positions tried in all; larger storeys get fewer lattices, among which there is less to choose.
const TRIES: f32 = 500_000.0;

/// Keeps nodes and the plumb lines through them off walls on round numbers, metres.
const OFF_GRID: Vec2 = Vec2::new(0.013, 0.017);

/// Start positions in a scene (the paper tests five a scene).
const STARTS: usize = 5;

/// Fewer connected positions are no scene.
const LEAST_NODES: usize = 2;

/// Rays from each position that must not leave a closed mesh.
const RAYS: usize = 64;

/// The lattice of a storey whose floor is at `y = 0`.
pub(super) struct Placed {
    pub(super) settings: Settings,
    /// Connected positions.
    pub(super) nodes: usize,
    /// Positions that are free, connected or not.
    pub(super) free: usize,
}

/// Finds the lattice with the most connected positions, and start positions that depend on the scene's name only.
pub(super) fn place(mesh: &Mesh, name: &str, storey: usize) -> Result<Placed, ImportError> {
    let rays = RayIndex::build(mesh);
    let bounds = mesh.bounds();
    let open = best(Interior::Open, bounds, &rays);
    let closed = best(Interior::Closed, bounds, &rays);
    let nodes = |found: &(Settings, LatticeGraph)| found.1.largest_component().len();
    // A closed mesh needs no guess about its inside.
    let is_closed = nodes(&closed) >= nodes(&open) && holds_rays(&closed.1, &rays);
    let (mut settings, graph) = if is_closed { closed } else { open };
    settings.scene.open = !is_closed;
    let nodes = graph.largest_component().len();
    if nodes < LEAST_NODES {
        return Err(ImportError::NoRoom { storey, nodes, need: LEAST_NODES });
    }
    let seed = name.bytes().fold(SeedTree::new(0), |tree, byte| tree.child("starts", u64::from(byte)));
    let starts = graph.spread_poses(STARTS, seed);
    settings.camera.start_positions =
        starts.iter().map(|pose| [pose.node.i, 0, pose.node.k, 2, pose.heading.index() as i32]).collect();
    let lattice = graph.lattice();
    let free = (0..lattice.len()).filter(|&index| graph.is_free(lattice.node(index))).count();
    Ok(Placed { settings, nodes, free })
}

fn best(interior: Interior, bounds: [Vec3; 2], rays: &RayIndex) -> (Settings, LatticeGraph) {
    let size = (bounds[1] - bounds[0]) / LATTICE_STEP;
    let phases = ((TRIES / (size.x * size.z)).sqrt() as u16).clamp(1, PHASES);
    let one = |phase: u16| {
        let steps = Vec2::new(f32::from(phase / phases), f32::from(phase % phases)) + 0.5;
        let settings = Settings::for_box(bounds, 0.0, steps * LATTICE_STEP / f32::from(phases) + OFF_GRID);
        let camera = &settings.camera;
        let lattice = Lattice {
            origin: Vec3::from(camera.x_min) + CAMERA_HEIGHT * Vec3::Y,
            spacing: LATTICE_STEP,
            size: [camera.pose_l, camera.pose_h],
        };
        (settings, LatticeGraph::inside(interior, lattice, rays))
    };
    let all: Vec<(Settings, LatticeGraph)> = (0..phases * phases).into_par_iter().map(one).collect();
    // The first of equals.
    let better = |a: (Settings, LatticeGraph), b: (Settings, LatticeGraph)| {
        if b.1.largest_component().len() > a.1.largest_component().len() { b } else { a }
    };
    all.into_iter().reduce(better).unwrap_or_else(|| one(0))
}

/// Whether no ray from the connected positions leaves the mesh.
fn holds_rays(graph: &LatticeGraph, rays: &RayIndex) -> bool {
    let is_hit = |node, n: usize| {
        // Directions spread over the sphere along a spiral.
        let y = (2 * n + 1) as f32 / RAYS as f32 - 1.0;
        let (sin, cos) = (TAU * 0.618_034 * n as f32).sin_cos();
        let flat = (1.0 - y * y).sqrt();
        rays.nearest(graph.lattice().position(node), Vec3::new(flat * sin, y, flat * cos), f32::INFINITY).is_some()
    };
    graph.largest_component().par_iter().all(|&node| (0..RAYS).all(|n| is_hit(node, n)))
}
