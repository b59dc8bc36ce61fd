//! Loss, and precision of the obstacle map, on the samples that were kept out.

use crate::ahead::ahead;
use crate::memory::Memory;
use crate::step::{Learner, StepError, load};
use burn::module::Module as _;
use burn::tensor::Tensor;
use nbp_model::{Tasks, loss};
use serde::{Deserialize, Serialize};

/// Mean losses over the validation samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Validation {
    /// Mean squared error over all labelled cells, squared percent points.
    pub mse: f64,
    /// Mean binary cross-entropy over all pixels.
    pub bce: f64,
    /// Share of true obstacles among the pixels that are predicted to be one (paper, section 5.4), 0 to 1; 0 where none is.
    pub precision: f64,
    /// Share of the true obstacle pixels that are predicted, 0 to 1; 0 where there is none.
    pub recall: f64,
}

impl Validation {
    /// What the schedule watches: the losses of what is learnt, unweighted (released code).
    pub fn total(&self, tasks: Tasks) -> f64 {
        match tasks {
            Tasks::Both => self.mse + self.bce,
            Tasks::Value => self.mse,
            Tasks::Obstacle => self.bce,
        }
    }
}

/// Validates with running statistics and without a tape, obstacles from the probability `threshold` on; `None` where nothing
/// was kept out.
///
/// # Errors
/// When a sample cannot be read or a loss is not finite.
pub fn run(
    learner: &Learner,
    held_out: &Memory,
    batch: usize,
    threshold: f32,
) -> Result<Option<Validation>, StepError> {
    let net = learner.net.valid();
    let device = learner.device.clone().inner();
    let (mut mse, mut cells, mut bce, mut samples) = (0.0, 0.0, 0.0, 0.0);
    // Of a probability's logit, which is what the network answers.
    let threshold = (threshold / (1.0 - threshold)).ln();
    let mut pixels = Pixels::default();
    let all: Vec<usize> = (0..held_out.len()).collect();
    let prepare = |indices| load(held_out, indices, &learner.config, &device, None);
    ahead(all.chunks(batch), prepare, |batches| -> Result<(), StepError> {
        for batch in batches {
            let batch = batch?;
            let labelled = batch.targets.labelled as f64;
            let output = net.forward(batch.x_bchw.clone());
            pixels.count(&output.obstacle_b1hw, &batch.targets.obstacle_b1hw, threshold);
            let values = loss(&net, output, &batch.targets, Tasks::Both).values();
            mse += f64::from(values.mse) * labelled;
            cells += labelled;
            bce += f64::from(values.bce) * batch.len() as f64;
            samples += batch.len() as f64;
        }
        Ok(())
    })?;
    let mean = (samples > 0.0).then(|| Validation {
        mse: mse / f64::max(cells, 1.0),
        bce: bce / samples,
        precision: pixels.hits as f64 / pixels.predicted.max(1) as f64,
        recall: pixels.hits as f64 / pixels.obstacles.max(1) as f64,
    });
    match mean.filter(|validation| !validation.total(Tasks::Both).is_finite()) {
        Some(bad) => Err(StepError::NonFinite {
            tensor: "validation loss".into(),
            value: bad.total(Tasks::Both) as f32,
            step: learner.steps,
        }),
        None => Ok(mean),
    }
}

/// Pixels of the obstacle maps.
#[derive(Default)]
struct Pixels {
    predicted: usize,
    obstacles: usize,
    hits: usize,
}

impl Pixels {
    fn count(&mut self, logit_b1hw: &Tensor<4>, truth_b1hw: &Tensor<4>, threshold: f32) {
        let (logits, truth) = (logit_b1hw.to_data(), truth_b1hw.to_data());
        for (logit, truth) in logits.iter::<f32>().zip(truth.iter::<f32>()) {
            let (is_predicted, is_obstacle) = (logit >= threshold, truth > 0.5);
            self.predicted += usize::from(is_predicted);
            self.obstacles += usize::from(is_obstacle);
            self.hits += usize::from(is_predicted && is_obstacle);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::Device;

    #[test]
    fn precision_and_recall_are_of_pixels() {
        let of = |numbers: [f32; 6]| Tensor::<1>::from_floats(numbers, &Device::flex()).reshape([1, 1, 2, 3]);
        let mut pixels = Pixels::default();
        pixels.count(&of([2.0, 0.1, -0.1, -3.0, 0.5, -0.2]), &of([1.0, 0.0, 1.0, 0.0, 1.0, 1.0]), 0.0);
        assert_eq!((pixels.predicted, pixels.obstacles, pixels.hits), (3, 4, 2));
    }
}
