//! Many policies on many data sets: cells that are computed in any order by any number of programs, and the tables of them.
//!
//! Data flows one way: `config → plan → run → store → summary → tables`.

pub mod config;
pub mod limits;
pub mod plan;

pub mod floor;
pub mod store;

pub mod run;
pub mod summary;
pub mod tables;

pub use floor::{FloorPlan, Tile};
pub use store::{BenchError, BenchResult, Manifest, SceneInfo, SetResult};
