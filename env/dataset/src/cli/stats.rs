//! `dataset stats`.

use super::{Column, bar, print_table};
use anyhow::{Context as _, Result, bail};
use nbp_dataset::picture::Picture;
use nbp_dataset::stats::{SceneStats, measure};
use nbp_env::Scene;
use nbp_env::scene::load::find_scenes;
use rayon::prelude::*;
use std::path::PathBuf;

const EXAMPLES: &str = "Examples:
  dataset stats data/simple
  dataset stats data/simple data/normal --json stats.json --pictures pictures

Complexity is the largest ratio of walking to straight distance over all pairs of connected positions on the 1.5 m
lattice; 'sampled' is the published protocol, 0.02 to 1 % of the pairs by the size of the map: a lower bound.";

/// Side of a picture's pixel, metres.
const PIXEL: f32 = 0.08;

#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// Scene folders, folders of them at any depth, or OBJ files.
    #[arg(required = true, value_name = "DIR")]
    dirs: Vec<PathBuf>,
    /// Also write the figures of every scene to this file.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Also draw every scene from above into this folder: floors, walls at the camera plane, positions, starts.
    #[arg(long, value_name = "DIR")]
    pictures: Option<PathBuf>,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let mut paths = Vec::new();
    for dir in &args.dirs {
        let found = find_scenes(dir)?;
        if found.is_empty() {
            bail!("{} holds no scene: give a folder with *.obj files at any depth", dir.display());
        }
        paths.extend(found);
    }
    if let Some(folder) = &args.pictures {
        std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    }
    let bar = bar(paths.len(), "measuring");
    let one = |path: &PathBuf| -> Result<SceneStats> {
        let scene = Scene::load(path)?;
        if let Some(folder) = &args.pictures {
            let file = folder.join(format!("{}.png", scene.name()));
            let png = Picture::of(&scene, PIXEL).png()?;
            std::fs::write(&file, png).with_context(|| format!("cannot write {}", file.display()))?;
        }
        bar.inc(1);
        Ok(measure(&scene))
    };
    let scenes: Vec<SceneStats> = paths.par_iter().map(one).collect::<Result<_>>()?;
    bar.finish_and_clear();
    if let Some(path) = &args.json {
        let text = serde_json::to_string_pretty(&scenes)?;
        std::fs::write(path, text + "\n").with_context(|| format!("cannot write {}", path.display()))?;
    }
    let names: Vec<&str> = scenes.iter().map(|s| s.name.as_str()).collect();
    print_table(&names, &scenes, &COLUMNS);
    Ok(())
}

const COLUMNS: [Column<SceneStats>; 12] = [
    Column { heading: "floor m²", decimals: 0, value: |s| s.floor_area },
    Column { heading: "connected m²", decimals: 0, value: |s| s.plane_area },
    Column { heading: "positions", decimals: 0, value: |s| s.nodes as f64 },
    Column { heading: "complexity", decimals: 1, value: |s| s.complexity },
    Column { heading: "sampled", decimals: 1, value: |s| s.sampled_complexity },
    Column { heading: "triangles", decimals: 0, value: |s| s.triangles as f64 },
    Column { heading: "fill", decimals: 2, value: |s| s.fill },
    Column { heading: "walls m/m²", decimals: 2, value: |s| s.wall_density },
    Column { heading: "oblique", decimals: 2, value: |s| s.oblique_share },
    Column { heading: "clear p50 m", decimals: 2, value: |s| s.clearance_p50 },
    Column { heading: "clear p90 m", decimals: 2, value: |s| s.clearance_p90 },
    Column { heading: "isles/100 m²", decimals: 1, value: |s| s.islands },
];
