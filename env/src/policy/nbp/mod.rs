//! `nbp`: walk to where the network promises most, replan on arrival or when stopped (paper, section 4.2). By settings beyond the paper's it
//! plans as [`Goals`] and [`Replan`] say, and leaves the lead to a tour of frontiers after [`NbpConfig::patience`] steps without news.

mod config;
mod outlook;
mod prices;
mod projection;

pub use config::{Goals, NbpConfig, NbpConfigError, Replan};

use super::fbe::{Fbe, Rule};
use super::{DOUBTFUL_PRICE, Plan, Policy, PolicyError, action_towards, observed_price, turn_on_the_spot};
use crate::encode::encode;
use crate::episode::Action;
use crate::goal::{Candidate, GoalRule};
use crate::map::MapView;
use crate::path::{PriceList, ShortestPaths};
use crate::pose::{HEADINGS, Heading, LatticePose, Node};
use crate::predict::{EncoderInput, Prediction, Predictor};
use crate::seed::Rng;
use crate::world::World;
use outlook::Outlook;
use projection::{Projection, Seen};
use rand::RngExt as _;
use std::collections::BTreeSet;
use std::sync::Arc;

/// Where paths may lead.
#[derive(Clone)]
pub enum Passability {
    /// The predicted obstacle map, bumps and travelled edges: inference.
    Predicted,
    /// The same, and the true lattice graph for the move that is next: inference with [`NbpConfig::oracle_edges`].
    Checked(Arc<World>),
    /// The true lattice graph: training (paper, section 4.2, training phase).
    Truth(Arc<World>),
}

impl Passability {
    /// What the settings allow a policy to know in inference.
    pub fn in_inference(config: &NbpConfig, world: &Arc<World>) -> Self {
        if config.oracle_edges { Self::Checked(Arc::clone(world)) } else { Self::Predicted }
    }
}

/// Cells of the carved plane that come to be known, since there was news, without being any: noise, and corners.
const FEW_CELLS: usize = 20;

/// What the network saw and answered.
type Thought = (EncoderInput, Prediction);

/// The policy.
pub struct Nbp {
    predictor: Arc<dyn Predictor>,
    config: NbpConfig,
    passability: Passability,
    plan: Option<Plan>,
    next: usize,
    /// Moves that a look at the true mesh has ruled out, both ways.
    closed: BTreeSet<[Node; 2]>,
    /// Goals that are none any more.
    refused: BTreeSet<Node>,
    projection: Projection,
    outlook: Outlook,
    drought: Drought,
    /// Who leads when nothing new was seen for too long.
    frontiers: Fbe,
}

/// Steps without news.
#[derive(Default)]
struct Drought {
    /// Cells of the carved plane that were known when there was news.
    known: usize,
    /// Steps since then.
    steps: usize,
}

impl Drought {
    fn update(&mut self, view: &MapView<'_>) {
        let known = view.occupancy().known();
        let is_news = known > self.known + FEW_CELLS;
        *self = if is_news { Self { known, steps: 0 } } else { Self { steps: self.steps + 1, ..*self } };
    }
}

impl Nbp {
    /// A policy that plans on what `predictor` answers.
    pub fn new(predictor: Arc<dyn Predictor>, config: NbpConfig, passability: Passability) -> Self {
        let (closed, refused, projection, outlook, drought) = Default::default();
        let frontiers = Fbe::new(Rule::Tsp);
        Self {
            predictor,
            config,
            passability,
            plan: None,
            next: 0,
            closed,
            refused,
            projection,
            outlook,
            drought,
            frontiers,
        }
    }

    /// What a tour of frontiers does next, if nothing new was seen for too long and there are any.
    fn follow_frontiers(&mut self, view: &MapView<'_>, rng: &mut Rng) -> Result<Option<Action>, PolicyError> {
        if self.config.patience == 0 {
            return Ok(None);
        }
        self.drought.update(view);
        if self.drought.steps <= self.config.patience {
            return Ok(None);
        }
        let action = self.frontiers.act(view, rng)?;
        let Some(plan) = self.frontiers.plan().filter(|plan| !plan.path.is_empty()) else { return Ok(None) };
        (self.plan, self.next) = (Some(plan.clone()), plan.path.len());
        Ok(Some(action))
    }

    /// The pose to go to next, if the plan still holds.
    fn follow(&mut self, view: &MapView<'_>) -> Option<LatticePose> {
        let plan = self.plan.as_ref()?;
        // After a bump the agent is where it was: the pose that it did not reach is not the one to go on from.
        let is_on_path = self.next == 0 || plan.path.get(self.next - 1).is_some_and(|&pose| pose == view.pose());
        let target = *plan.path.get(self.next).filter(|_| is_on_path)?;
        let here = view.pose().node;
        let holds = target.node == here
            || (self.still_holds(view, here, target.node) && self.is_open_at_a_look(here, target.node));
        holds.then_some(target)
    }

