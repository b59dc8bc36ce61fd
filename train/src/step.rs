//! One step of the optimiser: forward, loss, backward, and a refusal to move on numbers that are not finite.

use crate::augment::Symmetry;
use crate::memory::{Memory, MemoryError};
use burn::module::{Module, ModuleVisitor, Param};
use burn::optim::{GradientsAccumulator, GradientsParams, ModuleOptimizer};
use burn::tensor::{Device, Tensor};
use nbp_env::SeedTree;
use nbp_env::label::Sample;
use nbp_model::{Batch, LossValues, Nbp, NetConfig, SampleRef, Tasks, TensorizeError, loss};

/// Why a step was not made.
#[derive(Debug, thiserror::Error)]
pub enum StepError {
    /// Samples cannot be read.
    #[error(transparent)]
    Memory(#[from] MemoryError),
    /// Samples do not fit the network.
    #[error(transparent)]
    Tensorize(#[from] TensorizeError),
    /// A loss or a gradient is NaN or infinite; the weights are as they were.
    #[error(
        "the {tensor} is {value} at step {step}: the weights were left as they are, and the last checkpoint is good. \
         Start another run (--run DIR) with a lower optim.lr; net.input_scale=\"log1p\" tames large counts"
    )]
    NonFinite {
        /// Which term, or the gradient of which parameter.
        tensor: String,
        /// NaN or ±inf.
        value: f32,
        /// Steps of the optimiser before it.
        step: usize,
    },
    /// A step on part of its samples would be another step.
    #[error("only {found} of the {wanted} batches of step {step} were made: the weights were left as they are")]
    Missing {
        /// Batches that came.
        found: usize,
        /// Batches of the step.
        wanted: usize,
        /// Steps of the optimiser before it.
        step: usize,
    },
}

/// The network in training.
pub struct Learner {
    /// Weights, on an autodiff device.
    pub net: Nbp,
    /// Moments.
    pub optim: ModuleOptimizer,
    /// Shape of the network.
    pub config: NetConfig,
    /// Where it lives, with autodiff.
    pub device: Device,
    /// Steps made so far.
    pub steps: usize,
}

impl Learner {
    /// One step on the mean loss of `tasks` over `count` batches, each a forward pass of its own.
    ///
    /// # Errors
    /// When samples cannot be read, batches are missing or the loss is not finite; the weights do not move then.
    pub fn step(
        &mut self,
        mut batches: impl Iterator<Item = Result<Batch, StepError>>,
        count: usize,
        tasks: Tasks,
        lr: f64,
    ) -> Result<LossValues, StepError> {
        let mut accumulator = GradientsAccumulator::new();
        let mut mean = LossValues { total: 0.0, mse: 0.0, bce: 0.0, sigma: [0.0; 2] };
        let share = 1.0 / count.max(1) as f32;
        for found in 0..count {
            let missing = StepError::Missing { found, wanted: count, step: self.steps };
            let batch = batches.next().ok_or(missing)??;
            let output = self.net.forward(batch.x_bchw.clone());
            let losses = loss(&self.net, output, &batch.targets, tasks);
            let values = losses.values();
            self.refuse_non_finite(&values)?;
            let gradients = losses.total.mul_scalar(share).backward();
            accumulator.accumulate(&self.net, GradientsParams::from_grads(gradients, &self.net));
            mean.total += share * values.total;
            mean.mse += share * values.mse;
            mean.bce += share * values.bce;
            mean.sigma = values.sigma;
        }
        let gradients = accumulator.grads();
        self.refuse_non_finite_gradients(&gradients)?;
        self.net = self.optim.step(lr, self.net.clone(), gradients);
        self.steps += 1;
        Ok(mean)
    }

    fn refuse_non_finite_gradients(&self, gradients: &GradientsParams) -> Result<(), StepError> {
        match non_finite_gradient(&self.net, gradients) {
            Some((name, value)) => {
                Err(StepError::NonFinite { tensor: format!("gradient of {name}"), value, step: self.steps })
            }
            None => Ok(()),
        }
    }

    fn refuse_non_finite(&self, values: &LossValues) -> Result<(), StepError> {
        let [value_sigma, obstacle_sigma] = values.sigma;
        let terms = [
            ("value loss (masked MSE)", values.mse),
            ("obstacle loss (BCE)", values.bce),
            ("weight σ of the value loss", value_sigma),
            ("weight σ of the obstacle loss", obstacle_sigma),
            ("total loss", values.total),
        ];
        match terms.into_iter().find(|(_, value)| !value.is_finite()) {
            Some((tensor, value)) => Err(StepError::NonFinite { tensor: tensor.into(), value, step: self.steps }),
            None => Ok(()),
        }
    }
}

/// The first parameter, by its path, whose gradient has a number that is not finite, and what the sum of them comes to.
pub(crate) fn non_finite_gradient(net: &impl Module, gradients: &GradientsParams) -> Option<(String, f32)> {
    let mut sums = GradientSums { gradients, path: Vec::new(), names: Vec::new(), sums: Vec::new() };
    net.visit(&mut sums);
    // One read-back for all of them.
    let values: Vec<f32> = Tensor::cat(sums.sums, 0).into_data().iter().collect();
    sums.names.into_iter().zip(values).find(|(_, value)| !value.is_finite())
}

