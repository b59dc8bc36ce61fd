//! One episode: an agent in a scene, a number of steps, and what it has seen.

use crate::coverage::{Counting, Coverage, CoverageConfig, Surface};
use crate::encode::{EncodeConfig, encode};
use crate::map::{AgentMap, Kept, MapView};
use crate::motion::{Agent, Motion, Walker};
use crate::noise::{NoiseConfig, PoseError};
use crate::pilot;
use crate::pose::{Direction, HEADINGS, Heading, LatticePose, Node, Pose};
use crate::predict::EncoderInput;
use crate::scene::slice::ObstacleGrid;
use crate::scene::{Scene, SceneError};
use crate::seed::{Rng, SeedTree};
use crate::sensor::{Camera, CameraError, Colour, Frame, RgbdCamera, Sensor};
use crate::visibility::{Visibility, VisibilityCache};
use glam::Vec3;
use rand::RngExt as _;
use rand::seq::IndexedRandom as _;
use serde::{Deserialize, Serialize};
use std::sync::{Arc, OnceLock};

/// One step of the lattice agent: stay or move to a neighbour, and look somewhere (paper, section 5.1: 4 moves, 8
/// headings).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct Action {
    /// `None` turns on the spot.
    pub direction: Option<Direction>,
    /// Heading at the end of the step.
    pub heading: Heading,
}

/// What a policy wants next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Decision {
    /// A move on the lattice and a heading.
    Action(Action),
    /// A motion of the continuous agent.
    Motion(Motion),
}

/// The simulator's settings, the same for every policy that is compared.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SimConfig {
    /// What moves: `kind = "lattice"` or `kind = "continuous"`, with the settings of its motions.
    pub agent: Agent,
    /// The depth camera.
    pub camera: Camera,
    /// Colours of images and of the cloud: `off`, `nearest` or `bilinear`. Nothing but them depends on it; scenes must be
    /// loaded with their colours.
    pub colour: Colour,
    /// Errors of depths and believed poses, off by default.
    pub noise: NoiseConfig,
    /// What the network sees.
    pub encode: EncodeConfig,
    /// How coverage is measured.
    pub coverage: CoverageConfig,
    /// Share of a frame's pixels that become points, rounded to one in a whole number (released code: 0.05, one in 20).
    pub keep: f32,
    /// Captures during a step, the one at its end included (released code: 4). A motion has one.
    pub captures: usize,
}

impl Default for SimConfig {
    fn default() -> Self {
        Self {
            agent: Agent::Lattice,
            camera: Camera::default(),
            colour: Colour::Off,
            noise: NoiseConfig::default(),
            encode: EncodeConfig::default(),
            coverage: CoverageConfig::default(),
            keep: 0.05,
            captures: 4,
        }
    }
}

/// A setting that the simulator cannot work with.
#[derive(Debug, thiserror::Error)]
pub enum SimError {
    /// In the camera.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// The scene has no room for the agent.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// Nothing to cover.
    #[error(
        "scene {scene}: no triangle lies in the box from {low} to {high} m: check scene.x_min, scene.x_max and the units"
    )]
    NoSurface {
        /// Scene name.
        scene: String,
        /// Lower corner of its box.
        low: Vec3,
        /// Upper corner.
        high: Vec3,
    },
    /// Anywhere else.
    #[error("sim.{field} is {value}: it must be {want}")]
    Field {
        /// Path of the setting.
        field: &'static str,
        /// As given.
        value: String,
        /// What is accepted.
        want: &'static str,
    },
}