    /// Whether nothing that was met since the plan was made speaks against an edge of it.
    fn still_holds(&self, view: &MapView<'_>, a: Node, b: Node) -> bool {
        match (&self.passability, self.config.fuse_observed) {
            (Passability::Truth(_), _) => true,
            (_, false) => view.bumps(a, b) == 0,
            (_, true) => observed_price(view, a, b) == Some(1.0),
        }
    }

    /// Whether a move is possible, for who may look at the true mesh; an edge that is not stays closed.
    fn is_open_at_a_look(&mut self, a: Node, b: Node) -> bool {
        let Passability::Checked(world) = &self.passability else { return true };
        let is_open = world.scene().graph().is_passable(a, b);
        if !is_open {
            self.closed.extend([[a, b], [b, a]]);
        }
        is_open
    }

    fn think(&self, view: &MapView<'_>) -> Result<Thought, PolicyError> {
        let input = encode(view);
        match self.predictor.predict(std::slice::from_ref(&input))?.pop() {
            Some(prediction) => Ok((input, prediction)),
            None => Err(crate::predict::PredictError::Backend("no answer to one input".into()).into()),
        }
    }

    fn make_plan(&mut self, view: &MapView<'_>, rng: &mut Rng) -> Result<Plan, PolicyError> {
        let thought = self.think(view)?;
        let config = &self.config;
        if config.slice_overrides || config.observed_penalty > 0.0 || config.observed_within.is_some() {
            self.projection.update(view);
        }
        if config.goals == Goals::Surroundings {
            self.outlook.update(view, &thought, self.config.memory);
            if config.seen_penalty > 0.0 {
                self.outlook.doubt_seen(view, config.seen_penalty);
            }
        }
        let (here, mut tried) = (view.pose().node, BTreeSet::new());
        loop {
            let path = match self.config.goals {
                Goals::Surroundings => self.look_around(view, &thought, rng),
                _ => self.find_path(view, &thought, &tried, rng),
            };
            match path.first().map(|pose| pose.node) {
                Some(first) if first != here && !self.is_open_at_a_look(here, first) => {
                    tried.extend(path.last().map(|goal| goal.node));
                }
                _ => {
                    self.outlook.commit(path.last().map(|goal| goal.node));
                    return Ok(Plan { made_at: view.step(), path, thought: Some(thought) });
                }
            }
        }
    }

    /// The path to where looking around promises most; empty where there is nothing left to look at.
    fn look_around(&self, view: &MapView<'_>, thought: &Thought, rng: &mut Rng) -> Vec<LatticePose> {
        let price = |a, b| self.price(view, thought, a, b);
        let mut path = self.outlook.path(view, &mut PriceList::new(view.lattice(), price), &self.config);
        for pose in &mut path {
            if self.config.random_heading > 0.0 && rng.random::<f32>() < self.config.random_heading {
                pose.heading = Heading::new(rng.random_range(0..HEADINGS));
            }
        }
        path
    }

    /// The path to the best goal that was not tried yet; empty where there is none.
    fn find_path(
        &self,
        view: &MapView<'_>,
        thought: &Thought,
        tried: &BTreeSet<Node>,
        rng: &mut Rng,
    ) -> Vec<LatticePose> {
        let here = view.pose();
        let price = |a, b| self.price(view, thought, a, b);
        let mut paths =
            ShortestPaths::from(view.lattice(), here.node, |a, b| price(a, b).filter(|&price| price < DOUBTFUL_PRICE));
        if paths.reached().count() == 1 {
            // Walled in by what only looks like walls: a doubtful way out is better than none.
            paths = ShortestPaths::from(view.lattice(), here.node, price);
        }
        let value = |pose| thought.1.value.of_pose(&thought.0.window, view.lattice(), pose);
        let goals = paths.reached().map(|(node, _)| node).filter(|node| !tried.contains(node));
        let candidates: Vec<Candidate> = goals.flat_map(|node| self.candidates(node, view, &value)).collect();
        let mut path = Vec::new();
        if let Some(goal) = self.config.goal.choose(&candidates, rng) {
            let nodes = paths.path_to(goal.pose.node).unwrap_or_default();
            let on_the_way = nodes.len().saturating_sub(1);
            for &node in &nodes[..on_the_way] {
                path.push(LatticePose { node, heading: self.heading_at(node, view, &value, rng) });
            }
            path.push(match self.config.goals {
                Goals::Poses => goal.pose,
                Goals::Positions | Goals::Surroundings => {
                    LatticePose { heading: self.heading_at(goal.pose.node, view, &value, rng), ..goal.pose }
                }
            });
        }
        path
    }

