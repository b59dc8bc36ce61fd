//! `infer rollout`: one episode, with everything worth looking at.

use super::output::Output;
use super::setup::{self, Setup};
use super::talk::Talk;
use anyhow::{Context, Result};
use nbp_env::Policy;
use nbp_env::completion::Completion;
use nbp_env::explain::show;
use nbp_env::scene::LoadOptions;
use nbp_infer::rollout::{Rollout, Trial, run_episode};
use nbp_infer::{PolicyKind, export, picture, plot, registry, source};
use nbp_model::DeviceChoice;
use std::path::PathBuf;

/// Options of `infer rollout`.
#[derive(clap::Args)]
pub(super) struct Args {
    /// OBJ file, scene folder, WAD with one map, or one map of a WAD as FILE.wad:MAP01
    #[arg(long, value_name = "PATH")]
    scene: String,
    /// random, random-nbv, fbe, fbe-gain, fbe-tsp, scone, macarons, nbp, oracle-obstacles, oracle-looks,
    /// oracle-maps, oracle-greedy or oracle-beam
    #[arg(long, default_value_t = PolicyKind::Nbp, value_name = "NAME")]
    policy: PolicyKind,
    /// Which of the scene's start poses, from 0
    #[arg(long, default_value_t = 0, value_name = "N")]
    start: usize,
    /// Folder for cloud.ply, trajectory.json, coverage.csv, coverage.svg and topdown.png
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Also draw what the network saw and answered whenever it planned, into OUT/plans
    #[arg(long)]
    plans: bool,
    /// Also make a film of it, OUT/episode.gif: the map as it grows, the way and the plan, what the agent sees
    #[arg(long)]
    gif: bool,
    #[command(flatten)]
    setup: setup::Args,
}

pub(super) fn run(args: &Args, device: DeviceChoice, talk: Talk) -> Result<()> {
    let out = Output::prepare(&args.out)?;
    let read = args.setup.read(&[args.policy])?;
    let Setup { settings, context, steps } = args.setup.setup(read, &[args.policy], device, 1, talk)?;
    let options = LoadOptions { colour: settings.sim.colour.is_on() };
    let scene = source::load_one(&args.scene, options).context("cannot use the scene")?;
    let world = setup::worlds(vec![scene], &settings, talk)?.swap_remove(0);
    talk.say(format!(
        "scene {}: {} triangles, {} free poses",
        world.scene().name(),
        world.scene().mesh().triangles().len(),
        world.scene().graph().largest_component().len()
    ));

    let mut policy = registry::build(args.policy, &context, &world)?;
    let trial = Trial { start: args.start, seed: args.setup.seed, steps };
    let bar = talk.bar(trial.steps, "steps");
    let title = format!("{}  ·  {}", world.scene().name(), args.policy);
    let mut drawn = None;
    let mut film: Option<picture::Film> = None;
    let mut failure = Ok(());
    let finished = run_episode(&world, policy.as_mut(), trial, |episode, policy: &dyn Policy| {
        bar.set(episode.steps(), trial.steps);
        let fresh = policy.plan().filter(|plan| args.plans && drawn != Some(plan.made_at));
        if let Some(plan) = fresh {
            drawn = Some(plan.made_at);
            if let Some([seen, answered]) = picture::plan(plan, &world, settings.policy.obstacle_threshold) {
                for (name, image) in [("seen", seen), ("answered", answered)] {
                    let written = image.png().map_err(anyhow::Error::from);
                    let file = format!("plans/{:04}_{name}.png", plan.made_at);
                    let written = written.and_then(|bytes| out.write(&file, bytes));
                    failure = std::mem::replace(&mut failure, Ok(())).and(written);
                }
            }
        }
        if args.gif {
            let taken = match &mut film {
                Some(film) => film.take(episode, policy),
                None => picture::Film::new(&title, episode, trial.steps)
                    .and_then(|fresh| film.insert(fresh).take(episode, policy)),
            };
            failure = std::mem::replace(&mut failure, Ok(())).and(taken.map_err(anyhow::Error::from));
        }
        Ok(())
    });
    bar.finish();
    let Rollout { record, episode } = finished?;
    failure?;

    let points: Vec<_> = episode.view().cloud().iter().collect();
    out.write("cloud.ply", export::cloud_ply(&points, episode.view().cloud_colours()))?;
    out.write("trajectory.json", export::trajectory_json(&record, episode.track())?)?;
    out.write("coverage.csv", export::coverage_csv(&record.curve))?;
    out.write("coverage.svg", plot::coverage(&title, &plot::series(std::slice::from_ref(&record))))?;
    out.write("topdown.png", picture::topdown(&episode, &title).png()?)?;
    if let Some(film) = film {
        out.write("episode.gif", film.finish()?)?;
    }
    let completion = record.completion.map_or(String::new(), |Completion { share, mean_distance }| {
        format!(", Comp. {:.2} %, {:.2} cm", 100.0 * share, 100.0 * mean_distance)
    });
    show(format_args!(
        "{} {}: {:.1} % covered after {} steps, AUC {:.3}, {:.1} m walked, bumps: {}, {:.1} ms a decision{completion}",
        record.scene,
        record.policy,
        100.0 * record.final_coverage,
        record.steps,
        record.auc,
        record.path_length,
        record.bumps,
        record.decision_ms
    ))?;
    talk.say(format!(
        "wrote cloud.ply, trajectory.json, coverage.csv, coverage.svg, topdown.png{} to {}",
        if args.gif { ", episode.gif" } else { "" },
        out.folder().display()
    ));
    Ok(())
}
