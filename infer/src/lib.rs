//! Policies at work: from a checkpoint and scenes to episodes, tables and pictures.
//!
//! Data flows one way: `checkpoint + source → registry → rollout → eval | bench → table | export | picture | plot`. Nothing here
//! trains, and nothing here knows a tensor: networks answer behind [`nbp_env::Predictor`].

pub mod checkpoint;
pub mod source;

pub mod registry;
pub mod rollout;
pub mod rounds;

pub mod bench;
pub mod decisions;
pub mod eval;
pub mod journal;
mod seal;
pub mod speed;

pub mod export;
pub mod picture;
pub mod plot;
pub mod report;
pub mod table;

pub use checkpoint::Settings;
pub use eval::EvalConfig;
pub use registry::{PolicyContext, PolicyKind};
pub use rollout::{EpisodeRecord, Trial};
pub use table::SummaryRow;
