//! What `rollout` and `eval` share: settings from a checkpoint and the command line, the network, the worlds.

use super::overrides::{self, EvalSection};
use super::{talk::Talk, usage};
use anyhow::{Context, Result, bail};
use nbp_env::nbv::NbvConfig;
use nbp_env::predict::Paired;
use nbp_env::{Predictor, Scene, World};
use nbp_infer::registry::Network;
use nbp_infer::rollout::MOST_STEPS;
use nbp_infer::{PolicyContext, PolicyKind, Settings, checkpoint};
use nbp_model::weights::scone::Baseline;
use nbp_model::{CheckpointConfig, DeviceChoice};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Options of the commands that run episodes.
#[derive(clap::Args)]
pub(super) struct Args {
    /// Checkpoint folder (model.safetensors and config.json), or its model.safetensors; may be repeated, for policies of
    /// different networks. The simulator's settings of the nbp one, else of the first, hold for every policy
    /// [default: published, those in runs/published]
    #[arg(long, value_name = "DIR|FILE")]
    pub(super) checkpoint: Vec<PathBuf>,
    /// Take the obstacle map from another checkpoint: networks that learnt one task each
    #[arg(long, value_name = "DIR|FILE", requires = "checkpoint")]
    pub(super) obstacle_checkpoint: Option<PathBuf>,
    /// Configuration file (TOML): its sim, policy, search, nbv and eval tables; several are stacked left to right
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
    /// Checkpoints by their architecture.
    pub(super) checkpoints: BTreeMap<String, PathBuf>,
    /// What each of the next-best-view baselines is asked, by its architecture.
    nbv: BTreeMap<String, NbvConfig>,
    /// The configuration's `[eval]`.
    pub(super) eval: EvalSection,
}

impl Read {
    /// Whether a checkpoint of the policy's network was given.
    pub(super) fn has_network(&self, kind: PolicyKind) -> bool {
        kind.architecture().is_some_and(|architecture| self.checkpoints.contains_key(architecture))
    }
}

impl Args {
    /// Settings from checkpoint, files and command line, in this order.
    ///
    /// Where no checkpoint is given, `policies` have the published ones.
    pub(super) fn read(&self, policies: &[PolicyKind]) -> Result<Read> {
        if self.obstacle_threshold.is_some_and(|threshold| !(0.0..=1.0).contains(&threshold)) {
            usage("--obstacle-threshold must be a probability, 0 to 1");
        }
        let checkpoints = self.by_architecture(policies)?;
        let has_maps = PolicyKind::Nbp.architecture().is_some_and(|nbp| checkpoints.contains_key(nbp));
        if self.obstacle_checkpoint.is_some() && !has_maps {
            bail!("--obstacle-checkpoint is for nbp alone, of which there is no --checkpoint");
        }
        let (mut trained, mut base, mut nbv) = (None, None, BTreeMap::new());
        for (architecture, path) in &checkpoints {
            let (maps, its) = checkpoint::read_as(architecture, path).context("cannot use the checkpoint")?;
            // The same files and options for each of them, on top of what it was trained with.
            let asked = overrides::apply(&its, &self.config, &self.set)?.0.nbv;
            asked.validate().context("nbv")?;
            nbv.insert(architecture.clone(), asked);
            if maps.is_some() || base.is_none() && self.checkpoint.first().is_none_or(|first| first == path) {
                base = Some(its);
            }
            trained = trained.or(maps);
        }
        let (mut settings, eval) = overrides::apply(&base.unwrap_or_default(), &self.config, &self.set)?;
        if let Some(threshold) = self.obstacle_threshold {
            settings.policy.obstacle_threshold = threshold;
        }
        if let Some(fuse) = self.fuse_observed {
            settings.policy.fuse_observed = fuse;
        }
        settings.policy.validate().context("policy")?;
        settings.search.validate()?;
        settings.nbv.validate().context("nbv")?;
        Ok(Read { settings, trained, checkpoints, nbv, eval })
    }

    /// The checkpoints by what they hold; where none is given, `policies` have the published ones.
    fn by_architecture(&self, policies: &[PolicyKind]) -> Result<BTreeMap<String, PathBuf>> {
        let mut found = BTreeMap::new();
        for path in &self.checkpoint {
            let architecture = checkpoint::architecture(path).context("cannot use the checkpoint")?;
            if let Some(other) = found.insert(architecture.clone(), path.clone()) {
                let (first, second) = (other.display(), path.display());
                bail!("{first} and {second} both hold {architecture} networks: give one --checkpoint of each kind");
            }
        }
        if found.is_empty() {
            let needed = policies.iter().filter_map(|kind| kind.architecture());
            found = needed.map(|architecture| (architecture.to_owned(), checkpoint::published(architecture))).collect();
        }
        Ok(found)
    }

