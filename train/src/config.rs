//! The training configuration: TOML files stacked left to right, single settings on top.

use crate::scenes::ScenesConfig;
use nbp_env::goal::GoalRule;
use nbp_env::label::LabelKind;
use nbp_env::policy::nbp::NbpConfig;
use nbp_env::{Heading, SimConfig};
use nbp_infer::registry::PolicyKind;
use nbp_model::{AdamW, DeviceChoice, InputScale, NetConfig, Tasks};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Everything that decides what a run learns. The defaults are the paper's, for AiMDoom Simple.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Config {
    /// Root of every random stream.
    pub seed: u64,
    /// Where tensors live.
    pub device: DeviceChoice,
    /// Which maps.
    pub scenes: ScenesConfig,
    /// The simulator.
    pub sim: SimConfig,
    /// The network.
    pub net: NetSection,
    /// Gathering trajectories.
    pub collect: CollectConfig,
    /// Which samples are learnt from when.
    pub curriculum: CurriculumConfig,
    /// The optimiser.
    pub optim: AdamW,
    /// The loop.
    pub train: TrainConfig,
    /// Planning at inference, in validation rollouts and in the final table.
    pub policy: NbpConfig,
    /// The final table.
    pub eval: EvalSection,
}

impl Default for Config {
    fn default() -> Self {
        Self {
            seed: 1,
            device: DeviceChoice::Auto,
            scenes: ScenesConfig::default(),
            sim: SimConfig::default(),
            net: NetSection::default(),
            collect: CollectConfig::default(),
            curriculum: CurriculumConfig::default(),
            optim: AdamW::default(),
            train: TrainConfig::default(),
            policy: NbpConfig::default(),
            eval: EvalSection::default(),
        }
    }
}

/// Width of the network and scale of its input.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct NetSection {
    /// Channels of the first block (paper: 64).
    pub base: usize,
    /// `raw` counts (paper) or `log1p`.
    pub input_scale: InputScale,
}

impl Default for NetSection {
    fn default() -> Self {
        Self { base: 64, input_scale: InputScale::Raw }
    }
}

/// Gathering trajectories (paper, sections 4.2 and 4.3).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CollectConfig {
    /// Trajectories for each scene and iteration, `S_n` (paper: 2 in the first iteration, then 1).
    pub trajectories: usize,
    /// The same in the first iteration.
    pub first_trajectories: usize,
    /// Steps of a trajectory (released code: 100).
    pub steps: usize,
    /// A trajectory ends when so much of the surface is covered (released code: 0.95).
    pub enough: f32,
    /// Trajectories that are walked side by side and ask the network together; 1: each asks for itself. On the CPU the
    /// samples do not depend on it.
    pub batch: usize,
    /// Which poses of a path become labels of the others: `sub-paths` (paper), `goals` or `as-released`; or `looks` from everywhere.
    pub labels: LabelKind,
    /// With `labels = "looks"`: steps from one sample to the next.
    pub every: usize,
    /// How goals and headings are drawn (paper: Boltzmann; released code: β = 0.5 percent points).
    pub policy: NbpConfig,
}

impl Default for CollectConfig {
    fn default() -> Self {
        let policy = NbpConfig { goal: GoalRule::Boltzmann { beta: 0.5 }, ..NbpConfig::default() };
        Self {
            trajectories: 1,
            first_trajectories: 2,
            steps: 100,
            enough: 0.95,
            batch: 1,
            labels: LabelKind::SubPaths,
            every: 1,
            policy,
        }
    }
}

/// Easy samples first (paper, section 4.3, training strategy).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CurriculumConfig {
    /// Iterations that use easy samples only, `N_e`.
    pub easy_iterations: usize,
    /// First step of a trajectory that counts as easy (paper: 10).
    pub easy_step: usize,
}

impl Default for CurriculumConfig {
    fn default() -> Self {
        Self { easy_iterations: 1, easy_step: 10 }
    }
}

