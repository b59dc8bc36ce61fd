//! The houses, poses to look from, and walks through them.

use crate::MEMORY;
use crate::scenes::{Dice, rooms};
use glam::Vec3;
use nbp_env::scene::load::infer_settings;
use nbp_env::scene::{Mesh, RayIndex};
use nbp_env::{Action, Direction, Episode, Heading, LatticePose, Pose, Scene, SeedTree, SimConfig, World};
use serde_json::{Map, Value, json};
use std::collections::HashMap;
use std::error::Error;
use std::sync::Arc;

/// Side of the houses, metres.
const SIDE: f32 = 36.0;

/// Longest edges that give about 5 k, 63 k and 490 k triangles, metres.
const CELLS: [f32; 3] = [2.2, 0.43, 0.147];

/// Poses that frames are taken from.
const POSES: usize = 16;

/// A house with all that its episodes share.
pub(crate) struct House {
    pub(crate) world: Arc<World>,
    pub(crate) poses: Vec<Pose>,
    /// Memory of the world, bytes.
    pub(crate) bytes: usize,
}

/// The three houses, the small one first.
pub(crate) fn all() -> Result<Vec<House>, Box<dyn Error>> {
    CELLS.into_iter().map(House::new).collect()
}

impl House {
    fn new(cell: f32) -> Result<Self, Box<dyn Error>> {
        let before = MEMORY.current_usage();
        let (vertices, triangles) = rooms(SIDE, cell, 7);
        let mesh = Mesh::new(vertices, triangles)?;
        let settings = infer_settings(&mesh);
        let world = Arc::new(World::new(Scene::new("house", mesh, &settings)?, &SimConfig::default())?);
        let bytes = MEMORY.current_usage() - before;
        Ok(Self { poses: free_poses(world.scene().rays()), world, bytes })
    }

    pub(crate) fn triangles(&self) -> usize {
        self.world.scene().mesh().triangles().len()
    }

    pub(crate) fn about(&self) -> Map<String, Value> {
        Map::from_iter([("triangles".to_owned(), json!(self.triangles()))])
    }

    /// A start of the scene's, another one for each `number` while there are some.
    pub(crate) fn start(&self, number: usize) -> LatticePose {
        let starts = self.world.scene().starts();
        starts[number % starts.len()]
    }

    /// An episode from a start.
    pub(crate) fn episode(&self, start: LatticePose, horizon: usize) -> Result<Episode, Box<dyn Error>> {
        Ok(Episode::new(Arc::clone(&self.world), start, horizon, SeedTree::new(1))?)
    }

    /// A walk that goes where it has been least, and looks anywhere. No move is stopped: each step has all its captures.
    pub(crate) fn walk(&self, start: LatticePose, steps: usize, seed: u64) -> Vec<Action> {
        let (mut node, mut visits, mut dice) = (start.node, HashMap::new(), Dice(seed));
        let mut action = |_| {
            *visits.entry(node).or_insert(0_u32) += 1;
            let graph = self.world.scene().graph();
            let ways = Direction::ALL.into_iter().filter(|&way| graph.is_passable(node, node.step(way)));
            let rank = |way: &Direction| visits.get(&node.step(*way)).copied().unwrap_or(0);
            let least = ways.map(|way| (rank(&way) as f32 + dice.between(0.0, 0.9), way));
            let direction = least.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, way)| way);
            node = direction.map_or(node, |way| node.step(way));
            Action { direction, heading: Heading::new(dice.between(0.0, 8.0) as usize) }
        };
        (0..steps).map(&mut action).collect()
    }

    /// The poses of the captures of a walk's steps.
    pub(crate) fn captures(&self, start: LatticePose, walk: &[Action]) -> Vec<Vec<Pose>> {
        let (lattice, count) = (self.world.scene().lattice(), self.world.config().captures);
        let mut from = start;
        let captures = |action: &Action| {
            let node = action.direction.map_or(from.node, |way| from.node.step(way));
            let to = LatticePose { node, heading: action.heading };
            let (a, b) = (lattice.pose(from), lattice.pose(to));
            from = to;
            (1..=count).map(|n| a.interpolate(&b, n as f32 / count as f32)).collect()
        };
        walk.iter().map(captures).collect()
    }
}

/// Poses at camera height that keep half a metre from every wall.
fn free_poses(rays: &RayIndex) -> Vec<Pose> {
    let mut dice = Dice(3);
    let mut poses = Vec::new();
    while poses.len() < POSES {
        let position = dice.point(Vec3::new(0.5, 1.65, 0.5), Vec3::new(SIDE - 0.5, 1.65, SIDE - 0.5));
        let azimuth = dice.between(0.0, std::f32::consts::TAU);
        let around = (0..16).map(|k| Pose { position, azimuth: k as f32 * std::f32::consts::TAU / 16.0 }.forward());
        if around.into_iter().all(|direction| rays.nearest(position, direction, 0.5).is_none()) {
            poses.push(Pose { position, azimuth });
        }
    }
    poses
}
