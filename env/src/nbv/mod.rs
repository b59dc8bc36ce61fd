//! Next-best-view baselines, SCONE (Guédon et al., NeurIPS 2022) and MACARONS (Guédon et al., CVPR 2023): all but their networks.
//!
//! Points drawn once in the scene's box, the proxies, remember from where they were looked at . One network
//! says how likely each is solid, from the cloud around it; a second one how much of it a candidate camera would see.
//! Both answer behind [`NbvPredictor`]; the policy walks to the candidate of the highest gain.
//!
//! **View frame.** Everything a network is given is turned into the frame of the current camera: `x` to the left, `y` up, `z`
//! along the optical axis (the world turned about the vertical by minus the camera's azimuth).

pub mod belief;
pub mod cells;
pub mod config;
pub mod field;
pub mod harmonics;
pub mod label;
pub mod neighbours;

pub use belief::Belief;
pub use config::{NbvConfig, NbvConfigError};
pub use field::Field;
pub use harmonics::{Harmonics, harmonics_at};
pub use label::{CollectConfig, NbvSample, Teacher, collect_samples};

use crate::predict::PredictError;
use std::sync::Arc;

/// Neighbours of a query at each scale.
pub const NEIGHBOURS: usize = 16;

/// Scales at which neighbours are sought, each in a thinner cloud than the one before.
pub const SCALES: usize = 3;

/// Spherical harmonics of degrees 0 to 7 that describe from where a proxy was looked at.
pub const HARMONICS: usize = 64;

/// The cloud around one cell, and the proxies of that cell that are asked about. View frame, origin in the middle of the
/// cell, in units of three times the cell's diagonal.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OccupancyInput {
    /// Points drawn from the cell and its eight neighbours: [`NbvConfig::cloud_points`], always. Where there are fewer, they
    /// repeat from the first on.
    pub cloud: Vec<[f32; 3]>,
    /// `Q` proxies.
    pub queries: Vec<[f32; 3]>,
    /// `Q` times: from the query to its nearest different points of the cloud, nearest first, at each scale.
    pub offsets: Vec<[[[f32; 3]; NEIGHBOURS]; SCALES]>,
    /// `Q` times: from where the query was looked at.
    pub harmonics: Vec<[f32; HARMONICS]>,
}

/// One candidate camera: proxies drawn in its frustum, each once. View frame of the current camera, origin in the middle of
/// the box of the points, in units of the diagonal of the scene's box.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CandidateInput {
    /// `D` proxies, 0 to [`NbvConfig::draws`]: `x`, `y`, `z` and the probability of being solid.
    pub points: Vec<[f32; 4]>,
    /// `D` times: from where the proxy was looked at; zeros for one that was in no frustum yet.
    pub harmonics: Vec<[f32; HARMONICS]>,
    /// `D` unit vectors from the proxy to the candidate camera.
    pub directions: Vec<[f32; 3]>,
    /// `D` shares of the draws that fell on the proxy, times what its distance leaves of its worth.
    pub weights: Vec<f32>,
    /// Sum of the probabilities in the frustum.
    pub mass: f32,
}

/// The two networks, or a stand-in for them.
pub trait NbvPredictor: Send + Sync {
    /// For each input the probability that each of its queries is solid, `Q` numbers.
    ///
    /// # Errors
    /// When an input does not fit, an answer is not finite, or the back end fails.
    fn occupancy(&self, inputs: &[OccupancyInput]) -> Result<Vec<Vec<f32>>, PredictError>;

    /// The expected gain of each candidate, `mass · Σᵢ weightsᵢ · visibilityᵢ`; 0 for one without points.
    ///
    /// # Errors
    /// As [`NbvPredictor::occupancy`].
    fn gains(&self, candidates: &[CandidateInput]) -> Result<Vec<f32>, PredictError>;
}

impl<P: NbvPredictor + ?Sized> NbvPredictor for Arc<P> {
    fn occupancy(&self, inputs: &[OccupancyInput]) -> Result<Vec<Vec<f32>>, PredictError> {
        (**self).occupancy(inputs)
    }

    fn gains(&self, candidates: &[CandidateInput]) -> Result<Vec<f32>, PredictError> {
        (**self).gains(candidates)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// A network's stand-in: half of everything is solid, and a camera sees all that is in its frustum.
    pub(crate) struct Mass;

    impl NbvPredictor for Mass {
        fn occupancy(&self, inputs: &[OccupancyInput]) -> Result<Vec<Vec<f32>>, PredictError> {
            Ok(inputs.iter().map(|input| vec![0.5; input.queries.len()]).collect())
        }

        fn gains(&self, candidates: &[CandidateInput]) -> Result<Vec<f32>, PredictError> {
            Ok(candidates.iter().map(|candidate| candidate.mass * candidate.weights.iter().sum::<f32>()).collect())
        }
    }
}