impl SimConfig {
    /// Checks every setting.
    ///
    /// # Errors
    /// Naming the first setting that is out of range.
    pub fn validate(&self) -> Result<(), SimError> {
        self.camera.validate()?;
        let encode = &self.encode;
        let pixels = encode.window.pixels;
        let is_positive = |v: f32| v.is_finite() && v > 0.0;
        let checks: [(bool, &'static str, String, &'static str); 7] = [
            (
                pixels >= 16 && pixels.is_multiple_of(16) && pixels <= 4096,
                "encode.window.pixels",
                pixels.to_string(),
                "a multiple of 16 from 16 to 4096",
            ),
            (
                is_positive(encode.window.metres) && encode.window.metres <= 10_000.0,
                "encode.window.metres",
                encode.window.metres.to_string(),
                "a positive number of metres",
            ),
            (
                (1..=64).contains(&encode.layers.count),
                "encode.layers.count",
                encode.layers.count.to_string(),
                "from 1 to 64",
            ),
            (
                is_positive(encode.layers.top - encode.layers.bottom),
                "encode.layers.top",
                encode.layers.top.to_string(),
                "above encode.layers.bottom",
            ),
            (
                (1..=10_000_000).contains(&self.coverage.points) && (1e-6..=1e3).contains(&self.coverage.epsilon),
                "coverage",
                format!("{} points, epsilon {}", self.coverage.points, self.coverage.epsilon),
                "from 1 to 10,000,000 points and a positive epsilon from 1 µm to 1 km",
            ),
            (self.keep > 0.0 && self.keep <= 1.0, "keep", self.keep.to_string(), "above 0 and at most 1"),
            ((1..=64).contains(&self.captures), "captures", self.captures.to_string(), "from 1 to 64"),
        ];
        let motions = match &self.agent {
            Agent::Lattice => None,
            Agent::Continuous(config) => config.fault(),
        };
        let fault = checks.into_iter().find(|(ok, ..)| !ok).map(|(_, field, value, want)| (field, value, want));
        match fault.or(motions).or(self.noise.fault()) {
            Some((field, value, want)) => Err(SimError::Field { field, value, want }),
            None => Ok(()),
        }
    }
}

/// A scene with all that its episodes share. Built once, used by many threads.
#[derive(Debug)]
pub struct World {
    scene: Scene,
    surface: Surface,
    obstacles: ObstacleGrid,
    sensor: RgbdCamera,
    config: SimConfig,
    visibility: OnceLock<VisibilityCache>,
}

impl World {
    /// Prepares a scene for episodes, with a lattice laid anew where the agent is continuous.
    ///
    /// # Errors
    /// When a setting is out of range, the scene has no surface to cover, or no room for the agent.
    pub fn new(scene: Scene, config: &SimConfig) -> Result<Self, SimError> {
        config.validate()?;
        let scene = match &config.agent {
            Agent::Lattice => scene,
            Agent::Continuous(agent) => scene.for_robot(agent.camera_height, agent.lattice_step, agent.clearance())?,
        };
        let surface = Surface::of(&scene, &config.coverage);
        if surface.is_empty() {
            let [low, high] = scene.bounds();
            return Err(SimError::NoSurface { scene: scene.name().into(), low, high });
        }
        Ok(Self {
            surface,
            obstacles: ObstacleGrid::draw(scene.walls(), config.encode.window),
            sensor: RgbdCamera { camera: config.camera, colour: config.colour },
            config: config.clone(),
            visibility: OnceLock::new(),
            scene,
        })
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Ground-truth surface points.
    pub fn surface(&self) -> &Surface {
        &self.surface
    }

    /// Ground-truth obstacles of the camera plane.
    pub fn obstacles(&self) -> &ObstacleGrid {
        &self.obstacles
    }

    /// A pose drawn from the nodes of the largest connected component and all headings: where [`Episode::reset`] starts.
    pub fn random_start(&self, seed: SeedTree) -> LatticePose {
        let mut rng = seed.child("start", 0).rng();
        // A scene without a free node is refused, so the first start is never asked for.
        let nodes = self.scene.graph().largest_component();
        let node = nodes.choose(&mut rng).copied().unwrap_or(self.scene.starts()[0].node);
        LatticePose { node, heading: Heading::new(rng.random_range(0..HEADINGS)) }
    }

    /// Whether an agent can stand there.
    ///
    /// # Errors
    /// Naming the node that is outside the lattice or not free.
    pub fn check_start(&self, LatticePose { node, .. }: LatticePose) -> Result<(), StartError> {
        let (scene, lattice) = (self.scene.name(), self.scene.lattice());
        if !lattice.contains(node) {
            return Err(StartError::Outside { scene: scene.into(), node, size: lattice.size });
        }
        match self.scene.graph().is_free(node) {
            true => Ok(()),
            false => Err(StartError::Blocked { scene: scene.into(), node, position: lattice.position(node) }),
        }
    }

    /// What its lattice poses see. Nothing is computed before it is asked for.
    pub fn visibility(&self) -> Visibility<'_> {
        let new = || VisibilityCache::new(self.surface.points(), self.scene.lattice());
        Visibility::new(self, self.visibility.get_or_init(new))
    }

