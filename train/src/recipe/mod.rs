//! Training of the next-best-view baselines: `train --recipe scone` on the truth, `--recipe macarons` on what the agent itself
//! saw. The networks, the loop and the number of steps are the same.
//!
//! A round is a walk through every map with the networks as they are ([`collect`]), steps on what the last rounds remember
//! ([`learner`]), and the loss on maps that are kept out. What makes a run one that can be interrupted, its log, memory and
//! checkpoints, is shared with Algorithm 1.

pub mod collect;
pub mod config;
pub mod learner;
pub mod progress;
pub mod run;
pub mod sample;

pub use config::RecipeConfig;
pub use run::{Session, train};
