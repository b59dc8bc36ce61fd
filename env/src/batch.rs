//! Many episodes at once, for those who bring their own learner: `reset`, `step`, one action for each episode.
//!
//! Episodes run in parallel on the thread pool and share their worlds; what happens in one does not depend on the others
//! or on the number of threads.

use crate::episode::{Action, Episode, StepOutcome, World};
use crate::pose::{Heading, LatticePose};
use crate::seed::SeedTree;
use rand::RngExt as _;
use rand::seq::IndexedRandom as _;
use rayon::prelude::*;
use std::sync::Arc;

/// Episodes side by side, number `n` in world `n` modulo the number of worlds.
///
/// - Observation: [`Episode::view`] (what the agent knows) and [`Episode::encode`] (the same as the network's input).
/// - Reward: the growth of [`StepOutcome::coverage`].
/// - Termination: [`Episode::is_over`], after `horizon` steps; nothing ends an episode earlier. An episode that is over
///   stays as it is until it is reset.
pub struct EpisodeBatch {
    worlds: Vec<Arc<World>>,
    episodes: Vec<Episode>,
    horizon: usize,
    seeds: SeedTree,
    /// How often each episode was begun.
    rounds: Vec<u64>,
}

/// Why there is no batch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("a batch needs at least one world and one episode")]
pub struct EmptyBatch;

/// There must be one action for each episode.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("{actions} actions for {episodes} episodes")]
pub struct ActionCount {
    /// As given.
    pub actions: usize,
    /// As needed.
    pub episodes: usize,
}

impl EpisodeBatch {
    /// Begins `count` episodes at random free poses.
    ///
    /// # Errors
    /// Without worlds or episodes.
    pub fn new(worlds: Vec<Arc<World>>, count: usize, horizon: usize, seed: u64) -> Result<Self, EmptyBatch> {
        if worlds.is_empty() || count == 0 {
            return Err(EmptyBatch);
        }
        let mut batch =
            Self { worlds, episodes: Vec::new(), horizon, seeds: SeedTree::new(seed), rounds: vec![0; count] };
        batch.episodes = (0..count).into_par_iter().map(|n| batch.begin(n)).collect();
        Ok(batch)
    }

    /// Performs one action in each episode.
    ///
    /// # Errors
    /// When there are more or fewer actions than episodes.
    pub fn step(&mut self, actions: &[Action]) -> Result<Vec<StepOutcome>, ActionCount> {
        if actions.len() != self.episodes.len() {
            return Err(ActionCount { actions: actions.len(), episodes: self.episodes.len() });
        }
        Ok(self.episodes.par_iter_mut().zip(actions).map(|(episode, &action)| episode.step(action)).collect())
    }

    /// Begins those episodes anew that are over, at other poses, and returns their numbers.
    pub fn reset_finished(&mut self) -> Vec<usize> {
        let finished: Vec<usize> = (0..self.episodes.len()).filter(|&n| self.episodes[n].is_over()).collect();
        finished.iter().for_each(|&n| self.rounds[n] += 1);
        let begun: Vec<Episode> = finished.par_iter().map(|&n| self.begin(n)).collect();
        finished.iter().zip(begun).for_each(|(&n, episode)| self.episodes[n] = episode);
        finished
    }

    /// The episodes, in order.
    pub fn episodes(&self) -> &[Episode] {
        &self.episodes
    }

    fn begin(&self, number: usize) -> Episode {
        let world = &self.worlds[number % self.worlds.len()];
        let seed = self.seeds.child("episode", number as u64).child("round", self.rounds[number]);
        Episode::new(Arc::clone(world), random_start(world, seed.child("start", 0)), self.horizon, seed)
    }
}

/// A random pose of the largest connected component.
pub fn random_start(world: &World, seed: SeedTree) -> LatticePose {
    let mut rng = seed.rng();
    let nodes = world.scene().graph().largest_component();
    // A scene without a free node is refused, so the first start is never asked for.
    let node = nodes.choose(&mut rng).copied().unwrap_or(world.scene().starts()[0].node);
    LatticePose { node, heading: Heading::new(rng.random_range(0..8)) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::episode::SimConfig;
    use crate::scene::Scene;
    use crate::sensor::Camera;

    fn run(threads: usize) -> Vec<Vec<f32>> {
        let camera = Camera { width: 112, height: 64, ..Camera::default() };
        let world = World::new(Scene::two_rooms(), &SimConfig { camera, ..SimConfig::default() }).unwrap();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut batch = EpisodeBatch::new(vec![Arc::new(world)], 5, 3, 7).unwrap();
            let mut curves = Vec::new();
            for step in 0..6 {
                let actions: Vec<Action> =
                    (0..5).map(|n| Action { direction: None, heading: Heading::new(n + step) }).collect();
                assert_eq!(batch.step(&actions[1..]), Err(ActionCount { actions: 4, episodes: 5 }));
                let outcomes = batch.step(&actions).unwrap();
                assert!(outcomes.iter().all(|outcome| outcome.coverage > 0.0));
                curves.extend(batch.episodes().iter().map(|e| e.curve().to_vec()));
                let is_end = step % 3 == 2;
                assert_eq!(batch.reset_finished().len(), if is_end { 5 } else { 0 });
            }
            curves
        })
    }

    #[test]
    fn episodes_do_not_depend_on_each_other_or_on_threads() {
        let curves = run(1);
        assert_eq!(curves, run(3));
        assert_ne!(curves[10], curves[25], "another round begins elsewhere");
        assert!(EpisodeBatch::new(Vec::new(), 1, 1, 0).is_err());
    }
}
