//! Algorithm 1 (paper, section 4.3): the loop, and what it stands on.

use crate::ahead::{Ahead, ahead};
use crate::checkpoint::{self, Progress};
use crate::clock::Clock;
use crate::collect::CollectError;
use crate::config::{Config, Schedule};
use crate::log::Log;
use crate::memory::Memory;
use crate::plateau::Verdict;
use crate::step::{self, Learner, StepError};
use crate::walk::{self, Walks};
use crate::{collect, curriculum, interrupt, report, validate};
use anyhow::{Context as _, Result, bail};
use nbp_env::{Predictor, SeedTree, World};
use nbp_infer::checkpoint::{Settings, remember};
use nbp_model::{Batch, CheckpointConfig, LossValues, NetPredictor};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Everything a run works with.
pub struct Session {
    /// The resolved configuration.
    pub config: Config,
    /// The run's folder.
    pub folder: PathBuf,
    /// Training scenes.
    pub worlds: Vec<Arc<World>>,
    /// Scenes that are walked after every iteration; none: the loss decides which weights are best.
    pub validation: Vec<Arc<World>>,
    /// Replay memory.
    pub memory: Memory,
    /// Samples kept out for validation.
    pub held_out: Memory,
    /// Network and optimiser.
    pub learner: Learner,
    /// Where in the loop the run stands.
    pub progress: Progress,
    /// What its checkpoints tell of themselves.
    pub describe: CheckpointConfig,
    /// What it tells.
    pub log: Log,
    /// What its time went to.
    pub clock: Clock,
    /// When the last checkpoint was saved, or the process began.
    pub saved: Instant,
}

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// All iterations are done.
    Complete,
    /// Saved on request, to be resumed.
    Interrupted,
}

impl Session {
    /// Runs to the end, or until interrupted. Every stage can be resumed at the step at which it was saved.
    ///
    /// # Errors
    /// When a disk refuses or numbers stop being finite; the last checkpoint stays.
    pub fn run(&mut self) -> Result<Outcome> {
        let seeds = SeedTree::new(self.config.seed);
        let train = self.config.train.clone();
        while self.progress.iteration < train.iterations && !self.progress.done {
            let iteration = self.progress.iteration;
            if !self.progress.collected
                && self.collect(iteration, seeds.child("collect", iteration as u64))? == Outcome::Interrupted
            {
                return Ok(Outcome::Interrupted);
            }
            let set = curriculum::balanced(&self.memory, iteration, seeds.child("replay", iteration as u64));
            let mut verdict = Verdict::Wait;
            while self.progress.epoch < train.epochs && !set.is_empty() {
                let epoch = self.progress.epoch;
                let shuffle = seeds.child("shuffle", iteration as u64).child("epoch", epoch as u64);
                if self.epoch(&curriculum::shuffled(&set, shuffle))? == Outcome::Interrupted {
                    self.save(Verdict::Wait)?;
                    return Ok(Outcome::Interrupted);
                }
                verdict = self.validate()?;
                (self.progress.epoch, self.progress.step_of_epoch) = (epoch + 1, 0);
                self.progress.done = verdict == Verdict::Stop;
                if self.progress.done {
                    tracing::info!("no better validation loss for {} epochs: stopping early", train.early_stop);
                    break;
                }
                // The last epoch is saved with its iteration.
                if self.progress.epoch < train.epochs {
                    self.save(verdict)?;
                }
            }
            (self.progress.iteration, self.progress.epoch, self.progress.collected) = (iteration + 1, 0, false);
            self.progress.done |= self.progress.iteration == train.iterations;
            if !self.validation.is_empty() {
                verdict = self.walk()?;
            }
            if self.progress.done && self.progress.steps == 0 {
                bail!(
                    "no sample was ever admitted, so nothing was learnt: collect.steps must exceed curriculum.easy_step, \
                     or curriculum.easy_iterations be below train.iterations"
                );
            }
            self.log_time();
            self.save(verdict)?;
        }
        Ok(Outcome::Complete)
    }