    /// The camera.
    pub fn sensor(&self) -> &RgbdCamera {
        &self.sensor
    }

    /// Settings.
    pub fn config(&self) -> &SimConfig {
        &self.config
    }
}

/// A start pose where no agent can stand.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum StartError {
    /// Not a node of the lattice.
    #[error(
        "scene {scene}: start ({}, {}) is outside the lattice, which has nodes from (0, 0) to ({}, {}): take one of \
         Scene::starts or World::random_start", node.i, node.k, size[0] - 1, size[1] - 1
    )]
    Outside {
        /// Scene name.
        scene: String,
        /// As given.
        node: Node,
        /// Nodes along `x` and `z`.
        size: [i32; 2],
    },
    /// A node that is not free.
    #[error(
        "scene {scene}: start ({}, {}) at {position:.2} m is in a wall or outside the building: take one of Scene::starts \
         or World::random_start", node.i, node.k
    )]
    Blocked {
        /// Scene name.
        scene: String,
        /// As given.
        node: Node,
        /// Where the camera would be, metres.
        position: Vec3,
    },
}

/// What a step did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepOutcome {
    /// The move hit an obstacle: the agent stayed, the step is spent. In the continuous world it may have come a part of
    /// the way.
    pub bumped: bool,
    /// Covered share after the step.
    pub coverage: f32,
}

/// An agent on its way.
///
/// - Observation: [`Episode::view`] (what the agent knows) and [`Episode::encode`] (the same as the network's input). The
///   first frame is taken at the start, before any step.
/// - Action: [`Action`], a move to one of four neighbours or none, and one of eight headings. A move into an obstacle
///   spends the step and leaves the agent where and as it was; [`StepOutcome::bumped`] tells.
///   In the continuous world an action is carried out as motions of one step each, see [`Episode::step`]; and
///   [`Episode::move_by`] performs a single [`Motion`].
/// - Reward: the growth of [`StepOutcome::coverage`], the share of the ground-truth surface that has been reconstructed.
/// - Termination: [`Episode::is_over`], after `horizon` steps; nothing ends an episode earlier, and steps after it do nothing.
///
/// The same world, start, horizon, seed and actions give the same bits.
///
/// ```
/// use nbp_env::policy::{Policy, random::Random};
/// use nbp_env::{Episode, Scene, SeedTree, SimConfig, World};
/// use std::sync::Arc;
///
/// let world = Arc::new(World::new(Scene::two_rooms(), &SimConfig::default())?);
/// let mut episode = Episode::new(Arc::clone(&world), world.scene().starts()[0], 10, SeedTree::new(1))?;
/// for round in 0..2 {
///     let mut rng = SeedTree::new(round).rng();
///     let mut before = episode.curve()[0];
///     while !episode.is_over() {
///         let action = Random.act(&episode.view(), &mut rng)?;
///         let reward = episode.step(action).coverage - before;
///         assert!(reward >= 0.0);
///         before += reward;
///     }
///     assert!(episode.coverage().share() > 0.2);
///     episode.reset(SeedTree::new(round));
///     assert_eq!(episode.steps(), 0);
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Episode {
    world: Arc<World>,
    map: AgentMap,
    coverage: Coverage,
    pose: LatticePose,
    /// The body, in the continuous world.
    walker: Option<Walker>,
    /// True camera pose at the start and after each step.
    track: Vec<Pose>,
    step: usize,
    horizon: usize,
    pixels: SeedTree,
    noise: SeedTree,
    /// Of the last frame's pose.
    error: Option<PoseError>,
    sampling: SeedTree,
    frame: Frame,
    curve: Vec<f32>,
    covered: Vec<usize>,
    bumps: usize,
    path_length: f32,
}

