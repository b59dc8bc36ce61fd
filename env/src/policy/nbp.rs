//! `nbp`: walk to where the network promises most, replan on arrival or when stopped (paper, section 4.2).

use super::{DOUBTFUL_PRICE, Plan, Policy, PolicyError, action_towards, observed_price, turn_on_the_spot};
use crate::encode::{Trajectory, encode};
use crate::episode::Action;
use crate::goal::{Candidate, GoalRule};
use crate::map::grid::cells_between;
use crate::map::{Cell, MapView, occupancy};
use crate::path::ShortestPaths;
use crate::pose::{Heading, LatticePose, Node};
use crate::predict::{EncoderInput, Prediction, Predictor};
use crate::seed::Rng;
use crate::world::World;
use rand::RngExt as _;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// How the value and obstacle maps become a path.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct NbpConfig {
    /// How the goal, and the headings on the way, are chosen: greedy in inference, Boltzmann in training.
    pub goal: GoalRule,
    /// Probability from which a pixel is an obstacle (paper: not given; released code: 0.13).
    pub obstacle_threshold: f32,
    /// Obstacle pixels on a move's segment from which it is blocked (released code: 2 at 256 pixels).
    pub blocking_pixels: usize,
    /// Let the carved map overrule the predicted one where it knows better. Off in the paper.
    pub fuse_observed: bool,
    /// Leave poses already visited out of goals and headings (released code: headings only; paper: silent).
    pub skip_visited: bool,
    /// Probability that a heading on the way is replaced by a random one (released code, in collection: 0.6).
    pub random_heading: f32,
}

impl Default for NbpConfig {
    fn default() -> Self {
        Self {
            goal: GoalRule::Greedy,
            obstacle_threshold: 0.5,
            blocking_pixels: 2,
            fuse_observed: false,
            skip_visited: true,
            random_heading: 0.0,
        }
    }
}

/// A setting that the policy cannot work with.
#[derive(Debug, thiserror::Error)]
#[error("{field} is {value}: it must be {want}")]
pub struct NbpConfigError {
    field: &'static str,
    value: String,
    want: &'static str,
}

impl NbpConfig {
    /// Checks every number.
    ///
    /// # Errors
    /// Naming the first setting that is out of range.
    pub fn validate(&self) -> Result<(), NbpConfigError> {
        let refuse = |field, value: String, want| Err(NbpConfigError { field, value, want });
        if let GoalRule::Boltzmann { beta } = self.goal
            && !(beta.is_finite() && beta > 0.0)
        {
            return refuse("goal.beta", beta.to_string(), "a positive number of percent points");
        }
        if !(0.0..=1.0).contains(&self.obstacle_threshold) {
            return refuse("obstacle_threshold", self.obstacle_threshold.to_string(), "a probability, 0 to 1");
        }
        if self.blocking_pixels == 0 {
            return refuse("blocking_pixels", "0".into(), "at least 1, or every move is blocked");
        }
        if !(0.0..=1.0).contains(&self.random_heading) {
            return refuse("random_heading", self.random_heading.to_string(), "a probability, 0 to 1");
        }
        Ok(())
    }
}

/// Where paths may lead.
#[derive(Clone)]
pub enum Passability {
    /// The predicted obstacle map, bumps and travelled edges: inference.
    Predicted,
    /// The true lattice graph: training (paper, section 4.2, training phase).
    Truth(Arc<World>),
}

/// The policy.
pub struct Nbp {
    predictor: Arc<dyn Predictor>,
    config: NbpConfig,
    passability: Passability,
    trajectory: Trajectory,
    plan: Option<Plan>,
    next: usize,
}

impl Nbp {
    /// A policy that plans on what `predictor` answers.
    pub fn new(
        predictor: Arc<dyn Predictor>,
        config: NbpConfig,
        passability: Passability,
        trajectory: Trajectory,
    ) -> Self {
        Self { predictor, config, passability, trajectory, plan: None, next: 0 }
    }