    /// The goals at a node that may be chosen, with what they are worth to the planner.
    fn candidates(
        &self,
        node: Node,
        view: &MapView<'_>,
        value: &impl Fn(LatticePose) -> Option<f32>,
    ) -> Vec<Candidate> {
        let (here, config) = (view.pose(), &self.config);
        let pixel = view.window_size().world_pixel(view.lattice().position(node));
        if self.refused.contains(&node) || config.observed_within.is_some_and(|m| !self.projection.is_near(pixel, m)) {
            return Vec::new();
        }
        let is_seen = config.observed_penalty > 0.0 && self.projection.get(pixel) != Seen::Nothing;
        let penalty = if is_seen { config.observed_penalty } else { 0.0 };
        let poses = Heading::all().map(|heading| LatticePose { node, heading });
        let worth = |pose| value(pose).map(|value| Candidate { pose, value: value - penalty });
        match config.goals {
            Goals::Poses => poses
                .filter(|pose| *pose != here && !(config.skip_visited && view.visits(*pose) > 0))
                .filter_map(worth)
                .collect(),
            Goals::Positions if node == here.node => Vec::new(),
            Goals::Positions | Goals::Surroundings => {
                poses.filter_map(worth).reduce(|a, b| if b.value > a.value { b } else { a }).into_iter().collect()
            }
        }
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
        let rule = match self.config.goals {
            Goals::Poses => self.config.goal,
            Goals::Positions | Goals::Surroundings => GoalRule::Greedy,
        };
        let chosen = rule.choose(if fresh.is_empty() { &all } else { &fresh }, rng);
        chosen.map_or(view.pose().heading, |c| c.pose.heading)
    }
}

