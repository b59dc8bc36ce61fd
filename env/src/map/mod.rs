//! What the agent knows: the reconstruction, the carved plane, where it has been and where it was stopped.

pub mod cloud;
pub mod density;
pub mod grid;
pub mod kept;
pub mod occupancy;

pub use cloud::Cloud;
pub use density::{DensityGrid, Layers};
pub use kept::Kept;
pub use occupancy::{Cell, OccupancyGrid};

use crate::encode::EncodeConfig;
use crate::pose::{Direction, Lattice, LatticePose, Node, Pose};
use crate::sensor::{Camera, Frame};
use crate::window::WindowSize;
use glam::Vec3;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

/// The agent's memory of one episode.
#[derive(Debug, Clone)]
pub struct AgentMap {
    encode: EncodeConfig,
    density: DensityGrid,
    occupancy: OccupancyGrid,
    cloud: Cloud,
    /// One for each point, or none.
    colours: Vec<[u8; 3]>,
    history: Vec<LatticePose>,
    visits: BTreeMap<LatticePose, u32>,
    traversed: BTreeSet<(Node, Node)>,
    blocked: BTreeMap<(Node, Node), u32>,
}

impl AgentMap {
    /// Nothing known yet.
    pub fn new(encode: &EncodeConfig, floor: f32) -> Self {
        Self {
            encode: *encode,
            density: DensityGrid::new(encode.input(), encode.layers, floor),
            occupancy: OccupancyGrid::default(),
            cloud: Cloud::default(),
            colours: Vec::new(),
            history: Vec::new(),
            visits: BTreeMap::new(),
            traversed: BTreeSet::new(),
            blocked: BTreeMap::new(),
        }
    }

    /// Takes in one frame and what is kept of it.
    pub fn integrate(&mut self, camera: &Camera, pose: &Pose, frame: &Frame, kept: &Kept) {
        self.density.add(&kept.points);
        self.occupancy.carve(camera, pose, frame);
        self.cloud.add(camera.at(pose), frame, &kept.pixels);
        let colours = kept.pixels.iter().filter_map(|&pixel| frame.colour.get(pixel as usize));
        self.colours.extend(colours);
    }

    /// Every point kept so far.
    pub fn cloud(&self) -> &Cloud {
        &self.cloud
    }

    /// Memory that it holds, bytes. The sets of poses and edges, a few thousandths of it, are left out.
    pub fn bytes(&self) -> usize {
        self.density.bytes()
            + self.occupancy.bytes()
            + self.cloud.bytes()
            + self.colours.capacity() * size_of::<[u8; 3]>()
            + self.history.capacity() * size_of::<LatticePose>()
    }

    /// The agent stands at a pose at the end of a step.
    pub fn arrive(&mut self, pose: LatticePose) {
        if let Some(last) = self.history.last().filter(|last| last.node != pose.node) {
            self.traversed.insert(edge(last.node, pose.node));
        }
        self.history.push(pose);
        *self.visits.entry(pose).or_default() += 1;
    }

    /// A move was stopped by an obstacle.
    pub fn bump(&mut self, from: Node, to: Node) {
        *self.blocked.entry(edge(from, to)).or_default() += 1;
    }
}

/// An edge without direction.
fn edge(a: Node, b: Node) -> (Node, Node) {
    if a <= b { (a, b) } else { (b, a) }
}

/// Frames of an episode, to be looked at again. They are not kept, because most policies never do: each is taken anew, with
/// the bits that it had.
pub trait Frames: Sync {
    /// Shows the frames from number `first` on, one for each in [`Cloud::frames`], with the pose that each is believed to
    /// be taken from.
    fn show(&self, first: usize, to: &mut dyn FnMut(&Camera, &Pose, &Frame));
}

impl fmt::Debug for dyn Frames + '_ {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Frames")
    }
}

/// What a policy may look at. No field leads to the mesh or the ground-truth surface.
#[derive(Debug, Clone, Copy)]
pub struct MapView<'a> {
    map: &'a AgentMap,
    lattice: &'a Lattice,
    frames: &'a dyn Frames,
    pose: LatticePose,
    camera: Pose,
    step: usize,
    horizon: usize,
}

impl<'a> MapView<'a> {
    /// The view of an agent at `pose`, which believes its camera at `camera`, after `step` of `horizon` steps.
    pub fn new(
        map: &'a AgentMap,
        lattice: &'a Lattice,
        frames: &'a dyn Frames,
        pose: LatticePose,
        camera: Pose,
        step: usize,
        horizon: usize,
    ) -> Self {
        Self { map, lattice, frames, pose, camera, step, horizon }
    }

