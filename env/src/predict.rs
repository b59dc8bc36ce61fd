//! The seam between geometry and the network: arrays in, arrays out.

use crate::pose::{HEADINGS, Heading, Lattice, LatticePose};
use crate::window::{VALUE_STRIDE, Window};
use std::sync::Arc;

/// What the network sees: `channels × S × S` counts, row-major, axes as in [`crate::window`].
///
/// Channels `0..K` are the densities of the `K` horizontal layers from low to high (points per pixel), the last is the trajectory
/// (visits per pixel); paper, section 4.1 and appendix B. With `encode.occupancy` the free and the occupied cells of the carved
/// plane lie between them (cells per pixel).
#[derive(Clone, Debug, PartialEq)]
pub struct EncoderInput {
    /// Where in the world this image lies.
    pub window: Window,
    /// `K + 1`, or `K + 3`.
    pub channels: usize,
    /// `channels · S · S` counts, saturating.
    pub counts: Vec<u16>,
}

impl EncoderInput {
    /// Side `S` in pixels.
    pub fn size(&self) -> usize {
        self.window.size.pixels
    }

    /// One channel, `S · S` counts.
    pub fn channel(&self, channel: usize) -> &[u16] {
        let area = self.size() * self.size();
        &self.counts[channel * area..(channel + 1) * area]
    }
}

/// Predicted coverage gain of walking to a pose, in percent points of the scene's surface; paper, `M` of section 4.1.
#[derive(Clone, Debug, PartialEq)]
pub struct ValueMap {
    /// Side in cells, `S / 4`.
    pub size: usize,
    /// `8 · size · size`, heading-major, then rows, then columns.
    pub gain: Vec<f32>,
}

impl ValueMap {
    /// Gain at a cell.
    pub fn at(&self, heading: Heading, row: usize, col: usize) -> f32 {
        self.gain[(heading.index() * self.size + row) * self.size + col]
    }

    /// Gain of a lattice pose as seen in `window`; `None` outside.
    pub fn of_pose(&self, window: &Window, lattice: &Lattice, pose: LatticePose) -> Option<f32> {
        let (row, col) = window.value_cell(lattice.position(pose.node))?;
        (row < self.size && col < self.size).then(|| self.at(pose.heading, row, col))
    }

    /// Whether the array has the size that its side and an input of side `pixels` ask for.
    pub fn is_consistent(&self, pixels: usize) -> bool {
        self.size * VALUE_STRIDE == pixels && self.gain.len() == HEADINGS * self.size * self.size
    }
}

/// Probability that a pixel of the camera plane is an obstacle; paper, `O` of section 4.1.
#[derive(Clone, Debug, PartialEq)]
pub struct ObstacleMap {
    /// Side `S` in pixels.
    pub size: usize,
    /// `S · S` probabilities, row-major.
    pub probability: Vec<f32>,
}

impl ObstacleMap {
    /// Probability at a pixel.
    pub fn at(&self, row: usize, col: usize) -> f32 {
        self.probability[row * self.size + col]
    }
}

/// The network's answer to one [`EncoderInput`].
#[derive(Clone, Debug, PartialEq)]
pub struct Prediction {
    /// Where a walk pays off.
    pub value: ValueMap,
    /// Where the walls are.
    pub obstacle: ObstacleMap,
}

/// Why a prediction could not be made.
#[derive(Debug, thiserror::Error)]
pub enum PredictError {
    /// The input does not fit the network.
    #[error("input {what} is {found}, the network wants {wanted}: use the window and layers it was trained with")]
    Shape {
        /// Which dimension.
        what: &'static str,
        /// As given.
        found: usize,
        /// As trained.
        wanted: usize,
    },
    /// The network answered with a number that is not finite.
    #[error("the network's {0} map has a value that is not finite: the checkpoint is damaged or has diverged")]
    NonFinite(&'static str),
    /// Anything else, from the back end.
    #[error("prediction failed: {0}")]
    Backend(String),
}

/// Anything that answers inputs with value and obstacle maps, a network or a stand-in for one.
pub trait Predictor: Send + Sync {
    /// One prediction for each input, in order.
    ///
    /// # Errors
    /// When an input does not fit or the back end fails.
    fn predict(&self, inputs: &[EncoderInput]) -> Result<Vec<Prediction>, PredictError>;
}

impl<P: Predictor + ?Sized> Predictor for Arc<P> {
    fn predict(&self, inputs: &[EncoderInput]) -> Result<Vec<Prediction>, PredictError> {
        (**self).predict(inputs)
    }
}
/// The value map of one predictor beside the obstacle map of another (paper, section 5.4: single-task networks).
pub struct Paired {
    /// Whose value maps count.
    pub value: Arc<dyn Predictor>,
    /// Whose obstacle maps count.
    pub obstacle: Arc<dyn Predictor>,
}

impl Predictor for Paired {
    fn predict(&self, inputs: &[EncoderInput]) -> Result<Vec<Prediction>, PredictError> {
        let pairs = self.value.predict(inputs)?.into_iter().zip(self.obstacle.predict(inputs)?);
        Ok(pairs.map(|(value, obstacle)| Prediction { value: value.value, obstacle: obstacle.obstacle }).collect())
    }
}