    /// What the iteration's time went to, and all time so far.
    fn log_time(&mut self) {
        let threads = rayon::current_num_threads();
        let (lap, total) = (self.clock.lap().shares(threads), self.clock.total().shares(threads));
        let named = |group: &'static str| move |(name, share)| (format!("{group}/{name}"), share);
        let shares: Vec<_> =
            lap.into_iter().map(named("time")).chain(total.into_iter().map(named("time_total"))).collect();
        self.log.scalars(self.progress.steps, &shares);
    }

    /// Walks through every scene with the current model and remembers what was admitted.
    fn collect(&mut self, iteration: usize, seed: SeedTree) -> Result<Outcome> {
        let config = &self.config.collect;
        let count = if iteration == 0 { config.first_trajectories } else { config.trajectories };
        let predictor: Arc<dyn Predictor> = Arc::new(self.predictor().with_chunk(config.batch));
        let bar = self.log.bars.start(&format!("iteration {}: collect", iteration + 1), count * self.worlds.len());
        let begun = Instant::now();
        let collected = collect::trajectories(&self.worlds, &predictor, config, count, seed, |t| {
            bar.advance(format!("{} covered {:.1} %", t.scene, 100.0 * t.coverage));
        });
        bar.finish();
        let took = begun.elapsed();
        let (trajectories, threads) = match collected {
            // The last checkpoint stands before this collection, which is repeated.
            Err(CollectError::Interrupted) => return Ok(Outcome::Interrupted),
            other => other?,
        };
        self.clock.collection(took, threads);
        let begun = Instant::now();
        report::log_trajectories(&mut self.log, &trajectories, &self.worlds, self.progress.steps, took);
        let fresh = trajectories.into_iter().flat_map(|t| t.samples).collect();
        let mut fresh = curriculum::admit(fresh, iteration, &self.config.curriculum);
        if self.held_out.is_empty() {
            let share = (self.config.train.validation_share * fresh.len() as f32) as usize;
            let (keep, out) = hold_out(fresh, self.config.train.validation.min(share));
            self.held_out.append(iteration, &out)?;
            fresh = keep;
        }
        self.memory.append(iteration, &fresh)?;
        self.clock.io(begun.elapsed());
        self.progress.collected = true;
        self.save(Verdict::Wait)?;
        Ok(Outcome::Complete)
    }

    /// One pass over the set in the given order, from where the last checkpoint of this epoch left it.
    fn epoch(&mut self, order: &[usize]) -> Result<Outcome> {
        let (batch, accumulate) = (self.config.train.batch, self.config.train.accumulate);
        let groups: Vec<&[usize]> = order.chunks(batch * accumulate).collect();
        let name = format!(
            "iteration {}: epoch {}/{}",
            self.progress.iteration + 1,
            self.progress.epoch + 1,
            self.config.train.epochs
        );
        let bar = self.log.bars.start(&name, groups.len());
        bar.skip(self.progress.step_of_epoch);
        let augment = self.config.train.augment.then(|| SeedTree::new(self.config.seed).child("augment", 0));
        let left = groups.iter().skip(self.progress.step_of_epoch);
        let numbered = (self.progress.steps..).zip(left.clone());
        let parts = numbered.flat_map(|(step, group)| group.chunks(batch).map(move |part| (step, part)));
        let (memory, net, device) = (self.memory.clone(), self.learner.config, self.learner.device.clone());
        let load = move |(step, part): (usize, &[usize])| {
            step::load(&memory, part, &net, &device, augment.map(|seed| seed.child("step", step as u64)))
        };
        ahead(parts, load, |batches: &mut Ahead<Result<Batch, StepError>>| {
            for group in left {
                let begun = Instant::now();
                let count = group.len().div_ceil(batch);
                let lr = self.learning_rate(groups.len());
                let values = self.learner.step(batches.by_ref(), count, self.config.train.tasks, lr)?;
                let (took, waited) = (begun.elapsed(), batches.waited());
                self.clock.network(took.saturating_sub(waited));
                self.clock.io(waited);
                self.progress.step_of_epoch += 1;
                self.progress.steps = self.learner.steps;
                self.log_step(&values, lr, group.len() as f64 / took.as_secs_f64());
                bar.advance(format!("value {:.3}, obstacle {:.3}", values.mse, values.bce));
                if interrupt::asked() {
                    return Ok(Outcome::Interrupted);
                }
                if self.saved.elapsed() > Duration::from_secs_f64(60.0 * self.config.train.checkpoint_minutes) {
                    self.save(Verdict::Wait)?;
                }
            }
            bar.finish();
            Ok(Outcome::Complete)
        })
    }

