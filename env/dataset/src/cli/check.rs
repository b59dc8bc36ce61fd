//! `dataset check`.

use super::{bar, say, scenes_in};
use anyhow::{Result, bail};
use nbp_dataset::check::{Finding, Severity, check};
use std::path::PathBuf;

const EXAMPLES: &str = "Examples:
  dataset check data/simple
  dataset check AiMDoom_simple --quick

Looks at layout, settings, meshes, starts, reach, sight, colours, and meshes that are both trained and tested on. Faults make
a scene useless or figures wrong; warnings should be known. Exit code 1 when there is a fault. In scenes whose settings name
no unit, published ones, an open mesh is a warning.";

/// Places shown for each kind of finding.
const SHOWN: usize = 5;

#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// A set of scenes, or one scene.
    #[arg(value_name = "DIR")]
    dir: PathBuf,
    /// Leave out what can be seen, which takes most of the time.
    #[arg(long)]
    quick: bool,
    /// Print all findings as JSON.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let bar = bar(scenes_in(&args.dir)?.len(), "checking");
    let checked = check(&args.dir, args.quick, || bar.inc(1))?;
    bar.finish_and_clear();
    let (scenes, faults) = (checked.scenes, checked.faults());
    if args.json {
        say!("{}", serde_json::to_string_pretty(&checked)?);
    } else {
        for group in checked.findings.chunk_by(|a, b| (a.severity, a.kind) == (b.severity, b.kind)) {
            print_group(group);
        }
        say!("{scenes} scenes, {faults} faults, {} warnings", checked.findings.len() - faults);
    }
    if faults > 0 {
        bail!("{} has {faults} faults", args.dir.display());
    }
    Ok(())
}

fn print_group(group: &[Finding]) {
    let severity = match group[0].severity {
        Severity::Fault => "fault",
        Severity::Warning => "warning",
    };
    say!("{severity}: {}", group[0].kind);
    for Finding { place, detail, .. } in group.iter().take(SHOWN) {
        say!("  {}: {detail}", place.display());
    }
    if group.len() > SHOWN {
        say!("  … and {} more", group.len() - SHOWN);
    }
}