impl Episode {
    /// Puts an agent down at `start` and takes the first frame. `seed` draws which pixels become points.
    ///
    /// # Errors
    /// When the start is outside the lattice, in a wall or outside the building.
    pub fn new(world: Arc<World>, start: LatticePose, horizon: usize, seed: SeedTree) -> Result<Self, StartError> {
        world.check_start(start)?;
        Ok(Self::begin(world, start, horizon, seed, Frame::default()))
    }

    /// An episode where `seed` starts it: at [`World::random_start`].
    pub fn random(world: Arc<World>, horizon: usize, seed: SeedTree) -> Self {
        let start = world.random_start(seed);
        Self::begin(world, start, horizon, seed, Frame::default())
    }

    /// Begins anew in the same world with the same horizon, where `seed` starts it: at [`World::random_start`]. The same
    /// bits as a new episode.
    pub fn reset(&mut self, seed: SeedTree) {
        self.restart(self.world.random_start(seed), seed);
    }

    /// Begins anew at `start` in the same world with the same horizon: the same bits as a new episode.
    ///
    /// # Errors
    /// As [`Episode::new`]; the episode then stays as it was.
    pub fn reset_at(&mut self, start: LatticePose, seed: SeedTree) -> Result<(), StartError> {
        self.world.check_start(start)?;
        self.restart(start, seed);
        Ok(())
    }

    fn restart(&mut self, start: LatticePose, seed: SeedTree) {
        let frame = std::mem::take(&mut self.frame);
        *self = Self::begin(Arc::clone(&self.world), start, self.horizon, seed, frame);
    }

    /// `start` is free. `frame` lends its memory.
    fn begin(world: Arc<World>, start: LatticePose, horizon: usize, seed: SeedTree, frame: Frame) -> Self {
        let encode = &world.config.encode;
        let map = AgentMap::new(encode.window, encode.layers, world.scene.floor());
        let pose = world.scene.lattice().pose(start);
        let walker = match world.config.agent {
            Agent::Lattice => None,
            Agent::Continuous(config) => Some(Walker::new(config, pose)),
        };
        let mut episode = Self {
            map,
            coverage: Coverage::new(&world.surface),
            pose: start,
            walker,
            track: Vec::new(),
            step: 0,
            horizon,
            pixels: seed.child("pixels", 0),
            noise: seed.child("noise", 0),
            error: None,
            sampling: seed.child("coverage", 0),
            frame,
            curve: Vec::new(),
            covered: Vec::new(),
            bumps: 0,
            path_length: 0.0,
            world,
        };
        episode.capture(&pose, 0);
        episode.arrive();
        episode
    }

    /// Performs an action. After the horizon nothing happens any more.
    ///
    /// In the lattice world it is one step. In the continuous world the agent walks to the neighbouring node and turns to
    /// the heading, see [`pilot`]; each motion is a step, the horizon may end them anywhere, and the first one that is
    /// blocked ends the action. Where there is nothing to do, one step is spent standing.
    pub fn step(&mut self, action: Action) -> StepOutcome {
        let bumped = match self.walker {
            _ if self.is_over() => false,
            None => self.jump(action),
            Some(_) => self.walk(action),
        };
        StepOutcome { bumped, coverage: self.share() }
    }

    /// Performs one motion of the continuous agent, which is one step. After the horizon nothing happens any more. An
    /// agent of the lattice world has no motions: it stands, and the step counts as bumped.
    pub fn move_by(&mut self, motion: Motion) -> StepOutcome {
        let bumped = !self.is_over() && !self.perform(Some(motion));
        StepOutcome { bumped, coverage: self.share() }
    }

