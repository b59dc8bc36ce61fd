//! Goals by what looking around from them promises: the receding horizon of [`Goals::Surroundings`](super::Goals).
//!
//! Answers outlive their window: a room that was left behind is still known to be worth a visit.

use super::{NbpConfig, Thought};
use crate::map::grid::cells_between;
use crate::map::{Cell, MapView, OccupancyGrid, occupancy};
use crate::path::{PriceList, ShortestPaths};
use crate::policy::poses_of_step;
use crate::pose::{Direction, HEADINGS, Heading, LatticePose, Node};
use glam::Vec3;

/// How far rays look for cells that nothing is known of, metres.
const REACH: f32 = 10.0;

/// Rays from each position, three for each turn of an eighth.
const RAYS: usize = 3 * HEADINGS;

/// Unknown cells that the seven rays of a view must meet: where points are few, walls have holes.
const ENOUGH_CELLS: usize = 8;

/// Frames of a step: those between headings that are four eighths apart.
const FRAMES: usize = 4;

/// What the network last promised for a look from each lattice pose, ares, by node; nothing where it was not asked.
#[derive(Default)]
pub(super) struct Outlook {
    gains: Vec<Option<[f32; HEADINGS]>>,
    /// What is taken off them in the decision at hand; empty for nothing.
    doubts: Vec<[f32; HEADINGS]>,
    /// Goal of the last plan.
    goal: Option<Node>,
}

/// A pose one step away, what is found there and what is promised after it.
struct Step {
    pose: LatticePose,
    worth: f32,
    /// The position that promises most from there.
    goal: Node,
}

impl Outlook {
    /// Takes in what the network answered.
    pub(super) fn update(&mut self, view: &MapView<'_>, (input, prediction): &Thought, memory: f32) {
        let lattice = view.lattice();
        self.gains.resize(lattice.len(), None);
        for (index, known) in self.gains.iter_mut().enumerate() {
            let node = lattice.node(index);
            let Some((row, col)) = input.window.value_cell(lattice.position(node)) else { continue };
            if !view.is_within_sight(node) {
                *known = None;
                continue;
            }
            let answers =
                std::array::from_fn(|heading| prediction.value.at(Heading::new(heading), row, col).max(0.0).powi(2));
            let gains = known.get_or_insert(answers);
            for (gain, answer) in gains.iter_mut().zip(answers) {
                *gain = memory * *gain + (1.0 - memory) * answer;
            }
        }
    }

    /// The plan that was made leads there.
    pub(super) fn commit(&mut self, goal: Option<Node>) {
        self.goal = goal;
    }

    /// Takes `penalty` off what looks promise that meet nothing unknown.
    pub(super) fn doubt_seen(&mut self, view: &MapView<'_>, penalty: f32) {
        let lattice = view.lattice();
        let doubts = |(index, gains): (usize, &Option<[f32; HEADINGS]>)| match gains {
            Some(gains) if gains.iter().any(|&gain| gain > 0.0) => {
                meets_unknown(view, lattice.node(index)).map(|cells| if cells < ENOUGH_CELLS { penalty } else { 0.0 })
            }
            _ => [0.0; HEADINGS],
        };
        let doubts: Vec<_> = self.gains.iter().enumerate().map(doubts).collect();
        self.doubts = doubts;
    }

    /// The path to where the best next step leads on; empty if there is none.
    pub(super) fn path(&self, view: &MapView<'_>, prices: &mut PriceList<'_>, config: &NbpConfig) -> Vec<LatticePose> {
        let here = view.pose().node;
        let paths = prices.paths_from(here);
        let around: Vec<(Node, f32)> = paths.reached().map(|(node, _)| (node, self.around(view, node))).collect();
        let neighbours = Direction::ALL.map(|direction| here.step(direction));
        let moves =
            neighbours.map(|node| (node, view.lattice().contains(node).then(|| prices.of(here, node)).flatten()));
        let steps = moves.into_iter().filter_map(|(node, price)| Some((node, price?))).chain([(here, 1.0)]);
        let worth = |(node, price): (Node, f32)| {
            let after = if node == here { paths.clone() } else { prices.paths_from(node) };
            let step = self.step(view, node, &around, &after, config)?;
            Some(Step { worth: config.discount.powf(price - 1.0) * step.worth, ..step })
        };
        let best = steps.filter_map(worth).reduce(|best, step| if step.worth > best.worth { step } else { best });
        let Some(Step { pose, goal, .. }) = best.filter(|best| best.worth > 0.0) else { return Vec::new() };
        let later = prices.paths_from(pose.node).path_to(goal).unwrap_or_default();
        let looks = later.into_iter().map(|node| LatticePose { node, heading: self.best(view, node).0 });
        std::iter::once(pose).chain(looks).collect()
    }

