//! `dataset stats`.

use super::{Column, bar, print_table, say, say_part, scenes_in};
use anyhow::{Context as _, Result};
use nbp_dataset::picture::Picture;
use nbp_dataset::stats::{SceneStats, measure, spread};
use nbp_env::visible::visible_share;
use nbp_env::{Scene, SimConfig};
use rayon::prelude::*;
use serde::Serialize;
use serde_json::{Map, Value};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};

const EXAMPLES: &str = "Examples:
  dataset stats data/simple --quick
  dataset stats data/simple data/normal --markdown
  dataset stats data/simple --json > stats.json

Complexity is the largest ratio of walking to straight distance over all pairs of connected positions on the 1.5 m
lattice; 'sampled' is the published protocol, 0.02 to 1 % of the pairs by the size of the map: a lower bound. Accessible
is the share of the floor that is connected in the camera plane; escaping the share of 64,000 rays from inside that meet
nothing; visible the share of the surface that can be seen from all positions and headings together.";

/// Side of a picture's pixel, metres.
const PIXEL: f32 = 0.08;

#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// Scene folders, folders of them at any depth, or OBJ files.
    #[arg(required = true, value_name = "DIR")]
    dirs: Vec<PathBuf>,
    /// Print one row for each DIR, mean ± standard deviation, as a Markdown table.
    #[arg(long, conflicts_with = "json")]
    markdown: bool,
    /// Print every scene's figures and their means as JSON.
    #[arg(long)]
    json: bool,
    /// Leave out what can be seen, which takes most of the time.
    #[arg(long)]
    quick: bool,
    /// Also draw every scene from above into this folder: floors, walls at the camera plane, positions, starts. Scenes that
    /// share a name are called by their path.
    #[arg(long, value_name = "DIR")]
    pictures: Option<PathBuf>,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let sets: Vec<Vec<PathBuf>> = args.dirs.iter().map(|dir| scenes_in(dir)).collect::<Result<_>>()?;
    if let Some(folder) = &args.pictures {
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    }
    let bar = bar(sets.iter().map(Vec::len).sum(), "measuring");
    let one = |(path, name): (&&PathBuf, &String)| -> Result<SceneStats> {
        let scene = Scene::load(path)?;
        if let Some(folder) = &args.pictures {
            let file = folder.join(format!("{name}.png"));
            let png = Picture::of(&scene, PIXEL).with_positions(&scene).image.png()?;
            std::fs::write(&file, png).with_context(|| format!("cannot write {}", file.display()))?;
        }
        let visible = if args.quick { None } else { Some(visible_share(&scene, &SimConfig::default())) };
        let stats = SceneStats { visible_share: visible, ..measure(&scene) };
        bar.inc(1);
        Ok(stats)
    };
    let paths: Vec<&PathBuf> = sets.iter().flatten().collect();
    let names = picture_names(&args.dirs, &sets);
    let scenes: Vec<SceneStats> = paths.par_iter().zip(&names).map(one).collect::<Result<_>>()?;
    bar.finish_and_clear();
    if args.json {
        say!("{}", serde_json::to_string_pretty(&report(&scenes)?)?);
    } else if args.markdown {
        let mut rest = scenes.as_slice();
        print_markdown_head();
        for (dir, set) in args.dirs.iter().zip(&sets) {
            let (rows, others) = rest.split_at(set.len());
            rest = others;
            print_markdown_row(dir, rows);
        }
    } else {
        let names: Vec<&str> = scenes.iter().map(|s| s.name.as_str()).collect();
        print_table(&names, &scenes, &COLUMNS);
    }
    Ok(())
}

