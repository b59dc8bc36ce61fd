//! Many episodes at once, for those who bring their own learner: `reset`, `step`, one decision for each episode.
//!
//! Episodes run in parallel on the thread pool and share their worlds; what happens in one does not depend on the others
//! or on the number of threads.

use crate::episode::{Decision, Episode, StepOutcome};
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

/// There must be one decision for each episode.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("{decisions} decisions for {episodes} episodes")]
pub struct DecisionCount {
    /// As given.
    pub decisions: usize,
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

    /// Performs one decision in each episode: an [`Action`](crate::Action), a [`Motion`](crate::Motion), or what
    /// [`decide`](crate::policy::decide) said. In the continuous world an action may take many steps, a motion takes one.
    ///
    /// # Errors
    /// When there are more or fewer decisions than episodes.
    pub fn step<D: Into<Decision> + Copy + Sync>(
        &mut self,
        decisions: &[D],
    ) -> Result<Vec<StepOutcome>, DecisionCount> {
        if decisions.len() != self.episodes.len() {
            return Err(DecisionCount { decisions: decisions.len(), episodes: self.episodes.len() });
        }
        let pairs = self.episodes.par_iter_mut().zip(decisions);
        Ok(pairs.map(|(episode, &decision)| episode.follow(decision.into())).collect())
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
    use crate::episode::Action;
    use crate::motion::{Agent, Motion, MotionConfig};
    use crate::policy::{Policy as _, decide, random::Random};
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
                assert_eq!(batch.step(&actions[1..]), Err(DecisionCount { decisions: 4, episodes: 5 }));
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

    #[test]
    fn a_batch_follows_motions_and_whatever_was_decided() {
        let camera = Camera { width: 60, height: 34, ..Camera::default() };
        let agent = Agent::Continuous(MotionConfig::default());
        let world = World::new(Scene::two_rooms(), &SimConfig { agent, camera, ..SimConfig::default() }).unwrap();
        let mut batch = EpisodeBatch::new(vec![Arc::new(world)], 2, 4, 7).unwrap();
        let azimuth = |batch: &EpisodeBatch, n: usize| batch.episodes()[n].camera().azimuth.to_degrees();
        let before = [0, 1].map(|n| azimuth(&batch, n));
        batch.step(&[Motion::Left, Motion::Right]).unwrap();
        for (n, by) in [10.0, -10.0].into_iter().enumerate() {
            let turned = (azimuth(&batch, n) - before[n] - by).rem_euclid(360.0);
            assert!(turned.min(360.0 - turned) < 1e-3 && batch.episodes()[n].steps() == 1, "{turned}");
        }
        let mut rng = SeedTree::new(1).rng();
        Random.begin();
        while !batch.episodes()[0].is_over() {
            let decisions: Vec<Decision> =
                batch.episodes().iter().map(|episode| decide(&mut Random, episode, &mut rng).unwrap()).collect();
            assert!(decisions.iter().all(|decision| matches!(decision, Decision::Motion(_))));
            batch.step(&decisions).unwrap();
        }
        assert_eq!(batch.episodes()[1].steps(), 4);
    }
}