    /// The best look from a node that is one step away, and the best position after it.
    fn step(
        &self,
        view: &MapView<'_>,
        node: Node,
        around: &[(Node, f32)],
        after: &ShortestPaths,
        config: &NbpConfig,
    ) -> Option<Step> {
        let (heading, gain) = if config.sweeps { self.best_sweep(view, node) } else { self.best(view, node) };
        let promise = |&(other, around): &(Node, f32)| {
            // What is looked at now is not found again.
            let rest = if other == node { (around - gain).max(0.0) } else { around };
            Some((other, self.commitment(other, config) * config.discount.powf(after.distance(other)?.max(1.0)) * rest))
        };
        let promises = around.iter().filter_map(promise);
        let (goal, promise) = promises.reduce(|best, other| if other.1 > best.1 { other } else { best })?;
        Some(Step { pose: LatticePose { node, heading }, worth: self.commitment(node, config) * gain + promise, goal })
    }

    /// How much more a node is worth as the goal of the last plan.
    fn commitment(&self, node: Node, config: &NbpConfig) -> f32 {
        if self.goal == Some(node) { 1.0 + config.commitment } else { 1.0 }
    }

    /// What a look promises; nothing from where the agent has looked.
    fn gain(&self, view: &MapView<'_>, pose: LatticePose) -> f32 {
        let (index, heading) = (view.lattice().index(pose.node), pose.heading.index());
        let gain = || self.gains.get(index?)?.map(|gains| gains[heading]);
        let doubt = || Some(self.doubts.get(index?)?[heading]);
        if view.visits(pose) > 0 { 0.0 } else { (gain().unwrap_or(0.0) - doubt().unwrap_or(0.0)).max(0.0) }
    }

    /// The best of the headings that were not tried yet, or the agent's own.
    fn best(&self, view: &MapView<'_>, node: Node) -> (Heading, f32) {
        self.best_by(view, node, |pose| self.gain(view, pose))
    }

    /// The same of a step to the node, with what its frames see on the way: views overlap by half, as in [`Self::around`].
    fn best_sweep(&self, view: &MapView<'_>, node: Node) -> (Heading, f32) {
        let from = view.pose();
        self.best_by(view, node, |pose| {
            let mut passed: Vec<LatticePose> = poses_of_step(view.lattice(), from, pose, FRAMES).collect();
            passed.dedup_by_key(|passed| passed.heading);
            passed.retain(|passed| passed.heading != from.heading && passed.heading != pose.heading);
            self.gain(view, pose) + passed.into_iter().map(|passed| self.gain(view, passed)).sum::<f32>() / 2.0
        })
    }

    fn best_by(&self, view: &MapView<'_>, node: Node, gain: impl Fn(LatticePose) -> f32) -> (Heading, f32) {
        let poses = Heading::all().map(|heading| LatticePose { node, heading });
        let looks = poses.filter(|&pose| view.visits(pose) == 0).map(|pose| (pose.heading, gain(pose)));
        looks.reduce(|best, look| if look.1 > best.1 { look } else { best }).unwrap_or((view.pose().heading, 0.0))
    }

    /// What all looks from a node promise together: views overlap by half, since a frame spans two headings.
    fn around(&self, view: &MapView<'_>, node: Node) -> f32 {
        Heading::all().map(|heading| self.gain(view, LatticePose { node, heading })).sum::<f32>() / 2.0
    }
}

/// How many cells that nothing is known of each view from a position meets, the nearest few of each ray.
fn meets_unknown(view: &MapView<'_>, node: Node) -> [usize; HEADINGS] {
    const MOST: usize = 4;
    let (eye, grid) = (view.lattice().position(node), view.occupancy());
    if grid.get(OccupancyGrid::cell_of(eye)) == Cell::Occupied {
        return [0; HEADINGS];
    }
    let rays: [usize; RAYS] = std::array::from_fn(|ray| {
        let azimuth = ray as f32 * std::f32::consts::TAU / RAYS as f32;
        let end = eye + REACH * Vec3::new(azimuth.sin(), 0.0, azimuth.cos());
        let before_wall = cells_between(eye, end, occupancy::CELL)
            .map(|cell| grid.get(cell))
            .take_while(|&cell| cell != Cell::Occupied);
        before_wall.filter(|&cell| cell == Cell::Unknown).take(MOST).count()
    });
    // A view of 90° has three rays on each side of its middle.
    std::array::from_fn(|heading| (0..7).map(|ray| rays[(3 * heading + RAYS + ray - 3) % RAYS]).sum())
}

