//! `infer report`: a finished bench as one HTML page and as figures.

use super::output::Output;
use super::talk::Talk;
use anyhow::{Context, Result};
use nbp_env::explain::show;
use nbp_infer::bench::BenchResult;
use nbp_infer::report;
use std::path::PathBuf;

/// Options of `infer report`.
#[derive(clap::Args)]
pub(super) struct Args {
    /// Folder of a finished `infer bench`
    #[arg(long, value_name = "DIR")]
    bench: PathBuf,
    /// The page [default: report.html in the folder of the bench]
    #[arg(long, value_name = "FILE.html")]
    out: Option<PathBuf>,
    /// Also write the figures as SVG beside it: coverage-SET.svg, scatter-SET.svg, episode-SET.svg
    #[arg(long)]
    figures: bool,
}

pub(super) fn run(args: &Args, talk: Talk) -> Result<()> {
    let path = args.out.clone().unwrap_or_else(|| args.bench.join(report::FILE));
    let result = BenchResult::load(&args.bench).context("cannot use the bench")?;
    let (out, name) = Output::for_file(&path)?;
    let page = report::html(&result)?;
    let size = page.len() / 1000;
    out.write(&name, page)?;
    if args.figures {
        for (name, svg) in report::figures(&result) {
            out.write(&name, svg)?;
            talk.say(format!("wrote {}", out.folder().join(name).display()));
        }
    }
    Ok(show(format_args!("{}: {size} kB, opens in any browser", path.display()))?)
}
