//! `oracle-greedy`, `oracle-beam`: search on the true coverage gains, as bounds for policies that do not know the map.
//!
//! A step's gain is what its frames cover, each taken for the lattice pose nearest to it ([`World::glimpses`]); what has been
//! covered is counted from the cloud, exactly. Gains are discounted by the step at which they come, and a way ends with a
//! promise: what looking around from the best node of the map would add, discounted by the walk to it. So a bound neither nibbles
//! at what is next to it nor stands still where the search sees nothing.

use super::oracle::Hindsight;
use super::promise::{DISCOUNT, Promises};
use super::{Plan, Policy, PolicyError, action_towards, poses_of_step};
use crate::episode::Action;
use crate::map::MapView;
use crate::path::ShortestPaths;
use crate::pose::{Heading, LatticePose, Node};
use crate::seed::Rng;
use crate::visibility::PointSet;
use crate::world::World;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;

/// How far and how broadly to search.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SearchConfig {
    /// Ways kept at each depth.
    pub width: usize,
    /// Steps looked ahead.
    pub depth: usize,
}

impl Default for SearchConfig {
    fn default() -> Self {
        Self { width: 10, depth: 10 }
    }
}

/// A setting that no search can work with.
#[derive(Debug, thiserror::Error)]
#[error("search.{field} is {value}: it must be 1 to {most}")]
pub struct SearchConfigError {
    field: &'static str,
    value: usize,
    most: usize,
}

impl SearchConfig {
    /// The best next step.
    pub const GREEDY: Self = Self { width: 1, depth: 1 };

    /// Checks every number.
    ///
    /// # Errors
    /// Naming the first setting that is out of range.
    pub fn validate(&self) -> Result<(), SearchConfigError> {
        // A way holds a bit for each point: more ways would take gigabytes, more steps hours.
        for (field, value, most) in [("width", self.width, 1000), ("depth", self.depth, 1000)] {
            if !(1..=most).contains(&value) {
                return Err(SearchConfigError { field, value, most });
            }
        }
        Ok(())
    }
}

/// Searches the true map.
pub struct OracleSearch {
    name: &'static str,
    world: Arc<World>,
    config: SearchConfig,
    /// What the episode has really covered, frames between nodes included.
    hindsight: Hindsight,
    /// Poses within reach that may still add something.
    open: Option<Vec<LatticePose>>,
    plan: Option<Plan>,
}

/// A way through the lattice and what it would add.
#[derive(Clone)]
struct Way {
    poses: Vec<LatticePose>,
    covered: PointSet,
    /// Points, each step's discounted.
    gain: f32,
}

/// A step that prolongs a way.
#[derive(Clone, Copy)]
struct Step {
    parent: usize,
    pose: LatticePose,
    gain: f32,
    /// The gain and what is promised from there.
    worth: f32,
}

impl OracleSearch {
    /// `oracle-greedy`: the best next step in one world, of which it knows everything.
    pub fn greedy(world: Arc<World>) -> Self {
        Self::new("oracle-greedy", world, SearchConfig::GREEDY)
    }

    /// `oracle-beam`: the same, as far ahead as `config` says.
    pub fn beam(world: Arc<World>, config: SearchConfig) -> Self {
        Self::new("oracle-beam", world, config)
    }

    fn new(name: &'static str, world: Arc<World>, config: SearchConfig) -> Self {
        let hindsight = Hindsight::new(&world);
        Self { name, world, config, hindsight, open: None, plan: None }
    }

    /// Takes in what was covered since the last time, and returns all of it.
    fn look_back(&mut self, view: &MapView<'_>) -> PointSet {
        let covered = self.hindsight.look_back(&self.world, view);
        let open = match self.open.take() {
            Some(open) => open,
            None => self.poses_within_reach(view.pose().node),
        };
        let glimpses = self.world.glimpses();
        self.open = Some(open.into_iter().filter(|&pose| glimpses.gain(pose, &covered) > 0).collect());
        covered
    }

    fn poses_within_reach(&self, start: Node) -> Vec<LatticePose> {
        let graph = self.world.scene().graph();
        let paths =
            ShortestPaths::from(self.world.scene().lattice(), start, |a, b| graph.is_passable(a, b).then_some(1.0));
        let poses = |(node, _)| Heading::all().map(move |heading| LatticePose { node, heading });
        paths.reached().flat_map(poses).collect()
    }

    /// The best way of `depth` steps.
    fn search(&self, start: LatticePose, covered: PointSet) -> Vec<LatticePose> {
        let mut promises = Promises::new(&self.world, self.open.as_deref().unwrap_or_default(), &covered);
        let mut beam = vec![Way { poses: vec![start], covered, gain: 0.0 }];
        let mut discount = 1.0;
        for _ in 0..self.config.depth {
            // Of several ways to a pose only the best is kept, or one corner would fill the beam.
            let mut best: BTreeMap<LatticePose, Step> = BTreeMap::new();
            for (parent, way) in beam.iter().enumerate() {
                let Some(&here) = way.poses.last() else { continue };
                let mut promised = promises.after(&way.covered);
                for node in self.nodes_one_step_from(here.node) {
                    let promise = discount * DISCOUNT * promised.at(node);
                    for pose in Heading::all().map(|heading| LatticePose { node, heading }) {
                        let gain = way.gain + discount * self.gain(here, pose, &way.covered) as f32;
                        let step = Step { parent, pose, gain, worth: gain + promise };
                        let known = best.entry(pose).or_insert(step);
                        if step.worth > known.worth {
                            *known = step;
                        }
                    }
                }
            }
            let mut ranked: Vec<Step> = best.into_values().collect();
            ranked.sort_by(|a, b| b.worth.total_cmp(&a.worth).then(a.pose.cmp(&b.pose)));
            ranked.truncate(self.config.width);
            beam = ranked.into_iter().map(|step| self.prolong(&beam[step.parent], step)).collect();
            discount *= DISCOUNT;
        }
        // What a way itself has covered is promised to nobody any more.
        let mut promise = |way: &Way| way.poses.last().map_or(0.0, |pose| promises.after(&way.covered).at(pose.node));
        let ways = beam.into_iter().map(|way| (way.gain + discount * promise(&way), way));
        let best = ways.reduce(|best, way| if way.0 > best.0 { way } else { best });
        best.map(|(_, way)| way.poses[1..].to_vec()).unwrap_or_default()
    }