#[cfg(test)]
mod tests {
    use super::super::{Goals, Nbp, NbpConfig, Passability, Replan};
    use super::*;
    use crate::check::check_policy;
    use crate::config::SimConfig;
    use crate::episode::{Action, Episode};
    use crate::policy::Policy as _;
    use crate::policy::oracle::OracleLooks;
    use crate::policy::tests::explore;
    use crate::predict::{EncoderInput, ObstacleMap, PredictError, Prediction, Predictor, ValueMap};
    use crate::scene::Scene;
    use crate::seed::SeedTree;
    use crate::world::World;
    use std::sync::Arc;
    use std::sync::atomic::{AtomicUsize, Ordering};

    /// Promises so much for looks from some nodes, and sees no walls.
    struct Treasures(Vec<(Node, f32)>);

    impl Predictor for Treasures {
        fn predict(&self, inputs: &[EncoderInput]) -> Result<Vec<Prediction>, PredictError> {
            let lattice = *Scene::two_rooms().lattice();
            let answer = |input: &EncoderInput| {
                let (pixels, size) = (input.size(), input.size() / 4);
                let mut gain = vec![0.0; 8 * size * size];
                for &(node, promise) in &self.0 {
                    let (row, col) = input.window.value_cell(lattice.position(node)).unwrap();
                    (0..8).for_each(|heading| gain[(heading * size + row) * size + col] = promise);
                }
                let obstacle = ObstacleMap { size: pixels, probability: vec![0.0; pixels * pixels] };
                Prediction { value: ValueMap { size, gain }, obstacle }
            };
            Ok(inputs.iter().map(answer).collect())
        }
    }

    #[test]
    fn what_looking_around_promises_is_worth_its_way() {
        let world = Arc::new(World::new(Scene::two_rooms(), &SimConfig::default()).unwrap());
        let start = LatticePose { node: Node { i: 0, k: 0 }, heading: Heading::new(1) };
        let (near, far) = (Node { i: 1, k: 2 }, Node { i: 3, k: 1 });
        let first = |promises: [f32; 2], discount| {
            let treasures = Treasures(vec![(near, promises[0]), (far, promises[1])]);
            let (goals, replan) = (Goals::Surroundings, Replan::EveryStep);
            let config = NbpConfig { goals, replan, discount, ..NbpConfig::default() };
            let passability = Passability::Truth(Arc::clone(&world));
            let mut policy = Nbp::new(Arc::new(treasures), config, passability);
            let episode = explore(&world, &mut policy, start, 60);
            let at = |node| episode.view().history().iter().position(|pose| pose.node == node);
            // All eight looks of both are taken in the end.
            let looks = |node| {
                Heading::all().filter(|&heading| episode.view().visits(LatticePose { node, heading }) > 0).count()
            };
            assert_eq!((looks(near), looks(far)), (8, 8));
            if at(near) < at(far) { near } else { far }
        };
        assert_eq!(first([1.0, 1.0], 0.9), near);
        assert_eq!(first([1.0, 1.3], 0.9), far);
        assert_eq!(first([1.0, 1.3], 0.5), near);
    }

    /// Promises more at one node and at the other in turn.
    struct Fickle([Node; 2], AtomicUsize);

    impl Predictor for Fickle {
        fn predict(&self, inputs: &[EncoderInput]) -> Result<Vec<Prediction>, PredictError> {
            let turn = self.1.fetch_add(1, Ordering::Relaxed) % 2;
            Treasures(vec![(self.0[turn], 1.2), (self.0[1 - turn], 1.0)]).predict(inputs)
        }
    }

    #[test]
    fn who_is_committed_does_not_turn_back_for_every_promise() {
        let world = Arc::new(World::new(Scene::two_rooms(), &SimConfig::default()).unwrap());
        let start = LatticePose { node: Node { i: 2, k: 2 }, heading: Heading::new(0) };
        let places = [Node { i: 0, k: 0 }, Node { i: 3, k: 5 }];
        let reached = |commitment, memory| {
            let config = NbpConfig {
                goals: Goals::Surroundings,
                replan: Replan::EveryStep,
                commitment,
                memory,
                discount: 0.97,
                ..NbpConfig::default()
            };
            let passability = Passability::Truth(Arc::clone(&world));
            let fickle = Arc::new(Fickle(places, AtomicUsize::new(0)));
            let mut policy = Nbp::new(fickle, config, passability);
            let mut episode = Episode::new(Arc::clone(&world), start, 12, SeedTree::new(5)).unwrap();
            // Both places are to be known: the agent has turned around.
            for heading in [2, 4, 6].map(Heading::new) {
                episode.step(Action { direction: None, heading });
            }
            while !episode.is_over() {
                let action = policy.act(&episode.view(), &mut SeedTree::new(6).rng()).unwrap();
                episode.step(action);
            }
            let at = |node| episode.view().history().iter().any(|pose| pose.node == node);
            places.map(at).contains(&true)
        };
        assert!(!reached(0.0, 0.0));
        assert!(reached(0.5, 0.0) && reached(0.0, 0.8));
    }