/// Sums of the absolute gradients of all parameters, by their paths.
struct GradientSums<'a> {
    gradients: &'a GradientsParams,
    path: Vec<String>,
    names: Vec<String>,
    sums: Vec<Tensor<1>>,
}

impl ModuleVisitor for GradientSums<'_> {
    fn enter_module(&mut self, name: &str, _: &str) {
        self.path.push(name.into());
    }

    fn exit_module(&mut self, _: &str, _: &str) {
        self.path.pop();
    }

    fn visit_float<const D: usize>(&mut self, parameter: &Param<Tensor<D>>) {
        if let Some(gradient) = self.gradients.get::<D>(parameter.id) {
            self.names.push(self.path.join("."));
            self.sums.push(gradient.abs().sum());
        }
    }
}

/// Reads samples into one batch, each turned or mirrored by chance if there is a seed for it.
///
/// # Errors
/// When they cannot be read or do not fit the network.
pub fn load(
    memory: &Memory,
    indices: &[usize],
    config: &NetConfig,
    device: &Device,
    augment: Option<SeedTree>,
) -> Result<Batch, StepError> {
    let mut samples: Vec<Sample> = indices.iter().map(|&index| memory.get(index)).collect::<Result<_, _>>()?;
    if let Some(seed) = augment {
        for (sample, &index) in samples.iter_mut().zip(indices) {
            let symmetry = seed.child("sample", index as u64).key() % 8;
            *sample = Symmetry::new(symmetry as usize).apply(sample);
        }
    }
    let parts: Vec<SampleRef<'_>> = samples
        .iter()
        .map(|sample| SampleRef { input: &sample.input, labels: &sample.labels, obstacle: &sample.obstacles })
        .collect();
    Ok(Batch::new(&parts, config, device)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nbp_env::EncoderInput;
    use nbp_env::window::{Window, WindowSize};
    use nbp_model::AdamW;

    fn batch(config: &NetConfig, device: &Device) -> Batch {
        let window = Window { size: WindowSize { pixels: 32, metres: 20.0 }, centre: [0, 0], height: 0.0 };
        let counts = (0..config.in_channels as u16 * 32 * 32).map(|n| n % 7).collect();
        let input = EncoderInput { window, channels: config.in_channels, counts };
        let sample = SampleRef { input: &input, labels: &[], obstacle: &[1; 32 * 32] };
        Batch::new(&[sample], config, device).unwrap()
    }

    #[test]
    fn a_step_on_part_of_its_batches_is_not_made() {
        let (config, device) = (NetConfig { base: 2, ..NetConfig::default() }, Device::flex().autodiff());
        let net = Nbp::new(&config, 1, &device).unwrap();
        let mut learner = Learner { net, optim: AdamW::default().init(), config, device, steps: 0 };
        let weights = |learner: &Learner| learner.net.clone().into_record().into_bytes().unwrap().to_vec();
        let before = weights(&learner);
        let made = |count| (0..count).map(|_| Ok(batch(&config, &learner.device))).collect::<Vec<_>>();
        let (one, two) = (made(1), made(2));
        let error = learner.step(one.into_iter(), 2, Tasks::Both, 1e-3).unwrap_err().to_string();
        assert!(error.contains("only 1 of the 2 batches of step 0"), "{error}");
        assert_eq!((learner.steps, weights(&learner)), (0, before.clone()));
        learner.step(two.into_iter(), 2, Tasks::Both, 1e-3).unwrap();
        assert!(learner.steps == 1 && weights(&learner) != before);
    }

    #[test]
    fn what_is_not_learnt_stays() {
        let (config, device) = (NetConfig { base: 2, ..NetConfig::default() }, Device::flex().autodiff());
        let net = Nbp::new(&config, 1, &device).unwrap();
        let mut learner = Learner { net, optim: AdamW::default().init(), config, device, steps: 0 };
        let parameters = |learner: &Learner| {
            let mut found = Parameters::default();
            learner.net.visit(&mut found);
            found.all
        };
        let before = parameters(&learner);
        learner.step(vec![Ok(batch(&config, &learner.device))].into_iter(), 1, Tasks::Obstacle, 1e-3).unwrap();
        let after = parameters(&learner);
        let moved =
            |part: &str| before.iter().filter(|(name, v)| name.starts_with(part) && after[*name] != **v).count();
        assert!(moved("encoder") > 0 && moved("obstacle") > 0, "{:?}", before.keys());
        assert_eq!(moved("value"), 0);
    }

    #[derive(Default)]
    struct Parameters {
        path: Vec<String>,
        all: std::collections::BTreeMap<String, Vec<f32>>,
    }

    impl ModuleVisitor for Parameters {
        fn enter_module(&mut self, name: &str, _: &str) {
            self.path.push(name.into());
        }

        fn exit_module(&mut self, _: &str, _: &str) {
            self.path.pop();
        }

        fn visit_float<const D: usize>(&mut self, parameter: &Param<Tensor<D>>) {
            self.all.insert(self.path.join("."), parameter.val().into_data().iter().collect());
        }
    }
}
