//! What the network is worth as a policy: walks through maps that it does not learn from, after every iteration.
//!
//! The loss of maps says little about the walks that are planned on them, so the best weights are chosen by this.

use crate::config::Config;
use crate::log::Bars;
use anyhow::Result;
use nbp_env::metrics::mean_std;
use nbp_env::{Predictor, World};
use nbp_infer::eval::{self, EvalConfig};
use nbp_infer::plot;
use nbp_infer::registry::{PolicyContext, PolicyKind};
use nbp_model::weights;
use serde::{Deserialize, Serialize};
use std::fmt::Write as _;
use std::path::Path;
use std::sync::Arc;

/// What came of the walks of one iteration: a point of the learning curve.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Walks {
    /// Iterations done.
    pub iteration: usize,
    /// Optimiser steps until then.
    pub steps: usize,
    /// Samples collected until then.
    pub samples: usize,
    /// Seconds of work until then, these walks included.
    pub seconds: f64,
    /// Mean covered share at the end of an episode, 0 to 1.
    pub coverage: f64,
    /// Mean area under the curve of coverage, 0 to 1.
    pub auc: f64,
}

/// Mean coverage and area under its curve of one greedy episode from the first start of every world.
///
/// # Errors
/// When the network fails.
pub fn walk(worlds: &[Arc<World>], network: Arc<dyn Predictor>, config: &Config, bars: Bars) -> Result<[f64; 2]> {
    let context = PolicyContext { predictor: Some(network), nbp: config.policy, ..PolicyContext::default() };
    let walks = EvalConfig {
        policies: vec![PolicyKind::Nbp],
        steps: config.eval.steps,
        seed: config.seed,
        starts_limit: Some(1),
        ..EvalConfig::default()
    };
    let bar = bars.start("validation walks", worlds.len());
    let episodes = eval::run(worlds, &context, &walks, &[], |record, _| {
        bar.advance(format!("{}: {:.1} %", record.scene, 100.0 * record.final_coverage));
    })?;
    bar.finish();
    let mean = |of: fn(&nbp_infer::EpisodeRecord) -> f64| mean_std(&episodes.iter().map(of).collect::<Vec<_>>()).0;
    Ok([mean(|record| record.final_coverage), mean(|record| record.auc)])
}

/// Writes the learning curve of a run as CSV and as a picture.
///
/// # Errors
/// When the disk refuses.
pub fn write_curve(run: &Path, curve: &[Walks]) -> std::io::Result<()> {
    let mut csv = String::from("iteration,steps,samples,seconds,coverage,auc\n");
    for Walks { iteration, steps, samples, seconds, coverage, auc } in curve {
        let _ = writeln!(csv, "{iteration},{steps},{samples},{seconds:.0},{coverage:.4},{auc:.4}");
    }
    weights::write_atomic(&run.join("learning-curve.csv"), csv.as_bytes())?;
    let of = |measure: fn(&Walks) -> f64| curve.iter().map(measure).collect::<Vec<f64>>();
    let measures = [("Final Cov.", of(|walks| walks.coverage)), ("AUC", of(|walks| walks.auc))];
    let svg = plot::learning_curve("Walks on validation maps", &of(|walks| walks.seconds / 60.0), &measures);
    weights::write_atomic(&run.join("learning-curve.svg"), svg.as_bytes())
}