impl Policy for Nbp {
    fn name(&self) -> &'static str {
        "nbp"
    }

    fn begin(&mut self) {
        (self.plan, self.next) = (None, 0);
        (self.closed, self.refused, self.projection, self.outlook, self.drought) = Default::default();
        self.frontiers.begin();
    }

    fn act(&mut self, view: &MapView<'_>, rng: &mut Rng) -> Result<Action, PolicyError> {
        if let Some(action) = self.follow_frontiers(view, rng)? {
            return Ok(action);
        }
        let followed = self.follow(view);
        let own = self.plan.as_ref().filter(|plan| plan.thought.is_some());
        let goal = own.and_then(|plan| plan.path.last().copied());
        if let (None, true, Some(goal)) = (followed, self.config.blacklist_goals, goal)
            && goal != view.pose()
        {
            self.refused.insert(goal.node);
        }
        let target = match followed.filter(|_| self.config.replan == Replan::OnArrival) {
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
    use crate::check::check_policy;
    use crate::config::SimConfig;
    use crate::episode::Episode;
    use crate::policy::crosses_unknown;
    use crate::policy::tests::explore;
    use crate::predict::{ObstacleMap, PredictError, ValueMap};
    use crate::scene::Scene;
    use crate::seed::SeedTree;

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
        let mut policy = Nbp::new(Arc::new(Corner), config, passability);
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

    /// An episode of [`Corner`] with its plans, one for each time that the network was asked.
    fn plans(config: NbpConfig, steps: usize) -> (Episode, Vec<Plan>) {
        let world = Arc::new(World::new(Scene::two_rooms(), &SimConfig::default()).unwrap());
        let start = LatticePose { node: Node { i: 0, k: 0 }, heading: Heading::new(0) };
        let passability = Passability::in_inference(&config, &world);
        let mut policy = Nbp::new(Arc::new(Corner), config, passability);
        let mut episode = Episode::new(world, start, steps, SeedTree::new(5)).unwrap();
        let (mut rng, mut plans) = (SeedTree::new(6).rng(), Vec::<Plan>::new());
        while !episode.is_over() {
            let action = policy.act(&episode.view(), &mut rng).unwrap();
            let plan = policy.plan().unwrap();
            if plans.last().is_none_or(|last| last.made_at != plan.made_at) {
                plans.push(plan.clone());
            }
            episode.step(action);
        }
        (episode, plans)
    }

    #[test]
    fn a_plan_for_every_step_or_for_every_path() {
        let (_, rarely) = plans(NbpConfig { replan: Replan::OnArrival, ..NbpConfig::default() }, 20);
        let (_, often) = plans(NbpConfig { replan: Replan::EveryStep, ..NbpConfig::default() }, 20);
        assert!(rarely.len() < 15 && often.len() == 20, "{} {}", rarely.len(), often.len());
    }

    #[test]
    fn a_wall_that_was_seen_costs_what_the_settings_say() {
        let config = NbpConfig { fuse_observed: true, wall_price: 25.0, ..NbpConfig::default() };
        let episode = walk(config, false);
        let (view, policy) = (episode.view(), Nbp::new(Arc::new(Corner), config, Passability::Predicted));
        let (thought, lattice) = (policy.think(&view).unwrap(), view.lattice());
        let mut walls = 0;
        for a in (0..lattice.len()).map(|index| lattice.node(index)) {
            for b in crate::pose::Direction::ALL.map(|direction| a.step(direction)) {
                let (observed, price) = (observed_price(&view, a, b), policy.price(&view, &thought, a, b));
                let expected = if observed == Some(DOUBTFUL_PRICE) { Some(25.0) } else { observed };
                assert_eq!(price, expected, "{a:?} {b:?}");
                walls += usize::from(price == Some(25.0));
            }
        }
        assert!(walls > 4, "{walls}");
    }

    /// Sees walls everywhere.
    struct Walled;

    impl Predictor for Walled {
        fn predict(&self, inputs: &[EncoderInput]) -> Result<Vec<Prediction>, PredictError> {
            let mut answers = Corner.predict(inputs)?;
            answers.iter_mut().for_each(|answer| answer.obstacle.probability.fill(1.0));
            Ok(answers)
        }
    }

    #[test]
    fn a_wall_that_is_predicted_costs_as_much_as_one_that_was_seen() {
        let config = NbpConfig { fuse_observed: true, wall_price: 25.0, ..NbpConfig::default() };
        let episode = plans(config, 0).0;
        let (view, policy) = (episode.view(), Nbp::new(Arc::new(Walled), config, Passability::Predicted));
        let (thought, lattice) = (policy.think(&view).unwrap(), view.lattice());
        let edges =
            (0..lattice.len()).map(|index| lattice.node(index)).map(|a| (a, a.step(crate::pose::Direction::PlusX)));
        let unseen: Vec<_> = edges.filter(|&(a, b)| lattice.contains(b) && crosses_unknown(&view, a, b)).collect();
        assert!(unseen.len() > 4);
        assert!(unseen.iter().all(|&(a, b)| policy.price(&view, &thought, a, b) == Some(25.0)));
        for (wall_price, is_valid) in [(10.0, true), (9.9, false), (f32::INFINITY, false), (f32::NAN, false)] {
            assert_eq!(NbpConfig { wall_price, ..config }.validate().is_ok(), is_valid, "{wall_price}");
        }
    }

    #[test]
    fn the_goals_of_a_tour_of_frontiers_are_not_given_up() {
        let world = Arc::new(World::new(Scene::two_rooms(), &SimConfig::default()).unwrap());
        let start = LatticePose { node: Node { i: 0, k: 0 }, heading: Heading::new(0) };
        let config = NbpConfig { blacklist_goals: true, patience: 1, ..NbpConfig::default() };
        let mut policy = Nbp::new(Arc::new(Corner), config, Passability::Predicted);
        let mut episode = Episode::new(world, start, 40, SeedTree::new(5)).unwrap();
        let (mut rng, mut own, mut tours) = (SeedTree::new(6).rng(), BTreeSet::new(), 0);
        while !episode.is_over() {
            let action = policy.act(&episode.view(), &mut rng).unwrap();
            let plan = policy.plan().unwrap();
            match plan.thought {
                Some(_) => own.extend(plan.path.last().map(|goal| goal.node)),
                None => tours += 1,
            }
            episode.step(action);
        }
        assert!(tours > 0 && policy.refused.is_subset(&own), "{tours} {:?} {own:?}", policy.refused);
    }

    #[test]
    fn a_look_at_the_true_mesh_saves_the_bumps_and_their_steps() {
        let (believing, _) = plans(NbpConfig::default(), 14);
        let (looking, plans) = plans(NbpConfig { oracle_edges: true, ..NbpConfig::default() }, 14);
        assert!(believing.bumps() > 0 && looking.bumps() == 0);
        assert!(looking.view().history().windows(2).all(|poses| poses[0] != poses[1]), "no step is lost");
        // It does not know the way: what it plans leads through walls.
        let graph = looking.world().scene().graph();
        let is_wrong = |plan: &Plan| plan.path.windows(2).any(|p| !graph.is_passable(p[0].node, p[1].node));
        assert!(plans.iter().any(is_wrong));
    }

    #[test]
    fn a_goal_whose_path_was_stopped_is_given_up() {
        let returns = |blacklist_goals| {
            let (episode, plans) = plans(NbpConfig { blacklist_goals, ..NbpConfig::default() }, 40);
            let poses = episode.view().history();
            // A path that was not walked to its end before the next was planned.
            let stopped: Vec<(usize, Node)> = plans
                .windows(2)
                .enumerate()
                .filter_map(|(n, pair)| {
                    pair[0].path.last().filter(|goal| poses[pair[1].made_at] != **goal).map(|goal| (n, goal.node))
                })
                .collect();
            assert!(!stopped.is_empty());
            stopped
                .iter()
                .filter(|(n, goal)| {
                    plans[n + 1..].iter().any(|plan| plan.path.last().is_some_and(|pose| pose.node == *goal))
                })
                .count()
        };
        assert!(returns(false) > 0);
        assert_eq!(returns(true), 0);
    }

    #[test]
    fn the_slice_of_the_cloud_shows_the_walls_that_the_network_does_not() {
        // Walls of points are thinner than two pixels.
        let config = NbpConfig { blocking_pixels: 1, ..NbpConfig::default() };
        let (believing, _) = plans(config, 40);
        let (looking, _) = plans(NbpConfig { slice_overrides: true, ..config }, 40);
        assert!(looking.bumps() < believing.bumps(), "{} {}", looking.bumps(), believing.bumps());
    }

    #[test]
    fn goals_lie_near_what_was_seen_and_those_that_were_seen_are_worth_less() {
        let (start, _) = plans(NbpConfig::default(), 0);
        let view = start.view();
        let config = NbpConfig { observed_penalty: 10.0, observed_within: Some(0.5), ..NbpConfig::default() };
        let mut policy = Nbp::new(Arc::new(Corner), config, Passability::Predicted);
        policy.projection.update(&view);
        let (mut beyond, mut within) = (0, 0);
        for node in (0..view.lattice().len()).map(|index| view.lattice().node(index)) {
            let at = view.lattice().position(node);
            let flat = |point: glam::Vec3| glam::Vec2::new(point.x - at.x, point.z - at.z).abs().max_element();
            let nearest = view.cloud().iter().map(flat).fold(f32::INFINITY, f32::min);
            let goals = policy.candidates(node, &view, &|_| Some(30.0));
            // A pixel is 0.16 m wide, and the position anywhere in its own.
            match goals.first().map(|goal| goal.value) {
                Some(20.0) => assert!(nearest < 0.157, "{nearest}"),
                Some(value) => assert!(value == 30.0 && nearest < 0.66, "{value} {nearest}"),
                None => assert!(nearest > 0.34, "{nearest}"),
            }
            beyond += usize::from(goals.first().is_some_and(|goal| goal.value == 30.0));
            within += usize::from(goals.first().is_some_and(|goal| goal.value == 20.0));
        }
        assert!(beyond > 0 && within > 0, "{beyond} {within}");
    }

    #[test]
    fn a_position_is_a_goal_only_from_elsewhere() {
        let turns = |goals| {
            let (episode, plans) = plans(NbpConfig { goals, ..NbpConfig::default() }, 40);
            let here = |plan: &Plan| episode.view().history()[plan.made_at].node;
            plans.iter().filter(|plan| plan.path.last().is_some_and(|goal| goal.node == here(plan))).count()
        };
        assert!(turns(Goals::Poses) > 0, "eight headings of the best node are eight goals");
        assert_eq!(turns(Goals::Positions), 0);
    }

    #[test]
    fn the_released_planner_has_no_fault() {
        let world = Arc::new(World::new(Scene::two_rooms(), &SimConfig::default()).unwrap());
        let released = NbpConfig {
            goals: Goals::Positions,
            obstacle_threshold: 0.13,
            observed_penalty: 10.0,
            observed_within: Some(1.5625),
            blacklist_goals: true,
            slice_overrides: true,
            oracle_edges: true,
            ..NbpConfig::default()
        };
        for config in [released, NbpConfig { oracle_edges: false, replan: Replan::EveryStep, ..released }] {
            assert!(config.validate().is_ok());
            let passability = Passability::in_inference(&config, &world);
            let mut policy = Nbp::new(Arc::new(Corner), config, passability);
            assert_eq!(check_policy(&mut policy, &world), []);
        }
        let error = NbpConfig { observed_within: Some(-1.0), ..released }.validate().unwrap_err().to_string();
        assert!(error.contains("observed_within is -1: it must be a number that is not negative"), "{error}");
    }
}
