//! `train`: see `train --help`.

use anyhow::{Context as _, Result};
use burn::tensor::Device;
use clap::Parser;
use nbp_env::explain::{show, tell, told_once};
use nbp_model::weights::scone::Baseline;
use nbp_model::{DeviceChoice, Nbp, NetConfig, weights};
use nbp_train::checkpoint::{self, Progress};
use nbp_train::clock::{Clock, Spent};
use nbp_train::config::{self, Config};
use nbp_train::log::{Bars, Log};
use nbp_train::memory::Memory;
use nbp_train::run::{Outcome, Session, describe};
use nbp_train::step::Learner;
use nbp_train::{folder, interrupt, recipe, report, scenes};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;
use std::{fs, io};

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// Trains NextBestPath: collects trajectories, learns from them, and compares itself with simpler policies.
///
/// Running the same command again resumes, or says that the run is complete.
#[derive(Parser)]
#[command(version, after_help = EXAMPLES)]
struct Arguments {
    /// Train a next-best-view baseline instead: scone (on the truth) or macarons (on what it saw itself), whose
    /// configurations are in configs/scone [default: configs/scone/cpu.toml]
    #[arg(long, value_name = "NAME", value_parser = baseline)]
    recipe: Option<Baseline>,
    /// Configuration file; give it several times to stack them left to right [default: configs/quickstart.toml]
    #[arg(long, value_name = "FILE")]
    config: Vec<PathBuf>,
    /// One setting on top of the files, as path.to.key=value; may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Folder of the run [default: runs/ and the configuration's name]
    #[arg(long, value_name = "DIR")]
    run: Option<PathBuf>,
    /// Root of all random streams; the same as --set seed=N
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Where tensors live: auto, flex, ndarray, wgpu or cuda; the same as --set device=NAME
    #[arg(long, value_name = "NAME")]
    device: Option<DeviceChoice>,
    /// Threads to use [default: all cores]; results do not depend on it
    #[arg(long, value_name = "N")]
    threads: Option<usize>,
    /// Print the resolved configuration and stop
    #[arg(long)]
    print_config: bool,
    /// No progress bars
    #[arg(short, long)]
    quiet: bool,
    /// Tell more; twice: tell all
    #[arg(short, long, action = clap::ArgAction::Count)]
    verbose: u8,
}

impl Arguments {
    /// The configuration files, or the one that stands for them.
    fn files(&self, default: &str) -> Vec<PathBuf> {
        let default = [PathBuf::from(default)];
        let files = if self.config.is_empty() { &default[..] } else { &self.config[..] };
        files.iter().map(|path| config::find(path, &checkout())).collect()
    }
}

const EXAMPLES: &str = "\
Examples:
  cargo run -p train                                       ten minutes on generated Simple maps
  cargo run -p train -- --set train.iterations=6 --run runs/longer
  cargo run -p train -- --config configs/aimdoom/simple.toml --config configs/aimdoom/cpu.toml
  cargo run -p train -- --config configs/quickstart.toml --set 'scenes.train.paths=[\"my/maps\"]'
  cargo run -p train -- --recipe scone                     a baseline on the same maps
  tensorboard --logdir runs";

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    start_log(&arguments);
    match train(&arguments) {
        Ok(Outcome::Complete) => ExitCode::SUCCESS,
        Ok(Outcome::Interrupted) => ExitCode::from(130),
        Err(error) => {
            tell(format_args!("error: {}", told_once(error.chain().map(ToString::to_string))));
            ExitCode::FAILURE
        }
    }
}

fn baseline(name: &str) -> Result<Baseline, String> {
    Baseline::named(name).ok_or_else(|| "use scone or macarons".into())
}

fn train(arguments: &Arguments) -> Result<Outcome> {
    if let Some(threads) = arguments.threads {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build_global().context("--threads")?;
    }
    match arguments.recipe {
        Some(baseline) => train_baseline(arguments, baseline),
        None => train_nbp(arguments),
    }
}