    /// Performs what [`decide`](crate::policy::decide) said.
    pub fn follow(&mut self, decision: Decision) -> StepOutcome {
        match decision {
            Decision::Action(action) => self.step(action),
            Decision::Motion(motion) => self.move_by(motion),
        }
    }

    /// Whether the agent acts in motions.
    pub fn is_continuous(&self) -> bool {
        self.walker.is_some()
    }

    /// One step to a lattice pose; tells whether it bumped.
    fn jump(&mut self, action: Action) -> bool {
        self.step += 1;
        let node = action.direction.map_or(self.pose.node, |direction| self.pose.node.step(direction));
        let is_stay = action.direction.is_none();
        let bumped = !is_stay && !self.world.scene.graph().is_passable(self.pose.node, node);
        if bumped {
            self.map.bump(self.pose.node, node);
            self.bumps += 1;
        } else {
            let target = LatticePose { node, heading: action.heading };
            let lattice = *self.world.scene.lattice();
            let (from, to) = (lattice.pose(self.pose), lattice.pose(target));
            let captures = self.world.config.captures;
            for n in 1..=captures {
                self.capture(&from.interpolate(&to, n as f32 / captures as f32), n);
            }
            self.path_length += from.position.distance(to.position);
            self.pose = target;
        }
        self.arrive();
        bumped
    }

    /// An action as motions; tells whether one was blocked.
    fn walk(&mut self, action: Action) -> bool {
        let (from, before) = (self.pose.node, self.step);
        let to = action.direction.map(|direction| from.step(direction));
        // By way of its own node, to which the way is free: after a bump the agent stands beside it.
        let bumped = to.is_some_and(|to| !(self.walk_to(from) && self.walk_to(to)));
        if let Some(to) = to.filter(|&to| bumped && to != self.pose.node) {
            self.map.bump(from, to);
        }
        let next_turn = |episode: &Self| pilot::turn_to(episode.walker.as_ref()?, action.heading.azimuth());
        while !bumped
            && !self.is_over()
            && let Some(turn) = next_turn(self)
        {
            self.perform(Some(turn));
        }
        if self.step == before {
            self.perform(None);
        }
        bumped
    }

    /// Walks to a node until there, or over; `false` if the way is blocked.
    fn walk_to(&mut self, node: Node) -> bool {
        let goal = self.world.scene.lattice().position(node);
        while !self.is_over()
            && let Some(motion) = self.walker.as_ref().and_then(|walker| pilot::towards(walker, goal))
        {
            if !self.perform(Some(motion)) {
                return false;
            }
        }
        true
    }

    /// One step of the continuous agent, standing for `None`; tells whether it was possible.
    fn perform(&mut self, motion: Option<Motion>) -> bool {
        self.step += 1;
        let Some(mut walker) = self.walker else {
            self.bumps += 1;
            self.arrive();
            return false;
        };
        let from = walker.pose().position;
        let moved = motion.is_none_or(|motion| walker.attempt(motion, self.world.scene.rays()));
        let pose = walker.pose();
        self.walker = Some(walker);
        self.bumps += usize::from(!moved);
        self.path_length += from.distance(pose.position);
        self.pose = self.nearest(&walker);
        self.capture(&pose, 1);
        self.arrive();
        moved
    }

    /// The nearest lattice pose to which the way is free; on the other side of a wall there is none, and the node stays.
    fn nearest(&self, walker: &Walker) -> LatticePose {
        let (scene, Pose { position, azimuth }) = (&self.world.scene, walker.pose());
        let node = scene.lattice().nearest(position);
        let place = scene.lattice().position(node);
        let is_there = position.distance(place) <= pilot::arrival_distance(walker.config());
        let can_go = || !scene.rays().is_near(position, place, walker.config().radius);
        let node = if node == self.pose.node || is_there || can_go() { node } else { self.pose.node };
        LatticePose { node, heading: Heading::towards(azimuth.sin(), azimuth.cos()) }
    }

    /// Whether all steps are spent.
    pub fn is_over(&self) -> bool {
        self.step >= self.horizon
    }