    #[test]
    fn false_promises_do_not_keep_it_from_the_second_room() {
        let world = Arc::new(World::new(Scene::two_rooms(), &SimConfig::default()).unwrap());
        let start = LatticePose { node: Node { i: 1, k: 1 }, heading: Heading::new(1) };
        // Two places in the first room that promise much from step to step, whatever is looked at.
        let places = [Node { i: 0, k: 0 }, Node { i: 1, k: 2 }];
        let covered = |patience| {
            let config =
                NbpConfig { goals: Goals::Surroundings, replan: Replan::EveryStep, patience, ..NbpConfig::default() };
            let fickle = Arc::new(Fickle(places, AtomicUsize::new(0)));
            let mut policy = Nbp::new(fickle, config, Passability::Truth(Arc::clone(&world)));
            explore(&world, &mut policy, start, 40).curve()[40]
        };
        assert!(covered(4) > 0.95 && covered(0) < 0.9, "{} {}", covered(4), covered(0));
    }

    #[test]
    fn who_counts_what_is_passed_turns_by_half_a_circle() {
        let world = Arc::new(World::new(Scene::two_rooms(), &SimConfig::default()).unwrap());
        let start = LatticePose { node: Node { i: 1, k: 1 }, heading: Heading::new(5) };
        let turned = |sweeps| {
            let config = NbpConfig { goals: Goals::Surroundings, sweeps, ..NbpConfig::default() };
            let around = [(1, 1), (0, 1), (2, 1), (1, 0), (1, 2)].map(|(i, k)| (Node { i, k }, 1.0));
            let treasures = Arc::new(Treasures(around.to_vec()));
            let mut policy = Nbp::new(treasures, config, Passability::Truth(Arc::clone(&world)));
            let episode = Episode::new(Arc::clone(&world), start, 1, SeedTree::new(1)).unwrap();
            policy.act(&episode.view(), &mut SeedTree::new(1).rng()).unwrap().heading
        };
        assert_eq!(turned(true), Heading::new(1));
        assert_eq!(turned(false), Heading::new(0), "all looks alike: the first");
    }

    #[test]
    fn looks_at_what_is_known_count_for_nothing() {
        let world = Arc::new(World::new(Scene::two_rooms(), &SimConfig::default()).unwrap());
        let start = LatticePose { node: Node { i: 1, k: 1 }, heading: Heading::new(6) };
        let episode = explore(&world, &mut crate::policy::fbe::Fbe::default(), start, 40);
        let everywhere = world.scene().graph().largest_component().iter().map(|&node| (node, 1.0)).collect();
        let planned = |seen_penalty, episode: &Episode| {
            let config =
                NbpConfig { goals: Goals::Surroundings, seen_penalty, fuse_observed: true, ..NbpConfig::default() };
            let treasures = Treasures(Vec::clone(&everywhere));
            let mut policy = Nbp::new(Arc::new(treasures), config, Passability::Predicted);
            policy.act(&episode.view(), &mut SeedTree::new(1).rng()).unwrap();
            policy.plan().is_some_and(|plan| !plan.path.is_empty())
        };
        assert!(episode.curve()[40] > 0.97 && planned(0.0, &episode));
        assert!(!planned(1.0, &episode));
        assert!(planned(1.0, &Episode::new(Arc::clone(&world), start, 1, SeedTree::new(1)).unwrap()));
    }

    #[test]
    fn true_gains_of_looks_lead_through_the_house_faster_than_frontiers() {
        let camera = crate::sensor::Camera { width: 112, height: 64, ..Default::default() };
        let world = World::new(Scene::two_rooms(), &SimConfig { camera, ..SimConfig::default() });
        let world = Arc::new(world.unwrap());
        let config = NbpConfig {
            goals: Goals::Surroundings,
            replan: Replan::EveryStep,
            fuse_observed: true,
            ..NbpConfig::default()
        };
        let nbp = |predictor| Nbp::new(predictor, config, Passability::Predicted);
        let mut oracle = OracleLooks::new(Arc::new(Treasures(Vec::new())), Arc::clone(&world), nbp);
        let area = |episode: &Episode| episode.curve().iter().sum::<f32>();
        let (mut looking, mut frontiers) = (0.0, 0.0);
        for &start in world.scene().starts() {
            looking += area(&explore(&world, &mut oracle, start, 20));
            frontiers += area(&explore(&world, &mut crate::policy::fbe::Fbe::default(), start, 20));
        }
        assert!(looking > 1.03 * frontiers, "{looking} {frontiers}");
        assert_eq!(check_policy(&mut oracle, &world), []);
    }
}
