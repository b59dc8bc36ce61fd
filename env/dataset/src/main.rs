//! `dataset`: generates scenes, converts Doom maps, measures what is there.
//!
//! Results go to stdout, talk to stderr. Exit codes: 0 ok, 1 failure, 2 wrong usage.

mod cli;

use clap::{Parser, Subcommand};
use nbp_env::explain::told_once;
use std::process::ExitCode;

#[derive(Parser)]
#[command(name = "dataset", version, about, after_help = EXAMPLES)]
struct Args {
    #[command(subcommand)]
    command: Command,
    /// Worker threads; results do not depend on it [default: all cores].
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

#[derive(Subcommand)]
enum Command {
    /// Make new maps and write their scenes.
    Generate(cli::generate::Args),
    /// Turn the maps of WAD files into scenes.
    Convert(cli::convert::Args),
    /// Turn your own scans into scenes: OBJ, PLY, glTF, GLB.
    Import(cli::import::Args),
    /// Measure scenes: areas, navigation complexity, walls.
    Stats(cli::stats::Args),
    /// Say what is wrong with a set of scenes.
    Check(cli::check::Args),
    /// Part a set into scenes to train on and scenes to test on.
    Split(cli::split::Args),
    /// Draw all scenes of a set on one sheet.
    Preview(cli::preview::Args),
}

const EXAMPLES: &str = "Examples:
  dataset generate --level simple --count 100 --seed 1 --out data/simple --split
  dataset convert doom2.wad --maps MAP01,MAP07 --out data/doom2
  dataset import flat.glb --out data/scans
  dataset stats data/simple";

fn main() -> ExitCode {
    let args = Args::parse();
    if let Some(threads) = args.threads {
        // Fails only when a pool exists already, and none does yet.
        drop(rayon::ThreadPoolBuilder::new().num_threads(threads.into()).build_global());
    }
    let done = match args.command {
        Command::Generate(args) => cli::generate::run(&args),
        Command::Convert(args) => cli::convert::run(&args),
        Command::Import(args) => cli::import::run(&args),
        Command::Stats(args) => cli::stats::run(&args),
        Command::Check(args) => cli::check::run(&args),
        Command::Split(args) => cli::split::run(&args),
        Command::Preview(args) => cli::preview::run(&args),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {}", told_once(error.chain().map(ToString::to_string)));
            ExitCode::FAILURE
        }
    }
}
