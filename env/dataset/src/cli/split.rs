//! `dataset split`.

use super::say;
use anyhow::Result;
use nbp_dataset::split::{Part, carry_out, plan};
use std::path::PathBuf;

const EXAMPLES: &str = "Examples:
  dataset split data/maps --dry-run
  dataset split data/maps --seed 3
  dataset split data/maps --out data/parted --copy

Draws 70 % of the scene folders right below DIR for OUT/train, the others for OUT/test. The same names and seed give the same
parts. Nothing is overwritten, and nothing done where OUT/train or OUT/test hold scenes already.";

#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// Folder with scene folders.
    #[arg(value_name = "DIR")]
    dir: PathBuf,
    /// Folder for train and test [default: DIR].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Seed of the draw.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Copy the scenes instead of moving them.
    #[arg(long)]
    copy: bool,
    /// Only print what would be done.
    #[arg(long)]
    dry_run: bool,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let out = args.out.as_ref().unwrap_or(&args.dir);
    let placements = plan(&args.dir, out, args.seed)?;
    if args.dry_run {
        for placement in &placements {
            say!("{} -> {}", placement.from.display(), placement.to.display());
        }
    } else {
        carry_out(&placements, args.copy)?;
    }
    let train = placements.iter().filter(|placement| placement.part == Part::Train).count();
    let would = if args.dry_run { "would be " } else { "" };
    eprintln!("{would}{train} scenes in {0}/train, {would}{1} in {0}/test", out.display(), placements.len() - train);
    Ok(())
}
