//! Loss on the samples that were kept out.

use crate::ahead::ahead;
use crate::memory::Memory;
use crate::step::{Learner, StepError, load};
use burn::module::Module as _;
use nbp_model::loss;
use serde::{Deserialize, Serialize};

/// Mean losses over the validation samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Validation {
    /// Mean squared error over all labelled cells, squared percent points.
    pub mse: f64,
    /// Mean binary cross-entropy over all pixels.
    pub bce: f64,
}

impl Validation {
    /// What the schedule watches: the two losses unweighted (released code).
    pub fn total(&self) -> f64 {
        self.mse + self.bce
    }
}

/// Validates with running statistics and without a tape; `None` where nothing was kept out.
///
/// # Errors
/// When a sample cannot be read or a loss is not finite.
pub fn run(learner: &Learner, held_out: &Memory, batch: usize) -> Result<Option<Validation>, StepError> {
    let net = learner.net.valid();
    let device = learner.device.clone().inner();
    let (mut mse, mut cells, mut bce, mut samples) = (0.0, 0.0, 0.0, 0.0);
    let all: Vec<usize> = (0..held_out.len()).collect();
    let prepare = |indices| load(held_out, indices, &learner.config, &device, None);
    ahead(all.chunks(batch), prepare, |batches| -> Result<(), StepError> {
        for batch in batches {
            let batch = batch?;
            let labelled = batch.targets.labelled as f64;
            let output = net.forward(batch.x_bchw.clone());
            let values = loss(&net, output, &batch.targets).values();
            mse += f64::from(values.mse) * labelled;
            cells += labelled;
            bce += f64::from(values.bce) * batch.len() as f64;
            samples += batch.len() as f64;
        }
        Ok(())
    })?;
    let mean = (samples > 0.0).then(|| Validation { mse: mse / f64::max(cells, 1.0), bce: bce / samples });
    match mean.filter(|validation| !validation.total().is_finite()) {
        Some(bad) => Err(StepError::NonFinite {
            tensor: "validation loss".into(),
            value: bad.total() as f32,
            step: learner.steps,
        }),
        None => Ok(mean),
    }
}