/// A name for each scene's picture, no two the same: the scene's own or, where several have that, its path from DIR on
/// with `-` between folders.
fn picture_names(dirs: &[PathBuf], sets: &[Vec<PathBuf>]) -> Vec<String> {
    let own = |path: &Path| {
        let name = if path.is_dir() { path.file_name() } else { path.file_stem() };
        name.map_or_else(|| "scene".into(), |name| name.to_string_lossy().into_owned())
    };
    let mut count: BTreeMap<String, usize> = BTreeMap::new();
    sets.iter().flatten().for_each(|path| *count.entry(own(path)).or_default() += 1);
    let long = |dir: &Path, path: &Path| {
        let place = dir.parent().and_then(|parent| path.strip_prefix(parent).ok()).unwrap_or(path);
        let folders = place.parent().into_iter().flat_map(Path::components).filter_map(|folder| match folder {
            Component::Normal(folder) => Some(folder.to_string_lossy().into_owned()),
            _ => None,
        });
        folders.chain([own(path)]).collect::<Vec<_>>().join("-")
    };
    let mut taken = BTreeSet::new();
    let scenes = dirs.iter().zip(sets).flat_map(|(dir, set)| set.iter().map(move |path| (dir, path)));
    let unique = |(dir, path): (&PathBuf, &PathBuf)| {
        let name = Some(own(path)).filter(|own| count.get(own) == Some(&1)).unwrap_or_else(|| long(dir, path));
        let numbered = (2..).map(|n: usize| format!("{name}-{n}"));
        let free = std::iter::once(name.clone()).chain(numbered).find(|name| !taken.contains(name)).unwrap_or_default();
        taken.insert(free.clone());
        free
    };
    scenes.map(unique).collect()
}

/// What `--json` prints.
#[derive(Serialize)]
struct Report<'a> {
    scenes: &'a [SceneStats],
    mean: Map<String, Value>,
    standard_deviation: Map<String, Value>,
}

/// Figures of all scenes, and mean and standard deviation of every figure that each of them has.
fn report(scenes: &[SceneStats]) -> Result<Report<'_>> {
    let rows = scenes.iter().map(serde_json::to_value).collect::<serde_json::Result<Vec<Value>>>()?;
    let mut report = Report { scenes, mean: Map::new(), standard_deviation: Map::new() };
    for key in rows.first().and_then(Value::as_object).into_iter().flat_map(Map::keys) {
        let figures: Option<Vec<f64>> = rows.iter().map(|row| row[key].as_f64()).collect();
        if let Some(figures) = figures {
            let spread = spread(figures.into_iter());
            report.mean.insert(key.clone(), spread.mean.into());
            report.standard_deviation.insert(key.clone(), spread.deviation.into());
        }
    }
    Ok(report)
}

fn print_markdown_head() {
    let headings: Vec<&str> = COLUMNS.iter().map(|column| column.heading).collect();
    say!("| set | scenes | floor m², all | {} |", headings.join(" | "));
    say!("|---|{}", "---:|".repeat(COLUMNS.len() + 2));
}

fn print_markdown_row(dir: &Path, scenes: &[SceneStats]) {
    let name = dir.canonicalize().ok().and_then(|dir| Some(dir.file_name()?.to_string_lossy().into_owned()));
    let all: f64 = scenes.iter().map(|s| s.floor_area_m2).sum();
    say_part!("| {} | {} | {all:.0} |", name.unwrap_or_else(|| dir.display().to_string()), scenes.len());
    for column in &COLUMNS {
        say_part!(" {} |", column.spread(scenes));
    }
    say!("");
}

const COLUMNS: [Column<SceneStats>; 15] = [
    Column { heading: "floor m²", decimals: 0, value: |s| s.floor_area_m2 },
    Column { heading: "complexity", decimals: 1, value: |s| s.navigation_complexity },
    Column { heading: "sampled", decimals: 1, value: |s| s.navigation_complexity_sampled },
    Column { heading: "connected m²", decimals: 0, value: |s| s.connected_area_m2 },
    Column { heading: "accessible %", decimals: 1, value: |s| 100.0 * s.accessible_share },
    Column { heading: "positions", decimals: 0, value: |s| s.positions as f64 },
    Column { heading: "triangles", decimals: 0, value: |s| s.triangles as f64 },
    Column { heading: "escaping %", decimals: 2, value: |s| 100.0 * s.escaping_ray_share },
    Column { heading: "visible %", decimals: 1, value: |s| 100.0 * s.visible_share.unwrap_or(f64::NAN) },
    Column { heading: "fill", decimals: 2, value: |s| s.fill_share },
    Column { heading: "walls m/m²", decimals: 2, value: |s| s.wall_length_m_per_m2 },
    Column { heading: "oblique", decimals: 2, value: |s| s.oblique_wall_share },
    Column { heading: "clear p50 m", decimals: 2, value: |s| s.clearance_p50_m },
    Column { heading: "clear p90 m", decimals: 2, value: |s| s.clearance_p90_m },
    Column { heading: "isles/100 m²", decimals: 1, value: |s| s.islands_per_100_m2 },
];
