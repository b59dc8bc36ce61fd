//! `dataset generate`.

use super::{Column, Units, bar, open_wads, print_table, tell_problems, textures};
use anyhow::{Context as _, Result, bail};
use nbp_dataset::split::{Part, train_count};
use nbp_dataset::wad::{WadError, starts, to_bytes, to_playable};
use nbp_dataset::{
    ConvertOptions, ConvertReport, DoomMap, Generated, Level, WriteError, batch_seed, convert, generate,
    write_scene_with,
};
use rayon::prelude::*;
use std::path::PathBuf;

const EXAMPLES: &str = "Examples:
  dataset generate --level simple --count 20 --seed 7 --out data/simple
  dataset generate --level insane --count 100 --seed 1 --out data/insane --split

Scenes are called LEVEL_SEED_NUMBER. The same level, seed and number give the same bytes, whatever the count.
--split writes the first 70 % to OUT/train and the rest to OUT/test. Another count parts the same scenes elsewhere: with
--replace, a scene is removed from the part that it has left.
--wad writes each map as SCENE/SCENE.wad too, as MAP01 with nodes and starts for one to four players. Play it with the
textures of Freedoom or Doom 2: crispy-doom -iwad freedoom2.wad -file SCENE.wad -warp 1. `dataset convert` turns it back
into the same mesh.";

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
    /// Write a playable Doom map beside each mesh.
    #[arg(long)]
    wad: bool,
    /// WAD files with the textures that the maps name, the game's own first: freedoom2.wad or doom2.wad. Without, tiles are
    /// drawn.
    #[arg(long, value_name = "WAD")]
    textures: Vec<PathBuf>,
    /// Unit of the files.
    #[arg(long, value_enum, default_value_t, value_name = "UNIT")]
    units: Units,
    /// Replace scenes that exist.
    #[arg(long)]
    replace: bool,
}

/// What the table tells of a scene.
struct Row {
    name: String,
    report: ConvertReport,
    complexity: f64,
    tries: u64,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    if args.count == 0 {
        bail!("--count is 0: nothing to generate");
    }
    let name_of = |number: u64| format!("{}_{}_{number:03}", args.level, args.seed);
    let train = train_count(args.count as usize) as u64;
    // Where a scene goes and, of a set in two parts, where it must not be any more.
    let folders_of = |number: u64| {
        let part = |part: Part| args.out.join(part.folder()).join(name_of(number));
        match (args.split, number < train) {
            (false, _) => (args.out.join(name_of(number)), None),
            (true, true) => (part(Part::Train), Some(part(Part::Test))),
            (true, false) => (part(Part::Test), Some(part(Part::Train))),
        }
    };
    // Before the work rather than after it.
    let mut folders = (0..args.count).map(folders_of).flat_map(|(folder, other)| [Some(folder), other]).flatten();
    let existing = folders.find(|folder| folder.exists());
    if let (Some(folder), false) = (existing, args.replace) {
        return Err(WriteError::Exists(folder).into());
    }
    let textures = textures(&open_wads(&args.textures)?)?;
    let bar = bar(args.count as usize, "generating");
    let one = |number: u64| -> Result<Row> {
        let mut generated = generate(args.level, batch_seed(args.seed, number))?;
        if textures.is_some() {
            let options = ConvertOptions { textures: textures.as_ref(), ..ConvertOptions::default() };
            generated.scene = convert(&generated.map, options)?;
        }
        generated.scene.name = name_of(number);
        let mut extra = Vec::new();
        if args.wad {
            let (wad, trouble) = playable(&generated)?;
            extra.push((format!("{}.wad", generated.scene.name), wad));
            trouble.into_iter().for_each(|trouble| bar.suspend(|| eprintln!("{}: {trouble}", generated.scene.name)));
        }
        generated.scene.settings = args.units.of(generated.scene.settings);
        let (folder, other) = folders_of(number);
        write_scene_with(&generated.scene, &extra, folder.parent().unwrap_or(&args.out), args.replace)?;
        if let Some(other) = other.filter(|other| other.exists()) {
            std::fs::remove_dir_all(&other).with_context(|| format!("cannot remove {}", other.display()))?;
        }
        bar.inc(1);
        let Generated { scene, complexity, tries, .. } = generated;
        Ok(Row { name: scene.name, report: scene.report, complexity, tries })
    };
    let scenes: Vec<Row> = (0..args.count).into_par_iter().map(one).collect::<Result<_>>()?;
    bar.finish_and_clear();
    let names: Vec<&str> = scenes.iter().map(|s| s.name.as_str()).collect();
    print_table(&names, &scenes, &COLUMNS);
    eprintln!("{} scenes in {}", scenes.len(), args.out.display());
    tell_problems(scenes.iter().map(|made| made.report.texture_problems.as_slice()));
    Ok(())
}

/// The map as a WAD; without nodes, and a word why, where the game's limits do not hold them.
fn playable(generated: &Generated) -> Result<(Vec<u8>, Option<WadError>)> {
    let map = DoomMap { things: starts(&generated.map, &generated.scene), ..generated.map.clone() };
    match to_playable(&map, "MAP01") {
        Err(trouble @ WadError::Nodes { .. }) => Ok((to_bytes(&map, "MAP01")?, Some(trouble))),
        done => Ok((done?, None)),
    }
}

const COLUMNS: [Column<Row>; 6] = [
    Column { heading: "floor m²", decimals: 0, value: |g| g.report.floor_area },
    Column { heading: "connected m²", decimals: 0, value: |g| g.report.plane_area },
    Column { heading: "complexity", decimals: 1, value: |g| g.complexity },
    Column { heading: "positions", decimals: 0, value: |g| g.report.nodes as f64 },
    Column { heading: "triangles", decimals: 0, value: |g| g.report.triangles as f64 },
    Column { heading: "drafts", decimals: 1, value: |g| g.tries as f64 },
];
