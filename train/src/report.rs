//! What people look at: pictures and numbers of a collection, predictions beside the truth, the final table.

use crate::checkpoint;
use crate::collect::Trajectory;
use crate::config::Config;
use crate::log::Log;
use crate::scenes;
use anyhow::{Context as _, Result};
use nbp_env::label::Sample;
use nbp_env::{Lattice, Prediction, Predictor, SimConfig, World};
use nbp_infer::eval::{self, EvalConfig};
use nbp_infer::registry::{PolicyContext, PolicyKind};
use nbp_infer::{EpisodeRecord, checkpoint as infer_checkpoint, export, picture, table};
use nbp_model::{NetPredictor, weights};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// Probability from which pictures show an obstacle.
const OBSTACLE_THRESHOLD: f32 = 0.5;

/// Row of the network that comes with the repository.
const PUBLISHED: &str = "nbp-published";

/// Coverage of every scene, speed of the simulator, and the last plan of the first trajectory.
pub fn log_trajectories(
    log: &mut Log,
    trajectories: &[Trajectory],
    worlds: &[Arc<World>],
    step: usize,
    took: Duration,
) {
    let mut scalars: Vec<(String, f64)> = Vec::new();
    for world in worlds {
        let name = world.scene().name();
        let shares: Vec<f64> = trajectories.iter().filter(|t| t.scene == name).map(|t| f64::from(t.coverage)).collect();
        scalars.push((format!("collect/coverage/{name}"), shares.iter().sum::<f64>() / shares.len().max(1) as f64));
    }
    let mean = |sum: f64| sum / trajectories.len().max(1) as f64;
    scalars.push(("collect/coverage_mean".into(), mean(trajectories.iter().map(|t| f64::from(t.coverage)).sum())));
    let steps: usize = trajectories.iter().map(|t| t.steps).sum();
    scalars.push(("speed/collect_steps_per_second".into(), steps as f64 / took.as_secs_f64()));
    log.scalars(step, &scalars);
    let first = trajectories.first().zip(worlds.first());
    let pictures = first.and_then(|(t, world)| picture::plan(t.plan.as_ref()?, world, OBSTACLE_THRESHOLD));
    if let Some([seen, answer]) = pictures {
        log.image(step, "collect/input", &seen);
        log.image(step, "collect/value_map_with_path_and_obstacles", &answer);
    }
    log.flush();
}

/// One held-out sample: what the network sees, what it answers, what is true.
///
/// # Errors
/// When the network fails.
pub fn log_sample(
    log: &mut Log,
    predictor: &NetPredictor,
    sample: &Sample,
    lattice: &Lattice,
    step: usize,
) -> Result<()> {
    let answer = predictor.predict(std::slice::from_ref(&sample.input))?.pop();
    let Prediction { value, obstacle } = answer.context("the network gave no answer to a validation sample")?;
    log.image(step, "validation/input", &picture::encoder_layers(&sample.input));
    log.image(
        step,
        "validation/value_map",
        &picture::value_map(&sample.input.window, &value, &sample.obstacles, lattice, &[]),
    );
    let compared = picture::obstacle_map(&obstacle, &sample.obstacles, OBSTACLE_THRESHOLD);
    log.image(step, "validation/obstacles_predicted_and_true", &compared);
    Ok(())
}

/// Evaluates the best checkpoint and its rivals on the held-out scenes, from the same starts; writes the run's `eval/`
/// folder and returns the table.
///
/// # Errors
/// When scenes cannot be made or a policy fails.
pub fn final_table(config: &Config, run: &Path, log: &Log) -> Result<String> {
    let worlds = scenes::load(&config.scenes.held_out, &config.sim, "held-out scenes", log.bars)?;
    let best = infer_checkpoint::load(&checkpoint::best(run), config.device)?;
    let context =
        PolicyContext { predictor: Some(Arc::new(best.predictor)), nbp: config.policy, ..PolicyContext::default() };
    let compared = EvalConfig {
        policies: config.eval.policies.clone(),
        steps: config.eval.steps,
        seeds: 1,
        seed: config.seed,
        starts_limit: Some(config.eval.starts),
        // Side by side, the time of a decision would have the waiting for others in it.
        batch: 1,
    };
    let starts = worlds.iter().map(|world| world.scene().starts().len().min(config.eval.starts)).sum::<usize>();
    let bar = log.bars.start("held-out episodes", starts * compared.policies.len());
    let mut episodes = eval::run(&worlds, &context, &compared, &[], |record, _| {
        bar.advance(format!("{} on {}: {:.1} %", record.policy, record.scene, 100.0 * record.final_coverage));
    })?;
    bar.finish();
    // What a run has learnt does not hang on a folder that is not its own.
    match published(config, &worlds, compared, log) {
        Ok(rows) => episodes.extend(rows),
        Err(error) => tracing::warn!("no row {PUBLISHED}: {error:#}"),
    }
    let rows = table::summarise(&episodes, &BTreeMap::new());
    let summary = serde_json::to_string_pretty(&rows)?;
    let files = [
        ("episodes.csv", export::episodes_csv(&episodes)),
        ("summary.json", summary),
        ("summary.md", table::markdown(&rows)),
    ];
    for (name, text) in files {
        let path = run.join("eval").join(name);
        weights::write_atomic(&path, text.as_bytes()).with_context(|| format!("writing {}", path.display()))?;
    }
    Ok(table::text(&rows))
}

/// The same episodes with the network that comes with the repository, and its settings: what a run may be measured by. None where it is
/// not there, not asked for, or was made for another task.
fn published(config: &Config, worlds: &[Arc<World>], compared: EvalConfig, log: &Log) -> Result<Vec<EpisodeRecord>> {
    let folder = infer_checkpoint::published("nbp");
    if !config.eval.published || !folder.is_dir() {
        return Ok(Vec::new());
    }
    let (_, settings) = infer_checkpoint::read(&folder)?;
    let encode = settings.sim.encode;
    if settings.sim != (SimConfig { encode, ..config.sim.clone() }) {
        tracing::info!("{} was made for another simulator: no row {PUBLISHED}", folder.display());
        return Ok(Vec::new());
    }
    let worlds: Vec<Arc<World>> =
        worlds.iter().map(|world| Ok(Arc::new(world.with_encode(encode)?))).collect::<Result<_>>()?;
    let network = infer_checkpoint::load(&folder, config.device)?;
    let context = PolicyContext {
        predictor: Some(Arc::new(network.predictor)),
        nbp: settings.policy,
        ..PolicyContext::default()
    };
    let compared = EvalConfig { policies: vec![PolicyKind::Nbp], ..compared };
    let starts = worlds.iter().map(|world| world.scene().starts().len().min(config.eval.starts)).sum();
    let bar = log.bars.start(&format!("held-out episodes of {PUBLISHED}"), starts);
    let episodes = eval::run(&worlds, &context, &compared, &[], |record, _| {
        bar.advance(format!("{}: {:.1} %", record.scene, 100.0 * record.final_coverage));
    })?;
    bar.finish();
    Ok(episodes.into_iter().map(|record| EpisodeRecord { policy: PUBLISHED.into(), ..record }).collect())
}
