//! The loop: walk, remember, learn, validate; from a configuration to a finished checkpoint.

use super::collect::{self, CollectError};
use super::config::RecipeConfig;
use super::learner::{self, Batch, LearnError, Learner};
use super::progress::{Losses, Progress};
use crate::ahead::{Ahead, ahead};
use crate::log::{Bars, Log};
use crate::memory::Memory;
use crate::run::Outcome;
use crate::{checkpoint, config, folder, interrupt, scenes};
use anyhow::{Context as _, Result, ensure};
use burn::module::Module as _;
use nbp_env::explain::{show, tell};
use nbp_env::nbv::NbvPredictor;
use nbp_env::{SeedTree, World};
use nbp_infer::checkpoint::remember_scone;
use nbp_model::scone::{Scone, SconePredictor};
use nbp_model::weights::scone::{self as weights, Baseline, SconeDescription};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Everything a run works with.
pub struct Session {
    config: RecipeConfig,
    folder: PathBuf,
    /// Maps to learn from, and those that are kept out.
    worlds: [Vec<Arc<World>>; 2],
    /// Samples of both.
    memories: [Memory; 2],
    learner: Learner,
    /// The best networks so far, for inference.
    best: Option<Scone>,
    progress: Progress,
    describe: SconeDescription,
    log: Log,
    /// When the last checkpoint was saved, or the process began.
    saved: Instant,
}

/// Trains a baseline in a folder, from its last checkpoint if there is one.
///
/// # Errors
/// When the folder is another run's, a disk refuses, or numbers stop being finite; the last checkpoint stays.
pub fn train(baseline: Baseline, config: RecipeConfig, run: &Path, bars: Bars) -> Result<Outcome> {
    let device = config.device.resolve_for("train")?.autodiff();
    prepare(run, baseline, &config)?;
    let _lock = folder::lock(run)?;
    interrupt::listen();
    let (last, best) = (checkpoint::last(run), checkpoint::best(run));
    let (has_last, has_best) = (checkpoint::recover(&last)?, checkpoint::recover(&best)?);
    let fresh = Scone::new(&config.net, config.seed, &device)?;
    let (net, optim, progress) = match has_last || has_best {
        true => checkpoint::restore::<_, Progress>(if has_last { &last } else { &best }, fresh, &config.optim)?,
        false => (fresh, config.optim.init(), Progress::default()),
    };
    let log = Log::open(run, progress.steps, bars).with_context(|| format!("opening the log in {}", run.display()))?;
    if progress.done {
        tell(format_args!("the run in {} is complete; train another with --run DIR", run.display()));
        return finish(baseline, run, &progress);
    }
    if has_last || has_best {
        tracing::info!("resuming at round {}, step {}", progress.round + 1, progress.steps);
    }
    let worlds = worlds(&config, bars)?;
    let open = |name: &str, count: usize| -> Result<Memory> {
        let mut memory = Memory::open(&run.join("memory").join(name))?;
        memory.truncate(count)?;
        Ok(memory)
    };
    let mut describe = SconeDescription::new(baseline, config.net);
    remember_scone(&mut describe, &config.settings())?;
    let kept = match progress.best {
        Some(_) => Some(weights::load(&best, &device.clone().without_autodiff())?.net),
        None => None,
    };
    let mut session = Session {
        best: kept,
        memories: [open("train.bin", progress.memory)?, open("validation.bin", progress.held_out)?],
        learner: Learner { net, optim, device, steps: progress.steps },
        folder: run.to_owned(),
        saved: Instant::now(),
        config,
        worlds,
        progress,
        describe,
        log,
    };
    if session.run()? == Outcome::Interrupted {
        tell(format_args!("saved in {}; the same command resumes", run.display()));
        return Ok(Outcome::Interrupted);
    }
    finish(baseline, run, &session.progress)
}

/// Makes the run's folder, or checks that it was made for this configuration.
fn prepare(run: &Path, baseline: Baseline, config: &RecipeConfig) -> Result<()> {
    folder::make(run)?;
    let path = run.join("config.toml");
    if path.exists() {
        let begun = config::stack::<RecipeConfig>(std::slice::from_ref(&path), &[])
            .with_context(|| format!("{} is no run of --recipe {baseline}", run.display()))?;
        let mut differences = config::differences(&begun, config);
        // How often it is saved does not change what is learnt.
        differences.retain(|line| !line.starts_with("train.checkpoint_minutes:"));
        folder::refuse_other_settings(run, &differences)?;
    }
    nbp_model::weights::write_atomic(&path, config.to_toml()?.as_bytes()).with_context(|| folder::unwritable(run))
}

