//! Many policies on many data sets: cells that are computed in any order by any number of programs, and the tables of them.

pub mod floor;
pub mod store;

pub use floor::{FloorPlan, Tile};
pub use store::{BenchError, BenchResult, Manifest, SceneInfo, SetResult};
