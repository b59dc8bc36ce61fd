//! What `rollout` and `eval` share: settings from a checkpoint and the command line, the network, the worlds.

use super::overrides::{self, EvalSection};
use super::{talk::Talk, usage};
use anyhow::{Context, Result};
use nbp_env::predict::Paired;
use nbp_env::{Predictor, Scene, World};
use nbp_infer::{PolicyContext, PolicyKind, Settings, checkpoint};
use nbp_model::weights::WEIGHTS_FILE;
use nbp_model::{CheckpointConfig, DeviceChoice};
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Options of the commands that run episodes.
#[derive(clap::Args)]
pub(super) struct Args {
    /// Checkpoint folder (model.safetensors and config.json), or its model.safetensors. Its settings hold for every policy
    #[arg(long, value_name = "DIR|FILE")]
    pub(super) checkpoint: Option<PathBuf>,
    /// Take the obstacle map from another checkpoint: networks that learnt one task each
    #[arg(long, value_name = "DIR|FILE", requires = "checkpoint")]
    obstacle_checkpoint: Option<PathBuf>,
    /// Configuration file (TOML): its sim, policy, search and eval tables; several are stacked left to right
    #[arg(long, value_name = "FILE")]
    config: Vec<PathBuf>,
    /// Steps of an episode (paper: 100, 200, 400 and 500 from Simple to Insane) [default: the configuration's, else 100]
    #[arg(long, value_name = "N")]
    steps: Option<usize>,
    /// Root of all random numbers
    #[arg(long, default_value_t = 0, value_name = "N")]
    pub(super) seed: u64,
    /// Probability from which a pixel is an obstacle; the checkpoint's own setting if left out
    #[arg(long, value_name = "P")]
    obstacle_threshold: Option<f32>,
    /// Let what was seen overrule the predicted obstacles: true or false
    #[arg(long, value_name = "BOOL", num_args = 0..=1, default_missing_value = "true")]
    fuse_observed: Option<bool>,
    /// Change any setting, e.g. sim.coverage.points=50000 or policy.blocking_pixels=1; may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
}

/// Everything but the scenes.
pub(super) struct Setup {
    pub(super) settings: Settings,
    pub(super) context: PolicyContext,
    /// Steps of an episode.
    pub(super) steps: usize,
}

/// Settings, and all that is known before the network is loaded.
pub(super) struct Read {
    settings: Settings,
    trained: Option<CheckpointConfig>,
    /// The configuration's `[eval]`.
    pub(super) eval: EvalSection,
}

impl Args {
    /// Settings from checkpoint, files and command line, in this order.
    pub(super) fn read(&self) -> Result<Read> {
        if self.obstacle_threshold.is_some_and(|threshold| !(0.0..=1.0).contains(&threshold)) {
            usage("--obstacle-threshold must be a probability, 0 to 1");
        }
        let described = match &self.checkpoint {
            None => None,
            Some(path) => Some(checkpoint::read(path).context("cannot use the checkpoint")?),
        };
        let (trained, base) = described.unzip();
        let (mut settings, eval) = overrides::apply(&base.unwrap_or_default(), &self.config, &self.set)?;
        if let Some(threshold) = self.obstacle_threshold {
            settings.policy.obstacle_threshold = threshold;
        }
        if let Some(fuse) = self.fuse_observed {
            settings.policy.fuse_observed = fuse;
        }
        settings.policy.validate().context("policy")?;
        settings.search.validate()?;
        Ok(Read { settings, trained, eval })
    }

    /// Bytes of the weights of all checkpoints.
    pub(super) fn weights(&self) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        for path in self.checkpoint.iter().chain(&self.obstacle_checkpoint) {
            bytes.extend(std::fs::read(checkpoint::folder(path)?.join(WEIGHTS_FILE))?);
        }
        Ok(bytes)
    }

    /// What was read and, if one of the policies needs it, the network, which answers `batch` inputs at once.
    pub(super) fn setup(
        &self,
        Read { settings, trained, eval }: Read,
        policies: &[PolicyKind],
        device: DeviceChoice,
        batch: usize,
        talk: Talk,
    ) -> Result<Setup> {
        let needy = policies.iter().find(|kind| kind.needs_network());
        if let (Some(kind), None) = (needy, &self.checkpoint) {
            usage(&format!("policy {kind} needs a network: give --checkpoint DIR"));
        }
        let steps = self.steps.or(eval.steps).unwrap_or(100);
        if steps == 0 {
            usage("--steps must be at least 1");
        }
        if let Some(trained) = &trained {
            checkpoint::check(trained, &settings.sim)?;
        }
        let mut context = PolicyContext::new(&settings, None);
        if let (Some(path), true) = (&self.checkpoint, needy.is_some()) {
            let obstacle = self.obstacle_checkpoint.as_deref();
            context.predictor = Some(network(path, obstacle, &settings, device, batch, talk)?);
        }
        talk.detail(format!("settings: {}", serde_json::to_string(&settings)?));
        Ok(Setup { settings, context, steps })
    }
}

/// The network of a checkpoint, which answers `batch` inputs at once; the obstacle map is that of the second one, if there is
/// one.
pub(super) fn network(
    path: &Path,
    obstacle: Option<&Path>,
    settings: &Settings,
    device: DeviceChoice,
    batch: usize,
    talk: Talk,
) -> Result<Arc<dyn Predictor>> {
    let loaded = checkpoint::load(path, device).context("cannot use the checkpoint")?;
    let (net, window) = (loaded.config.net, loaded.config.window);
    talk.say(format!(
        "network: {:.1} million parameters, window {} pixels over {} m, on {}",
        net.parameters() as f64 / 1e6,
        window.pixels,
        window.metres,
        loaded.device
    ));
    let value: Arc<dyn Predictor> = Arc::new(loaded.predictor.with_chunk(batch));
    let Some(path) = obstacle else { return Ok(value) };
    let obstacle = checkpoint::load(path, device).context("cannot use the obstacle checkpoint")?;
    checkpoint::check(&obstacle.config, &settings.sim)?;
    Ok(Arc::new(Paired { value, obstacle: Arc::new(obstacle.predictor.with_chunk(batch)) }))
}

/// Scenes ready for episodes.
pub(super) fn worlds(scenes: Vec<Scene>, settings: &Settings, talk: Talk) -> Result<Vec<Arc<World>>> {
    let world = |scene: Scene| Ok(Arc::new(World::new(scene, &settings.sim)?));
    let worlds: Vec<Arc<World>> = scenes.into_par_iter().map(world).collect::<Result<_>>()?;
    worlds.iter().flat_map(|world| world.scene().notes()).for_each(|note| talk.say(format!("note: {note}")));
    Ok(worlds)
}