/// All maps: those to learn from, and the last of each set, which are kept out.
fn worlds(config: &RecipeConfig, bars: Bars) -> Result<[Vec<Arc<World>>; 2]> {
    let [mut learnt, mut kept] = [Vec::new(), Vec::new()];
    for set in &config.scenes {
        let mut all = scenes::load(set, &config.sim, "maps", bars)?;
        ensure!(all.len() > 1, "a set of maps has only {}: two are needed, one of which is kept out", all.len());
        let out = (config.train.held_out * all.len() as f64).round().clamp(1.0, all.len() as f64 - 1.0);
        kept.extend(all.split_off(all.len() - out as usize));
        learnt.extend(all);
    }
    Ok([learnt, kept])
}

fn finish(baseline: Baseline, run: &Path, progress: &Progress) -> Result<Outcome> {
    interrupt::nothing_to_save();
    if let Some(Losses { occupancy, gains }) = progress.best {
        show(format_args!(
            "{baseline}: {} steps in {:.0} s; on maps kept out, occupancy {occupancy:.4}, gains {gains:.4}",
            progress.steps, progress.seconds
        ))?;
    }
    tell(format_args!("checkpoint: {}", checkpoint::best(run).display()));
    Ok(Outcome::Complete)
}

impl Session {
    fn run(&mut self) -> Result<Outcome> {
        let (begun, before) = (Instant::now(), self.progress.seconds);
        while !self.progress.done {
            if !self.progress.collected && self.collect()? == Outcome::Interrupted {
                return Ok(Outcome::Interrupted);
            }
            let outcome = self.learn()?;
            self.progress.seconds = before + begun.elapsed().as_secs_f64();
            if outcome == Outcome::Interrupted {
                self.save(false)?;
                return Ok(Outcome::Interrupted);
            }
            let is_best = self.validate()?;
            (self.progress.step_of_round, self.progress.collected) = (0, false);
            self.progress.round += 1;
            self.progress.done = self.progress.round == self.config.train.rounds;
            self.save(is_best)?;
        }
        Ok(Outcome::Complete)
    }

    /// Walks through all maps with the networks as they are; at first there are none.
    fn collect(&mut self) -> Result<Outcome> {
        let RecipeConfig { nbv, collect, train, seed, .. } = &self.config;
        let round = self.progress.round;
        let predictor = SconePredictor::new(&self.learner.net, &self.describe, &self.learner.device);
        let predictor = (round > 0).then_some(&predictor as &dyn NbvPredictor);
        let walks = [train.walks, 1].into_iter().zip(&self.worlds);
        let total = walks.clone().map(|(walks, worlds)| walks * worlds.len()).sum();
        let bar = self.log.bars.start(&format!("round {}: walks", round + 1), total);
        for (n, (walks, worlds)) in walks.enumerate() {
            // The same walks in every round where maps are kept out, so that rounds are compared on the same poses.
            let seed = match n {
                0 => SeedTree::new(*seed).child("walks", round as u64),
                _ => SeedTree::new(*seed).child("kept out", 0),
            };
            let found = collect::samples(worlds, walks, predictor, nbv, collect, seed, |world, count| {
                bar.advance(format!("{count} samples in {}", world.scene().name()));
            });
            let found = match found {
                // The last checkpoint stands before these walks, which are repeated.
                Err(CollectError::Interrupted) => return Ok(Outcome::Interrupted),
                other => other?,
            };
            self.memories[n].append(round, &found)?;
        }
        bar.finish();
        let count = |memory: &Memory| of_rounds(memory, round..round + 1).len();
        let [fresh, kept] = [0, 1].map(|n| count(&self.memories[n]));
        ensure!(fresh > 0 && kept > 0, "the walks gave no samples: collect.steps or nbv.cloud_points may be too small");
        let scalars = [("collect/samples".to_string(), fresh as f64), ("collect/held_out".to_string(), kept as f64)];
        self.log.scalars(self.progress.steps, &scalars);
        self.progress.collected = true;
        self.save(false)?;
        Ok(Outcome::Complete)
    }

