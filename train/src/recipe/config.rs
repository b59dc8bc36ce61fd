//! The configuration of a baseline's training.

use crate::config::{self, ConfigError};
use crate::scenes::SceneSet;
use nbp_env::SimConfig;
use nbp_env::nbv::{CollectConfig, NbvConfig, Teacher};
use nbp_infer::checkpoint::Settings;
use nbp_model::scone::SconeConfig;
use nbp_model::weights::scone::Baseline;
use nbp_model::{AdamW, DeviceChoice};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Everything that decides what a baseline learns.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RecipeConfig {
    /// Root of every random stream.
    pub seed: u64,
    /// Where tensors live.
    pub device: DeviceChoice,
    /// Optimiser; its learning rate is reached after the warm-up.
    pub optim: AdamW,
    /// The loop.
    pub train: LoopConfig,
    /// Widths of the networks.
    pub net: SconeConfig,
    /// What the networks are asked.
    pub nbv: NbvConfig,
    /// How samples are collected; the recipe decides whom they learn from.
    pub collect: CollectConfig,
    /// The simulator.
    pub sim: SimConfig,
    /// Sets of maps.
    pub scenes: Vec<SceneSet>,
}

impl Default for RecipeConfig {
    fn default() -> Self {
        Self {
            seed: 1,
            device: DeviceChoice::Auto,
            optim: AdamW { lr: 1e-4, ..AdamW::default() },
            train: LoopConfig::default(),
            net: SconeConfig::default(),
            nbv: NbvConfig::PUBLISHED,
            collect: CollectConfig { queries: 6000, ..CollectConfig::default() },
            sim: SimConfig::default(),
            scenes: vec![SceneSet { level: "simple".into(), count: 70, seed: 1, paths: Vec::new() }],
        }
    }
}

/// The loop. The defaults are for networks of the published size.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LoopConfig {
    /// Rounds: walks through every map, then steps.
    pub rounds: usize,
    /// Walks through each map in a round.
    pub walks: usize,
    /// Rounds whose samples are remembered; 0: all.
    pub memory: usize,
    /// Steps of the optimiser in a round.
    pub steps: usize,
    /// Samples of a step (published: 12 and 6).
    pub batch: usize,
    /// Candidates of a sample that a step compares, drawn anew for each; 0: all (published: all).
    pub candidates: usize,
    /// Samples that go through the networks at once; their number changes memory and rounding, not what is learnt.
    pub at_once: usize,
    /// Steps in which the learning rate rises linearly (published: 1000).
    pub warm_up: usize,
    /// Share of all steps after which the learning rate is a tenth (published: 250 of 301 epochs).
    pub decay_at: f64,
    /// Share of the maps of each set that is kept out, at least one (published for SCONE: 10 %).
    pub held_out: f64,
    /// Save at least so often, minutes.
    pub checkpoint_minutes: f64,
}

impl Default for LoopConfig {
    fn default() -> Self {
        Self {
            rounds: 20,
            walks: 5,
            memory: 5,
            steps: 1000,
            batch: 8,
            candidates: 0,
            at_once: 1,
            warm_up: 1000,
            decay_at: 0.8,
            held_out: 0.1,
            checkpoint_minutes: 5.0,
        }
    }
}

impl LoopConfig {
    /// Learning rate of a step, as a share of the optimiser's.
    pub fn rate(&self, step: usize) -> f64 {
        let rise = ((step + 1) as f64 / self.warm_up.max(1) as f64).min(1.0);
        let late = step as f64 >= self.decay_at * (self.rounds * self.steps) as f64;
        if late { 0.1 * rise } else { rise }
    }
}

impl RecipeConfig {
    /// Stacks files left to right, then `path.to.key=value` settings; the recipe says who teaches.
    ///
    /// # Errors
    /// Naming the file or setting, the line and the key.
    pub fn load(baseline: Baseline, files: &[PathBuf], settings: &[String]) -> Result<Self, ConfigError> {
        let mut config: Self = config::stack(files, settings)?;
        config.collect.teacher = match baseline {
            Baseline::Scone => Teacher::Truth,
            Baseline::Macarons => Teacher::Own,
        };
        config.validate()?;
        Ok(config)
    }

