//! SCONE's two networks (Guédon et al., 2022), which MACARONS (Guédon et al., 2023) trains on its own observations: from the
//! cloud to the occupancy of points, from occupied points to what a camera would see of them.
//!
//! Shape suffixes: `b` batch of point sets, `n` points, `e` features, `h` heads, `q` queries, `l` clouds, `k` harmonics.

pub mod attention;
pub mod batch;
pub mod config;
pub mod layers;
pub mod loss;
pub mod occupancy;
pub mod predictor;
#[cfg(test)]
mod tests;
pub mod visibility;

pub use config::SconeConfig;
pub use layers::Padding;
pub use occupancy::{Queries, SconeOcc};
pub use predictor::SconePredictor;
pub use visibility::{SconeVis, Views};

use crate::config::ConfigError;
use crate::net::init::Init;
use burn::prelude::*;

/// Both networks.
#[derive(Module, Debug)]
pub struct Scone {
    /// From the cloud to the occupancy of points.
    pub occupancy: SconeOcc,
    /// From occupied points to what a camera sees of them.
    pub visibility: SconeVis,
}

impl Scone {
    /// Fresh networks; the same seed gives the same weights on every device.
    ///
    /// # Errors
    /// When a width is out of range.
    pub fn new(config: &SconeConfig, seed: u64, device: &Device) -> Result<Self, ConfigError> {
        Self::build(config, &Init::seeded(seed, device))
    }

    /// Networks whose weights are zero, to load others into.
    pub(crate) fn blank(config: &SconeConfig, device: &Device) -> Result<Self, ConfigError> {
        Self::build(config, &Init::zeros(device))
    }

    fn build(config: &SconeConfig, init: &Init<'_>) -> Result<Self, ConfigError> {
        config.check()?;
        Ok(Self {
            occupancy: SconeOcc::new(config, &init.of("occupancy")),
            visibility: SconeVis::new(config, &init.of("visibility")),
        })
    }
}
