//! `oracle-obstacles`: a predictor whose obstacle map is the true one (paper, section 5.3, Table 4).

use crate::predict::{EncoderInput, ObstacleMap, PredictError, Prediction, Predictor};
use crate::world::World;
use std::sync::Arc;

/// Wraps a predictor and replaces its obstacle maps by the ground truth of one world.
pub struct OracleObstacles<P> {
    inner: P,
    world: Arc<World>,
}

impl<P> OracleObstacles<P> {
    /// Answers for inputs of `world`.
    pub fn new(inner: P, world: Arc<World>) -> Self {
        Self { inner, world }
    }
}

impl<P: Predictor> Predictor for OracleObstacles<P> {
    fn predict(&self, inputs: &[EncoderInput]) -> Result<Vec<Prediction>, PredictError> {
        let predictions = self.inner.predict(inputs)?.into_iter().zip(inputs);
        Ok(predictions
            .map(|(prediction, input)| {
                let truth = self.world.obstacles().crop(&input.window);
                let probability = truth.into_iter().map(f32::from).collect();
                Prediction { obstacle: ObstacleMap { size: input.size(), probability }, ..prediction }
            })
            .collect())
    }
}
