//! The command line: one file for each command, what they share in `setup`, `output` and `talk`.

mod bench;
mod eval;
mod export;
mod import;
mod output;
mod overrides;
mod predict;
mod report;
mod rollout;
mod setup;
mod speed;
mod talk;

use clap::{CommandFactory, Parser, Subcommand};
use nbp_env::explain::{tell, told_once};
use nbp_model::DeviceChoice;
use std::process::ExitCode;
use talk::Talk;

const EXAMPLES: &str = "\
Examples:
  cargo run -p infer -- rollout --scene maps/normal/3001 --policy fbe --steps 200 --out out/fbe
  cargo run -p infer -- rollout --scene DOOM2.WAD:MAP01 --policy nbp --checkpoint runs/quickstart/checkpoints/best --out out/map01
  cargo run -p infer -- eval --scenes maps/simple/test --policies random,fbe,nbp --checkpoint runs/quickstart/checkpoints/best --out out/eval
  cargo run -p infer -- bench --config configs/bench/aimdoom.toml --out out/bench
  cargo run -p infer -- bench --config configs/bench/aimdoom.toml --data simple=maps/mine --shard 1/2 --out out/mine
  cargo run -p infer -- report --bench out/bench --out report.html
  cargo run -p infer -- speed --scenes maps/simple --threads 2 --json
  cargo run -p infer -- eval --config configs/continuous/matterport.toml --scenes maps/simple --out out/continuous
  cargo run -p infer -- import nbp_weights.pth --out checkpoints/released
  cargo run -p infer -- export --checkpoint runs/quickstart/checkpoints/best --precision f16 --out checkpoints/small
  cargo run -p infer -- predict --checkpoint checkpoints/released --input x.safetensors --out y.safetensors

In the source tree, `cargo run -p infer --` stands for `infer`.
Results go to standard output, talk goes to standard error. Exit codes: 0 done, 1 failed, 2 not understood.";

/// Explore scenes with a policy, compare policies, and bring weights in.
#[derive(Parser)]
#[command(name = "infer", version, after_help = EXAMPLES)]
struct Cli {
    #[command(flatten)]
    common: Common,
    #[command(subcommand)]
    command: Command,
}

/// Options of every command.
#[derive(clap::Args)]
#[command(next_help_heading = "General options")]
struct Common {
    /// Where the network computes: auto, flex, ndarray, wgpu or cuda
    #[arg(long, global = true, default_value_t = DeviceChoice::Auto, value_name = "DEVICE")]
    device: DeviceChoice,
    /// Threads to use; one a core if left out or 0. Results do not depend on it
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(0..=1024))]
    threads: Option<u16>,
    /// Say nothing but errors
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    quiet: bool,
    /// Say more
    #[arg(short, long, global = true)]
    verbose: bool,
}

#[derive(Subcommand)]
enum Command {
    /// Let a policy explore one scene, and draw what it did
    Rollout(rollout::Args),
    /// Compare policies over scenes and starts
    Eval(eval::Args),
    /// Compare rows of policies, networks and settings on data sets: resumable, in shards
    Bench(bench::Args),
    /// Show a finished bench as one HTML page: tables, curves, episodes
    Report(report::Args),
    /// Run the network on tensors, for comparison with other frameworks
    Predict(predict::Args),
    /// Measure how fast the simulator is in scenes of your own
    Speed(speed::Args),
    /// Turn PyTorch weights of the released code into a checkpoint
    Import(import::Args),
    /// Store a checkpoint's weights in half the bits, and count on how many steps it decides the same
    Export(export::Args),
}

/// Runs the program.
pub(crate) fn main() -> ExitCode {
    let Cli { common, command } = Cli::parse();
    let talk = Talk::new(common.quiet, common.verbose);
    let result = threads(usize::from(common.threads.unwrap_or(0))).and_then(|()| match command {
        Command::Rollout(args) => rollout::run(&args, common.device, talk),
        Command::Eval(args) => eval::run(&args, common.device, talk),
        Command::Bench(args) => bench::run(&args, common.device, talk),
        Command::Speed(args) => speed::run(&args, common.threads.map(usize::from), talk),
        Command::Report(args) => report::run(&args, talk),
        Command::Predict(args) => predict::run(&args, common.device, talk),
        Command::Import(args) => import::run(&args, talk),
        Command::Export(args) => export::run(&args, common.device, talk),
    });
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            tell(format_args!("error: {}", told_once(error.chain().map(ToString::to_string))));
            ExitCode::FAILURE
        }
    }
}

fn threads(count: usize) -> anyhow::Result<()> {
    if count > 0 {
        rayon::ThreadPoolBuilder::new().num_threads(count).build_global()?;
    }
    Ok(())
}

/// Ends the program with exit code 2 and the usage of the command line.
fn usage(message: &str) -> ! {
    Cli::command().error(clap::error::ErrorKind::MissingRequiredArgument, message).exit()
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyhow::Context;

    #[test]
    fn the_command_line_is_well_formed() {
        Cli::command().debug_assert();
    }

    #[test]
    fn causes_are_told_once() {
        let inner = std::io::Error::other("the disk is full");
        let error =
            Err::<(), _>(inner).context("cannot write a.png: the disk is full").context("while drawing").unwrap_err();
        assert_eq!(
            told_once(error.chain().map(ToString::to_string)),
            "while drawing: cannot write a.png: the disk is full"
        );
    }
}
