//! `infer eval`: policies compared, resumable.

use super::output::Output;
use super::setup::{self, Setup};
use super::talk::Talk;
use super::usage;
use anyhow::{Context, Result};
use nbp_env::explain::{show, tell};
use nbp_env::scene::LoadOptions;
use nbp_infer::journal::{Fingerprints, Journal};
use nbp_infer::{EvalConfig, PolicyKind, checkpoint, eval, export, plot, source, table};
use nbp_model::DeviceChoice;
use serde_json::json;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// Options of `infer eval`.
#[derive(clap::Args)]
pub(super) struct Args {
    /// Scene folders, OBJ files, WADs, single maps as FILE.wad:MAP01, or folders of these
    #[arg(long, required = true, num_args = 1.., value_name = "PATH")]
    scenes: Vec<String>,
    /// Policies to compare: random, random-nbv, fbe, fbe-gain, fbe-tsp, scone, macarons, nbp, oracle-obstacles, oracle-looks,
    /// oracle-maps, oracle-greedy, oracle-beam [default: the configuration's, else random,fbe, and those that the checkpoints are of]
    #[arg(long, value_delimiter = ',', value_name = "NAMES")]
    policies: Vec<PolicyKind>,
    /// Episodes from every start, each with its own seed
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=10_000))]
    seeds: u16,
    /// Only the first so many starts of each scene
    #[arg(long, value_name = "N")]
    starts: Option<usize>,
    /// Episodes that are walked side by side and ask the network together; the time of decisions then has the waiting for
    /// each other in it
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256))]
    batch: u16,
    /// Also measure how much of each scene can be seen at all, which takes a second to half a minute, and show coverage as a
    /// share of it
    #[arg(long)]
    visible: bool,
    /// Folder for episodes.csv, summary.json, summary.md and coverage.svg; a second call goes on where the first stopped
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    #[command(flatten)]
    setup: setup::Args,
}

pub(super) fn run(args: &Args, device: DeviceChoice, talk: Talk) -> Result<()> {
    if args.starts == Some(0) {
        usage("--starts must be at least 1");
    }
    let out = Output::prepare(&args.out)?;
    let mut policies = args.policies.clone();
    if policies.is_empty() {
        policies = args.setup.named_in_files()?.unwrap_or_default();
    }
    let read = args.setup.read(&policies)?;
    if policies.is_empty() {
        let blind = [PolicyKind::Random, PolicyKind::Fbe];
        let networks = [PolicyKind::Scone, PolicyKind::Macarons, PolicyKind::Nbp];
        policies = blind.into_iter().chain(networks.into_iter().filter(|kind| read.has_network(*kind))).collect();
    }
    let starts_limit = args.starts.or(read.eval.starts);
    anyhow::ensure!(starts_limit != Some(0), "eval.starts is 0: it must be at least 1");
    let (seeds, seed, batch) = (usize::from(args.seeds), args.setup.seed, usize::from(args.batch));
    let needs_network = policies.iter().any(|kind| kind.needs_network());
    let weights = needs_network.then(|| args.setup.weights(&read)).transpose()?;
    let is_asked = |architecture: &str| policies.iter().any(|kind| kind.architecture() == Some(architecture));
    let asked = read.checkpoints.iter().filter(|(architecture, _)| is_asked(architecture));
    let checkpoints: BTreeMap<String, PathBuf> = asked.map(|(name, path)| (name.clone(), path.clone())).collect();
    let Setup { settings, context, steps } = args.setup.setup(read, &policies, device, batch, talk)?;
    let config = EvalConfig { policies, steps, seeds, seed, starts_limit, batch };

    let (bar, read) = (talk.bar(1, "scenes"), AtomicUsize::new(0));
    // Nothing that is written here has colours.
    let on_scene = |total| bar.set(read.fetch_add(1, Ordering::Relaxed) + 1, total);
    let scenes = source::load_all(&args.scenes, LoadOptions::default(), on_scene);
    bar.finish();
    let scenes = scenes.context("cannot use the scenes")?;
    let worlds = setup::worlds(scenes, &settings, talk)?;
    let fingerprints = Fingerprints::new(&worlds, &settings, &config, weights.as_deref());
    drop(weights);
    let folder = out.folder().display();
    let (journal, done) =
        Journal::open(out.folder(), fingerprints).with_context(|| format!("cannot use the journal in {folder}"))?;
    if !done.is_empty() {
        talk.say(format!("{folder} has {} finished episodes with these settings", done.len()));
    }

    let (bar, warned) = (talk.bar(1, "episodes"), AtomicBool::new(false));
    let episodes = eval::run(&worlds, &context, &config, &done, |record, progress| {
        // A full disk must not end hours of work: the results may still find a place at the end.
        if let Err(error) = journal.append(record)
            && !warned.swap(true, Ordering::Relaxed)
        {
            tell(format_args!("warning: cannot write the journal in {folder}: {error}; going on without it"));
        }
        bar.set(progress.finished, progress.total);
    });
    bar.finish();
    let episodes = episodes?;
    let visible = if args.visible {
        let what = "scenes measured for what can be seen";
        talk.say(format!("{what}: 0/{}", worlds.len()));
        let bar = talk.bar(worlds.len(), what);
        let visible = eval::visible_shares(&worlds, |done| bar.set(done, worlds.len()));
        bar.finish();
        visible
    } else {
        BTreeMap::new()
    };
    let rows = table::summarise(&episodes, &visible);
    // First to the terminal: there it is safe whatever the disk says.
    let shown = show(table::text(&rows).trim_end());
    out.write("episodes.csv", export::episodes_csv(&episodes))?;
    if args.visible {
        out.write("visible.csv", export::visible_csv(&visible))?;
    }
    out.write("summary.json", serde_json::to_string_pretty(&rows)? + "\n")?;
    out.write("summary.md", table::markdown(&rows))?;
    out.write(
        "coverage.svg",
        plot::coverage(&title(worlds.len(), rows.first().map_or(0, |row| row.episodes)), &plot::series(&episodes)),
    )?;
    let about = json!({
        "scenes": args.scenes, "checkpoints": checkpoints, "obstacle_checkpoint": args.setup.obstacle_checkpoint, "eval": config, "settings": checkpoint::plain(&settings)?,
    });
    out.write("settings.json", serde_json::to_string_pretty(&about)? + "\n")?;
    talk.say(format!("wrote episodes.csv, summary.json, summary.md, coverage.svg, settings.json to {folder}"));
    Ok(shown?)
}

fn title(scenes: usize, episodes: usize) -> String {
    let plural = |n: usize, one: &str| format!("{n} {one}{}", if n == 1 { "" } else { "s" });
    format!("Coverage, mean of {} in {}", plural(episodes, "episode"), plural(scenes, "scene"))
}
