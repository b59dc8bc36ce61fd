//! Checkpoints of the next-best-view baselines: the same two files, tensors under the paths of our modules.
//!
//! A linear layer's weight is `[in, out]`, transposed to PyTorch's.

use super::{WeightsError, read_description, read_tensors, tensors, write};
use crate::config::VERSION;
use crate::scone::{Scone, SconeConfig};
use burn::prelude::*;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use std::fmt;
use std::path::Path;

/// Which baseline was trained: the networks are the same, what they learnt from is not.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Baseline {
    /// On ground truth.
    Scone,
    /// On its own observations.
    Macarons,
}

impl Baseline {
    /// Name of the architecture in `config.json`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Scone => "scone",
            Self::Macarons => "macarons",
        }
    }

    /// The baseline of that name.
    pub fn named(name: &str) -> Option<Self> {
        [Self::Scone, Self::Macarons].into_iter().find(|baseline| baseline.name() == name)
    }
}

impl fmt::Display for Baseline {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// The `config.json` of a baseline's checkpoint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SconeDescription {
    /// Which of them.
    pub architecture: Baseline,
    /// [`VERSION`].
    pub version: u32,
    /// Widths of the networks.
    pub net: SconeConfig,
    /// What other packages want to remember (settings of the simulator and of the policy); not read here.
    #[serde(default, skip_serializing_if = "Map::is_empty")]
    pub meta: Map<String, Value>,
}

impl SconeDescription {
    /// A checkpoint without notes.
    pub fn new(architecture: Baseline, net: SconeConfig) -> Self {
        Self { architecture, version: VERSION, net, meta: Map::new() }
    }
}

/// The networks of a baseline and what is needed to use them.
#[derive(Debug)]
pub struct SconeCheckpoint {
    /// The networks, on the device that they were loaded to.
    pub net: Scone,
    /// Their description.
    pub config: SconeDescription,
}

/// Writes a checkpoint into a folder, which is made if need be; each file is replaced as a whole.
///
/// # Errors
/// When the folder cannot be written to.
pub fn save(dir: &Path, net: &Scone, config: &SconeDescription) -> Result<(), WeightsError> {
    write(dir, &tensors::collect(&net.valid(), str::to_owned), config)
}

/// The description in a checkpoint's folder.
///
/// # Errors
/// When it is not there or not one of a baseline.
pub fn read_config(dir: &Path) -> Result<SconeDescription, WeightsError> {
    let architectures = [Baseline::Scone, Baseline::Macarons].map(Baseline::name);
    let (path, raw) = read_description(dir, "scone or macarons", &architectures)?;
    let config: SconeDescription =
        serde_json::from_value(raw).map_err(|error| WeightsError::Config { path, reason: error.to_string() })?;
    config.net.check()?;
    Ok(config)
}

/// The checkpoint in a folder; pass an autodiff device to go on training it.
///
/// # Errors
/// When a file is missing, damaged, or does not fit the other.
pub fn load(dir: &Path, device: &Device) -> Result<SconeCheckpoint, WeightsError> {
    let config = read_config(dir)?;
    let (path, tensors) = read_tensors(dir)?;
    let net = Scone::blank(&config.net, device)?;
    let difference = tensors::compare(&net, str::to_owned, &tensors);
    if !difference.is_empty() {
        let described = format!("{} networks of width {}", config.architecture, config.net.width);
        return Err(WeightsError::Tensors { path, described, difference: difference.to_string() });
    }
    Ok(SconeCheckpoint { net: tensors::apply(net, str::to_owned, tensors), config })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{CheckpointConfig, NetConfig};
    use crate::net::Nbp;
    use crate::weights::{self, CONFIG_FILE, WEIGHTS_FILE};
    use nbp_env::window::WindowSize;
    use std::fs;

    fn small() -> (Scone, SconeDescription) {
        let net = SconeConfig { width: 16, ..SconeConfig::default() };
        let config = SconeDescription::new(Baseline::Macarons, net);
        (Scone::new(&net, 3, &Device::flex()).unwrap(), config)
    }

    #[test]
    fn weights_come_back_bit_for_bit_with_their_notes() {
        let dir = tempfile::tempdir().unwrap();
        let (net, mut config) = small();
        config.meta.insert("nbv".into(), serde_json::json!({"carving": 5.0}));
        save(dir.path(), &net, &config).unwrap();
        assert_eq!(weights::architecture(dir.path()).unwrap(), "macarons");
        let first = fs::read(dir.path().join(WEIGHTS_FILE)).unwrap();
        let loaded = load(dir.path(), &Device::flex().autodiff()).unwrap();
        assert_eq!(loaded.config, config);
        save(dir.path(), &loaded.net, &config).unwrap();
        assert_eq!(first, fs::read(dir.path().join(WEIGHTS_FILE)).unwrap());
        let other = Scone::new(&config.net, 4, &Device::flex()).unwrap();
        save(dir.path(), &other, &config).unwrap();
        assert_ne!(first, fs::read(dir.path().join(WEIGHTS_FILE)).unwrap());
    }

    #[test]
    fn damage_and_other_networks_are_explained() {
        let dir = tempfile::tempdir().unwrap();
        let (net, config) = small();
        save(dir.path(), &net, &config).unwrap();
        let nbp = weights::load(dir.path(), &Device::flex()).unwrap_err().to_string();
        assert!(nbp.contains("another architecture (macarons), not the nbp network"), "{nbp}");
        let fails = |what: &str| {
            let error = load(dir.path(), &Device::flex()).unwrap_err().to_string();
            assert!(error.contains(what), "{error}");
        };
        let (weights, json) = (dir.path().join(WEIGHTS_FILE), dir.path().join(CONFIG_FILE));
        let (good_weights, good_json) = (fs::read(&weights).unwrap(), fs::read_to_string(&json).unwrap());
        fs::write(&weights, &good_weights[..good_weights.len() / 2]).unwrap();
        fails("cut short");
        fs::write(&weights, good_weights).unwrap();
        for (from, to, what) in [
            ("\"width\": 16", "\"width\": 32", "macarons networks of width 32"),
            ("\"width\": 16", "\"width\": 17", "net.width = 17"),
            ("\"macarons\"", "\"unet\"", "another architecture (unet), not the scone or macarons network"),
            ("\"version\": 1", "\"version\": 9", "version 9"),
            ("\"net\"", "\"nets\"", "unknown field `nets`"),
        ] {
            assert!(good_json.contains(from), "{good_json}");
            fs::write(&json, good_json.replace(from, to)).unwrap();
            fails(what);
        }

        let net = NetConfig { base: 2, ..NetConfig::default() };
        let described = CheckpointConfig::new(net, WindowSize { pixels: 32, metres: 20.0 });
        weights::save(dir.path(), &Nbp::new(&net, 1, &Device::flex()).unwrap(), &described).unwrap();
        fails("another architecture (nbp), not the scone or macarons network");
    }
}
