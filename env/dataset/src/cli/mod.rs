//! The commands of the binary, one file each, and what they share: bars and tables.

pub(crate) mod check;
pub(crate) mod convert;
pub(crate) mod generate;
pub(crate) mod import;
pub(crate) mod preview;
pub(crate) mod split;
pub(crate) mod stats;

use anyhow::{Context as _, Result, bail};
/// Prints a line of results. Where nobody reads them any more (`dataset stats … | head`), that is the end.
macro_rules! say {
    ($($text:tt)*) => { $crate::cli::write_out(format_args!("{}\n", format_args!($($text)*))) };
}
pub(crate) use say;

/// The same without an end of the line.
macro_rules! say_part {
    ($($text:tt)*) => { $crate::cli::write_out(format_args!($($text)*)) };
}
pub(crate) use say_part;

/// Writes to stdout, or ends the program: quietly where the other end is closed, else with the reason.
pub(crate) fn write_out(text: std::fmt::Arguments<'_>) {
    use std::io::Write as _;
    if let Err(error) = std::io::stdout().write_fmt(text) {
        if error.kind() == std::io::ErrorKind::BrokenPipe {
            std::process::exit(0);
        }
        // The results are lost: there is nobody to hand the error to.
        drop(writeln!(std::io::stderr(), "error: cannot write the results: {error}"));
        std::process::exit(1);
    }
}

use indicatif::{ProgressBar, ProgressStyle};
use nbp_dataset::stats::spread;
use nbp_dataset::wad::{Textures, Wad};
use nbp_env::scene::Settings;
use nbp_env::scene::load::find_scenes;
use nbp_env::scene::settings::PUBLISHED_METRES_PER_UNIT;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The scenes below a folder, sorted; at least one.
pub(crate) fn scenes_in(dir: &Path) -> Result<Vec<PathBuf>> {
    let found = find_scenes(dir)?;
    if found.is_empty() {
        bail!("{} holds no scene: give a folder with *.obj files at any depth", dir.display());
    }
    Ok(found)
}

/// Unit of the files that are written.
#[derive(Clone, Copy, Default, clap::ValueEnum)]
pub(crate) enum Units {
    /// One unit is 1 m. The released code reads such scenes with `scene_scale_factor` 2.
    #[default]
    Metres,
    /// One unit is 5 m: the released code reads such scenes unchanged.
    Published,
}

impl Units {
    /// The settings in this unit; meshes follow when they are written.
    pub(crate) fn of(self, settings: Settings) -> Settings {
        match self {
            Self::Metres => settings,
            Self::Published => settings.in_units(PUBLISHED_METRES_PER_UNIT),
        }
    }
}

/// A bar on stderr; nothing where stderr is no terminal.
pub(crate) fn bar(count: usize, what: &'static str) -> ProgressBar {
    let bar = ProgressBar::new(count as u64);
    // The template is a constant and valid; the plain bar would do, too.
    if let Ok(style) = ProgressStyle::with_template("{msg} {wide_bar} {pos}/{len} [{elapsed} < {eta}]") {
        bar.set_style(style);
    }
    bar.with_message(what)
}

/// WAD files with textures; later ones override earlier ones.
pub(crate) fn open_wads(paths: &[PathBuf]) -> Result<Vec<Arc<Wad>>> {
    let open = |path: &PathBuf| Wad::open(path).map(Arc::new).with_context(|| format!("--textures {}", path.display()));
    paths.iter().map(open).collect()
}

/// The textures of WAD files; none where no file is given.
pub(crate) fn textures(wads: &[Arc<Wad>]) -> Result<Option<Textures>> {
    let read = Textures::read(wads).context("--textures")?;
    if read.is_none() && !wads.is_empty() {
        bail!("--textures: no file has a palette (PLAYPAL): give the game's own WAD first, for example freedoom2.wad");
    }
    Ok(read)
}

/// Tells what was wrong with the textures of some scenes.
pub(crate) fn tell_problems<'a>(of_scenes: impl Iterator<Item = &'a [String]>) {
    let mut scenes: BTreeMap<&str, usize> = BTreeMap::new();
    of_scenes.flatten().for_each(|problem| *scenes.entry(problem).or_default() += 1);
    for (problem, count) in scenes.iter().take(MAX_PROBLEMS) {
        eprintln!("{problem}: a drawn tile stands in for it in {count} scenes");
    }
    if scenes.len() > MAX_PROBLEMS {
        eprintln!("… and {} more", scenes.len() - MAX_PROBLEMS);
    }
}

/// Problems that are told one by one.
const MAX_PROBLEMS: usize = 12;

/// One column of a table: a heading, decimals, and the figure of a row.
pub(crate) struct Column<T> {
    pub(crate) heading: &'static str,
    pub(crate) decimals: usize,
    pub(crate) value: fn(&T) -> f64,
}

impl<T> Column<T> {
    /// The figure of a row; `-` where it was not measured.
    fn cell(&self, row: &T) -> String {
        let value = (self.value)(row);
        if value.is_nan() { "-".into() } else { format!("{value:.*}", self.decimals) }
    }

    /// Mean ± standard deviation of some rows; the figure alone where there is one row.
    pub(crate) fn spread(&self, rows: &[T]) -> String {
        match rows {
            [only] => self.cell(only),
            _ => {
                let spread = spread(rows.iter().map(self.value));
                let is_known = !spread.mean.is_nan();
                let text = || format!("{:.*} ± {:.*}", self.decimals, spread.mean, self.decimals, spread.deviation);
                if is_known { text() } else { "-".into() }
            }
        }
    }
}

/// Prints rows with their names and, below, mean ± standard deviation.
pub(crate) fn print_table<T>(names: &[&str], rows: &[T], columns: &[Column<T>]) {
    if rows.is_empty() {
        return;
    }
    let widest = names.iter().map(|name| name.len()).max().unwrap_or(0).max(12);
    let widths: Vec<usize> = columns.iter().map(|column| column.heading.len().max(13)).collect();
    say_part!("{:widest$}", "scene");
    columns.iter().zip(&widths).for_each(|(column, width)| say_part!("  {:>width$}", column.heading));
    say!("");
    for (name, row) in names.iter().zip(rows) {
        say_part!("{name:widest$}");
        for (column, width) in columns.iter().zip(&widths) {
            say_part!("  {:>width$}", column.cell(row));
        }
        say!("");
    }
    if rows.len() > 1 {
        say_part!("{:widest$}", "mean ± sd");
        for (column, width) in columns.iter().zip(&widths) {
            say_part!("  {:>width$}", column.spread(rows));
        }
        say!("");
    }
}
