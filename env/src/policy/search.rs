//! `oracle-greedy`, `oracle-beam`: search on the true coverage gains, as bounds for policies that do not know the map.
//!
//! Gains are those of the frames at the end of steps ([`Visibility`](crate::visibility::Visibility)); what the frames in
//! between add is neither predicted nor counted.

use super::{Plan, Policy, PolicyError, action_towards};
use crate::episode::Action;
use crate::map::MapView;
use crate::path::ShortestPaths;
use crate::pose::{Heading, LatticePose};
use crate::seed::Rng;
use crate::visibility::PointSet;
use crate::world::World;
use serde::{Deserialize, Serialize};
use std::cmp::Reverse;
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
    covered: PointSet,
    plan: Option<Plan>,
}

/// A way through the lattice and what it would add.
#[derive(Clone)]
struct Way {
    poses: Vec<LatticePose>,
    covered: PointSet,
    gain: usize,
    /// Sum of the gains after each step: of equal gains, the earlier ones are better.
    area: usize,
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
        Self { name, covered: world.visibility().nothing(), world, config, plan: None }
    }

    /// The best way of at most `depth` steps; `None` where no step adds anything.
    fn search(&self, start: LatticePose) -> Option<Vec<LatticePose>> {
        let visibility = self.world.visibility();
        let mut beam = vec![Way { poses: vec![start], covered: self.covered.clone(), gain: 0, area: 0 }];
        for _ in 0..self.config.depth {
            // Of several ways to a pose only the best is kept, or one corner would fill the beam.
            let mut best: BTreeMap<LatticePose, (usize, usize, usize)> = BTreeMap::new();
            for (parent, way) in beam.iter().enumerate() {
                let Some(&here) = way.poses.last() else { continue };
                for pose in self.steps_from(here) {
                    let gain = way.gain + visibility.gain(pose, &way.covered);
                    let candidate = (gain, way.area + gain, parent);
                    let known = best.entry(pose).or_insert(candidate);
                    if (candidate.0, candidate.1) > (known.0, known.1) {
                        *known = candidate;
                    }
                }
            }
            let mut ranked: Vec<_> = best.into_iter().collect();
            ranked.sort_by_key(|&(pose, (gain, area, _))| (Reverse((gain, area)), pose));
            ranked.truncate(self.config.width);
            beam = ranked
                .into_iter()
                .map(|(pose, (gain, area, parent))| {
                    let mut way = beam[parent].clone();
                    visibility.cover(pose, &mut way.covered);
                    way.poses.push(pose);
                    Way { gain, area, ..way }
                })
                .collect();
        }
        beam.into_iter().next().filter(|way| way.gain > 0).map(|way| way.poses[1..].to_vec())
    }

    /// Poses one step away: four moves and staying, eight headings each.
    fn steps_from(&self, here: LatticePose) -> impl Iterator<Item = LatticePose> + '_ {
        let nodes = self.world.scene().graph().neighbours(here.node).chain([here.node]);
        nodes.flat_map(|node| Heading::all().map(move |heading| LatticePose { node, heading }))
    }

    /// The shortest way to a pose that adds something.
    fn walk_to_nearest(&self, start: LatticePose) -> Vec<LatticePose> {
        let graph = self.world.scene().graph();
        let paths = ShortestPaths::from(start.node, |a, b| graph.is_passable(a, b).then_some(1.0));
        let mut nodes: Vec<_> = paths.reached().collect();
        nodes.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
        let gain = |pose: &LatticePose| self.world.visibility().gain(*pose, &self.covered);
        let best_look = |node| {
            let poses = Heading::all().map(|heading| LatticePose { node, heading });
            poses.max_by_key(|pose| (gain(pose), Reverse(pose.heading))).filter(|pose| gain(pose) > 0)
        };
        let Some(goal) = nodes.into_iter().find_map(|(node, _)| best_look(node)) else { return Vec::new() };
        let path = paths.path_to(goal.node).unwrap_or_default();
        path.into_iter().map(|node| LatticePose { node, ..goal }).collect()
    }
}

impl Policy for OracleSearch {
    fn name(&self) -> &'static str {
        self.name
    }

    fn begin(&mut self) {
        (self.covered, self.plan) = (self.world.visibility().nothing(), None);
    }

    fn act(&mut self, view: &MapView<'_>, _: &mut Rng) -> Result<Action, PolicyError> {
        // Where an action has led: between two of them, a continuous agent looks otherwise than any lattice pose.
        let here = view.pose();
        self.world.visibility().cover(here, &mut self.covered);
        let path = self.search(here).unwrap_or_else(|| self.walk_to_nearest(here));
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
    use crate::config::SimConfig;
    use crate::episode::Episode;
    use crate::policy::fbe::Fbe;
    use crate::policy::tests::explore;
    use crate::pose::Node;
    use crate::scene::Scene;
    use crate::sensor::Camera;

    #[test]
    fn who_knows_the_map_is_faster_and_never_bumps() {
        let camera = Camera { width: 112, height: 64, ..Camera::default() };
        let world = World::new(Scene::two_rooms(), &SimConfig { camera, ..SimConfig::default() });
        let world = Arc::new(world.unwrap());
        let start = LatticePose { node: Node { i: 1, k: 1 }, heading: Heading::new(6) };
        let area = |episode: &Episode| episode.curve().iter().sum::<f32>();
        let fbe = explore(&world, &mut Fbe::default(), start, 20);
        let mut oracles =
            [OracleSearch::greedy(Arc::clone(&world)), OracleSearch::beam(Arc::clone(&world), SearchConfig::default())];
        let [greedy, beam] = oracles.each_mut().map(|oracle| explore(&world, oracle, start, 20));
        assert!(area(&beam) > area(&fbe) && area(&beam) > area(&greedy));
        assert!(greedy.curve()[20] > fbe.curve()[20]);
        assert!(beam.curve()[20] > 0.95, "{:?}", beam.curve());
        assert_eq!((greedy.bumps(), beam.bumps()), (0, 0));
    }
}
