//! Checkpoints: a folder with `model.safetensors` and `config.json`.
//!
//! Tensors of the NextBestPath network are named and laid out as in the released PyTorch model, so files go both ways:
//! [`import_pth`] reads its weights, and `load_state_dict(strict=True)` takes ours. Names are in one place, `names.rs`. Those
//! of the baselines ([`scone`]) have our own names.

mod file;
mod names;
mod precision;
pub mod scone;
mod tensors;

pub use file::{create_temporary, write_atomic};
pub use precision::{Precision, UnknownPrecision};

use crate::config::{ARCHITECTURE, CheckpointConfig, ConfigError, InputScale, NetConfig, VERSION};
use crate::net::Nbp;
use burn::prelude::*;
use nbp_env::window::WindowSize;
use serde::Serialize;
use serde_json::Value;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use tensors::Tensors;

/// Name of the weights in a checkpoint's folder.
pub const WEIGHTS_FILE: &str = "model.safetensors";
/// Name of the description in a checkpoint's folder.
pub const CONFIG_FILE: &str = "config.json";

/// A network and what is needed to use it.
#[derive(Debug)]
pub struct Checkpoint {
    /// The network, on the device that it was loaded to.
    pub net: Nbp,
    /// Its description.
    pub config: CheckpointConfig,
}

/// Weights that cannot be written or read.
#[derive(Debug, thiserror::Error)]
pub enum WeightsError {
    /// The disk said no.
    #[error("cannot {what} {}: {source}", path.display())]
    Io {
        /// Read, write or create.
        what: &'static str,
        /// Which file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// `config.json` is not one of ours.
    #[error("{} is not a checkpoint's description: {reason}", path.display())]
    Config {
        /// Which file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// A network of another kind.
    #[error(
        "{} holds a checkpoint from another architecture ({found}), not the {wanted} network: \
         check that it is the right file", path.display()
    )]
    Architecture {
        /// Which file.
        path: PathBuf,
        /// What it seems to be.
        found: String,
        /// What it should be.
        wanted: &'static str,
    },
    /// A checkpoint written by a newer program.
    #[error("{} has layout version {found}, this program reads up to {VERSION}: update the program", path.display())]
    Version {
        /// Which file.
        path: PathBuf,
        /// As written.
        found: u32,
    },
    /// The file is damaged or of another format.
    #[error("cannot make sense of {}: {reason}; it may be cut short, copy it again", path.display())]
    Format {
        /// Which file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// The right kind of network, but not the one described.
    #[error(
        "{} does not fit {described} ({difference}): the weights and their {CONFIG_FILE} do not belong together",
        path.display()
    )]
    Tensors {
        /// Which file.
        path: PathBuf,
        /// The network that its description asks for.
        described: String,
        /// What is missing, unknown or of another shape.
        difference: String,
    },
    /// Weights too large for the precision asked for.
    #[error("{tensor} has numbers too large for {precision}: use bf16 or f32")]
    Range {
        /// Released name of the first such tensor.
        tensor: String,
        /// As asked for.
        precision: Precision,
    },
    /// The description cannot be built.
    #[error(transparent)]
    Net(#[from] ConfigError),
}

/// Writes a checkpoint into a folder, which is made if need be; each file is replaced as a whole.
///
/// # Errors
/// When the folder cannot be written to.
pub fn save(dir: &Path, net: &Nbp, config: &CheckpointConfig) -> Result<(), WeightsError> {
    save_as(dir, net, config, Precision::F32)
}

/// [`save`] with weights of another precision, half the size; it loads as any other.
///
/// # Errors
/// When the folder cannot be written to, or a weight does not fit.
pub fn save_as(dir: &Path, net: &Nbp, config: &CheckpointConfig, precision: Precision) -> Result<(), WeightsError> {
    // Burn keeps the newest running statistics of a training network apart until `valid()` merges them.
    let tensors = tensors::collect(&net.valid(), names::naming);
    let tensors = precision.store(tensors).map_err(|tensor| WeightsError::Range { tensor, precision })?;
    write(dir, &tensors, config)
}

fn write(dir: &Path, tensors: &Tensors, config: &impl Serialize) -> Result<(), WeightsError> {
    fs::create_dir_all(dir).map_err(|source| WeightsError::Io { what: "create", path: dir.to_owned(), source })?;
    let write = |name, bytes: &[u8]| {
        let path = dir.join(name);
        write_atomic(&path, bytes).map_err(|source| WeightsError::Io { what: "write", path, source })
    };
    let format = |reason| WeightsError::Format { path: dir.join(WEIGHTS_FILE), reason };
    write(WEIGHTS_FILE, &file::to_safetensors(tensors).map_err(format)?)?;
    let mut json = serde_json::to_string_pretty(config)
        .map_err(|error| WeightsError::Config { path: dir.join(CONFIG_FILE), reason: error.to_string() })?;
    json.push('\n');
    write(CONFIG_FILE, json.as_bytes())
}

