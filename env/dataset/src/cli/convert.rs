//! `dataset convert`.

use super::{Column, Units, bar, open_wads, print_table, tell_problems, textures};
use anyhow::{Context as _, Result, bail};
use nbp_dataset::wad::Wad;
use nbp_dataset::wad::textures::{TextureError, Textures};
use nbp_dataset::{ConvertOptions, ConvertReport, convert, scene_name, write_scene};
use nbp_env::explain::told_once;
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

const EXAMPLES: &str = "Examples:
  dataset convert freedoom2.wad --maps MAP01,MAP07 --out data/freedoom
  dataset convert maps/ --textures freedoom2.wad --out data/maps

Textures come from the WAD itself and from --textures; tiles are drawn for names that none of them has. A WAD with one map gives a scene called like the file, others FILE_MAP. A map that cannot be converted is listed with the
reason, and the others go on. Exit code 1 when no map was converted.";

#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// WAD files, or folders of them.
    #[arg(required = true, value_name = "WAD")]
    wads: Vec<PathBuf>,
    /// Only these maps, for example MAP01,E1M7 [default: all].
    #[arg(long, value_delimiter = ',', value_name = "MAP,…")]
    maps: Vec<String>,
    /// Folder for the scenes; made if need be.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// WAD files with textures, the game's own first, for maps that do not bring them.
    #[arg(long, value_name = "WAD")]
    textures: Vec<PathBuf>,
    /// Draw tiles instead of the WAD's own textures.
    #[arg(long, conflicts_with = "textures")]
    no_textures: bool,
    /// Scale walkable floors into ± 40 map units around their median, for hand-made maps with floors at many heights.
    #[arg(long)]
    relief: bool,
    /// Convert maps whose sectors contradict each other.
    #[arg(long)]
    force: bool,
    /// Unit of the files.
    #[arg(long, value_enum, default_value_t, value_name = "UNIT")]
    units: Units,
    /// Replace scenes that exist.
    #[arg(long)]
    replace: bool,
}

/// One map to convert.
struct Job {
    path: PathBuf,
    wad: Arc<Wad>,
    textures: Arc<Option<Textures>>,
    map: String,
    /// Of the scene.
    name: String,
}

/// What the table tells of a scene.
struct Row {
    name: String,
    report: ConvertReport,
}

/// What became of one map.
type Outcome = std::result::Result<Row, String>;

pub(crate) fn run(args: &Args) -> Result<()> {
    let files = wad_files(&args.wads)?;
    let given = open_wads(&args.textures)?;
    let shared = Arc::new(textures(&given)?);
    let mut jobs: Vec<Job> = Vec::new();
    let mut refused: Vec<String> = Vec::new();
    let mut names = BTreeSet::new();
    for path in &files {
        let wad = match Wad::open(path) {
            Ok(wad) => Arc::new(wad),
            Err(error) => {
                refused.push(format!("{}: {error}", path.display()));
                continue;
            }
        };
        let textures = match own_textures(&given, &wad, args.no_textures) {
            Ok(Some(own)) => Arc::new(Some(own)),
            Ok(None) => Arc::clone(&shared),
            Err(error) => {
                eprintln!("{}: its own textures are left out: {error}", path.display());
                Arc::clone(&shared)
            }
        };
        let available: Vec<String> = wad.maps().iter().map(ToString::to_string).collect();
        let maps = if args.maps.is_empty() { &available } else { &args.maps };
        if maps.is_empty() {
            refused.push(format!("{}: the WAD holds no map", path.display()));
        }
        for map in maps {
            let name = scene_name(path, map, available.len());
            if names.insert(name.clone()) {
                let (wad, textures) = (Arc::clone(&wad), Arc::clone(&textures));
                jobs.push(Job { path: path.clone(), wad, textures, map: map.clone(), name });
            } else {
                refused.push(format!(
                    "{}: its scene would be called {name}, like another: rename the file",
                    path.display()
                ));
            }
        }
    }
    let bar = bar(jobs.len(), "converting");
    let one = |job: &Job| -> Outcome {
        let done = convert_one(job, args)
            .map_err(|error| format!("{}: {}", job.path.display(), told_once(error.chain().map(ToString::to_string))));
        bar.inc(1);
        done
    };
    let outcomes: Vec<Outcome> = jobs.par_iter().map(one).collect();
    bar.finish_and_clear();
    let mut scenes = Vec::new();
    for outcome in outcomes {
        match outcome {
            Ok(scene) => scenes.push(scene),
            Err(reason) => refused.push(reason),
        }
    }
    let names: Vec<&str> = scenes.iter().map(|scene| scene.name.as_str()).collect();
    print_table(&names, &scenes, &COLUMNS);
    eprintln!("{} scenes in {}", scenes.len(), args.out.display());
    tell_problems(scenes.iter().map(|scene| scene.report.texture_problems.as_slice()));
    for reason in &refused {
        eprintln!("refused: {reason}");
    }
    if scenes.is_empty() {
        bail!("no map was converted, {} refused", refused.len());
    }
    Ok(())
}