/// The loop.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrainConfig {
    /// Outer iterations, `N` (paper: at most 15).
    pub iterations: usize,
    /// Epochs over an iteration's set, `E` (released code: 5).
    pub epochs: usize,
    /// Samples of a forward pass (released code: 56).
    pub batch: usize,
    /// Forward passes for each step of the optimiser; effective batch = `batch · accumulate` (paper: 448 = 56 · 8).
    pub accumulate: usize,
    /// What is learnt: `both` maps in one network (paper), or only the `value` or the `obstacle` map.
    pub tasks: Tasks,
    /// The checkpoint whose weights are the first ones, `published` or a folder; drawn from the seed if left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub init: Option<PathBuf>,
    /// Make the answers of batch norm again on the way back instead of keeping them: a fifth less memory at no measurable
    /// time (128/32/8: 705 MiB instead of 890); same bits.
    pub gradient_checkpointing: bool,
    /// Turn and mirror every sample at random each time it is used (paper and released code: off).
    pub augment: bool,
    /// Samples of the first iteration that are kept out for validation (paper: 1,000).
    pub validation: usize,
    /// At most this share of the first iteration's samples.
    pub validation_share: f32,
    /// How the learning rate falls: `plateau` (released code), by the next two settings, or `cosine`, from `optim.lr` down to nothing at
    /// the end of the last iteration.
    pub schedule: Schedule,
    /// Learning rate × `plateau_factor` after `plateau_patience` epochs without a better validation loss.
    pub plateau_factor: f64,
    /// See `plateau_factor` (released code: 2).
    pub plateau_patience: usize,
    /// Stop after so many epochs without a better validation loss; 0: never.
    pub early_stop: usize,
    /// Save at least so often, minutes.
    pub checkpoint_minutes: f64,
}

impl Default for TrainConfig {
    fn default() -> Self {
        Self {
            iterations: 15,
            epochs: 5,
            batch: 56,
            accumulate: 8,
            tasks: Tasks::Both,
            init: None,
            gradient_checkpointing: true,
            augment: false,
            validation: 1000,
            validation_share: 0.1,
            schedule: Schedule::Plateau,
            plateau_factor: 0.1,
            plateau_patience: 2,
            early_stop: 25,
            checkpoint_minutes: 5.0,
        }
    }
}

/// How the learning rate falls.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Schedule {
    /// Where the validation loss does not fall any more.
    #[default]
    Plateau,
    /// As half a wave, over the whole run.
    Cosine,
}

/// The final table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EvalSection {
    /// Rows.
    pub policies: Vec<PolicyKind>,
    /// Steps of an episode (paper: 100, 200, 400, 500 from Simple to Insane).
    pub steps: usize,
    /// Start poses for each scene (paper: 5).
    pub starts: usize,
    /// One more row, `nbp-published`: the network that comes with the repository, with its own settings.
    pub published: bool,
}

impl Default for EvalSection {
    fn default() -> Self {
        Self {
            policies: vec![PolicyKind::Random, PolicyKind::Fbe, PolicyKind::Nbp],
            steps: 100,
            starts: 5,
            published: true,
        }
    }
}

/// Each of them has a thread and a map.
const MAX_BATCH: usize = 256;

/// A year.
pub(crate) const MAX_MINUTES: f64 = 525_600.0;

/// Why a configuration is refused.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The file system says no.
    #[error("cannot read the configuration {path}: {source}")]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// Not TOML.
    #[error("{origin} is not TOML: {reason}")]
    Syntax {
        /// File or command-line setting.
        origin: String,
        /// The parser's reason, with its line.
        reason: String,
    },
    /// TOML, but not this schema.
    #[error("the configuration ({origin}) is not valid: {reason}")]
    Schema {
        /// Files and settings.
        origin: String,
        /// The parser's reason.
        reason: String,
    },
    /// A number out of range.
    #[error("{field} is {value}: it must be {want}")]
    Range {
        /// Path of the setting.
        field: &'static str,
        /// As given.
        value: String,
        /// What is accepted.
        want: &'static str,
    },
}

impl Config {
    /// Stacks files left to right, then `path.to.key=value` settings.
    ///
    /// # Errors
    /// Naming the file or setting, the line and the key.
    pub fn load(files: &[PathBuf], settings: &[String]) -> Result<Self, ConfigError> {
        let config: Self = stack(files, settings)?;
        config.validate()?;
        Ok(config)
    }

