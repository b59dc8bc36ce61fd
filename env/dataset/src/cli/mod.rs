//! The commands of the binary, one file each, and what they share: bars and tables.

pub(crate) mod convert;
pub(crate) mod generate;
pub(crate) mod stats;

use anyhow::{Result, bail};
use indicatif::{ProgressBar, ProgressStyle};
use nbp_dataset::stats::spread;
use nbp_env::scene::load::find_scenes;
use std::path::{Path, PathBuf};

/// The scenes below a folder, sorted; at least one.
pub(crate) fn scenes_in(dir: &Path) -> Result<Vec<PathBuf>> {
    let found = find_scenes(dir)?;
    if found.is_empty() {
        bail!("{} holds no scene: give a folder with *.obj files at any depth", dir.display());
    }
    Ok(found)
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
    print!("{:widest$}", "scene");
    columns.iter().zip(&widths).for_each(|(column, width)| print!("  {:>width$}", column.heading));
    println!();
    for (name, row) in names.iter().zip(rows) {
        print!("{name:widest$}");
        for (column, width) in columns.iter().zip(&widths) {
            print!("  {:>width$}", column.cell(row));
        }
        println!();
    }
    if rows.len() > 1 {
        print!("{:widest$}", "mean ± sd");
        for (column, width) in columns.iter().zip(&widths) {
            print!("  {:>width$}", column.spread(rows));
        }
        println!();
    }
}
