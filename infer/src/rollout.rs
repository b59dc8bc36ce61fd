//! One episode of one policy: the loop `look → act → step`, and what is written down of it.

use nbp_env::completion::Completion;
use nbp_env::policy::{PolicyError, decide};
use nbp_env::world::StartError;
use nbp_env::{Episode, LatticePose, Policy, SeedTree, World, metrics};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::time::Instant;

/// Steps of an episode, at most; the paper's longest are 500.
pub const MOST_STEPS: usize = 100_000;

/// Which episode: the same trial of the same scene is the same for every policy, up to its decisions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Trial {
    /// Number of the start among [`nbp_env::Scene::starts`].
    pub start: usize,
    /// Root of the random streams.
    pub seed: u64,
    /// Steps given.
    pub steps: usize,
}

/// An episode that cannot be run or broke off.
#[derive(Debug, thiserror::Error)]
pub enum RolloutError {
    /// The scene has fewer starts.
    #[error("scene {scene} has {count} start poses, so there is no number {start} (they count from 0)")]
    NoSuchStart {
        /// Scene.
        scene: String,
        /// As asked for.
        start: usize,
        /// What it has.
        count: usize,
    },
    /// Nobody can stand there.
    #[error(transparent)]
    Start(#[from] StartError),
    /// The policy failed.
    #[error("scene {scene}, policy {policy}, start {start}, seed {seed}, step {step}: {source}")]
    Policy {
        /// Scene.
        scene: String,
        /// Policy.
        policy: String,
        /// Number of the start.
        start: usize,
        /// Root seed.
        seed: u64,
        /// Steps done.
        step: usize,
        /// Why.
        source: PolicyError,
    },
}

impl Trial {
    /// Where it starts.
    ///
    /// # Errors
    /// When the scene has no start of this number.
    pub fn pose(&self, world: &World) -> Result<LatticePose, RolloutError> {
        let scene = world.scene();
        scene.starts().get(self.start).copied().ok_or_else(|| RolloutError::NoSuchStart {
            scene: scene.name().to_owned(),
            start: self.start,
            count: scene.starts().len(),
        })
    }

    /// Its beginning.
    ///
    /// # Errors
    /// When the scene has no start of this number, or nobody can stand there.
    pub fn episode(&self, world: &Arc<World>) -> Result<Episode, RolloutError> {
        let seeds = self.seeds(world.scene().name());
        Ok(Episode::new(Arc::clone(world), self.pose(world)?, self.steps, seeds)?)
    }

    /// The node that all its random streams hang from. Policies do not enter: which pixels become points depends on the
    /// trial alone, so that policies are compared on equal terms.
    pub fn seeds(&self, scene: &str) -> SeedTree {
        SeedTree::new(self.seed).child(&format!("scene:{scene}"), 0).child("start", self.start as u64)
    }
}

/// What is written down of an episode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EpisodeRecord {
    /// Scene.
    pub scene: String,
    /// Policy.
    pub policy: String,
    /// Number of the start pose.
    pub start: usize,
    /// Root seed.
    pub seed: u64,
    /// Steps done.
    pub steps: usize,
    /// Covered share, 0 to 1, at the start and after each step: `steps + 1` numbers.
    pub curve: Vec<f32>,
    /// Last of the curve.
    pub final_coverage: f64,
    /// Area under the curve over its steps, 0 to 1.
    pub auc: f64,
    /// The same curve as the released code counts coverage, where it was asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub released_curve: Option<Vec<f32>>,
    /// Last of that curve.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub released_final: Option<f64>,
    /// Area under it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub released_auc: Option<f64>,
    /// Moves that hit an obstacle.
    pub bumps: usize,
    /// Metres walked.
    pub path_length: f32,
    /// Mean time that the policy took for a decision, milliseconds. The only field that differs between runs.
    pub decision_ms: f64,
    /// Comp. % and Comp. cm at the end, measured in the continuous world.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub completion: Option<Completion>,
    /// Pose at the start and after each step; in the continuous world the nearest one.
    pub poses: Vec<LatticePose>,
}

/// A finished episode: its record, and the episode itself for its map.
pub struct Rollout {
    /// What is written down.
    pub record: EpisodeRecord,
    /// The agent at the end of its way.
    pub episode: Episode,
}

/// Lets `policy` act for a whole trial. `on_step` is called at the start and after every step, and ends it where it fails.
///
/// # Errors
/// When the scene has no such start, nobody can stand there, or the policy or `on_step` fails.
pub fn run_episode(
    world: &Arc<World>,
    policy: &mut dyn Policy,
    trial: Trial,
    on_step: impl FnMut(&Episode, &dyn Policy) -> Result<(), PolicyError>,
) -> Result<Rollout, RolloutError> {
    go_on(trial.episode(world)?, policy, trial, on_step)
}