    /// The steps of a round that are left.
    fn learn(&mut self) -> Result<Outcome> {
        let RecipeConfig { train, seed, .. } = self.config.clone();
        let round = self.progress.round;
        let first = if train.memory == 0 { 0 } else { (round + 1).saturating_sub(train.memory) };
        let known = of_rounds(&self.memories[0], first..round + 1);
        let bar = self.log.bars.start(&format!("round {}: steps", round + 1), train.steps);
        bar.skip(self.progress.step_of_round);
        let left = self.progress.step_of_round..train.steps;
        let batch = train.batch.min(known.len());
        let (memory, device, steps) = (self.memories[0].clone(), self.learner.device.clone(), self.progress.steps);
        let drawn = (steps..steps + left.len()).flat_map(|step| {
            let mut rng = SeedTree::new(seed).child("batch", step as u64).rng();
            let drawn = rand::seq::index::sample(&mut rng, known.len(), batch);
            let drawn: Vec<usize> = drawn.into_iter().map(|n| known[n]).collect();
            let limit = (train.candidates > 0)
                .then(|| (train.candidates, SeedTree::new(seed).child("candidates", step as u64)));
            drawn.chunks(train.at_once).map(|indices| (indices.to_vec(), limit)).collect::<Vec<_>>()
        });
        let load = move |(indices, limit): (Vec<usize>, _)| learner::load(&memory, &indices, limit, &device);
        ahead(drawn, load, |batches| {
            for _ in left {
                let begun = Instant::now();
                let lr = self.config.optim.lr * train.rate(self.progress.steps);
                let found = self.learner.step(batches.by_ref(), batch.div_ceil(train.at_once), lr)?;
                self.progress.step_of_round += 1;
                self.progress.steps = self.learner.steps;
                let scalars = [
                    ("train/occupancy", found.occupancy),
                    ("train/gains", found.gains),
                    ("train/learning_rate", lr),
                    ("speed/samples_per_second", batch as f64 / begun.elapsed().as_secs_f64()),
                ];
                self.log.scalars(self.progress.steps, &scalars.map(|(name, value)| (name.to_string(), value)));
                bar.advance(format!("occupancy {:.4}, gains {:.4}", found.occupancy, found.gains));
                if interrupt::asked() {
                    return Ok(Outcome::Interrupted);
                }
                if self.saved.elapsed() > Duration::from_secs_f64(60.0 * train.checkpoint_minutes) {
                    self.save(false)?;
                }
            }
            bar.finish();
            Ok(Outcome::Complete)
        })
    }

    /// Losses on the maps that are kept out, and whether they are better than those of the best networks so far. Both answer
    /// what the newest walks met: losses on the walks of different rounds cannot be compared.
    fn validate(&mut self) -> Result<bool> {
        let round = self.progress.round;
        let memory = self.memories[1].clone();
        let known = of_rounds(&memory, round..round + 1);
        let device = self.learner.device.clone().without_autodiff();
        let load = |indices: &[usize]| learner::load(&memory, indices, None, &device);
        let net = self.learner.net.valid();
        let nets: Vec<&Scone> = std::iter::once(&net).chain(&self.best).collect();
        let batches = known.chunks(self.config.train.at_once);
        let losses = ahead(batches, load, |batches: &mut Ahead<Result<Batch, LearnError>>| {
            self.learner.validate(&nets, batches)
        })?;
        let found = losses[0];
        let is_best = losses.get(1).is_none_or(|best| found.total() < best.total());
        let values = [("validation/occupancy", found.occupancy), ("validation/gains", found.gains)];
        self.log.scalars(self.progress.steps, &values.map(|(name, value)| (name.to_string(), value)));
        self.log.flush();
        tracing::info!(
            "round {}: on maps kept out, occupancy {:.4}, gains {:.4}{}",
            round + 1,
            found.occupancy,
            found.gains,
            if is_best { " (best so far)" } else { "" }
        );
        if is_best {
            (self.progress.best, self.best) = (Some(found), Some(net));
        }
        Ok(is_best)
    }

    /// Saves where the run stands, and before that the best weights: a crash in between repeats the round's end.
    fn save(&mut self, is_best: bool) -> Result<()> {
        self.memories.iter().try_for_each(Memory::sync)?;
        [self.progress.memory, self.progress.held_out] = [0, 1].map(|n| self.memories[n].len());
        let (learner, describe) = (&self.learner, &self.describe);
        let publish = |aside: &Path| weights::save(aside, &learner.net, describe);
        let (best, last) = (checkpoint::best(&self.folder), checkpoint::last(&self.folder));
        for folder in is_best.then_some(best).into_iter().chain([last]) {
            checkpoint::replace(&folder, publish, &learner.net, &learner.optim, &self.progress)
                .with_context(|| format!("the checkpoint before this one is still in {}", folder.display()))?;
        }
        self.saved = Instant::now();
        Ok(())
    }
}

/// The samples that some rounds collected.
fn of_rounds(memory: &Memory, rounds: std::ops::Range<usize>) -> Vec<usize> {
    (0..memory.len()).filter(|&n| memory.iteration(n).is_some_and(|round| rounds.contains(&round))).collect()
}
