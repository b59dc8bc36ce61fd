//! One episode: an agent in a world, a number of steps, and what it has seen.

mod released;
mod walk;

use crate::coverage::{Counting, Coverage};
use crate::encode::encode;
use crate::map::{AgentMap, Frames, Kept, MapView};
use crate::motion::{Agent, Motion, Walker};
use crate::noise::PoseError;
use crate::pose::{Direction, Heading, LatticePose, Pose};
use crate::predict::EncoderInput;
use crate::seed::SeedTree;
use crate::sensor::{Camera, Frame};
use crate::world::{StartError, World};
use released::Released;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

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
    /// Frames taken so far.
    shots: Vec<Shot>,
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
    /// The curve as the released code counts it, if asked for.
    released: Option<Released>,
    /// Covers nothing in between; for counting as the released code does.
    recount: Option<Coverage>,
    bumps: usize,
    path_length: f32,
}

/// How a frame was taken: enough to take it again.
#[derive(Clone, Copy)]
struct Shot {
    /// True pose of the camera.
    pose: Pose,
    step: u32,
    /// Number in its step.
    number: u32,
}

impl Shot {
    /// By step and number, so that policies that took different ways still keep the same pixels and meet the same errors.
    fn stream(&self, tree: SeedTree) -> SeedTree {
        tree.child("step", u64::from(self.step)).child("capture", u64::from(self.number))
    }
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
        let encode = &world.config().encode;
        let map = AgentMap::new(encode, world.scene().floor());
        let pose = world.scene().lattice().pose(start);
        let walker = match world.config().agent {
            Agent::Lattice {} => None,
            Agent::Continuous(config) => Some(Walker::new(config, pose)),
        };
        let mut episode = Self {
            map,
            coverage: Coverage::new(world.surface()),
            pose: start,
            walker,
            track: Vec::new(),
            shots: Vec::new(),
            step: 0,
            horizon,
            pixels: seed.child("pixels", 0),
            noise: seed.child("noise", 0),
            error: None,
            sampling: seed.child("coverage", 0),
            frame,
            curve: Vec::new(),
            covered: Vec::new(),
            released: None,
            recount: None,
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
    /// the heading, see [`pilot`](crate::pilot); each motion is a step, the horizon may end them anywhere, and the first one that is
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
        let bumped = !is_stay && !self.world.scene().graph().is_passable(self.pose.node, node);
        if bumped {
            self.map.bump(self.pose.node, node);
            self.bumps += 1;
        } else {
            let target = LatticePose { node, heading: action.heading };
            let lattice = *self.world.scene().lattice();
            let (from, to) = (lattice.pose(self.pose), lattice.pose(target));
            let captures = self.world.config().captures;
            for n in 1..=captures {
                self.capture(&from.interpolate(&to, n as f32 / captures as f32), n);
            }
            self.path_length += from.position.distance(to.position);
            self.pose = target;
        }
        self.arrive();
        bumped
    }

    /// Whether all steps are spent.
    pub fn is_over(&self) -> bool {
        self.step >= self.horizon
    }

    /// What a policy may look at.
    pub fn view(&self) -> MapView<'_> {
        let camera = self.believed(&self.camera());
        MapView::new(&self.map, self.world.scene().lattice(), self, self.pose, camera, self.step, self.horizon)
    }

    /// The network's input at the current pose.
    pub fn encode(&self) -> EncoderInput {
        encode(&self.view())
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
        self.walker.as_ref().map_or_else(|| self.world.scene().lattice().pose(self.pose), Walker::pose)
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
        let released = self.released.as_ref().map_or(0, Released::bytes);
        let curves = released + self.curve.capacity() * size_of::<f32>() + self.covered.capacity() * size_of::<usize>();
        let track = self.track.capacity() * size_of::<Pose>();
        let shots = self.shots.capacity() * size_of::<Shot>();
        let coverage = self.coverage.bytes() + self.recount.as_ref().map_or(0, Coverage::bytes);
        size_of::<Self>() + self.map.bytes() + coverage + frame + curves + track + shots
    }

    fn arrive(&mut self) {
        self.map.arrive(self.pose);
        self.track.push(self.camera());
        let covered = match self.world.config().coverage.counting {
            Counting::Exact => self.coverage.covered(),
            Counting::AsReleased => self.covered_as_released(),
        };
        self.curve.push(covered as f32 / self.world.surface().len() as f32);
        self.covered.push(covered);
        self.count_on();
    }

    fn share(&self) -> f32 {
        self.curve.last().copied().unwrap_or(0.0)
    }

    fn believed(&self, pose: &Pose) -> Pose {
        self.error.map_or(*pose, |error| error.of(pose))
    }

    fn capture(&mut self, pose: &Pose, number: usize) {
        let (world, mut frame) = (Arc::clone(&self.world), std::mem::take(&mut self.frame));
        let shot = Shot { pose: *pose, step: self.step as u32, number: number as u32 };
        self.error = self.take(&shot, &mut frame);
        let (camera, pose) = (world.sensor().camera(), &self.believed(pose));
        let mut pixels = shot.stream(self.pixels).rng();
        let kept = Kept::draw(camera, pose, &frame, world.config().keep, &mut pixels);
        self.coverage.add(world.surface(), &kept.points, self.step as u32);
        self.map.integrate(camera, pose, &frame, &kept);
        self.shots.push(shot);
        self.frame = frame;
    }

    /// Takes a frame, and says how far the believed pose is off.
    fn take(&self, shot: &Shot, frame: &mut Frame) -> Option<PoseError> {
        let (sensor, noise) = (self.world.sensor(), shot.stream(self.noise));
        sensor.capture(self.world.scene(), &shot.pose, frame);
        self.world.config().noise.disturb(frame, sensor.camera(), noise);
        self.world.config().noise.pose_error(noise)
    }
}

impl Frames for Episode {
    fn show(&self, first: usize, to: &mut dyn FnMut(&Camera, &Pose, &Frame)) {
        let mut frame = Frame::default();
        for shot in self.shots.iter().skip(first) {
            let error = self.take(shot, &mut frame);
            to(self.world.sensor().camera(), &error.map_or(shot.pose, |error| error.of(&shot.pose)), &frame);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::SimConfig;
    use crate::map::Cloud;
    use crate::scene::Scene;
    use crate::sensor::Colour;

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
    fn frames_that_are_looked_at_again_are_those_that_the_cloud_was_made_of() {
        let noise = crate::noise::NoiseConfig { depth: 0.01, dropout: 0.02, position: 0.1, ..Default::default() };
        let config = SimConfig { noise, keep: 1.0, ..SimConfig::default() };
        let world = Arc::new(World::new(Scene::two_rooms(), &config).unwrap());
        let mut episode = Episode::new(world, start(1, 2), 3, SeedTree::new(2)).unwrap();
        for direction in [Direction::PlusX, Direction::MinusX, Direction::MinusX, Direction::MinusX] {
            episode.step(Action { direction: Some(direction), heading: Heading::new(3) });
        }
        let view = episode.view();
        let mut points = Vec::new();
        view.look_again(2, &mut |camera, pose, frame| points.extend(frame.points(camera.at(pose))));
        assert_eq!((view.cloud().frames(), episode.bumps()), (1 + 3 * 4, 0));
        assert!(view.cloud().of_frames(2).eq(points.iter().copied()) && points.len() > 100_000);
    }
}
