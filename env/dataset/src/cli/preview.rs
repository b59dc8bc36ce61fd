//! `dataset preview`.

use super::{bar, scenes_in};
use anyhow::{Context as _, Result, bail};
use nbp_dataset::navigation::Navigation;
use nbp_dataset::picture::Picture;
use nbp_dataset::preview::{Tile, extent, pixel_for, sheet};
use nbp_dataset::stats::floor_area;
use nbp_env::Scene;
use nbp_env::scene::LoadOptions;
use rayon::prelude::*;
use std::path::{Path, PathBuf};

const EXAMPLES: &str = "Examples:
  dataset preview data/simple --out simple.png
  dataset preview data/maps --out maps.png --side 480 --columns 4

Floors in their colours, or grey by height; walls at the camera plane in orange. All scenes have the same scale.";

#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// Scene folders, folders of them at any depth, or OBJ files.
    #[arg(required = true, value_name = "DIR")]
    dirs: Vec<PathBuf>,
    /// The PNG file to write.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Side of a scene's view, pixels.
    #[arg(long, default_value_t = 300, value_parser = clap::value_parser!(u16).range(100..=2000))]
    side: u16,
    /// Scenes in a row [default: so many that the sheet is about 4:3].
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=100))]
    columns: Option<u16>,
    /// Only the first scenes, sorted by path.
    #[arg(long, default_value_t = 100, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    limit: u16,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    if args.out.extension().is_none_or(|extension| !extension.eq_ignore_ascii_case("png")) {
        bail!("--out {} is no PNG file: give it a name that ends in .png", args.out.display());
    }
    let mut paths: Vec<PathBuf> = Vec::new();
    for dir in &args.dirs {
        paths.extend(scenes_in(dir)?);
    }
    let left_out = paths.len().saturating_sub(usize::from(args.limit));
    paths.truncate(usize::from(args.limit));
    let bar = bar(2 * paths.len(), "drawing");
    let measure = |path: &PathBuf| -> Result<f32> {
        let extent = extent(&Scene::load(path)?);
        bar.inc(1);
        Ok(extent)
    };
    let extents: Vec<f32> = paths.par_iter().map(measure).collect::<Result<_>>()?;
    let side = usize::from(args.side);
    let pixel = pixel_for(extents.into_iter(), side);
    // Loaded again rather than kept: a hundred large scenes with images do not fit into memory.
    let draw = |path: &PathBuf| -> Result<Tile> {
        // A scene whose colours cannot be read is still worth a look.
        let scene = Scene::load_with(path, LoadOptions { colour: true }).or_else(|_| Scene::load(path))?;
        bar.inc(1);
        let complexity = Navigation::of(scene.graph()).complexity().ratio;
        Ok(Tile {
            picture: Picture::of(&scene, pixel),
            name: scene.name().into(),
            facts: format!("{:.0} m² · complexity {complexity:.1}", floor_area(&scene)),
        })
    };
    let tiles: Vec<Tile> = paths.par_iter().map(draw).collect::<Result<_>>()?;
    bar.finish_and_clear();
    let columns = args.columns.map_or_else(|| (1.4 * tiles.len() as f32).sqrt().round() as usize, usize::from);
    let png = sheet(&tiles, side, columns, pixel).png()?;
    write_whole(&args.out, &png).with_context(|| format!("cannot write {}", args.out.display()))?;
    eprintln!("{} scenes in {}", tiles.len(), args.out.display());
    if left_out > 0 {
        eprintln!("{left_out} more were left out: raise --limit");
    }
    Ok(())
}

/// Writes a file under a hidden name first: a full disk leaves what was there.
fn write_whole(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let partial = path.with_file_name(format!(".{name}.partial-{}", std::process::id()));
    let written = std::fs::write(&partial, bytes).and_then(|()| std::fs::rename(&partial, path));
    if written.is_err() {
        // Best effort: the first error is the one to tell.
        drop(std::fs::remove_file(&partial));
    }
    written
}
