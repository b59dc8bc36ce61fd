//! Geometry and the task of active mapping: everything that needs no network.
//!
//! Data flows one way: `scene → sensor → map → encode → (Predictor) → goal → path → episode → coverage → label`.
//! Units are metres and radians, `y` is up; see [`pose`] for headings and [`window`] for image axes.

pub mod pose;
pub mod predict;
pub mod seed;
pub mod window;

pub use pose::{Direction, Heading, Lattice, LatticePose, Node, Pose};
pub use predict::{EncoderInput, ObstacleMap, PredictError, Prediction, Predictor, ValueMap};
pub use window::Window;