fn train_baseline(arguments: &Arguments, baseline: Baseline) -> Result<Outcome> {
    let files = arguments.files("configs/scone/cpu.toml");
    let mut config = recipe::RecipeConfig::load(baseline, &files, &arguments.set)?;
    config.seed = arguments.seed.unwrap_or(config.seed);
    config.device = arguments.device.unwrap_or(config.device);
    if arguments.print_config {
        show(config.to_toml()?.trim_end())?;
        return Ok(Outcome::Complete);
    }
    let name = format!("{baseline}-{}", config::run_name(&files));
    let folder = arguments.run.clone().unwrap_or_else(|| checkout().join("runs").join(name));
    recipe::train(baseline, config, &folder, Bars::detect(arguments.quiet))
}

fn train_nbp(arguments: &Arguments) -> Result<Outcome> {
    let (config, name) = configure(arguments)?;
    if arguments.print_config {
        show(config.to_toml()?.trim_end())?;
        return Ok(Outcome::Complete);
    }
    let folder = arguments.run.clone().unwrap_or_else(|| checkout().join("runs").join(name));
    let device = config.device.resolve_for("train")?;
    if !folder.join("config.toml").exists() {
        // A folder that is made for settings which cannot be would refuse those that can.
        first_network(&config)?;
    }
    prepare(&folder, &config)?;
    let _lock = folder::lock(&folder)?;
    interrupt::listen();

    let bars = Bars::detect(arguments.quiet);
    let (net, device) = (config.net_config(), device.autodiff());
    let device = if config.train.gradient_checkpointing { device.gradient_checkpointing() } else { device };
    let (last, best) = (checkpoint::last(&folder), checkpoint::best(&folder));
    let (has_last, has_best) = (checkpoint::recover(&last)?, checkpoint::recover(&best)?);
    let (learner, progress) = if has_last || has_best {
        checkpoint::load(if has_last { &last } else { &best }, &net, &config.optim, &device)?
    } else {
        let weights = first_weights(&config, &net, &device)?;
        let learner = Learner { net: weights, optim: config.optim.init(), config: net, device, steps: 0 };
        (learner, Progress::new(config.optim.lr))
    };
    let log =
        Log::open(&folder, progress.steps, bars).with_context(|| format!("opening the log in {}", folder.display()))?;
    if progress.done {
        tell(format_args!("the run in {} is complete; train another with --run DIR", folder.display()));
        return finish(&config, &folder, &log, &progress.spent);
    }
    if has_last || has_best {
        tracing::info!("resuming at iteration {}, step {}", progress.iteration + 1, progress.steps);
    }
    // What is only needed at the end must not fail then.
    scenes::load(&config.scenes.held_out, &config.sim, "held-out scenes", Bars::Quiet)?;
    let worlds = scenes::load(&config.scenes.train, &config.sim, "training scenes", bars)?;
    let validation = match config.scenes.validation.is_empty() {
        true => Vec::new(),
        false => scenes::load(&config.scenes.validation, &config.sim, "validation scenes", bars)?,
    };
    let open = |name: &str, count: usize| -> Result<Memory> {
        let mut memory = Memory::open(&folder.join("memory").join(name))?;
        memory.truncate(count)?;
        Ok(memory)
    };
    let mut session = Session {
        memory: open("train.bin", progress.memory)?,
        held_out: open("validation.bin", progress.held_out)?,
        clock: Clock::start(progress.spent),
        saved: Instant::now(),
        describe: describe(&config)?,
        folder: folder.clone(),
        config: config.clone(),
        worlds,
        validation,
        learner,
        progress,
        log,
    };
    if session.run()? == Outcome::Interrupted {
        tell(format_args!("saved in {}; the same command resumes", folder.display()));
        return Ok(Outcome::Interrupted);
    }
    finish(&config, &folder, &session.log, &session.progress.spent)
}

/// What a run begins with: drawn from the seed, or the weights of another network of the same shape.
fn first_weights(config: &Config, net: &NetConfig, device: &Device) -> Result<Nbp> {
    match first_network(config)? {
        Some(folder) => Ok(weights::load(&folder, device).context("train.init")?.net),
        None => Ok(Nbp::new(net, config.seed, device)?),
    }
}

