//! `dataset generate`.

use super::{Column, bar, print_table};
use anyhow::{Result, bail};
use nbp_dataset::{Generated, Level, WriteError, batch_seed, generate, write_scene};
use rayon::prelude::*;
use std::path::PathBuf;

const EXAMPLES: &str = "Examples:
  dataset generate --level simple --count 20 --seed 7 --out data/simple
  dataset generate --level insane --count 100 --seed 1 --out data/insane --split

Scenes are called LEVEL_SEED_NUMBER. The same level, seed and number give the same bytes, whatever the count.
--split writes the first 70 % to OUT/train and the rest to OUT/test.";

#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// simple, normal, hard or insane: 630, 1350, 3200 or 5500 m² on average.
    #[arg(long)]
    level: Level,
    /// Number of scenes.
    #[arg(long, default_value_t = 1)]
    count: u64,
    /// Seed of the set.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Folder for the scenes; made if need be.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Write 70 % to OUT/train and 30 % to OUT/test.
    #[arg(long)]
    split: bool,
    /// Replace scenes that exist.
    #[arg(long)]
    replace: bool,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    if args.count == 0 {
        bail!("--count is 0: nothing to generate");
    }
    let name_of = |number: u64| format!("{}_{}_{number:03}", args.level, args.seed);
    let parent_of = |number: u64| match args.split {
        true if number * 10 < args.count * 7 => args.out.join("train"),
        true => args.out.join("test"),
        false => args.out.clone(),
    };
    // Before the work rather than after it.
    let existing = (0..args.count).map(|n| parent_of(n).join(name_of(n))).find(|folder| folder.exists());
    if let (Some(folder), false) = (existing, args.replace) {
        return Err(WriteError::Exists(folder).into());
    }
    let bar = bar(args.count as usize, "generating");
    let one = |number: u64| -> Result<Generated> {
        let mut generated = generate(args.level, batch_seed(args.seed, number))?;
        generated.scene.name = name_of(number);
        write_scene(&generated.scene, &parent_of(number), args.replace)?;
        bar.inc(1);
        Ok(generated)
    };
    let scenes: Vec<Generated> = (0..args.count).into_par_iter().map(one).collect::<Result<_>>()?;
    bar.finish_and_clear();
    let names: Vec<&str> = scenes.iter().map(|s| s.scene.name.as_str()).collect();
    print_table(&names, &scenes, &COLUMNS);
    eprintln!("{} scenes in {}", scenes.len(), args.out.display());
    Ok(())
}

const COLUMNS: [Column<Generated>; 6] = [
    Column { heading: "floor m²", decimals: 0, value: |g| g.scene.report.floor_area },
    Column { heading: "connected m²", decimals: 0, value: |g| g.scene.report.plane_area },
    Column { heading: "complexity", decimals: 1, value: |g| g.complexity },
    Column { heading: "positions", decimals: 0, value: |g| g.scene.report.nodes as f64 },
    Column { heading: "triangles", decimals: 0, value: |g| g.scene.report.triangles as f64 },
    Column { heading: "drafts", decimals: 1, value: |g| g.tries as f64 },
];