    /// What a policy may look at.
    pub fn view(&self) -> MapView<'_> {
        let camera = self.believed(&self.camera());
        MapView::new(&self.map, self.world.scene.lattice(), self.pose, camera, self.step, self.horizon)
    }

    /// The network's input at the current pose.
    pub fn encode(&self) -> EncoderInput {
        encode(&self.view(), self.world.config.encode.trajectory)
    }

    /// The world it takes place in.
    pub fn world(&self) -> &Arc<World> {
        &self.world
    }

    /// What has been covered, point by point.
    pub fn coverage(&self) -> &Coverage {
        &self.coverage
    }

    /// Where the agent is.
    pub fn pose(&self) -> LatticePose {
        self.pose
    }

    /// Where its camera truly is.
    pub fn camera(&self) -> Pose {
        self.walker.as_ref().map_or_else(|| self.world.scene.lattice().pose(self.pose), Walker::pose)
    }

    /// Where its camera truly was at the start and after each step.
    pub fn track(&self) -> &[Pose] {
        &self.track
    }

    /// Steps spent.
    pub fn steps(&self) -> usize {
        self.step
    }

    /// Covered share after the start and after each step: `steps + 1` numbers.
    pub fn curve(&self) -> &[f32] {
        &self.curve
    }

    /// Covered points after the start and after each step.
    pub fn covered(&self) -> &[usize] {
        &self.covered
    }

    /// Number of moves that hit an obstacle.
    pub fn bumps(&self) -> usize {
        self.bumps
    }

    /// Metres walked.
    pub fn path_length(&self) -> f32 {
        self.path_length
    }

    /// Memory of this episode alone, bytes: what a further environment in the same world costs.
    pub fn memory_bytes(&self) -> usize {
        let frame =
            self.frame.depth.capacity() * size_of::<f32>() + self.frame.colour.capacity() * size_of::<[u8; 3]>();
        let curves = self.curve.capacity() * size_of::<f32>() + self.covered.capacity() * size_of::<usize>();
        let track = self.track.capacity() * size_of::<Pose>();
        size_of::<Self>() + self.map.bytes() + self.coverage.bytes() + frame + curves + track
    }

    fn arrive(&mut self) {
        self.map.arrive(self.pose);
        self.track.push(self.camera());
        let surface = &self.world.surface;
        let covered = match self.world.config.coverage.counting {
            Counting::Exact => self.coverage.covered(),
            Counting::AsReleased => {
                let mut rng = self.sampling.child("step", self.step as u64).rng();
                let sample = self.map.cloud().sample(&mut rng, 2 * surface.len());
                surface.covered_by(&sample).len()
            }
        };
        self.curve.push(covered as f32 / surface.len() as f32);
        self.covered.push(covered);
    }

    fn share(&self) -> f32 {
        self.curve.last().copied().unwrap_or(0.0)
    }

    fn believed(&self, pose: &Pose) -> Pose {
        self.error.map_or(*pose, |error| error.of(pose))
    }

    fn capture(&mut self, pose: &Pose, number: usize) {
        let world = Arc::clone(&self.world);
        let camera = world.sensor.camera();
        world.sensor.capture(&world.scene, pose, &mut self.frame);
        // By step and capture, so that policies that took different ways still keep the same pixels and meet the same errors.
        let stream = |tree: SeedTree| tree.child("step", self.step as u64).child("capture", number as u64);
        let (mut pixels, noise) = (stream(self.pixels).rng(), stream(self.noise));
        world.config.noise.disturb(&mut self.frame, camera, noise);
        self.error = world.config.noise.pose_error(noise);
        let pose = &self.believed(pose);
        let kept = keep_points(camera, pose, &self.frame, world.config.keep, &mut pixels);
        self.coverage.add(&world.surface, &kept.points, self.step as u32);
        self.map.integrate(camera, pose, &self.frame, &kept);
    }
}