/// [`run_episode`] in an episode of the trial that has just begun.
///
/// # Errors
/// When the policy or `on_step` fails.
pub fn go_on(
    mut episode: Episode,
    policy: &mut dyn Policy,
    trial: Trial,
    mut on_step: impl FnMut(&Episode, &dyn Policy) -> Result<(), PolicyError>,
) -> Result<Rollout, RolloutError> {
    let world = Arc::clone(episode.world());
    let scene = world.scene().name();
    let mut rng = trial.seeds(scene).child(&format!("policy:{}", policy.name()), 0).rng();
    let (mut deciding, mut decisions) = (0.0, 0_usize);
    let name = policy.name();
    let failed = |step: usize| {
        move |source: PolicyError| RolloutError::Policy {
            scene: scene.to_owned(),
            policy: name.to_owned(),
            start: trial.start,
            seed: trial.seed,
            step,
            source,
        }
    };
    policy.begin();
    on_step(&episode, policy).map_err(failed(0))?;
    while !episode.is_over() {
        let clock = Instant::now();
        let decision = decide(policy, &episode, &mut rng).map_err(failed(episode.steps()))?;
        deciding += clock.elapsed().as_secs_f64();
        decisions += 1;
        episode.follow(decision);
        on_step(&episode, policy).map_err(failed(episode.steps()))?;
    }
    let record = EpisodeRecord {
        scene: scene.to_owned(),
        policy: name.to_owned(),
        start: trial.start,
        seed: trial.seed,
        steps: episode.steps(),
        curve: episode.curve().to_vec(),
        final_coverage: metrics::final_coverage(episode.curve()),
        auc: metrics::auc(episode.curve()),
        released_curve: episode.released_curve().map(<[f32]>::to_vec),
        released_final: episode.released_curve().map(metrics::final_coverage),
        released_auc: episode.released_curve().map(metrics::auc),
        bumps: episode.bumps(),
        path_length: episode.path_length(),
        decision_ms: 1e3 * deciding / decisions.max(1) as f64,
        completion: episode.is_continuous().then(|| {
            Completion::published(world.surface().points(), &episode.view().cloud().iter().collect::<Vec<_>>())
        }),
        poses: episode.view().history().to_vec(),
    };
    Ok(Rollout { record, episode })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::registry::{self, PolicyKind, tests::with_network};
    use nbp_env::{Scene, SimConfig};

    fn run(kind: PolicyKind, trial: Trial) -> Result<Rollout, RolloutError> {
        let world = Arc::new(World::new(Scene::two_rooms(), &SimConfig::default()).unwrap());
        let mut policy = registry::build(kind, &with_network(), &world).unwrap();
        run_episode(&world, policy.as_mut(), trial, |_, _| Ok(()))
    }

    #[test]
    fn every_policy_walks_and_repeats_itself() {
        let trial = Trial { start: 1, seed: 7, steps: 12 };
        for kind in PolicyKind::ALL {
            let (first, again) = (run(kind, trial).unwrap().record, run(kind, trial).unwrap().record);
            assert_eq!(
                EpisodeRecord { decision_ms: 0.0, ..first.clone() },
                EpisodeRecord { decision_ms: 0.0, ..again }
            );
            assert_eq!((first.steps, first.curve.len(), first.poses.len()), (12, 13, 13));
            assert_eq!(first.policy, kind.name());
            assert!(first.final_coverage > 0.0 && first.auc > 0.0 && first.auc <= first.final_coverage);
        }
    }

    #[test]
    fn policies_see_the_same_first_frame() {
        let trial = Trial { start: 0, seed: 3, steps: 1 };
        let firsts = PolicyKind::ALL.map(|kind| run(kind, trial).unwrap().record.curve[0]);
        assert!(firsts.iter().all(|&first| first == firsts[0]), "{firsts:?}");
        let other = run(PolicyKind::Random, Trial { seed: 4, ..trial }).unwrap().record;
        assert_ne!(other.curve[0], firsts[0]);
    }

    #[test]
    fn an_oracle_does_not_bump() {
        let trial = |start| Trial { start, seed: 1, steps: 40 };
        let bumps = |kind| (0..5).map(|start| run(kind, trial(start)).unwrap().record.bumps).sum::<usize>();
        assert_eq!(bumps(PolicyKind::OracleObstacles), 0);
        assert!(bumps(PolicyKind::Nbp) > 0, "the stand-in sees no walls");
    }

    #[test]
    fn a_start_that_is_not_there_is_an_error() {
        let error = run(PolicyKind::Random, Trial { start: 9, seed: 0, steps: 1 }).err().unwrap().to_string();
        assert!(error.contains("two_rooms has 5 start poses"), "{error}");
    }
}