/// The folder of the network that a run begins with, if it sees and answers what the settings say.
fn first_network(config: &Config) -> Result<Option<PathBuf>> {
    let Some(path) = &config.train.init else { return Ok(None) };
    let (found, settings) = nbp_infer::checkpoint::read(path).context("train.init")?;
    let (net, encode) = (config.net_config(), config.sim.encode);
    anyhow::ensure!(
        found.net == net && settings.sim.encode == encode,
        "train.init: {} holds {:?} for {:?}, the settings ask for {net:?} for {encode:?}: leave net and sim.encode as it was trained",
        path.display(),
        found.net,
        settings.sim.encode
    );
    Ok(Some(nbp_infer::checkpoint::folder(path)?))
}

/// The final table, in a run's folder.
const TABLE: &str = "eval/table.txt";

/// Prints the final table, computed once and kept in `eval/`.
fn finish(config: &Config, folder: &Path, log: &Log, spent: &Spent) -> Result<Outcome> {
    interrupt::nothing_to_save();
    let kept = folder.join(TABLE);
    let table = match fs::read_to_string(&kept) {
        Ok(table) => table,
        Err(_) => {
            let table = report::final_table(config, folder, log)?;
            weights::write_atomic(&kept, table.as_bytes()).with_context(|| format!("writing {}", kept.display()))?;
            table
        }
    };
    show(&table)?;
    tell(spent.tell(rayon::current_num_threads()));
    tell(format_args!("checkpoint: {}", checkpoint::best(folder).display()));
    Ok(Outcome::Complete)
}

fn configure(arguments: &Arguments) -> Result<(Config, String)> {
    let files = arguments.files("configs/quickstart.toml");
    let mut config = Config::load(&files, &arguments.set)?;
    config.seed = arguments.seed.unwrap_or(config.seed);
    config.device = arguments.device.unwrap_or(config.device);
    Ok((config, config::run_name(&files)))
}

/// Makes the run's folder, or checks that it was made for this configuration. Where only the final table is to be another
/// one, the old table goes.
fn prepare(folder: &Path, config: &Config) -> Result<()> {
    folder::make(folder)?;
    let path = folder.join("config.toml");
    let differences = match path.exists() {
        true => Config::load(std::slice::from_ref(&path), &[])?.differences(config),
        false => Vec::new(),
    };
    let (of_the_table, mut learnt): (Vec<String>, Vec<String>) = differences
        .into_iter()
        .partition(|line| ["eval.", "scenes.held_out.", "policy."].iter().any(|part| line.starts_with(part)));
    // These change what a step costs, not what is learnt.
    learnt.retain(|line| !["collect.batch:", "train.gradient_checkpointing:"].iter().any(|key| line.starts_with(key)));
    folder::refuse_other_settings(folder, &learnt)?;
    let table = folder.join(TABLE);
    if !of_the_table.is_empty() && table.exists() {
        fs::remove_file(&table).with_context(|| format!("removing the old {}", table.display()))?;
    }
    weights::write_atomic(&path, config.to_toml()?.as_bytes()).with_context(|| folder::unwritable(folder))
}

/// The folder of the workspace, so that `cargo run` finds `configs/` and `runs/` from any folder below it.
fn checkout() -> PathBuf {
    let built_in = Path::new(env!("CARGO_MANIFEST_DIR")).parent().map(Path::to_path_buf).unwrap_or_default();
    if built_in.join("configs").is_dir() { built_in } else { PathBuf::new() }
}

fn start_log(arguments: &Arguments) {
    let level = match (arguments.quiet, arguments.verbose) {
        (true, _) => tracing::Level::WARN,
        (false, 0) => tracing::Level::INFO,
        (false, 1) => tracing::Level::DEBUG,
        (false, _) => tracing::Level::TRACE,
    };
    tracing_subscriber::fmt().with_max_level(level).with_writer(io::stderr).with_target(false).without_time().init();
}
