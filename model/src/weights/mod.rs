//! Checkpoints: a folder with `model.safetensors` and `config.json`.
//!
//! Tensors are named and laid out as in the released PyTorch model, so files go both ways: [`import_pth`] reads its
//! weights, and `load_state_dict(strict=True)` takes ours. Names are in one place, `names.rs`.

mod file;
mod names;
mod precision;
mod tensors;

pub use file::write_atomic;
pub use precision::{Precision, UnknownPrecision};

use crate::config::{ARCHITECTURE, CheckpointConfig, ConfigError, InputScale, NetConfig, VERSION};
use crate::net::Nbp;
use burn::prelude::*;
use nbp_env::window::WindowSize;
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
        "{} holds a checkpoint from another architecture ({found}), not the {ARCHITECTURE} network: \
         check that it is the right file", path.display()
    )]
    Architecture {
        /// Which file.
        path: PathBuf,
        /// What it seems to be.
        found: String,
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
        "{} does not fit a network of base {base} with {in_channels} input channels ({difference}): \
         the weights and their {CONFIG_FILE} do not belong together", path.display()
    )]
    Tensors {
        /// Which file.
        path: PathBuf,
        /// Width of the network.
        base: usize,
        /// Channels of its input.
        in_channels: usize,
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
    fs::create_dir_all(dir).map_err(|source| WeightsError::Io { what: "create", path: dir.to_owned(), source })?;
    let write = |name, bytes: &[u8]| {
        let path = dir.join(name);
        write_atomic(&path, bytes).map_err(|source| WeightsError::Io { what: "write", path, source })
    };
    // Burn keeps the newest running statistics of a training network apart until `valid()` merges them.
    let tensors =
        precision.store(tensors::collect(&net.valid())).map_err(|tensor| WeightsError::Range { tensor, precision })?;
    let format = |reason| WeightsError::Format { path: dir.join(WEIGHTS_FILE), reason };
    write(WEIGHTS_FILE, &file::to_safetensors(&tensors).map_err(format)?)?;
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
    let path = dir.join(CONFIG_FILE);
    let bytes = read(&path)?;
    let config_error =
        |error: serde_json::Error| WeightsError::Config { path: path.clone(), reason: error.to_string() };
    // Architecture and version first: a newer layout may have fields that this program does not know.
    let raw: serde_json::Value = serde_json::from_slice(&bytes).map_err(config_error)?;
    match raw.get("architecture").and_then(serde_json::Value::as_str) {
        Some(ARCHITECTURE) => {}
        other => {
            let found = other.unwrap_or("it names none").to_owned();
            return Err(WeightsError::Architecture { path, found });
        }
    }
    let version = raw.get("version").and_then(serde_json::Value::as_u64).unwrap_or(0);
    if version > u64::from(VERSION) {
        return Err(WeightsError::Version { path, found: u32::try_from(version).unwrap_or(u32::MAX) });
    }
    let config: CheckpointConfig = serde_json::from_value(raw).map_err(config_error)?;
    config.net.check()?;
    Ok(config)
}

/// The checkpoint in a folder; pass an autodiff device to go on training it.
///
/// # Errors
/// When a file is missing, damaged, or does not fit the other.
pub fn load(dir: &Path, device: &Device) -> Result<Checkpoint, WeightsError> {
    let config = read_config(dir)?;
    let path = dir.join(WEIGHTS_FILE);
    let tensors =
        file::from_safetensors(&read(&path)?).map_err(|reason| WeightsError::Format { path: path.clone(), reason })?;
    let net = fill(&path, &config.net, tensors, device)?;
    Ok(Checkpoint { net, config })
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
    let foreign = |found: &str| WeightsError::Architecture { path: path.to_owned(), found: found.to_owned() };
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
    let difference = tensors::compare(&net, &tensors);
    let foreign = !tensors.contains_key(names::FIRST);
    match difference.is_empty() {
        true => Ok(tensors::apply(net, tensors)),
        false if foreign => Err(WeightsError::Architecture { path: path.to_owned(), found: difference.to_string() }),
        false => Err(WeightsError::Tensors {
            path: path.to_owned(),
            base: config.base,
            in_channels: config.in_channels,
            difference: difference.to_string(),
        }),
    }
}

#[cfg(test)]
mod tests;