    fn validate(&self) -> Result<(), ConfigError> {
        let schema = |reason: String| ConfigError::Schema { origin: "checked values".into(), reason };
        self.sim.validate().map_err(|error| schema(error.to_string()))?;
        self.nbv.validate().map_err(|error| schema(format!("nbv.{error}")))?;
        self.net.check().map_err(|error| schema(error.to_string()))?;
        if let Some((field, value, want)) = self.collect.fault() {
            return Err(schema(format!("collect.{field} is {value}: it must be {want}")));
        }
        for set in &self.scenes {
            set.levels().map_err(|reason| schema(format!("scenes: {reason}")))?;
        }
        let train = &self.train;
        let counts = [
            ("train.rounds", train.rounds),
            ("train.walks", train.walks),
            ("train.steps", train.steps),
            ("train.batch", train.batch),
            ("train.at_once", train.at_once),
        ];
        if let Some((field, value)) = counts.into_iter().find(|&(_, value)| value == 0) {
            return Err(ConfigError::Range { field, value: value.to_string(), want: "at least 1" });
        }
        let is_share = |x: f64| x > 0.0 && x <= 1.0;
        let is_there = |set: &SceneSet| !set.paths.is_empty() || set.count >= 2;
        let checks = [
            (is_share(train.decay_at), "train.decay_at", train.decay_at.to_string(), "above 0 and at most 1"),
            (
                is_share(train.held_out) && train.held_out < 1.0,
                "train.held_out",
                train.held_out.to_string(),
                "between 0 and 1",
            ),
            (
                self.optim.lr > 0.0 && self.optim.lr.is_finite(),
                "optim.lr",
                self.optim.lr.to_string(),
                "a positive number",
            ),
            (
                train.checkpoint_minutes > 0.0 && train.checkpoint_minutes <= config::MAX_MINUTES,
                "train.checkpoint_minutes",
                train.checkpoint_minutes.to_string(),
                "above 0 and at most a year",
            ),
            (
                !self.scenes.is_empty() && self.scenes.iter().all(is_there),
                "scenes",
                format!("{} sets", self.scenes.len()),
                "sets of at least two maps each, one of which is kept out",
            ),
        ];
        match checks.into_iter().find(|(ok, ..)| !ok) {
            Some((_, field, value, want)) => Err(ConfigError::Range { field, value, want }),
            None => Ok(()),
        }
    }

    /// As TOML, every setting spelled out.
    ///
    /// # Errors
    /// When a setting has no TOML form.
    pub fn to_toml(&self) -> Result<String, ConfigError> {
        config::to_toml(self)
    }

    /// What a checkpoint remembers besides its networks.
    pub fn settings(&self) -> Settings {
        Settings { sim: self.sim.clone(), nbv: self.nbv, ..Settings::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rate_rises_and_falls() {
        let train = LoopConfig { rounds: 2, steps: 50, warm_up: 10, decay_at: 0.8, ..LoopConfig::default() };
        let rates = [0, 4, 9, 79, 80, 99].map(|step| train.rate(step));
        for (rate, want) in rates.into_iter().zip([0.1, 0.5, 1.0, 1.0, 0.1, 0.1]) {
            assert!((rate - want).abs() < 1e-12, "{rates:?}");
        }
        assert_eq!(LoopConfig { warm_up: 0, ..train }.rate(0), 1.0);
    }

    #[test]
    fn recipes_have_their_teachers_and_mistakes_are_named() {
        let load = |baseline, settings: &[&str]| {
            let settings: Vec<String> = settings.iter().map(|&setting| setting.into()).collect();
            RecipeConfig::load(baseline, &[], &settings)
        };
        assert_eq!(load(Baseline::Scone, &[]).unwrap().collect.teacher, Teacher::Truth);
        assert_eq!(load(Baseline::Macarons, &[]).unwrap().collect.teacher, Teacher::Own);
        let fails = |setting: &str| load(Baseline::Scone, &[setting]).unwrap_err().to_string();
        for (setting, named) in [
            ("train.rounds=0", "train.rounds is 0"),
            ("train.held_out=1.0", "train.held_out is 1"),
            ("nbv.draws=0", "nbv.draws is 0"),
            ("net.width=20", "net.width = 20"),
            ("collect.epsilon=2", "collect.epsilon is 2"),
            ("train.rouns=3", "rouns"),
            ("scenes=[]", "scenes is 0 sets"),
        ] {
            assert!(fails(setting).contains(named), "{}", fails(setting));
        }
    }
}
