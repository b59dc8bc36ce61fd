//! Where a baseline's run stands, as its checkpoints keep it.

use serde::{Deserialize, Serialize};

/// Mean losses over the samples of the maps that are kept out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Losses {
    /// Mean squared error of occupancy.
    pub occupancy: f64,
    /// Uncentred L1 of gains.
    pub gains: f64,
}

impl Losses {
    /// The two with weight 1, as in training.
    pub fn total(&self) -> f64 {
        self.occupancy + self.gains
    }
}

/// Where in the loop a run stands.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Progress {
    /// Round being worked on.
    pub round: usize,
    /// Whether its samples are in the memory.
    pub collected: bool,
    /// Steps of the round already made.
    pub step_of_round: usize,
    /// Steps in all.
    pub steps: usize,
    /// Samples in the memory.
    pub memory: usize,
    /// Samples of the maps that are kept out.
    pub held_out: usize,
    /// Losses of the best networks so far, when they were made.
    pub best: Option<Losses>,
    /// Seconds of work so far.
    pub seconds: f64,
    /// All rounds are done.
    pub done: bool,
}