/// The description in a checkpoint's folder.
///
/// # Errors
/// When it is not there or not one of ours.
pub fn read_config(dir: &Path) -> Result<CheckpointConfig, WeightsError> {
    let (path, raw) = read_description(dir, ARCHITECTURE, &[ARCHITECTURE])?;
    let config: CheckpointConfig =
        serde_json::from_value(raw).map_err(|error| WeightsError::Config { path, reason: error.to_string() })?;
    config.net.check()?;
    Ok(config)
}

/// The architecture that a checkpoint's folder says it holds.
///
/// # Errors
/// When there is no description or it names none.
pub fn architecture(dir: &Path) -> Result<String, WeightsError> {
    let (path, raw) = raw_description(dir)?;
    let reason = || "it names no architecture".to_owned();
    let named = raw.get("architecture").and_then(Value::as_str).map(str::to_owned);
    named.ok_or_else(|| WeightsError::Config { path, reason: reason() })
}

fn raw_description(dir: &Path) -> Result<(PathBuf, Value), WeightsError> {
    let path = dir.join(CONFIG_FILE);
    let raw = serde_json::from_slice(&read(&path)?);
    match raw {
        Ok(raw) => Ok((path, raw)),
        Err(error) => Err(WeightsError::Config { path, reason: error.to_string() }),
    }
}

/// Checks architecture and version first: a newer layout may have fields that this program does not know.
fn read_description(
    dir: &Path,
    wanted: &'static str,
    architectures: &[&str],
) -> Result<(PathBuf, Value), WeightsError> {
    let (path, raw) = raw_description(dir)?;
    let found = raw.get("architecture").and_then(Value::as_str).unwrap_or("it names none");
    if !architectures.contains(&found) {
        return Err(WeightsError::Architecture { path, found: found.to_owned(), wanted });
    }
    let version = raw.get("version").and_then(Value::as_u64).unwrap_or(0);
    if version > u64::from(VERSION) {
        return Err(WeightsError::Version { path, found: u32::try_from(version).unwrap_or(u32::MAX) });
    }
    Ok((path, raw))
}

/// The checkpoint in a folder; pass an autodiff device to go on training it.
///
/// # Errors
/// When a file is missing, damaged, or does not fit the other.
pub fn load(dir: &Path, device: &Device) -> Result<Checkpoint, WeightsError> {
    let config = read_config(dir)?;
    let (path, tensors) = read_tensors(dir)?;
    let net = fill(&path, &config.net, tensors, device)?;
    Ok(Checkpoint { net, config })
}

fn read_tensors(dir: &Path) -> Result<(PathBuf, Tensors), WeightsError> {
    let path = dir.join(WEIGHTS_FILE);
    match file::from_safetensors(&read(&path)?) {
        Ok(tensors) => Ok((path, tensors)),
        Err(reason) => Err(WeightsError::Format { path, reason }),
    }
}

/// A `.pth` file of the released code; width and channels follow from its shapes, counts go in raw.
///
/// # Errors
/// When the file is not a PyTorch file or holds another network.
pub fn import_pth(path: &Path, window: WindowSize, device: &Device) -> Result<Checkpoint, WeightsError> {
    if let Err(source) = fs::File::open(path) {
        return Err(WeightsError::Io { what: "read", path: path.to_owned(), source });
    }
    let tensors = file::from_pytorch(path).map_err(|reason| WeightsError::Format { path: path.to_owned(), reason })?;
    let foreign = |found: &str| WeightsError::Architecture {
        path: path.to_owned(),
        found: found.to_owned(),
        wanted: ARCHITECTURE,
    };
    let first = tensors.get(names::FIRST).ok_or_else(|| foreign("it has no tensor Conv1.conv.0.weight"))?;
    let &[base, in_channels, 3, 3] = first.shape().as_slice() else {
        return Err(foreign("its first convolution is not 3 × 3"));
    };
    let net = NetConfig { base, in_channels, input_scale: InputScale::Raw, ..NetConfig::default() };
    let config = CheckpointConfig::new(net, window);
    Ok(Checkpoint { net: fill(path, &config.net, tensors, device)?, config })
}

fn read(path: &Path) -> Result<Vec<u8>, WeightsError> {
    fs::read(path).map_err(|source| WeightsError::Io { what: "read", path: path.to_owned(), source })
}

fn fill(path: &Path, config: &NetConfig, tensors: Tensors, device: &Device) -> Result<Nbp, WeightsError> {
    let net = Nbp::blank(config, device)?;
    let difference = tensors::compare(&net, names::naming, &tensors);
    let foreign = !tensors.contains_key(names::FIRST);
    let path = path.to_owned();
    match difference.is_empty() {
        true => Ok(tensors::apply(net, names::naming, tensors)),
        false if foreign => {
            Err(WeightsError::Architecture { path, found: difference.to_string(), wanted: ARCHITECTURE })
        }
        false => {
            let described = format!("a network of base {} with {} input channels", config.base, config.in_channels);
            Err(WeightsError::Tensors { path, described, difference: difference.to_string() })
        }
    }
}

#[cfg(test)]
mod tests;