    /// The pose to go to next, if the plan still holds.
    fn follow(&self, view: &MapView<'_>) -> Option<LatticePose> {
        let target = *self.plan.as_ref()?.path.get(self.next)?;
        let here = view.pose().node;
        (target.node == here || self.still_holds(view, here, target.node)).then_some(target)
    }

    /// Whether nothing that was met since the plan was made speaks against an edge of it.
    fn still_holds(&self, view: &MapView<'_>, a: Node, b: Node) -> bool {
        match (&self.passability, self.config.fuse_observed) {
            (Passability::Truth(_), _) => true,
            (Passability::Predicted, false) => view.bumps(a, b) == 0,
            (Passability::Predicted, true) => observed_price(view, a, b) == Some(1.0),
        }
    }

    /// What the planner pays for an edge; `None` where it is closed or leaves the window.
    fn price(&self, view: &MapView<'_>, thought: &(EncoderInput, Prediction), a: Node, b: Node) -> Option<f32> {
        let (input, prediction) = thought;
        let (from, to) = (view.lattice().position(a), view.lattice().position(b));
        input.window.pixel(to)?;
        if let Passability::Truth(world) = &self.passability {
            return world.scene().graph().is_passable(a, b).then_some(1.0);
        }
        let observed = observed_price(view, a, b)?;
        let is_known = || cells_between(from, to, occupancy::CELL).all(|cell| view.occupancy().get(cell) == Cell::Free);
        if view.is_traversed(a, b) || (self.config.fuse_observed && is_known()) {
            return Some(1.0);
        }
        let is_obstacle = |world: &[i32; 2]| {
            let pixel = input.window.pixel_of(*world);
            pixel.is_some_and(|(row, col)| prediction.obstacle.at(row, col) >= self.config.obstacle_threshold)
        };
        let obstacles = cells_between(from, to, input.window.size.pixel()).filter(is_obstacle).count();
        match (obstacles < self.config.blocking_pixels, self.config.fuse_observed) {
            (true, false) => Some(1.0),
            (true, true) => Some(observed),
            (false, false) => None,
            // A predicted wall is as doubtful as a seen one: an agent that stands beside a wall is not walled in by it.
            (false, true) => Some(DOUBTFUL_PRICE),
        }
    }

    fn make_plan(&self, view: &MapView<'_>, rng: &mut Rng) -> Result<Plan, PolicyError> {
        let input = encode(view, self.trajectory);
        let prediction = match self.predictor.predict(std::slice::from_ref(&input))?.pop() {
            Some(prediction) => prediction,
            None => return Err(crate::predict::PredictError::Backend("no answer to one input".into()).into()),
        };
        let here = view.pose();
        let thought = (input, prediction);
        let price = |a, b| self.price(view, &thought, a, b);
        let mut paths = ShortestPaths::from(here.node, |a, b| price(a, b).filter(|&price| price < DOUBTFUL_PRICE));
        if paths.reached().count() == 1 {
            // Walled in by what only looks like walls: a doubtful way out is better than none.
            paths = ShortestPaths::from(here.node, price);
        }
        let value = |pose| thought.1.value.of_pose(&thought.0.window, view.lattice(), pose);
        let is_wanted = |pose: &LatticePose| *pose != here && !(self.config.skip_visited && view.visits(*pose) > 0);
        let candidates: Vec<Candidate> = paths
            .reached()
            .flat_map(|(node, _)| Heading::all().map(move |heading| LatticePose { node, heading }))
            .filter(is_wanted)
            .filter_map(|pose| value(pose).map(|value| Candidate { pose, value }))
            .collect();
        let mut path = Vec::new();
        if let Some(goal) = self.config.goal.choose(&candidates, rng) {
            let nodes = paths.path_to(goal.pose.node).unwrap_or_default();
            let on_the_way = nodes.len().saturating_sub(1);
            for &node in &nodes[..on_the_way] {
                path.push(LatticePose { node, heading: self.heading_at(node, view, &value, rng) });
            }
            path.push(goal.pose);
        }
        Ok(Plan { made_at: view.step(), path, thought: Some(thought) })
    }