/// A random share of a frame's valid pixels: one pixel at random out of each run of `1 / keep`.
fn keep_points(camera: &Camera, pose: &Pose, frame: &Frame, keep: f32, rng: &mut Rng) -> Kept {
    let run = (1.0 / keep).round().max(1.0) as usize;
    let eye = camera.at(pose);
    let most = frame.depth.len() / run + 1;
    let mut kept = Kept { pixels: Vec::with_capacity(most), points: Vec::with_capacity(most) };
    for begin in (0..frame.depth.len()).step_by(run) {
        let index = begin + rng.random_range(0..run);
        if let Some(&depth) = frame.depth.get(index).filter(|&&depth| depth > 0.0) {
            kept.pixels.push(index as u32);
            kept.points.push(eye.unproject(index % frame.width, index / frame.width, depth));
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::Cloud;

    fn world() -> Arc<World> {
        Arc::new(World::new(Scene::two_rooms(), &SimConfig::default()).unwrap())
    }

    fn start(i: i32, k: i32) -> LatticePose {
        LatticePose { node: crate::Node { i, k }, heading: Heading::new(0) }
    }

    #[test]
    fn a_bump_spends_the_step_and_is_remembered() {
        let mut episode = Episode::new(world(), start(0, 0), 3, SeedTree::new(1)).unwrap();
        let outcome = episode.step(Action { direction: Some(Direction::MinusX), heading: Heading::new(4) });
        assert!(outcome.bumped);
        assert_eq!((episode.pose(), episode.steps(), episode.bumps()), (start(0, 0), 1, 1));
        let outside = episode.pose().node.step(Direction::MinusX);
        assert_eq!(episode.view().bumps(outside, episode.pose().node), 1);
        let outcome = episode.step(Action { direction: Some(Direction::PlusX), heading: Heading::new(2) });
        assert!(!outcome.bumped && episode.path_length() == 1.5);
        assert!(episode.view().is_traversed(start(1, 0).node, start(0, 0).node));
    }

    #[test]
    fn coverage_only_grows_and_looking_around_sees_the_room() {
        let mut episode = Episode::new(world(), start(1, 2), 8, SeedTree::new(2)).unwrap();
        for k in 1..=8 {
            episode.step(Action { direction: None, heading: Heading::new(k) });
        }
        assert!(episode.is_over());
        assert!(episode.curve().windows(2).all(|w| w[1] >= w[0]));
        assert!(episode.curve()[8] > 0.4, "{:?}", episode.curve());
        let again = episode.step(Action { direction: None, heading: Heading::new(0) });
        assert_eq!((episode.steps(), again.coverage), (8, episode.curve()[8]));
    }

    #[test]
    fn the_input_shows_the_agent_in_the_middle_and_its_walls_around() {
        let mut episode = Episode::new(world(), start(1, 2), 2, SeedTree::new(3)).unwrap();
        episode.step(Action { direction: Some(Direction::PlusZ), heading: Heading::new(0) });
        let input = episode.encode();
        assert_eq!((input.channels, input.size()), (5, 256));
        let visits = input.channel(4);
        assert_eq!(visits.iter().sum::<u16>(), 1, "k < t");
        assert_eq!(
            visits[(128 + 10) * 256 + 128] + visits[(128 + 9) * 256 + 128],
            1,
            "it came from -z, which is below"
        );
        assert!(input.channel(2).iter().any(|&c| c > 0));
    }

    #[test]
    fn colours_change_nothing_but_the_colours_of_the_cloud() {
        let [plain, coloured] = [Colour::Off, Colour::Nearest].map(|colour| {
            let world = World::new(Scene::painted_rooms(), &SimConfig { colour, ..SimConfig::default() }).unwrap();
            let mut episode = Episode::new(Arc::new(world), start(1, 2), 3, SeedTree::new(1)).unwrap();
            for heading in [3, 6] {
                episode.step(Action { direction: Some(Direction::PlusX), heading: Heading::new(heading) });
            }
            episode
        });
        assert_eq!(plain.curve(), coloured.curve());
        assert!(plain.view().cloud().iter().eq(coloured.view().cloud().iter()));
        assert_eq!(plain.encode(), coloured.encode());
        assert!(plain.view().cloud_colours().is_empty());
        let (points, colours) = (coloured.view().cloud(), coloured.view().cloud_colours());
        assert_eq!(points.len(), colours.len());
        // The floor is painted in one colour; where walls meet it, points of theirs lie as low.
        let floor: Vec<_> = points.iter().zip(colours).filter(|(point, _)| point.y < 1e-3).collect();
        let (all, brown) = (floor.len(), floor.iter().filter(|(_, colour)| **colour == [90, 70, 50]).count());
        assert!(brown > 1000 && 100 * brown >= 99 * all, "{brown} of {all}");
    }

    #[test]
    fn an_episode_that_was_reset_is_a_new_one() {
        let world = world();
        let told = |episode: &mut Episode| {
            for k in 0..3 {
                episode.step(Action { direction: Some(Direction::ALL[k]), heading: Heading::new(3 * k) });
            }
            let bits = |points: &Cloud| points.iter().flat_map(|p| p.to_array().map(f32::to_bits)).collect::<Vec<_>>();
            let (view, steps) = (episode.view(), 0..episode.world().surface().len());
            let first: Vec<_> = steps.map(|point| episode.coverage().first_step(point)).collect();
            (bits(view.cloud()), view.history().to_vec(), first, episode.covered().to_vec(), episode.encode())
        };
        let mut used = Episode::new(Arc::clone(&world), start(3, 3), 3, SeedTree::new(8)).unwrap();
        told(&mut used);
        for seed in (0..3).map(SeedTree::new) {
            used.reset(seed);
            let expected = told(&mut Episode::random(Arc::clone(&world), 3, seed));
            assert_eq!(told(&mut used), expected);
            let start = world.random_start(seed);
            assert_eq!(expected.1[0], start);
            used.reset_at(start, seed).unwrap();
            assert_eq!(told(&mut used), expected);
            assert_eq!(told(&mut Episode::new(Arc::clone(&world), start, 3, seed).unwrap()), expected);
        }
    }

    #[test]
    fn nobody_starts_in_a_wall() {
        let (mesh, mut settings) = crate::scene::two_rooms();
        settings.camera.pose_l = 10;
        let world = Arc::new(World::new(Scene::new("rooms", mesh, &settings).unwrap(), &SimConfig::default()).unwrap());
        let begin = |start| Episode::new(Arc::clone(&world), start, 3, SeedTree::new(1));
        let error = begin(start(10, 2)).err().unwrap().to_string();
        assert!(error.contains("rooms: start (10, 2) is outside the lattice") && error.contains("(9, 5)"), "{error}");
        let error = begin(start(9, 2)).err().unwrap().to_string();
        assert!(error.contains("start (9, 2) at [14.25, 1.65, 3.75] m is in a wall or outside"), "{error}");
        let mut episode = begin(start(1, 2)).unwrap();
        episode.step(Action { direction: None, heading: Heading::new(1) });
        assert!(episode.reset_at(start(-1, 0), SeedTree::new(1)).is_err());
        assert_eq!(episode.steps(), 1, "it stays as it was");
    }

    #[test]
    fn the_released_counting_reads_lower() {
        let mut config = SimConfig::default();
        let mut last = |counting| {
            config.coverage = CoverageConfig { points: 500, counting, ..config.coverage };
            let world = Arc::new(World::new(Scene::two_rooms(), &config).unwrap());
            let mut episode = Episode::new(world, start(1, 2), 8, SeedTree::new(2)).unwrap();
            for heading in (1..=8).map(Heading::new) {
                episode.step(Action { direction: None, heading });
            }
            episode.curve()[8]
        };
        let (exact, released) = (last(Counting::Exact), last(Counting::AsReleased));
        assert!(released < exact && released > 0.7 * exact, "{released} {exact}");
    }

    #[test]
    fn out_of_range_settings_are_named() {
        let mut config = SimConfig::default();
        config.encode.window.pixels = 100;
        assert!(config.validate().unwrap_err().to_string().contains("encode.window.pixels"));
        let config = SimConfig { keep: 0.0, ..SimConfig::default() };
        assert!(config.validate().unwrap_err().to_string().contains("keep"));
    }
}