    /// Loss on what was kept out, the schedule's verdict on it, and pictures.
    fn validate(&mut self) -> Result<Verdict> {
        let begun = Instant::now();
        let validation = validate::run(
            &self.learner,
            &self.held_out,
            self.config.train.batch,
            self.config.policy.obstacle_threshold,
        )?;
        self.clock.network(begun.elapsed());
        let begun = Instant::now();
        let train = &self.config.train;
        let verdict = match validation {
            // Without validation samples the last weights are the best there are.
            None => Verdict::Better,
            Some(loss) => {
                let (factor, patience) = (train.plateau_factor, train.plateau_patience);
                self.progress.plateau.observe(loss.total(train.tasks), factor, patience, train.early_stop)
            }
        };
        if let Some(loss) = validation {
            self.progress.validation = Some(loss);
            let values = [
                ("validation/value_mse", loss.mse),
                ("validation/obstacle_bce", loss.bce),
                ("validation/obstacle_precision", loss.precision),
                ("validation/obstacle_recall", loss.recall),
            ];
            self.log.scalars(self.progress.steps, &values.map(|(name, value)| (name.to_string(), value)));
            tracing::info!(
                "iteration {}, epoch {}: validation value {:.3}, obstacle {:.4}, precision {:.3}, recall {:.3}{}",
                self.progress.iteration + 1,
                self.progress.epoch + 1,
                loss.mse,
                loss.bce,
                loss.precision,
                loss.recall,
                if verdict == Verdict::Better { " (least loss so far)" } else { "" }
            );
            let sample = self.held_out.get(0)?;
            if let Some(world) = self.worlds.first() {
                let (predictor, lattice) = (self.predictor(), world.scene().lattice());
                report::log_sample(&mut self.log, &predictor, &sample, lattice, self.progress.steps)?;
            }
        }
        self.log.flush();
        self.clock.io(begun.elapsed());
        Ok(if verdict == Verdict::Better && !self.validation.is_empty() { Verdict::Wait } else { verdict })
    }

    /// Walks through the validation scenes with the current model: better if more is covered, sooner, than ever before.
    fn walk(&mut self) -> Result<Verdict> {
        let begun = Instant::now();
        let [coverage, auc] = walk::walk(&self.validation, Arc::new(self.predictor()), &self.config, self.log.bars)?;
        self.clock.walks(begun.elapsed());
        let best = self.progress.curve.iter().map(|walks| walks.auc).fold(f64::NEG_INFINITY, f64::max);
        let walks = Walks {
            iteration: self.progress.iteration,
            steps: self.progress.steps,
            samples: self.memory.len(),
            seconds: self.clock.total().wall,
            coverage,
            auc,
        };
        self.progress.curve.push(walks);
        self.log.scalars(walks.steps, &[("walks/coverage".into(), coverage), ("walks/auc".into(), auc)]);
        let verdict = if auc > best { Verdict::Better } else { Verdict::Wait };
        tracing::info!(
            "iteration {}: validation walks cover {:.1} %, area under the curve {auc:.3}{}",
            walks.iteration,
            100.0 * coverage,
            if verdict == Verdict::Better { " (best so far)" } else { "" }
        );
        walk::write_curve(&self.folder, &self.progress.curve).context("writing learning-curve.csv")?;
        Ok(verdict)
    }