/// The given textures with those of a WAD on top; `None` where the WAD has nothing to add.
fn own_textures(given: &[Arc<Wad>], wad: &Arc<Wad>, is_unwanted: bool) -> Result<Option<Textures>, TextureError> {
    if is_unwanted || !wad.has_textures() {
        return Ok(None);
    }
    Textures::read(&given.iter().chain([wad]).cloned().collect::<Vec<_>>())
}

fn convert_one(job: &Job, args: &Args) -> Result<Row> {
    let mut map = job.wad.map(&job.map)?;
    map.name.clone_from(&job.name);
    let options = ConvertOptions { force: args.force, relief: args.relief, textures: job.textures.as_ref().as_ref() };
    let mut scene = convert(&map, options)?;
    scene.settings = args.units.of(scene.settings);
    let place = |path: &Path| path.canonicalize().ok();
    if job.path.parent().and_then(place).is_some_and(|folder| place(&args.out.join(&job.name)) == Some(folder)) {
        bail!("the WAD lies in the folder of its scene, which would be replaced: choose another --out");
    }
    write_scene(&scene, &args.out, args.replace)?;
    Ok(Row { name: scene.name, report: scene.report })
}

/// The files themselves and the WADs in folders, sorted.
fn wad_files(paths: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for path in paths {
        if !path.is_dir() {
            files.push(path.clone());
            continue;
        }
        let is_wad = |path: &Path| path.extension().is_some_and(|e| e.eq_ignore_ascii_case("wad"));
        let entries = std::fs::read_dir(path).with_context(|| format!("cannot list {}", path.display()))?;
        let listed = entries.map(|entry| entry.map(|e| e.path())).collect::<std::io::Result<Vec<_>>>();
        let mut found: Vec<PathBuf> = listed?.into_iter().filter(|path| is_wad(path)).collect();
        if found.is_empty() {
            bail!("{} holds no *.wad file", path.display());
        }
        found.sort();
        files.extend(found);
    }
    Ok(files)
}

const COLUMNS: [Column<Row>; 9] = [
    Column { heading: "map m²", decimals: 0, value: |s| s.report.map_area },
    Column { heading: "floor m²", decimals: 0, value: |s| s.report.floor_area },
    Column { heading: "connected m²", decimals: 0, value: |s| s.report.plane_area },
    Column { heading: "positions", decimals: 0, value: |s| s.report.nodes as f64 },
    Column { heading: "triangles", decimals: 0, value: |s| s.report.triangles as f64 },
    Column { heading: "doors", decimals: 0, value: |s| s.report.doors as f64 },
    Column { heading: "lifts", decimals: 0, value: |s| s.report.lifts as f64 },
    Column { heading: "relief", decimals: 2, value: |s| s.report.relief },
    Column { heading: "conflict m²", decimals: 2, value: |s| s.report.conflict_area },
];
