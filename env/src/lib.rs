//! Geometry and the task of active mapping: everything that needs no network.
//!
//! Data flows one way: `scene → sensor → map → encode → (Predictor) → goal → path → episode → coverage → label`.
//! Units are metres and radians, `y` is up; see [`pose`] for headings and [`window`] for image axes.

pub mod pose;
pub mod seed;
pub mod window;

pub mod scene;
pub mod sensor;

pub mod completion;
pub mod coverage;
pub mod encode;
pub mod map;
pub mod nbv;
pub mod predict;

pub mod goal;
pub mod path;
pub mod policy;

pub mod batch;
pub mod check;
pub mod config;
pub mod episode;
pub mod explain;
pub mod label;
pub mod metrics;
pub mod motion;
pub mod noise;
pub mod parallel;
pub mod pilot;
pub mod ply;
pub mod visibility;
pub mod visible;
pub mod world;

pub use config::SimConfig;
pub use episode::{Action, Episode};
pub use map::MapView;
pub use motion::{Agent, Motion, MotionConfig};
pub use policy::Policy;
pub use pose::{Direction, Heading, Lattice, LatticePose, Node, Pose};
pub use predict::{EncoderInput, ObstacleMap, PredictError, Prediction, Predictor, ValueMap};
pub use scene::Scene;
pub use seed::{Rng, SeedTree};
pub use window::Window;
pub use world::World;
