//! Checkpoints: a folder written aside, checksummed, then moved into place, so that a crash leaves the old or the new.

use crate::clock::Spent;
use crate::plateau::Plateau;
use crate::step::Learner;
use crate::validate::Validation;
use crate::walk::Walks;
use burn::module::Module;
use burn::optim::ModuleOptimizer;
use burn::store::ModuleRecord;
use burn::tensor::{Bytes, Device};
use nbp_model::{AdamW, CheckpointConfig, Nbp, NetConfig, WeightsError, weights};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Deserializer, Serialize};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

const STATE_FILE: &str = "state.json";
const RECORD_FILE: &str = "training.bpk";
const OPTIMISER_FILE: &str = "optimiser.bpk";

/// Where in the loop a run stands.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Progress {
    /// Iteration being worked on.
    pub iteration: usize,
    /// Whether its trajectories are in the memory.
    pub collected: bool,
    /// Epoch of the iteration.
    pub epoch: usize,
    /// Optimiser steps of the epoch already made.
    pub step_of_epoch: usize,
    /// Optimiser steps in all.
    pub steps: usize,
    /// Samples in the memory.
    pub memory: usize,
    /// Samples kept out.
    pub held_out: usize,
    /// Learning rate and its history.
    pub plateau: Plateau,
    /// The last validation.
    pub validation: Option<Validation>,
    /// The learning curve, where there are validation maps.
    #[serde(default)]
    pub curve: Vec<Walks>,
    /// Seconds of work so far, by what they were spent on.
    #[serde(alias = "seconds", deserialize_with = "spent")]
    pub spent: Spent,
    /// All iterations are done, or the training stopped early.
    pub done: bool,
}

impl Progress {
    /// Before the first step.
    pub fn new(lr: f64) -> Self {
        Self {
            iteration: 0,
            collected: false,
            epoch: 0,
            step_of_epoch: 0,
            steps: 0,
            memory: 0,
            held_out: 0,
            plateau: Plateau::new(lr),
            validation: None,
            curve: Vec::new(),
            spent: Spent::default(),
            done: false,
        }
    }
}

/// Checkpoints once told `seconds` alone.
fn spent<'de, D: Deserializer<'de>>(from: D) -> Result<Spent, D::Error> {
    #[derive(Deserialize)]
    #[serde(untagged)]
    enum Told {
        Seconds(f64),
        Parts(Spent),
    }
    Ok(match Told::deserialize(from)? {
        Told::Seconds(wall) => Spent { wall, ..Spent::default() },
        Told::Parts(spent) => spent,
    })
}

/// `state.json`: progress, and what the other files must be.
#[derive(Serialize, Deserialize)]
struct State<P> {
    progress: P,
    crc32: BTreeMap<String, u32>,
}

/// Why a checkpoint cannot be written or read.
#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    /// The file system says no.
    #[error("checkpoint {path}: {source}")]
    Io {
        /// File or folder.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A file does not check.
    #[error(
        "checkpoint {path} is damaged ({reason}): delete its folder to fall back on checkpoints/best, or start a new --run"
    )]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What does not fit.
        reason: String,
    },
    /// Weights cannot be written or read.
    #[error(transparent)]
    Weights(#[from] WeightsError),
}

/// Folder of the checkpoint that a run resumes from.
pub fn last(run: &Path) -> PathBuf {
    run.join("checkpoints/last")
}

/// Folder of the checkpoint with the best validation loss.
pub fn best(run: &Path) -> PathBuf {
    run.join("checkpoints/best")
}

/// Saves into `folder`, replacing what is there only once all is written.
///
/// # Errors
/// When the disk refuses; an older checkpoint stays.
pub fn save(
    folder: &Path,
    learner: &Learner,
    progress: &Progress,
    describe: &CheckpointConfig,
) -> Result<(), CheckpointError> {
    let publish = |aside: &Path| weights::save(aside, &learner.net, describe);
    replace(folder, publish, &learner.net, &learner.optim, progress)
}

/// Replaces a checkpoint by another one of any network; `publish` writes the files that other programs read.
///
/// # Errors
/// As [`save`].
pub fn replace(
    folder: &Path,
    publish: impl FnOnce(&Path) -> Result<(), WeightsError>,
    net: &impl Module,
    optim: &ModuleOptimizer,
    progress: &impl Serialize,
) -> Result<(), CheckpointError> {
    let aside = sibling(folder, "new");
    remove(&aside)?;
    fs::create_dir_all(&aside).map_err(|e| io(&aside, e))?;
    publish(&aside)?;
    let damaged = |name: &str, e: &dyn std::fmt::Display| CheckpointError::Damaged {
        path: aside.join(name),
        reason: e.to_string(),
    };
    let record = net.clone().into_record().into_bytes().map_err(|e| damaged(RECORD_FILE, &e))?;
    let moments = optim.into_bytes().map_err(|e| damaged(OPTIMISER_FILE, &e))?;
    let mut crc32 = BTreeMap::new();
    for (name, bytes) in [(RECORD_FILE, &record[..]), (OPTIMISER_FILE, &moments[..])] {
        weights::write_atomic(&aside.join(name), bytes).map_err(|e| io(&aside.join(name), e))?;
        crc32.insert(name.to_string(), crc32fast::hash(bytes));
    }
    let state = State { progress, crc32 };
    let text = serde_json::to_vec_pretty(&state).map_err(|e| damaged(STATE_FILE, &e))?;
    weights::write_atomic(&aside.join(STATE_FILE), &text).map_err(|e| io(&aside, e))?;
    let old = sibling(folder, "old");
    remove(&old)?;
    if folder.exists() {
        fs::rename(folder, &old).map_err(|e| io(folder, e))?;
    }
    fs::rename(&aside, folder).map_err(|e| io(folder, e))?;
    remove(&old)
}

