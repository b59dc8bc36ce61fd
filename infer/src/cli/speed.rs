//! `infer speed`: how fast the simulator is in scenes of your own.

use super::talk::Talk;
use super::{overrides, setup, usage};
use anyhow::{Context, Result};
use nbp_env::explain::show;
use nbp_env::scene::LoadOptions;
use nbp_infer::speed::{Speed, SpeedConfig, measure};
use nbp_infer::{PolicyKind, Settings, source};
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};

const KEYS: &str = "\
What is measured, and what --json prints as one object:
  steps_per_second  Steps of all threads together for each second of the clock: frames, map, coverage, the network's input
                    after each, and the policy's decisions. Steps of the lattice agent that bumped take no frames and do
                    not count
  frame_ms          Milliseconds for a frame, before noise, on one thread, median over the poses at which steps ended
  coverage_us       Microseconds to count a frame's kept points into the coverage, on one thread, median over these frames
  input_us          Microseconds for the network's input, on one thread, median over the steps
  memory_mb         Memory of an environment at its end, without what it shares with others in its scene, in 10^6 bytes,
                    the largest of the scenes

First one episode in each scene on one thread, for the parts; then on each of --threads (one a core if left out or 0) one
episode in each scene, at once.";

/// Options of `infer speed`.
#[derive(clap::Args)]
#[command(after_help = KEYS)]
pub(super) struct Args {
    /// Scene folders, OBJ files, WADs, single maps as FILE.wad:MAP01, or folders of these
    #[arg(long, required = true, num_args = 1.., value_name = "PATH")]
    scenes: Vec<String>,
    /// Who walks: random or fbe, or another that needs no network
    #[arg(long, default_value_t = PolicyKind::Random, value_name = "NAME")]
    policy: PolicyKind,
    /// Configuration file (TOML): its sim and eval tables; several are stacked left to right
    #[arg(long, value_name = "FILE")]
    config: Vec<PathBuf>,
    /// Steps of an episode [default: the configuration's, else 200]
    #[arg(long, value_name = "N")]
    steps: Option<usize>,
    /// Root of all random numbers
    #[arg(long, default_value_t = 0, value_name = "N")]
    seed: u64,
    /// Print one JSON object and nothing else
    #[arg(long)]
    json: bool,
    /// Change any setting of the simulator, e.g. sim.coverage.points=50000; may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
}

pub(super) fn run(args: &Args, threads: Option<usize>, talk: Talk) -> Result<()> {
    if args.steps == Some(0) {
        usage("--steps must be at least 1");
    }
    if args.policy.needs_network() {
        usage(&format!("speed measures the simulator, not the network of policy {}: use random or fbe", args.policy));
    }
    let (settings, eval) = overrides::apply(&Settings::default(), &args.config, &args.set)?;
    let steps = args.steps.or(eval.steps).unwrap_or(200);
    let (bar, read) = (talk.bar(1, "scenes"), AtomicUsize::new(0));
    let on_scene = |total| bar.set(read.fetch_add(1, Ordering::Relaxed) + 1, total);
    let scenes = source::load_all(&args.scenes, LoadOptions { colour: settings.sim.colour.is_on() }, on_scene);
    bar.finish();
    let scenes = scenes.context("cannot use the scenes")?;
    let worlds = setup::worlds(scenes, &settings, talk)?;
    let threads = threads
        .filter(|&count| count > 0)
        .unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from));
    let config = SpeedConfig { policy: args.policy, steps, seed: args.seed, threads };
    let bar = talk.bar(worlds.len(), "scenes walked");
    let speed = measure(&worlds, config, |number| bar.set(number, worlds.len()));
    bar.finish();
    let speed = speed?;
    if args.json {
        show(serde_json::to_string(&speed)?)?;
    } else {
        let triangles: usize = worlds.iter().map(|world| world.scene().mesh().triangles().len()).sum();
        show(format_args!(
            "scenes: {}, triangles on average: {}, episodes of {steps} steps by {}",
            worlds.len(),
            triangles / worlds.len(),
            args.policy
        ))?;
        show(table(&speed, threads).trim_end())?;
    }
    Ok(())
}

fn table(speed: &Speed, threads: usize) -> String {
    let rows = [
        ("steps per second", speed.steps_per_second, 0, format!("on {threads} threads")),
        ("ms per frame", speed.frame_ms, 3, "on one thread, median".into()),
        ("us of coverage per frame", speed.coverage_us, 1, "on one thread, median".into()),
        ("us per input", speed.input_us, 1, "on one thread, median".into()),
        ("MB per environment", speed.memory_mb, 1, "at the end of an episode, the largest".into()),
    ];
    rows.iter().map(|(name, value, digits, note)| format!("{name:<26}{value:>10.digits$}  {note}\n")).collect()
}