    /// Checks every number.
    ///
    /// # Errors
    /// Naming the first setting that is out of range.
    pub fn validate(&self) -> Result<(), ConfigError> {
        let schema = |reason: String| ConfigError::Schema { origin: "checked values".into(), reason };
        self.sim.validate().map_err(|e| schema(e.to_string()))?;
        self.policy.validate().map_err(|e| schema(format!("policy: {e}")))?;
        self.collect.policy.validate().map_err(|e| schema(format!("collect.policy: {e}")))?;
        self.net_config().check().map_err(|e| schema(e.to_string()))?;
        for set in [&self.scenes.train, &self.scenes.held_out, &self.scenes.validation] {
            set.levels().map_err(|reason| schema(format!("scenes: {reason}")))?;
        }
        let train = &self.train;
        let is_share = |v: f32| (0.0..=1.0).contains(&v);
        let checks = [
            (train.iterations >= 1, "train.iterations", train.iterations.to_string(), "at least 1"),
            (train.epochs >= 1, "train.epochs", train.epochs.to_string(), "at least 1"),
            (train.batch >= 1, "train.batch", train.batch.to_string(), "at least 1"),
            (train.accumulate >= 1, "train.accumulate", train.accumulate.to_string(), "at least 1"),
            (
                is_share(train.validation_share),
                "train.validation_share",
                train.validation_share.to_string(),
                "from 0 to 1",
            ),
            (
                train.plateau_factor > 0.0 && train.plateau_factor <= 1.0,
                "train.plateau_factor",
                train.plateau_factor.to_string(),
                "above 0 and at most 1",
            ),
            (
                self.optim.lr > 0.0 && self.optim.lr.is_finite(),
                "optim.lr",
                self.optim.lr.to_string(),
                "a positive number",
            ),
            (
                self.collect.trajectories >= 1 && self.collect.first_trajectories >= 1,
                "collect.trajectories",
                format!("{} (first {})", self.collect.trajectories, self.collect.first_trajectories),
                "at least 1",
            ),
            (
                (1..=MAX_BATCH).contains(&self.collect.batch),
                "collect.batch",
                self.collect.batch.to_string(),
                "from 1 to 256",
            ),
            (self.collect.every >= 1, "collect.every", self.collect.every.to_string(), "at least 1"),
            (self.collect.steps >= 1, "collect.steps", self.collect.steps.to_string(), "at least 1"),
            (self.eval.steps >= 1, "eval.steps", self.eval.steps.to_string(), "at least 1"),
            (self.eval.starts >= 1, "eval.starts", self.eval.starts.to_string(), "at least 1"),
            (!self.eval.policies.is_empty(), "eval.policies", "empty".into(), "a list of policies"),
            (
                train.checkpoint_minutes > 0.0 && train.checkpoint_minutes <= MAX_MINUTES,
                "train.checkpoint_minutes",
                train.checkpoint_minutes.to_string(),
                "above 0 and at most a year",
            ),
            (
                train.validation_share < 1.0,
                "train.validation_share",
                train.validation_share.to_string(),
                "below 1: something must be left to learn from",
            ),
            (
                self.scenes.held_out.count >= 1 || !self.scenes.held_out.paths.is_empty(),
                "scenes.held_out",
                "empty".into(),
                "a count of generated maps or paths of scenes",
            ),
            (
                !self.scenes.validation.overlaps(&self.scenes.train)
                    && !self.scenes.validation.overlaps(&self.scenes.held_out),
                "scenes.validation.seed",
                self.scenes.validation.seed.to_string(),
                "chosen so that no validation map is a training or a held-out map",
            ),
            (
                !self.scenes.train.overlaps(&self.scenes.held_out),
                "scenes.held_out.seed",
                self.scenes.held_out.seed.to_string(),
                "chosen so that no held-out map is a training map",
            ),
            (
                self.scenes.train.count >= 1 || !self.scenes.train.paths.is_empty(),
                "scenes.train",
                "empty".into(),
                "a count of generated maps or paths of scenes",
            ),
        ];
        match checks.into_iter().find(|(ok, ..)| !ok) {
            Some((_, field, value, want)) => Err(ConfigError::Range { field, value, want }),
            None => Ok(()),
        }
    }

    /// The network that this configuration trains.
    pub fn net_config(&self) -> NetConfig {
        NetConfig {
            base: self.net.base,
            in_channels: self.sim.encode.channels(),
            headings: Heading::all().count(),
            input_scale: self.net.input_scale,
        }
    }

