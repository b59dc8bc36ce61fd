//! Algorithm 1 of the paper: collect with the current model, remember, train on new and replayed samples, repeat.
//!
//! [`run`] is the loop; everything else is one of its verbs: [`scenes`] → [`collect`] → [`memory`] → [`curriculum`] →
//! [`step`] → [`validate`] → [`walk`] → [`checkpoint`], seen through [`log`].

pub mod config;
pub mod scenes;

pub mod collect;
pub mod curriculum;
pub mod memory;

pub mod ahead;
pub mod augment;
pub mod plateau;
pub mod step;
pub mod validate;
pub mod walk;

pub mod recipe;

pub mod checkpoint;
pub mod clock;
pub mod folder;
pub mod interrupt;
pub mod log;
pub mod report;
pub mod run;
