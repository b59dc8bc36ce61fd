//! Many episodes: every policy from every start of every scene, in parallel, in an order that does not depend on it.

use crate::registry::{self, PolicyContext, PolicyKind, RegistryError};
use crate::rollout::{EpisodeRecord, RolloutError, Trial, run_episode};
use crate::rounds;
use nbp_env::{World, parallel};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, PoisonError};

/// What is compared.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EvalConfig {
    /// Policies, in the order of the tables.
    pub policies: Vec<PolicyKind>,
    /// Steps of an episode (paper: 100 to 500 by level).
    pub steps: usize,
    /// Episodes from every start, each with a seed of its own.
    pub seeds: usize,
    /// The first of the seeds.
    pub seed: u64,
    /// Only the first starts of every scene (paper: 5).
    pub starts_limit: Option<usize>,
    /// Episodes that are walked side by side and ask the network together; 0 or 1: each asks for itself. On the CPU the
    /// records do not depend on it, but for the time of decisions, which then has the waiting for each other in it.
    pub batch: usize,
}

impl Default for EvalConfig {
    fn default() -> Self {
        let policies = vec![PolicyKind::Random, PolicyKind::Fbe, PolicyKind::Nbp];
        Self { policies, steps: 100, seeds: 1, seed: 0, starts_limit: None, batch: 1 }
    }
}

/// How far an evaluation is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// Episodes that are done, those taken over included.
    pub finished: usize,
    /// All episodes.
    pub total: usize,
}

/// An evaluation that cannot be run or broke off.
#[derive(Debug, thiserror::Error)]
pub enum EvalError {
    /// Nothing to do.
    #[error("there is nothing to evaluate: {0}")]
    Nothing(&'static str),
    /// Names are how episodes are told apart.
    #[error("two scenes are called {0}: give each its own name")]
    SameName(String),
    /// A policy cannot be built.
    #[error(transparent)]
    Registry(#[from] RegistryError),
    /// An episode failed.
    #[error(transparent)]
    Rollout(#[from] RolloutError),
}

/// What tells the episodes of an evaluation apart: scene, policy, start, seed.
pub type EpisodeKey = (String, String, usize, u64);

impl EpisodeRecord {
    /// What tells it apart.
    pub fn key(&self) -> EpisodeKey {
        (self.scene.clone(), self.policy.clone(), self.start, self.seed)
    }
}

struct Job<'a> {
    world: &'a Arc<World>,
    kind: PolicyKind,
    trial: Trial,
}

/// Runs what is not among `done` yet and returns all episodes, by scene, policy, start and seed in the order given.
///
/// `on_episode` is called as each new episode finishes, one call at a time, in an order that depends on the machine. The
/// records do not: every episode has random streams of its own.
///
/// # Errors
/// Before the first episode when there is nothing to do or a policy lacks its network; else the first failed episode,
/// after those that were under way have finished.
pub fn run(
    worlds: &[Arc<World>],
    context: &PolicyContext,
    config: &EvalConfig,
    done: &[EpisodeRecord],
    on_episode: impl Fn(&EpisodeRecord, Progress) + Sync,
) -> Result<Vec<EpisodeRecord>, EvalError> {
    let jobs = jobs(worlds, context, config)?;
    let known: BTreeMap<EpisodeKey, &EpisodeRecord> = done.iter().map(|record| (record.key(), record)).collect();
    let mut records: Vec<Option<EpisodeRecord>> =
        jobs.iter().map(|job| known.get(&job.key()).map(|&r| r.clone())).collect();
    let open: Vec<usize> = (0..jobs.len()).filter(|&index| records[index].is_none()).collect();

    let finished = Mutex::new(jobs.len() - open.len());
    let run = |index: usize, context: &PolicyContext| {
        let record = jobs[index].run(context)?;
        let mut finished = finished.lock().unwrap_or_else(PoisonError::into_inner);
        *finished += 1;
        on_episode(&record, Progress { finished: *finished, total: jobs.len() });
        Ok::<_, EvalError>(record)
    };
    // Those who never ask the network would keep the others waiting.
    let (together, apart): (Vec<usize>, Vec<usize>) = match context.predictor {
        Some(_) if config.batch > 1 => open.iter().partition(|&&index| jobs[index].kind.needs_network()),
        _ => (Vec::new(), open),
    };
    let fresh = parallel::try_map(&apart, |&index| run(index, context))?;
    for (index, record) in apart.into_iter().zip(fresh) {
        records[index] = Some(record);
    }
    if let Some(network) = &context.predictor {
        let fresh = rounds::try_map(&together, config.batch, network, |&index, predictor| {
            run(index, &PolicyContext { predictor: Some(predictor), ..context.clone() })
        })?;
        for (index, record) in together.into_iter().zip(fresh) {
            records[index] = Some(record);
        }
    }
    Ok(records.into_iter().flatten().collect())
}

/// The share of each scene's surface that can be seen from the poses of its lattice, 0 to 1: the most that can be covered.
/// `on_scene` is called after each with the number of those done.
pub fn visible_shares(worlds: &[Arc<World>], mut on_scene: impl FnMut(usize)) -> BTreeMap<String, f64> {
    let mut shares = BTreeMap::new();
    for (number, world) in worlds.iter().enumerate() {
        let share = world.visibility().visible().len() as f64 / world.surface().len() as f64;
        shares.insert(world.scene().name().to_owned(), share);
        on_scene(number + 1);
    }
    shares
}

fn jobs<'a>(worlds: &'a [Arc<World>], context: &PolicyContext, config: &EvalConfig) -> Result<Vec<Job<'a>>, EvalError> {
    let checks = [(worlds.is_empty(), "no scenes"), (config.policies.is_empty(), "no policies")];
    let checks = checks.into_iter().chain([(config.steps == 0, "0 steps"), (config.seeds == 0, "0 seeds")]);
    if let Some((_, what)) = checks.into_iter().find(|(is_bad, _)| *is_bad) {
        return Err(EvalError::Nothing(what));
    }
    let mut names = BTreeSet::new();
    if let Some(twin) = worlds.iter().find(|world| !names.insert(world.scene().name())) {
        return Err(EvalError::SameName(twin.scene().name().to_owned()));
    }
    let mut kinds = Vec::new();
    for &kind in &config.policies {
        registry::build(kind, context, &worlds[0])?;
        if !kinds.contains(&kind) {
            kinds.push(kind);
        }
    }
    let mut jobs = Vec::new();
    for world in worlds {
        let starts = world.scene().starts().len().min(config.starts_limit.unwrap_or(usize::MAX));
        for &kind in &kinds {
            for start in 0..starts {
                for repeat in 0..config.seeds as u64 {
                    let trial = Trial { start, seed: config.seed.wrapping_add(repeat), steps: config.steps };
                    jobs.push(Job { world, kind, trial });
                }
            }
        }
    }
    if jobs.is_empty() { Err(EvalError::Nothing("no start poses")) } else { Ok(jobs) }
}

