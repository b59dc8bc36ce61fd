//! The NextBestPath network on Burn: `tensorize → net → loss`, and the [`NetPredictor`] behind the seam of `nbp_env`.
//!
//! Everything geometric lives in `nbp_env`, which knows no tensor; here live tensors, weights and devices.

#[cfg(test)]
mod agreement;
pub mod config;
pub mod device;
pub mod fast;
pub mod loss;
pub mod net;
pub mod optim;
pub mod predictor;
pub mod scone;
pub mod tensorize;
pub mod weights;

pub use config::{CheckpointConfig, InputScale, NetConfig};
pub use device::{DeviceChoice, DeviceError, device_name};
pub use loss::{LossValues, Losses, Targets, Tasks, loss};
pub use net::{Nbp, NetOutput};
pub use optim::AdamW;
pub use predictor::NetPredictor;
pub use tensorize::{Batch, SampleRef, TensorizeError};
pub use weights::{Checkpoint, WeightsError};
