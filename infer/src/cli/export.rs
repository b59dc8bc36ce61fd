//! `infer export`: a checkpoint for others, its weights at half the size if asked for.

use super::output::Output;
use super::setup;
use super::talk::Talk;
use super::usage;
use anyhow::{Context, Result};
use nbp_env::Predictor;
use nbp_env::explain::show;
use nbp_env::scene::LoadOptions;
use nbp_infer::{checkpoint, decisions, source};
use nbp_model::weights::{self, Precision, WEIGHTS_FILE};
use nbp_model::{DeviceChoice, NetPredictor};
use std::path::PathBuf;
use std::sync::Arc;

/// Where `train` leaves what it resumes from, beside the weights.
const TRAINING_STATE: &str = "state.json";

/// Options of `infer export`.
#[derive(clap::Args)]
pub(super) struct Args {
    /// Checkpoint folder (model.safetensors and config.json), or its model.safetensors
    #[arg(long, value_name = "DIR|FILE")]
    checkpoint: PathBuf,
    /// How the weights are stored: f32, f16 or bf16. All programs here and PyTorch's load_state_dict read each of them
    #[arg(long, default_value_t = Precision::F16, value_name = "NAME")]
    precision: Precision,
    /// Scenes in which to count the steps of rollouts on which both checkpoints decide the same
    #[arg(long, num_args = 1.., value_name = "PATH")]
    compare: Vec<String>,
    /// Steps of each of these rollouts, one from every start
    #[arg(long, default_value_t = 100, value_name = "N")]
    steps: usize,
    /// Folder for model.safetensors and config.json
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

pub(super) fn run(args: &Args, device: DeviceChoice, talk: Talk) -> Result<()> {
    if args.steps == 0 {
        usage("--steps must be at least 1");
    }
    let from = checkpoint::folder(&args.checkpoint)?;
    anyhow::ensure!(
        !args.out.join(TRAINING_STATE).exists(),
        "--out {} is a checkpoint that a training resumes from: name another folder",
        args.out.display()
    );
    let out = Output::prepare(&args.out)?;
    anyhow::ensure!(
        std::fs::canonicalize(&from)? != std::fs::canonicalize(out.folder())?,
        "--out is the checkpoint's own folder: name another one, what is rounded away does not come back"
    );
    let (_, settings) = checkpoint::read(&from)?;
    let device = device.resolve_for("infer")?;
    let trained = weights::load(&from, &device).context("cannot use the checkpoint")?;
    weights::save_as(out.folder(), &trained.net, &trained.config, args.precision)?;
    let size = |dir: &std::path::Path| std::fs::metadata(dir.join(WEIGHTS_FILE)).map(|about| about.len() as f64 / 1e6);
    let (before, after) = (size(&from)?, size(out.folder())?);
    show(format_args!("{}: {after:.1} MB in {}, {before:.1} MB before", out.folder().display(), args.precision))?;
    if args.compare.is_empty() {
        return Ok(());
    }
    let scenes = source::load_all(&args.compare, LoadOptions::default(), |_| ()).context("cannot use the scenes")?;
    let worlds = setup::worlds(scenes, &settings, talk)?;
    let exported = NetPredictor::load(out.folder(), &device)?;
    let first: Arc<dyn Predictor> = Arc::new(NetPredictor::new(&trained.net, &trained.config));
    let second: Arc<dyn Predictor> = Arc::new(exported);
    let found = decisions::compare(&worlds, settings.policy, [&first, &second], usize::MAX, args.steps, 0)?;
    let plans = 100.0 * found.plans as f64 / found.steps.max(1) as f64;
    let (percent, steps) = (found.percent(), found.steps);
    show(format_args!(
        "{steps} decisions on the same maps: {percent:.2} % equal, {plans:.2} % with the same whole plan"
    ))?;
    Ok(())
}
