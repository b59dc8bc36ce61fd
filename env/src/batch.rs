//! Many episodes at once, for those who bring their own learner: `reset`, `step`, one action for each episode.
//!
//! Episodes run in parallel on the thread pool and share their worlds; what happens in one does not depend on the others
//! or on the number of threads.

use crate::episode::{Action, Episode, StepOutcome};
use crate::seed::SeedTree;
use crate::world::World;
use rayon::prelude::*;
use std::sync::Arc;

/// Episodes side by side, number `n` in world `n` modulo the number of worlds.
///
/// Observation, action, reward and termination are those of [`Episode`]. One that is over stays as it is until it is
/// reset.
pub struct EpisodeBatch {
    episodes: Vec<Episode>,
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
        let seeds = SeedTree::new(seed);
        let begin = |n: usize| Episode::random(Arc::clone(&worlds[n % worlds.len()]), horizon, round_of(seeds, n, 0));
        Ok(Self { episodes: (0..count).into_par_iter().map(begin).collect(), seeds, rounds: vec![0; count] })
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
        let seeds = self.seeds;
        let episodes = self.episodes.par_iter_mut().zip(&mut self.rounds).enumerate();
        let finished = episodes.filter(|(_, (episode, _))| episode.is_over());
        let reset = finished.map(|(n, (episode, round))| {
            *round += 1;
            episode.reset(round_of(seeds, n, *round));
            n
        });
        reset.collect()
    }

    /// The episodes, in order.
    pub fn episodes(&self) -> &[Episode] {
        &self.episodes
    }
}

/// The seed of an episode that was begun `round` times before.
fn round_of(seeds: SeedTree, number: usize, round: u64) -> SeedTree {
    seeds.child("episode", number as u64).child("round", round)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::SimConfig;
    use crate::pose::Heading;
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