    /// Of the next step, in an epoch of `steps`.
    fn learning_rate(&self, steps: usize) -> f64 {
        let (train, at) = (&self.config.train, &self.progress);
        match train.schedule {
            Schedule::Plateau => at.plateau.lr,
            Schedule::Cosine => {
                let epochs = at.epoch as f64 + at.step_of_epoch as f64 / steps.max(1) as f64;
                let done = (at.iteration as f64 + epochs / train.epochs as f64) / train.iterations as f64;
                self.config.optim.lr * 0.5 * (1.0 + (std::f64::consts::PI * done).cos())
            }
        }
    }

    fn log_step(&mut self, values: &LossValues, lr: f64, samples_per_second: f64) {
        let scalars = [
            ("train/total", f64::from(values.total)),
            ("train/value_mse", f64::from(values.mse)),
            ("train/obstacle_bce", f64::from(values.bce)),
            ("train/sigma_value", f64::from(values.sigma[0])),
            ("train/sigma_obstacle", f64::from(values.sigma[1])),
            ("train/learning_rate", lr),
            ("speed/samples_per_second", samples_per_second),
        ];
        self.log.scalars(self.progress.steps, &scalars.map(|(name, value)| (name.to_string(), value)));
    }

    /// The current network, for inference.
    pub fn predictor(&self) -> NetPredictor {
        NetPredictor::new(&self.learner.net, &self.describe)
    }

    /// Saves where the run stands, and before that the best weights: a crash in between repeats the epoch.
    fn save(&mut self, verdict: Verdict) -> Result<()> {
        let begun = Instant::now();
        self.memory.sync()?;
        self.held_out.sync()?;
        self.progress.memory = self.memory.len();
        self.progress.held_out = self.held_out.len();
        self.progress.spent = self.clock.total();
        if verdict == Verdict::Better {
            checkpoint::save(&checkpoint::best(&self.folder), &self.learner, &self.progress, &self.describe)?;
        }
        let folder = checkpoint::last(&self.folder);
        checkpoint::save(&folder, &self.learner, &self.progress, &self.describe)
            .with_context(|| format!("the checkpoint before this one is still in {}", folder.display()))?;
        self.clock.io(begun.elapsed());
        self.saved = Instant::now();
        Ok(())
    }
}

/// What a checkpoint tells those who load it: the network's shape, and how its inputs and plans are made.
///
/// # Errors
/// When a setting has no JSON form.
pub fn describe(config: &Config) -> Result<CheckpointConfig, serde_json::Error> {
    let mut describe = CheckpointConfig::new(config.net_config(), config.sim.encode.window);
    let settings = Settings { sim: config.sim.clone(), policy: config.policy, ..Settings::default() };
    remember(&mut describe, &settings)?;
    Ok(describe)
}

/// Takes `count` out of a list at a regular stride: `(rest, taken)`.
fn hold_out<T>(all: Vec<T>, count: usize) -> (Vec<T>, Vec<T>) {
    if count == 0 {
        return (all, Vec::new());
    }
    let stride = all.len() / count;
    let (mut rest, mut taken) = (Vec::new(), Vec::new());
    for (index, item) in all.into_iter().enumerate() {
        if index % stride == 0 && taken.len() < count { taken.push(item) } else { rest.push(item) }
    }
    (rest, taken)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn validation_samples_are_taken_at_a_regular_stride() {
        let (rest, taken) = hold_out((0..103).collect(), 10);
        assert_eq!((rest.len(), taken.len()), (93, 10));
        assert_eq!(taken, (0..10).map(|n| n * 10).collect::<Vec<_>>());
        assert_eq!(hold_out(vec![1, 2, 3], 0), (vec![1, 2, 3], vec![]));
    }
}