    /// As TOML, every setting spelled out.
    ///
    /// # Errors
    /// When a setting has no TOML form.
    pub fn to_toml(&self) -> Result<String, ConfigError> {
        to_toml(self)
    }

    /// Settings in which two configurations differ, as `key: here → there` lines.
    pub fn differences(&self, other: &Self) -> Vec<String> {
        differences(self, other)
    }
}

/// Files stacked left to right on the defaults of a configuration, then `path.to.key=value` settings.
pub(crate) fn stack<T: Default + Serialize + DeserializeOwned>(
    files: &[PathBuf],
    settings: &[String],
) -> Result<T, ConfigError> {
    // From the defaults, not from nothing: a file that names one key of a table leaves the others as they are.
    let mut whole = toml::Table::try_from(T::default())
        .map_err(|e| ConfigError::Schema { origin: "defaults".into(), reason: e.to_string() })?;
    for path in files {
        let text = std::fs::read_to_string(path).map_err(|source| ConfigError::Read { path: path.clone(), source })?;
        merge(&mut whole, parse(&text, &path.display().to_string())?);
    }
    for setting in settings {
        merge(&mut whole, parse_setting(setting)?);
    }
    let origins = files.iter().map(|p| p.display().to_string()).chain(settings.iter().cloned());
    let origin = origins.collect::<Vec<_>>().join(", ");
    whole.try_into().map_err(|e: toml::de::Error| ConfigError::Schema { origin, reason: e.to_string().trim().into() })
}

/// A configuration as TOML, every setting spelled out.
pub(crate) fn to_toml(config: &impl Serialize) -> Result<String, ConfigError> {
    toml::to_string_pretty(config)
        .map_err(|e| ConfigError::Schema { origin: "resolved configuration".into(), reason: e.to_string() })
}

/// Settings in which two configurations differ, as `key: here → there` lines.
pub(crate) fn differences<T: Serialize>(here: &T, there: &T) -> Vec<String> {
    let flat = |config: &T| {
        let mut lines = Vec::new();
        if let Ok(value) = toml::Value::try_from(config) {
            flatten("", &value, &mut lines);
        }
        lines.into_iter().collect::<std::collections::BTreeMap<_, _>>()
    };
    let (here, there) = (flat(here), flat(there));
    let keys: std::collections::BTreeSet<&String> = here.keys().chain(there.keys()).collect();
    let shown = |side: &std::collections::BTreeMap<String, String>, key: &String| {
        side.get(key).cloned().unwrap_or_else(|| "(none)".into())
    };
    keys.into_iter()
        .filter(|key| here.get(*key) != there.get(*key))
        .map(|key| format!("{key}: {} → {}", shown(&here, key), shown(&there, key)))
        .collect()
}

/// Name of a run for a stack of configuration files: their stems.
pub fn run_name(files: &[PathBuf]) -> String {
    let stem = |path: &PathBuf| path.file_stem().map(|s| s.to_string_lossy().into_owned());
    let stems: Vec<String> = files.iter().filter_map(stem).collect();
    if stems.is_empty() { "default".into() } else { stems.join("-") }
}

fn flatten(prefix: &str, value: &toml::Value, lines: &mut Vec<(String, String)>) {
    match value {
        toml::Value::Table(table) => {
            for (key, value) in table {
                flatten(&if prefix.is_empty() { key.clone() } else { format!("{prefix}.{key}") }, value, lines);
            }
        }
        value => lines.push((prefix.into(), value.to_string())),
    }
}

fn parse(text: &str, origin: &str) -> Result<toml::Table, ConfigError> {
    text.parse().map_err(|e: toml::de::Error| ConfigError::Syntax {
        origin: origin.into(),
        reason: e.to_string().trim().into(),
    })
}

/// `a.b=c`, where `c` is a TOML value or, failing that, a string.
fn parse_setting(setting: &str) -> Result<toml::Table, ConfigError> {
    let Some((key, value)) = setting.split_once('=') else {
        let reason = "write it as path.to.key=value".into();
        return Err(ConfigError::Syntax { origin: format!("--set {setting}"), reason });
    };
    parse(&format!("{key} = {value}"), setting).or_else(|_| {
        parse(&format!("{key} = {}", toml::Value::String(value.trim().into())), &format!("--set {setting}"))
    })
}