/// Puts back the older checkpoint if a crash came between the two moves of [`save`]; tells whether there is one now.
///
/// # Errors
/// When the disk refuses.
pub fn recover(folder: &Path) -> Result<bool, CheckpointError> {
    let (aside, old) = (sibling(folder, "new"), sibling(folder, "old"));
    if !folder.exists() {
        // Everything in `new` was on the disk before `folder` was moved away.
        let whole = if old.exists() && aside.join(STATE_FILE).exists() { &aside } else { &old };
        if whole.exists() {
            fs::rename(whole, folder).map_err(|e| io(folder, e))?;
        }
    }
    remove(&aside)?;
    remove(&old)?;
    Ok(folder.exists())
}

/// Loads network, moments and progress.
///
/// # Errors
/// When a file is missing or damaged, or belongs to another network.
pub fn load(
    folder: &Path,
    config: &NetConfig,
    optim: &AdamW,
    device: &Device,
) -> Result<(Learner, Progress), CheckpointError> {
    let damaged = |reason: String| CheckpointError::Damaged { path: folder.join(RECORD_FILE), reason };
    let blank = Nbp::new(config, 0, device).map_err(|e| damaged(e.to_string()))?;
    let (net, optim, progress) = restore::<_, Progress>(folder, blank, optim)?;
    let learner = Learner { net, optim, config: *config, device: device.clone(), steps: progress.steps };
    Ok((learner, progress))
}

/// The network, moments and progress that [`replace`] left; `blank` is a network of the same shape.
///
/// # Errors
/// As [`load`].
pub fn restore<M: Module, P: DeserializeOwned>(
    folder: &Path,
    blank: M,
    optim: &AdamW,
) -> Result<(M, ModuleOptimizer, P), CheckpointError> {
    let read = |name: &str| fs::read(folder.join(name)).map_err(|e| io(&folder.join(name), e));
    let damaged = |name: &str, reason: String| CheckpointError::Damaged { path: folder.join(name), reason };
    let state: State<P> = serde_json::from_slice(&read(STATE_FILE)?).map_err(|e| damaged(STATE_FILE, e.to_string()))?;
    let checked = |name: &str| {
        let bytes = read(name)?;
        match state.crc32.get(name) {
            Some(&crc) if crc == crc32fast::hash(&bytes) => Ok(Bytes::from_bytes_vec(bytes)),
            _ => Err(damaged(name, "its checksum differs".into())),
        }
    };
    let record = ModuleRecord::from_bytes(checked(RECORD_FILE)?).map_err(|e| damaged(RECORD_FILE, e.to_string()))?;
    let net =
        blank.try_load_record(record).map_err(|e| damaged(RECORD_FILE, format!("it is of another network: {e}")))?;
    let optim =
        optim.init().from_bytes(checked(OPTIMISER_FILE)?).map_err(|e| damaged(OPTIMISER_FILE, e.to_string()))?;
    Ok((net, optim, state.progress))
}

fn sibling(folder: &Path, suffix: &str) -> PathBuf {
    let name = folder.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
    folder.with_file_name(format!("{name}.{suffix}"))
}

fn remove(folder: &Path) -> Result<(), CheckpointError> {
    match fs::remove_dir_all(folder) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(io(folder, e)),
        _ => Ok(()),
    }
}

fn io(path: &Path, source: std::io::Error) -> CheckpointError {
    CheckpointError::Io { path: path.to_path_buf(), source }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seconds_of_old_checkpoints_are_kept() {
        let old = r#"{
            "progress": {
                "iteration": 2, "collected": true, "epoch": 1, "step_of_epoch": 3, "steps": 40, "memory": 700,
                "held_out": 70, "plateau": { "lr": 0.001, "best": null, "since_best": 0, "since_decay": 0 },
                "validation": null, "seconds": 12.25, "done": false
            },
            "crc32": {}
        }"#;
        let progress = serde_json::from_str::<State<Progress>>(old).unwrap().progress;
        assert_eq!(progress.spent, Spent { wall: 12.25, ..Spent::default() });
        assert_eq!(progress.spent.tell(2), "training took 12 s");
        let spent = Spent { network: 3.0, ..progress.spent };
        let text = serde_json::to_string(&Progress { spent, ..progress }).unwrap();
        assert_eq!(serde_json::from_str::<Progress>(&text).unwrap().spent, spent);
    }
}