    fn heading_at(
        &self,
        node: Node,
        view: &MapView<'_>,
        value: &impl Fn(LatticePose) -> Option<f32>,
        rng: &mut Rng,
    ) -> Heading {
        if self.config.random_heading > 0.0 && rng.random::<f32>() < self.config.random_heading {
            return Heading::new(rng.random_range(0..8_usize));
        }
        let poses = Heading::all().map(|heading| LatticePose { node, heading });
        let all: Vec<Candidate> =
            poses.map(|pose| Candidate { pose, value: value(pose).unwrap_or(f32::NEG_INFINITY) }).collect();
        let fresh: Vec<Candidate> =
            all.iter().copied().filter(|c| !self.config.skip_visited || view.visits(c.pose) == 0).collect();
        let chosen = self.config.goal.choose(if fresh.is_empty() { &all } else { &fresh }, rng);
        chosen.map_or(view.pose().heading, |c| c.pose.heading)
    }
}

impl Policy for Nbp {
    fn name(&self) -> &'static str {
        "nbp"
    }

    fn begin(&mut self) {
        self.plan = None;
        self.next = 0;
    }

    fn act(&mut self, view: &MapView<'_>, rng: &mut Rng) -> Result<Action, PolicyError> {
        // After a bump the agent is where it was: the pose that it did not reach is not the one to go on from.
        let is_on_path = self.plan.as_ref().is_some_and(|plan| {
            self.next == 0 || plan.path.get(self.next - 1).is_some_and(|&pose| pose == view.pose())
        });
        let target = match self.follow(view).filter(|_| is_on_path) {
            Some(target) => target,
            None => {
                let plan = self.make_plan(view, rng)?;
                let first = plan.path.first().copied();
                self.plan = Some(plan);
                self.next = 0;
                match first {
                    Some(target) => target,
                    None => return Ok(turn_on_the_spot(view, rng)),
                }
            }
        };
        self.next += 1;
        Ok(action_towards(view.pose().node, target))
    }

    fn plan(&self) -> Option<&Plan> {
        self.plan.as_ref()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::SimConfig;
    use crate::episode::Episode;
    use crate::policy::tests::explore;
    use crate::predict::{ObstacleMap, PredictError, ValueMap};
    use crate::scene::Scene;

    /// Promises most in one corner of the window and sees no walls.
    struct Corner;

    impl Predictor for Corner {
        fn predict(&self, inputs: &[EncoderInput]) -> Result<Vec<Prediction>, PredictError> {
            let answer = |input: &EncoderInput| {
                let (pixels, size) = (input.size(), input.size() / 4);
                let gain = (0..8 * size * size).map(|n| -((n % size) as f32) - (n / size % size) as f32).collect();
                Prediction {
                    value: ValueMap { size, gain },
                    obstacle: ObstacleMap { size: pixels, probability: vec![0.0; pixels * pixels] },
                }
            };
            Ok(inputs.iter().map(answer).collect())
        }
    }

    fn walk(config: NbpConfig, truth: bool) -> Episode {
        let world = Arc::new(World::new(Scene::two_rooms(), &SimConfig::default()).unwrap());
        let start = LatticePose { node: Node { i: 0, k: 0 }, heading: Heading::new(0) };
        let passability = if truth { Passability::Truth(Arc::clone(&world)) } else { Passability::Predicted };
        let mut policy = Nbp::new(Arc::new(Corner), config, passability, Trajectory::KeyPoses);
        explore(&world, &mut policy, start, 40)
    }

    #[test]
    fn it_gets_to_the_far_corner_and_learns_from_bumps() {
        let far = Node { i: 7, k: 5 };
        let believing = walk(NbpConfig::default(), false);
        assert!(believing.bumps() > 0, "the wall between the rooms is not predicted");
        assert!(believing.view().history().iter().any(|pose| pose.node == far));
        let knowing = walk(NbpConfig::default(), true);
        assert_eq!(knowing.bumps(), 0);
        assert_eq!(knowing.view().history()[12].node, far, "twelve moves are the shortest way");
        let looking = walk(NbpConfig { fuse_observed: true, ..NbpConfig::default() }, false);
        assert!(looking.bumps() < believing.bumps());
    }
}
