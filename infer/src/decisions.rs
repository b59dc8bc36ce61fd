//! How often two networks lead to the same decision, on all steps of rollouts that the first of them leads.
//!
//! At every step both plan afresh on the same map, whether the agent needs a plan then or not.

use crate::registry::{self, PolicyContext, PolicyKind};
use crate::rollout::{RolloutError, Trial, run_episode};
use nbp_env::policy::PolicyError;
use nbp_env::policy::nbp::{Nbp, NbpConfig, Passability};
use nbp_env::{Action, Episode, LatticePose, Policy, Predictor, World, parallel};
use std::sync::Arc;

/// What two networks decided.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Agreement {
    /// Steps at which both decided.
    pub steps: usize,
    /// Steps at which they did the same.
    pub actions: usize,
    /// Steps at which they had the same goal and the same way to it, headings included.
    pub plans: usize,
}

impl Agreement {
    /// Equal actions, percent.
    pub fn percent(&self) -> f64 {
        100.0 * self.actions as f64 / self.steps.max(1) as f64
    }
}

/// Episodes of `steps` steps from the first `starts` starts of every scene.
///
/// # Errors
/// When a scene has no such start or a network fails.
pub fn compare(
    worlds: &[Arc<World>],
    config: NbpConfig,
    [leads, other]: [&Arc<dyn Predictor>; 2],
    starts: usize,
    steps: usize,
    seed: u64,
) -> Result<Agreement, RolloutError> {
    let jobs: Vec<(&Arc<World>, Trial)> = worlds
        .iter()
        .flat_map(|world| {
            let starts = 0..starts.min(world.scene().starts().len());
            starts.map(move |start| (world, Trial { start, seed, steps }))
        })
        .collect();
    let found = parallel::try_map(&jobs, |&(world, trial)| one(world, config, [leads, other], trial))?;
    Ok(found.into_iter().fold(Agreement::default(), |all, one| Agreement {
        steps: all.steps + one.steps,
        actions: all.actions + one.actions,
        plans: all.plans + one.plans,
    }))
}

fn one(
    world: &Arc<World>,
    config: NbpConfig,
    predictors: [&Arc<dyn Predictor>; 2],
    trial: Trial,
) -> Result<Agreement, RolloutError> {
    let context = PolicyContext { predictor: Some(Arc::clone(predictors[0])), nbp: config, ..PolicyContext::default() };
    let mut policy: Box<dyn Policy> =
        registry::build(PolicyKind::Nbp, &context, world).unwrap_or_else(|_| unreachable!("the context has a network"));
    let mut agreement = Agreement::default();
    run_episode(world, policy.as_mut(), trial, |episode, _| {
        if !episode.is_over() {
            let first = decide(predictors[0], config, episode, trial)?;
            let second = decide(predictors[1], config, episode, trial)?;
            agreement.steps += 1;
            agreement.actions += usize::from(first.0 == second.0);
            agreement.plans += usize::from(first == second);
        }
        Ok(())
    })?;
    Ok(agreement)
}

/// What the network decides here with nothing planned before, and the way that it plans; chance is the same for both.
fn decide(
    predictor: &Arc<dyn Predictor>,
    config: NbpConfig,
    episode: &Episode,
    trial: Trial,
) -> Result<(Action, Vec<LatticePose>), PolicyError> {
    let world = episode.world();
    let passability = Passability::in_inference(&config, world);
    let mut policy = Nbp::new(Arc::clone(predictor), config, passability);
    let mut rng = trial.seeds(world.scene().name()).child("decision", episode.steps() as u64).rng();
    let action = policy.act(&episode.view(), &mut rng)?;
    Ok((action, policy.plan().map(|plan| plan.path.clone()).unwrap_or_default()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nbp_env::window::WindowSize;
    use nbp_env::{Scene, SimConfig};
    use nbp_model::weights::{self, Precision};
    use nbp_model::{CheckpointConfig, DeviceChoice, Nbp as Net, NetConfig, NetPredictor};

    /// Two rooms, and networks that see them in 32 pixels: one untrained, itself in 16 bits, another.
    fn agreements(precision: Precision) -> [Agreement; 3] {
        let mut sim = SimConfig::default();
        sim.encode.window = WindowSize { pixels: 32, metres: 20.0 };
        let world = Arc::new(World::new(Scene::two_rooms(), &sim).unwrap());
        let config = CheckpointConfig::new(NetConfig { base: 4, ..NetConfig::default() }, sim.encode.window);
        let device = DeviceChoice::Flex.resolve().unwrap();
        let net = |seed| Net::new(&config.net, seed, &device).unwrap();
        let dir = tempfile::tempdir().unwrap();
        weights::save_as(dir.path(), &net(1), &config, precision).unwrap();
        let [itself, rounded, another]: [Arc<dyn Predictor>; 3] = [
            Arc::new(NetPredictor::new(&net(1), &config)),
            Arc::new(NetPredictor::load(dir.path(), &device).unwrap()),
            Arc::new(NetPredictor::new(&net(2), &config)),
        ];
        [&itself, &rounded, &another]
            .map(|other| compare(&[Arc::clone(&world)], NbpConfig::default(), [&itself, other], 3, 40, 5).unwrap())
    }

    #[test]
    fn weights_of_half_the_bits_decide_the_same_and_another_network_does_not() {
        for precision in [Precision::F16, Precision::Bf16] {
            let [itself, rounded, another] = agreements(precision);
            assert_eq!(itself, Agreement { steps: 120, actions: 120, plans: 120 });
            assert!(rounded.steps == 120 && rounded.percent() >= 95.0, "{precision}: {rounded:?}");
            assert!(another.percent() < 90.0 && another.plans <= another.actions, "{another:?}");
        }
    }
}