/// Tables merge key by key, everything else is replaced; so is a goal rule or an agent, whose keys depend on each other.
fn merge(base: &mut toml::Table, over: toml::Table) {
    for (key, value) in over {
        match (base.get_mut(&key), value) {
            (Some(toml::Value::Table(below)), toml::Value::Table(above))
                if !above.contains_key("rule") && !above.contains_key("kind") =>
            {
                merge(below, above)
            }
            (_, value) => {
                base.insert(key, value);
            }
        }
    }
}

/// Finds a configuration file given from any folder of the checkout: as named, or below `root`.
pub fn find(path: &Path, root: &Path) -> PathBuf {
    if path.exists() { path.to_path_buf() } else { root.join(path) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn load(texts: &[&str], settings: &[&str]) -> Result<Config, ConfigError> {
        let folder = tempfile::tempdir().unwrap();
        let files: Vec<PathBuf> = texts
            .iter()
            .enumerate()
            .map(|(n, text)| {
                let path = folder.path().join(format!("{n}.toml"));
                std::fs::write(&path, text).unwrap();
                path
            })
            .collect();
        Config::load(&files, &settings.iter().map(|s| (*s).to_string()).collect::<Vec<_>>())
    }

    #[test]
    fn later_files_and_settings_win_and_the_rest_stays() {
        let config = load(
            &["seed = 3\n[train]\nbatch = 4\nepochs = 2", "[train]\nbatch = 8"],
            &["optim.lr=3e-4", "net.input_scale=log1p", "collect.policy.goal={rule='greedy'}"],
        )
        .unwrap();
        assert_eq!((config.seed, config.train.batch, config.train.epochs, config.optim.lr), (3, 8, 2, 3e-4));
        assert_eq!(config.net.input_scale, InputScale::Log1p);
        assert_eq!(config.collect.policy.goal, GoalRule::Greedy);
        assert_eq!(config.train.iterations, TrainConfig::default().iterations);
        let partial = load(&["[scenes.held_out]\ncount = 3\n[collect.policy]\nrandom_heading = 0.5"], &[]).unwrap();
        assert_eq!(partial.scenes.held_out.seed, Config::default().scenes.held_out.seed);
        assert_eq!(partial.collect.policy.goal, GoalRule::Boltzmann { beta: 0.5 });
    }

    #[test]
    fn mistakes_are_named() {
        let message = |texts: &[&str], settings: &[&str]| load(texts, settings).unwrap_err().to_string();
        assert!(message(&["[train]\nbathc = 4"], &[]).contains("bathc"));
        assert!(message(&["seed = "], &[]).contains("0.toml"));
        assert!(message(&[], &["seed"]).contains("--set seed"));
        assert!(message(&[], &["train.batch=0"]).contains("train.batch is 0"));
        assert!(message(&[], &["train.checkpoint_minutes=inf"]).contains("checkpoint_minutes"));
        assert!(message(&[], &["scenes.held_out.seed=5"]).contains("no held-out map"));
        let validation = ["scenes.validation.count=4", "scenes.validation.level=mixed", "scenes.validation.seed=60"];
        assert!(message(&[], &validation).contains("scenes.validation.seed is 60"));
        assert!(load(&[], &[&validation[..], &["scenes.train.level=hard", "scenes.train.count=50"]].concat()).is_ok());
        assert!(message(&[], &["scenes.train.level=mixt"]).contains("mixt"));
        assert!(message(&[], &["policy.blocking_pixels=0"]).contains("blocking_pixels"));
        assert!(message(&[], &["sim.encode.window.pixels=100"]).contains("window.pixels"));
        assert!(Config::load(&["nowhere.toml".into()], &[]).unwrap_err().to_string().contains("nowhere.toml"));
    }

    #[test]
    fn resolved_configurations_read_back_and_differences_are_listed() {
        let config = Config::default();
        let again: Config = toml::from_str(&config.to_toml().unwrap()).unwrap();
        assert_eq!(config, again);
        let mut other = config.clone();
        other.train.batch = 9;
        assert_eq!(config.differences(&other), ["train.batch: 56 → 9"]);
    }
}