impl Job<'_> {
    fn key(&self) -> EpisodeKey {
        (self.world.scene().name().to_owned(), self.kind.name().to_owned(), self.trial.start, self.trial.seed)
    }

    fn run(&self, context: &PolicyContext) -> Result<EpisodeRecord, EvalError> {
        let mut policy = registry::build(self.kind, context, self.world)?;
        Ok(run_episode(self.world, policy.as_mut(), self.trial, |_, _| Ok(()))?.record)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::registry::tests::with_network;
    use nbp_env::{EncoderInput, PredictError, Prediction, Predictor, Scene, SimConfig};

    fn worlds() -> Vec<Arc<World>> {
        vec![Arc::new(World::new(Scene::two_rooms(), &SimConfig::default()).unwrap())]
    }

    fn config() -> EvalConfig {
        let policies = vec![PolicyKind::Fbe, PolicyKind::Random, PolicyKind::Nbp];
        EvalConfig { policies, steps: 6, seeds: 2, seed: 5, starts_limit: Some(2), batch: 1 }
    }

    fn without_times(records: Vec<EpisodeRecord>) -> Vec<EpisodeRecord> {
        records.into_iter().map(|record| EpisodeRecord { decision_ms: 0.0, ..record }).collect()
    }

    #[test]
    fn neither_threads_nor_batches_change_anything() {
        let run = |threads, batch| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let config = EvalConfig { batch, ..config() };
            pool.install(|| without_times(run(&worlds(), &with_network(), &config, &[], |_, _| ()).unwrap()))
        };
        let one = run(1, 1);
        for (threads, batch) in [(3, 1), (1, 3), (3, 4)] {
            assert_eq!(one, run(threads, batch));
        }
        let keys: Vec<_> = one.iter().map(|r| (r.policy.as_str(), r.start, r.seed)).collect();
        assert_eq!(keys[..5], [("fbe", 0, 5), ("fbe", 0, 6), ("fbe", 1, 5), ("fbe", 1, 6), ("random", 0, 5)]);
        assert_eq!(keys.len(), 12);
    }

    #[test]
    fn finished_episodes_are_taken_over() {
        let all = run(&worlds(), &with_network(), &config(), &[], |_, _| ()).unwrap();
        let fresh = Mutex::new(Vec::new());
        let resumed = run(&worlds(), &with_network(), &config(), &all[3..], |record, progress| {
            fresh.lock().unwrap().push((record.key(), progress.finished));
        });
        let mut fresh = fresh.into_inner().unwrap();
        fresh.sort();
        assert_eq!(fresh.len(), 3);
        assert!(fresh.iter().any(|(_, finished)| *finished == 12));
        assert_eq!(without_times(resumed.unwrap()), without_times(all));
    }

    struct Broken;

    impl Predictor for Broken {
        fn predict(&self, _: &[EncoderInput]) -> Result<Vec<Prediction>, PredictError> {
            Err(PredictError::NonFinite("value"))
        }
    }

    #[test]
    fn what_cannot_work_is_refused_at_once_and_failures_are_named() {
        let message = |worlds: &[Arc<World>], context: &PolicyContext, config: &EvalConfig| {
            run(worlds, context, config, &[], |_, _| ()).unwrap_err().to_string()
        };
        let blind = PolicyContext::default();
        assert!(message(&worlds(), &blind, &config()).contains("nbp needs a network"));
        assert!(message(&[], &blind, &config()).contains("no scenes"));
        let none = EvalConfig { steps: 0, ..config() };
        assert!(message(&worlds(), &with_network(), &none).contains("0 steps"));
        let twins = [worlds(), worlds()].concat();
        assert!(message(&twins, &with_network(), &config()).contains("two scenes are called two_rooms"));
        let broken = PolicyContext { predictor: Some(Arc::new(Broken)), ..PolicyContext::default() };
        let error = message(&worlds(), &broken, &config());
        assert!(error.contains("policy nbp, start 0") && error.contains("not finite"), "{error}");
    }
}
