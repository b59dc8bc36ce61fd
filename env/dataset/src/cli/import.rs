//! `dataset import`.

use super::say;
use anyhow::{Result, bail};
use nbp_dataset::import::{Assumptions, ImportOptions, Imported, Source, StoreyReport, Up, import, parse_file};
use nbp_dataset::{WriteError, scene_name, write_mesh};
use nbp_env::explain::told_once;
use serde::Serialize;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "Examples:
  dataset import flat.glb --out data/scans
  dataset import house.ply --up z --scale 0.01 --out data/scans --name house
  dataset import scene0000_00_vh_clean_2.ply --out data/scannet

What the file does not say is guessed and told: which axis is up (glTF: y), how long a unit is (a metre, unless the rooms
would be absurdly high or low), where the floors are. A building of several storeys becomes one scene for each, NAME_floor0
being the lowest. OUT/NAME/import.json keeps what was assumed, and where the scene lies in the file's coordinates. Look at
what came out with `dataset stats OUT --pictures DIR`. A file that gives no scene is listed with the reason, and the others
go on. Exit code 1 when there is no scene.";

#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// OBJ, PLY, glTF or GLB files, one building each.
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Metres in a unit of the file [default: 1, or a guess where rooms are absurd then].
    #[arg(long, value_name = "S", value_parser = positive)]
    scale: Option<f32>,
    /// Axis that points up: x, y or z [default: y for glTF, else a guess].
    #[arg(long, value_name = "AXIS")]
    up: Option<Up>,
    /// Folder for the scenes; made if need be.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Name of the scene; for a single file [default: the file's].
    #[arg(long)]
    name: Option<String>,
    /// Only this storey, counted from 0 at the bottom [default: all].
    #[arg(long, value_name = "N")]
    storey: Option<usize>,
    /// Replace scenes that exist.
    #[arg(long)]
    replace: bool,
}

fn positive(text: &str) -> Result<f32, String> {
    let value = text.parse().ok().filter(|value: &f32| value.is_finite() && *value > 0.0);
    value.ok_or_else(|| "it must be a positive number".into())
}

pub(crate) fn run(args: &Args) -> Result<()> {
    if args.name.is_some() && args.files.len() > 1 {
        bail!("--name is for a single file: leave it out, and the scenes are called like their files");
    }
    let (mut scenes, mut refused, mut names) = (0, Vec::new(), BTreeSet::new());
    for file in &args.files {
        match one(file, args, &mut names) {
            Ok(count) => scenes += count,
            Err(error) => {
                let reason = told_once(error.chain().map(ToString::to_string));
                refused.push(format!("{}: {reason}", file.display()));
            }
        }
    }
    eprintln!("{scenes} scenes in {}", args.out.display());
    for reason in &refused {
        eprintln!("refused: {reason}");
    }
    if scenes == 0 {
        bail!("no scan was imported, {} refused", refused.len());
    }
    Ok(())
}

/// Scenes written of a file; `names` are those of files before it.
fn one(file: &Path, args: &Args, names: &mut BTreeSet<String>) -> Result<usize> {
    let name = args.name.clone().unwrap_or_else(|| scene_name(file, "", 1));
    let (scan, format) = parse_file(file)?;
    let options = ImportOptions { up: args.up, scale: args.scale, storey: args.storey };
    let (scenes, assumed) = import(scan, format, &name, &options)?;
    // Before the first is written rather than after it.
    if let Some(scene) = scenes.iter().find(|scene| names.contains(&scene.name)) {
        bail!("its scene would be called {}, like another: rename the file", scene.name);
    }
    let existing = scenes.iter().map(|scene| args.out.join(&scene.name)).find(|folder| folder.exists());
    if let (Some(folder), false) = (existing, args.replace) {
        return Err(WriteError::Exists(folder).into());
    }
    names.extend(scenes.iter().map(|scene| scene.name.clone()));
    say!("{}", file.display());
    tell(&assumed);
    for scene in &scenes {
        let record =
            Record { file: file.display().to_string(), scene: &scene.name, assumed: &assumed, storey: &scene.report };
        let record = ("import.json".into(), (serde_json::to_string_pretty(&record)? + "\n").into_bytes());
        let written = write_mesh(&scene.name, &scene.mesh, &scene.settings, &[record], &args.out, args.replace)?;
        tell_scene(scene);
        if written.halvings > 0 {
            say!("    its images are at 1/{} of their size, to fit on one", 1_u64 << written.halvings);
        }
    }
    Ok(scenes.len())
}

/// What `import.json` holds.
#[derive(Serialize)]
struct Record<'a> {
    file: String,
    scene: &'a str,
    assumed: &'a Assumptions,
    storey: &'a StoreyReport,
}

fn tell(assumed: &Assumptions) {
    let up = assumed.up.value.name();
    match assumed.up.source {
        Source::Given => say!("  up        {up}, as given"),
        Source::Format => say!("  up        {up}, as in every {} file", assumed.format),
        Source::Guessed if assumed.up.margin < 1.5 => {
            say!("  up        {up}, guessed and uncertain: if the scene lies on its side, give --up");
        }
        Source::Guessed => say!("  up        {up}, guessed from the area of level faces"),
    }
    let (scale, height) = (assumed.scale.value, assumed.room_height);
    match assumed.scale.source {
        Source::Given => say!("  unit      {scale} m, as given: rooms are {height:.2} m high"),
        _ if scale != 1.0 => say!("  unit      {scale} m, guessed: rooms are {height:.2} m high then"),
        _ if height > 5.5 => {
            say!("  unit      1 m: rooms are {height:.2} m high; if these are feet, give --scale 0.3048");
        }
        _ => say!("  unit      1 m: rooms are {height:.2} m high"),
    }
    let floors: Vec<String> = assumed.floors.iter().map(|floor| format!("{floor:.2}")).collect();
    say!("  floors    {} m above the lowest point", floors.join(", "));
    assumed.notes.iter().for_each(|note| say!("  note      {note}"));
}

fn tell_scene(scene: &Imported) {
    let report = &scene.report;
    say!(
        "  {}: {:.0} m² to stand on, {} connected positions of {} free, {} triangles, {}, {}",
        scene.name,
        report.floor_area,
        report.nodes,
        report.free,
        report.triangles,
        if report.coloured { "coloured" } else { "no colours" },
        if report.open { "open (a scan)" } else { "closed" },
    );
    let starts = scene.settings.camera.start_positions.len();
    if starts < 5 {
        say!("    it has room for {starts} start positions only");
    }
}