    fn prolong(&self, way: &Way, step: Step) -> Way {
        let Way { mut poses, mut covered, .. } = way.clone();
        for pose in poses.last().into_iter().flat_map(|&here| self.frames_of_step(here, step.pose)) {
            self.world.glimpses().cover(pose, &mut covered);
        }
        poses.push(step.pose);
        Way { poses, covered, gain: step.gain }
    }

    /// Points that a step adds.
    fn gain(&self, from: LatticePose, to: LatticePose, covered: &PointSet) -> usize {
        let mut covered = covered.clone();
        self.frames_of_step(from, to).map(|pose| self.world.glimpses().cover(pose, &mut covered)).sum()
    }

    fn frames_of_step(&self, from: LatticePose, to: LatticePose) -> impl Iterator<Item = LatticePose> + '_ {
        poses_of_step(self.world.scene().lattice(), from, to, self.world.config().captures)
    }

    /// Four moves and staying.
    fn nodes_one_step_from(&self, here: Node) -> impl Iterator<Item = Node> + '_ {
        self.world.scene().graph().neighbours(here).chain([here])
    }
}

impl Policy for OracleSearch {
    fn name(&self) -> &'static str {
        self.name
    }

    fn begin(&mut self) {
        self.hindsight = Hindsight::new(&self.world);
        (self.open, self.plan) = (None, None);
    }

    fn act(&mut self, view: &MapView<'_>, _: &mut Rng) -> Result<Action, PolicyError> {
        let (here, covered) = (view.pose(), self.look_back(view));
        let path = self.search(here, covered);
        let next = path.first().copied().unwrap_or(here);
        self.plan = Some(Plan { made_at: view.step(), path, thought: None });
        Ok(action_towards(here.node, next))
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
    use crate::policy::fbe::Fbe;
    use crate::policy::tests::explore;
    use crate::scene::Scene;
    use crate::seed::SeedTree;
    use crate::sensor::Camera;

    #[test]
    fn who_knows_the_map_is_faster_and_never_bumps() {
        let camera = Camera { width: 112, height: 64, ..Camera::default() };
        let world = World::new(Scene::two_rooms(), &SimConfig { camera, ..SimConfig::default() });
        let world = Arc::new(world.unwrap());
        let area = |episode: &Episode| episode.curve().iter().sum::<f32>();
        let mut sums = [0.0; 3];
        for &start in world.scene().starts() {
            let mut oracles = [
                OracleSearch::greedy(Arc::clone(&world)),
                OracleSearch::beam(Arc::clone(&world), SearchConfig::default()),
            ];
            let fbe = explore(&world, &mut Fbe::default(), start, 20);
            let [greedy, beam] = oracles.each_mut().map(|oracle| explore(&world, oracle, start, 20));
            assert!(beam.curve()[20] > 0.95, "{:?}", beam.curve());
            assert_eq!((greedy.bumps(), beam.bumps()), (0, 0));
            for (sum, episode) in sums.iter_mut().zip([&fbe, &greedy, &beam]) {
                *sum += area(episode);
            }
        }
        assert!(sums[1] > 1.05 * sums[0] && sums[2] > 1.05 * sums[0], "{sums:?}");
        let way = |mut oracle: OracleSearch| {
            explore(&world, &mut oracle, world.scene().starts()[0], 12).view().history().to_vec()
        };
        let beam = |config| OracleSearch::beam(Arc::clone(&world), config);
        assert_eq!(way(beam(SearchConfig::GREEDY)), way(OracleSearch::greedy(Arc::clone(&world))));
        assert_ne!(way(beam(SearchConfig::default())), way(beam(SearchConfig::GREEDY)));
        assert_eq!(check_policy(&mut OracleSearch::beam(Arc::clone(&world), SearchConfig::default()), &world), []);
    }

    #[test]
    fn what_a_step_adds_is_what_the_search_expects_and_counts() {
        // Every pixel kept, turns by quarters: the frames in between are lattice poses too.
        let camera = Camera { width: 112, height: 64, ..Camera::default() };
        let config = SimConfig { camera, keep: 1.0, captures: 2, ..SimConfig::default() };
        let world = Arc::new(World::new(Scene::two_rooms(), &config).unwrap());
        let here = LatticePose { node: Node { i: 1, k: 1 }, heading: Heading::new(6) };
        let mut episode = Episode::new(Arc::clone(&world), here, 4, SeedTree::new(1)).unwrap();
        let mut oracle = OracleSearch::greedy(Arc::clone(&world));
        for turn in [2, 4, 6] {
            let to = LatticePose { heading: Heading::new(episode.pose().heading.index() + turn), ..here };
            let covered = oracle.look_back(&episode.view());
            assert_eq!(covered.len(), episode.coverage().covered());
            let expected = oracle.gain(episode.pose(), to, &covered);
            let before = episode.coverage().covered();
            episode.step(Action { direction: None, heading: to.heading });
            assert_eq!(episode.coverage().covered() - before, expected);
        }
    }
}