    /// Policies that the configuration files name.
    pub(super) fn named_in_files(&self) -> Result<Option<Vec<PolicyKind>>> {
        Ok(overrides::apply(&Settings::default(), &self.config, &[])?.1.policies)
    }

    /// Bytes of all checkpoints: what their networks answer depends on more than weights, and the settings of an evaluation
    /// hold that of one checkpoint only.
    pub(super) fn weights(&self, read: &Read) -> Result<Vec<u8>> {
        let all = read.checkpoints.values().chain(&self.obstacle_checkpoint).map(|path| Ok(checkpoint::bytes(path)?));
        Ok(all.collect::<Result<Vec<_>>>()?.concat())
    }

    /// What was read and, if one of the policies needs it, the network, which answers `batch` inputs at once.
    pub(super) fn setup(
        &self,
        Read { settings, trained, checkpoints, nbv, eval }: Read,
        policies: &[PolicyKind],
        device: DeviceChoice,
        batch: usize,
        talk: Talk,
    ) -> Result<Setup> {
        let of = |kind: &PolicyKind| checkpoints.get(kind.architecture()?);
        if let Some(kind) = policies.iter().find(|kind| kind.needs_network() && of(kind).is_none()) {
            let net = kind.architecture().unwrap_or_default();
            let others: Vec<&str> = checkpoints.keys().map(String::as_str).collect();
            let given = if others.is_empty() { String::new() } else { format!(", not of {}", others.join(" and ")) };
            usage(&format!("policy {kind} needs a network: give --checkpoint DIR of {net}{given}"));
        }
        let steps = self.steps.or(eval.steps).unwrap_or(100);
        if !(1..=MOST_STEPS).contains(&steps) {
            usage(&format!("--steps must be at least 1 and at most {MOST_STEPS}"));
        }
        if let Some(trained) = &trained {
            checkpoint::check(trained, &settings.sim)?;
        }
        let (mut context, mut loaded) = (PolicyContext::new(&settings), BTreeMap::new());
        for &kind in policies {
            let (Some(path), Some(architecture)) = (of(&kind), kind.architecture()) else { continue };
            let network = match loaded.remove(architecture) {
                Some(network) => network,
                None => network(path, self.obstacle_checkpoint.as_deref(), &settings, device, batch, talk)?,
            };
            loaded.insert(architecture, Network::clone(&network));
            context = context.with(kind, network, nbv.get(architecture).copied().unwrap_or(settings.nbv));
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
) -> Result<Network> {
    if Baseline::named(&checkpoint::architecture(path).context("cannot use the checkpoint")?).is_some() {
        let loaded = checkpoint::load_scone(path, device).context("cannot use the checkpoint")?;
        let about = loaded.predictor.config();
        let parameters = about.net.parameters().iter().sum::<usize>() as f64 / 1e6;
        talk.say(format!("{}: {parameters:.1} million parameters, on {}", about.architecture, loaded.device));
        return Ok(Network::Views(Arc::new(loaded.predictor)));
    }
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
    let Some(path) = obstacle else { return Ok(Network::Maps(value)) };
    let about = checkpoint::read(path).context("cannot use the obstacle checkpoint")?.0;
    checkpoint::check(&about, &settings.sim).context("cannot use the obstacle checkpoint")?;
    let obstacle = checkpoint::load(path, device).context("cannot use the obstacle checkpoint")?;
    Ok(Network::Maps(Arc::new(Paired { value, obstacle: Arc::new(obstacle.predictor.with_chunk(batch)) })))
}

/// Scenes ready for episodes.
pub(super) fn worlds(scenes: Vec<Scene>, settings: &Settings, talk: Talk) -> Result<Vec<Arc<World>>> {
    let world = |scene: Scene| Ok(Arc::new(World::new(scene, &settings.sim)?));
    let worlds: Vec<Arc<World>> = scenes.into_par_iter().map(world).collect::<Result<_>>()?;
    worlds.iter().flat_map(|world| world.scene().notes()).for_each(|note| talk.say(format!("note: {note}")));
    Ok(worlds)
}