    /// Every point kept so far.
    pub fn cloud(&self) -> &'a Cloud {
        &self.map.cloud
    }

    /// Shows the frames from number `first` on again, see [`Frames::show`]. Takes as long as taking them.
    pub fn look_again(&self, first: usize, to: &mut dyn FnMut(&Camera, &Pose, &Frame)) {
        self.frames.show(first, to);
    }

    /// sRGB of each point of the cloud; empty when the sensor or the scene has no colours.
    pub fn cloud_colours(&self) -> &'a [[u8; 3]] {
        &self.map.colours
    }

    /// Points per pixel and layer.
    pub fn density(&self) -> &'a DensityGrid {
        &self.map.density
    }

    /// Size and range of what the network answers; the density has that of its input.
    pub fn window_size(&self) -> WindowSize {
        self.map.encode.window
    }

    /// What the network's input shows.
    pub fn encode_config(&self) -> &'a EncodeConfig {
        &self.map.encode
    }

    /// Known cells of the camera plane.
    pub fn occupancy(&self) -> &'a OccupancyGrid {
        &self.map.occupancy
    }

    /// Whether a node is known to be free, or one step from such a one without a wall seen between: from where the agent can
    /// hope to look.
    pub fn is_within_sight(&self, node: Node) -> bool {
        let at = |node| self.lattice.position(node);
        let cell = |node| self.occupancy().get(OccupancyGrid::cell_of(at(node)));
        let opens = |near| cell(near) == Cell::Free && !self.occupancy().is_wall_between(at(near), at(node));
        match cell(node) {
            Cell::Free => true,
            Cell::Occupied => false,
            Cell::Unknown => Direction::ALL.into_iter().any(|direction| opens(node.step(direction))),
        }
    }

    /// Poses at the end of every step so far, the start first, the current pose last.
    pub fn history(&self) -> &'a [LatticePose] {
        &self.map.history
    }

    /// How often a step ended in a pose.
    pub fn visits(&self, pose: LatticePose) -> u32 {
        self.map.visits.get(&pose).copied().unwrap_or(0)
    }

    /// Whether the agent has moved along an edge, either way.
    pub fn is_traversed(&self, a: Node, b: Node) -> bool {
        self.map.traversed.contains(&edge(a, b))
    }

    /// How often a move along an edge, either way, was stopped.
    pub fn bumps(&self, a: Node, b: Node) -> u32 {
        self.map.blocked.get(&edge(a, b)).copied().unwrap_or(0)
    }

    /// Number of different edges found blocked.
    pub fn blocked_edges(&self) -> usize {
        self.map.blocked.len()
    }

    /// The lattice of poses: the agent's own odometry.
    pub fn lattice(&self) -> &'a Lattice {
        self.lattice
    }

    /// Where the agent is: in the continuous world, the nearest node and heading.
    pub fn pose(&self) -> LatticePose {
        self.pose
    }

    /// Where the agent believes its camera: that of [`MapView::pose`] in the lattice world, and exact in the continuous
    /// one; with pose noise, off by the error of the last frame.
    pub fn camera(&self) -> Pose {
        self.camera
    }

    /// Position of that camera, metres.
    pub fn position(&self) -> Vec3 {
        self.camera.position
    }

    /// Steps spent.
    pub fn step(&self) -> usize {
        self.step
    }

    /// Steps given.
    pub fn horizon(&self) -> usize {
        self.horizon
    }
}

#[cfg(test)]
mod tests {
    use crate::config::SimConfig;
    use crate::episode::{Action, Episode};
    use crate::pose::{Heading, LatticePose, Node};
    use crate::scene::Scene;
    use crate::seed::SeedTree;
    use crate::world::World;
    use std::sync::Arc;

    #[test]
    fn what_is_within_sight_grows_up_to_the_walls() {
        let world = Arc::new(World::new(Scene::two_rooms(), &SimConfig::default()).unwrap());
        let start = LatticePose { node: Node { i: 1, k: 1 }, heading: Heading::new(0) };
        let mut episode = Episode::new(Arc::clone(&world), start, 8, SeedTree::new(1)).unwrap();
        let within = |episode: &Episode| {
            let lattice = *world.scene().lattice();
            let nodes = (0..lattice.len()).map(|index| lattice.node(index));
            nodes.filter(|&node| episode.view().is_within_sight(node)).collect::<Vec<_>>()
        };
        let first = within(&episode);
        let (ahead, behind) = (Node { i: 1, k: 3 }, Node { i: 1, k: -1 });
        assert!(first.contains(&ahead) && !first.contains(&behind));
        for heading in [2, 4, 6] {
            episode.step(Action { direction: None, heading: Heading::new(heading) });
        }
        let all = within(&episode);
        assert!(first.iter().all(|node| all.contains(node)) && all.len() > first.len());
        // The first room, and of the second what the door shows.
        let free = world.scene().graph().largest_component();
        let (near, far): (Vec<Node>, Vec<Node>) = free.iter().partition(|node| node.i < 4);
        assert!(near.iter().filter(|node| all.contains(node)).count() > near.len() / 2);
        assert!(far.iter().any(|node| all.contains(node)) && !far.iter().all(|node| all.contains(node)), "{all:?}");
    }
}
