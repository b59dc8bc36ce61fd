//! One step on samples of the baselines: both losses with weight 1, and a refusal to move on numbers that are not finite.

use super::progress::Losses;
use super::sample;
use crate::memory::{Memory, MemoryError};
use crate::step::non_finite_gradient;
use burn::optim::{GradientsAccumulator, GradientsParams, ModuleOptimizer};
use burn::prelude::*;
use nbp_env::nbv::{CandidateInput, NbvSample, OccupancyInput};
use nbp_env::{PredictError, SeedTree};
use nbp_model::scone::{Queries, Scone, Views, batch, loss};

/// Why a step was not made.
#[derive(Debug, thiserror::Error)]
pub enum LearnError {
    /// Samples cannot be read.
    #[error(transparent)]
    Memory(#[from] MemoryError),
    /// Samples do not fit the networks.
    #[error("a sample in the memory does not fit: {0}; train in another --run")]
    Sample(#[from] PredictError),
    /// Bytes that are no sample of the baselines.
    #[error("sample {0} of the memory is none of this recipe: train in another --run")]
    Foreign(usize),
    /// A loss or a gradient is NaN or infinite; the weights are as they were.
    #[error(
        "the {tensor} is {value} at step {step}: the weights were left as they are, and the last checkpoint is good. \
         Start another run (--run DIR) with a lower optim.lr"
    )]
    NonFinite {
        /// Which loss, or the gradient of which parameter.
        tensor: String,
        /// NaN or ±inf.
        value: f32,
        /// Steps of the optimiser before it.
        step: usize,
    },
}

/// Samples as tensors.
pub struct Batch {
    /// Clouds and queries, and which queries are solid.
    occupancy: Option<(Tensor<3>, Option<nbp_model::scone::Padding>, Queries, Tensor<1>)>,
    /// Candidates of all samples, their gains, and how many each sample has.
    views: Option<(Views, Vec<f32>, Vec<usize>)>,
}

impl Batch {
    /// Of some samples, in their order.
    ///
    /// # Errors
    /// When a sample does not fit together.
    pub fn new(samples: &[NbvSample], device: &Device) -> Result<Self, LearnError> {
        let asked = samples.iter().flat_map(|sample| sample.occupancy.iter().zip(&sample.solid));
        let asked = asked.filter(|(input, _)| !input.queries.is_empty());
        let (inputs, solid): (Vec<OccupancyInput>, Vec<&[f32]>) =
            asked.map(|(input, solid)| (input.clone(), &solid[..])).unzip();
        inputs.iter().try_for_each(batch::check_occupancy)?;
        let occupancy = (!inputs.is_empty()).then(|| {
            let clouds: Vec<&[[f32; 3]]> = inputs.iter().map(|input| &input.cloud[..]).collect();
            let (cloud_ln3, padding) = batch::clouds(&clouds, device);
            let all = inputs.iter().enumerate().flat_map(|(n, input)| (0..input.queries.len()).map(move |q| (n, n, q)));
            let all: Vec<(usize, usize, usize)> = all.collect();
            let solid = solid.concat();
            let count = solid.len();
            let solid_q = Tensor::from_data(TensorData::new(solid, [count]), device);
            (cloud_ln3, padding, batch::queries(&inputs, &all, device), solid_q)
        });

        let (mut candidates, mut gains, mut decisions) = (Vec::new(), Vec::new(), Vec::new());
        for sample in samples {
            // A camera before which nothing stands gains nothing, whatever the weights.
            let seen: Vec<(&CandidateInput, f32)> =
                sample.candidates.iter().zip(sample.gains.iter().copied()).collect();
            let seen: Vec<_> = seen.into_iter().filter(|(candidate, _)| !candidate.points.is_empty()).collect();
            if seen.len() > 1 && seen.iter().any(|&(_, gain)| gain > 0.0) {
                decisions.push(seen.len());
                candidates.extend(seen.iter().map(|&(candidate, _)| candidate));
                gains.extend(seen.iter().map(|&(_, gain)| gain));
            }
        }
        candidates.iter().try_for_each(|candidate| batch::check_candidate(candidate))?;
        let views = (!decisions.is_empty()).then(|| (batch::views(&candidates, device), gains, decisions));
        Ok(Self { occupancy, views })
    }

    /// Both losses, where there is something to compare.
    pub fn losses(&self, net: &Scone) -> [Option<Tensor<1>>; 2] {
        let occupancy = self.occupancy.as_ref().map(|(cloud_ln3, padding, queries, solid_q)| {
            let cloud_lg = net.occupancy.clouds(cloud_ln3.clone(), padding.as_ref());
            loss::occupancy(net.occupancy.forward(cloud_lg, queries.clone()), solid_q.clone())
        });
        let gains = self
            .views
            .as_ref()
            .and_then(|(views, wanted, decisions)| loss::gains(net.visibility.forward(views), wanted, decisions));
        [occupancy, gains]
    }
}

/// The samples of some numbers; with at most so many candidates of each, drawn by a seed, if there is a limit.
///
/// # Errors
/// When they cannot be read or are none.
pub fn load(
    memory: &Memory,
    indices: &[usize],
    limit: Option<(usize, SeedTree)>,
    device: &Device,
) -> Result<Batch, LearnError> {
    let read = |&index: &usize| {
        let mut sample = sample::unpack(&memory.bytes(index)?).ok_or(LearnError::Foreign(index))?;
        if let Some((most, seed)) = limit {
            thin(&mut sample, most, seed.child("sample", index as u64));
        }
        Ok(sample)
    };
    let samples = indices.iter().map(read).collect::<Result<Vec<NbvSample>, LearnError>>()?;
    Batch::new(&samples, device)
}

fn thin(sample: &mut NbvSample, most: usize, seed: SeedTree) {
    if sample.candidates.len() > most {
        let drawn = rand::seq::index::sample(&mut seed.rng(), sample.candidates.len(), most).into_vec();
        sample.candidates = drawn.iter().map(|&n| std::mem::take(&mut sample.candidates[n])).collect();
        sample.gains = drawn.iter().map(|&n| sample.gains[n]).collect();
    }
}

/// Means of what was found.
#[derive(Default)]
struct Means {
    sums: [f64; 2],
    counts: [usize; 2],
}

impl Means {
    fn losses(&self) -> Losses {
        let [occupancy, gains] = [0, 1].map(|n| self.sums[n] / self.counts[n].max(1) as f64);
        Losses { occupancy, gains }
    }
}

/// Networks in training.
pub struct Learner {
    /// Weights, on an autodiff device.
    pub net: Scone,
    /// Moments.
    pub optim: ModuleOptimizer,
    /// Where they live, with autodiff.
    pub device: Device,
    /// Steps made so far.
    pub steps: usize,
}

impl Learner {
    /// One step on the mean losses of `count` batches, each a forward pass of its own.
    ///
    /// # Errors
    /// When a batch cannot be made or a number is not finite; the weights do not move then.
    pub fn step(
        &mut self,
        batches: impl Iterator<Item = Result<Batch, LearnError>>,
        count: usize,
        lr: f64,
    ) -> Result<Losses, LearnError> {
        let (mut accumulator, mut means) = (GradientsAccumulator::new(), Means::default());
        let mut has_learnt = false;
        for batch in batches.take(count) {
            let losses = batch?.losses(&self.net);
            self.read(&losses, &mut means)?;
            let Some(total) = losses.into_iter().flatten().reduce(|a, b| a + b) else { continue };
            let gradients = total.mul_scalar(1.0 / count as f64).backward();
            accumulator.accumulate(&self.net, GradientsParams::from_grads(gradients, &self.net));
            has_learnt = true;
        }
        if has_learnt {
            let gradients = accumulator.grads();
            if let Some((name, value)) = non_finite_gradient(&self.net, &gradients) {
                return Err(self.non_finite(format!("gradient of {name}"), value));
            }
            self.net = self.optim.step(lr, self.net.clone(), gradients);
        }
        self.steps += 1;
        Ok(means.losses())
    }

    /// Mean losses of some networks on the same batches, without learning.
    ///
    /// # Errors
    /// When a batch cannot be made or a loss is not finite.
    pub fn validate(
        &self,
        nets: &[&Scone],
        batches: impl Iterator<Item = Result<Batch, LearnError>>,
    ) -> Result<Vec<Losses>, LearnError> {
        let mut means: Vec<Means> = nets.iter().map(|_| Means::default()).collect();
        for batch in batches {
            let batch = batch?;
            for (net, means) in nets.iter().zip(&mut means) {
                self.read(&batch.losses(net), means)?;
            }
        }
        Ok(means.iter().map(Means::losses).collect())
    }

    fn read(&self, losses: &[Option<Tensor<1>>; 2], means: &mut Means) -> Result<(), LearnError> {
        for (n, name) in ["occupancy loss", "loss of gains"].into_iter().enumerate() {
            let Some(loss) = &losses[n] else { continue };
            let value = loss.clone().detach().into_scalar::<f32>();
            if !value.is_finite() {
                return Err(self.non_finite(name.into(), value));
            }
            means.sums[n] += f64::from(value);
            means.counts[n] += 1;
        }
        Ok(())
    }

    fn non_finite(&self, tensor: String, value: f32) -> LearnError {
        LearnError::NonFinite { tensor, value, step: self.steps }
    }
}

#[cfg(test)]
mod tests {
    use super::super::sample::tests::sample;
    use super::*;
    use nbp_model::AdamW;
    use nbp_model::scone::SconeConfig;

    fn learner() -> Learner {
        let device = Device::flex().autodiff();
        let net = Scone::new(&SconeConfig { width: 16, ..SconeConfig::default() }, 1, &device).unwrap();
        Learner { net, optim: AdamW::default().init(), device, steps: 0 }
    }

    fn weights(learner: &Learner) -> Vec<u8> {
        learner.net.clone().into_record().into_bytes().unwrap().to_vec()
    }

    #[test]
    fn steps_go_downhill_and_whatever_is_missing_is_left_out() {
        let mut learner = learner();
        let batches = |learner: &Learner| {
            let all = [vec![sample(2, 4)], vec![sample(1, 0)], vec![sample(0, 3), sample(1, 6)], vec![]];
            all.map(|samples| Batch::new(&samples, &learner.device))
        };
        let first = learner.step(batches(&learner).into_iter(), 4, 2e-3).unwrap();
        assert!(first.occupancy > 0.0 && first.gains > 0.0);
        for _ in 0..20 {
            learner.step(batches(&learner).into_iter(), 4, 2e-3).unwrap();
        }
        let plain = learner.device.clone().without_autodiff();
        let (trained, fresh) = (learner.net.valid(), self::learner().net.valid());
        let found = learner.validate(&[&trained, &fresh], [Batch::new(&[sample(2, 4)], &plain)].into_iter()).unwrap();
        assert!(found[0].total() < first.total() && found[0].total() < found[1].total(), "{first:?} {found:?}");
        assert_eq!(learner.steps, 21);
    }

    #[test]
    fn thinned_samples_keep_candidates_with_their_gains() {
        let whole = sample(1, 9);
        let thinned = |seed| {
            let mut sample = whole.clone();
            thin(&mut sample, 4, SeedTree::new(seed));
            sample
        };
        let some = thinned(1);
        assert_eq!((some.candidates.len(), some.gains.len()), (4, 4));
        for (candidate, gain) in some.candidates.iter().zip(&some.gains) {
            assert_eq!(*candidate, whole.candidates[*gain as usize]);
        }
        assert!(some == thinned(1) && some.gains != thinned(2).gains);
        let mut few = whole.clone();
        thin(&mut few, 9, SeedTree::new(1));
        assert_eq!(few, whole);
    }

    #[test]
    fn numbers_that_are_none_do_not_move_the_weights() {
        let mut learner = learner();
        let before = weights(&learner);
        let mut broken = sample(1, 3);
        broken.solid[0][0] = f32::NAN;
        let batch = Batch::new(&[broken], &learner.device);
        let error = learner.step([batch].into_iter(), 1, 1e-3).unwrap_err().to_string();
        assert!(error.contains("occupancy loss is NaN at step 0"), "{error}");
        assert_eq!((weights(&learner), learner.steps), (before, 0));
        let mut broken = sample(1, 3);
        broken.candidates[2].weights.pop();
        let error = Batch::new(&[broken], &learner.device).err().unwrap().to_string();
        assert!(error.contains("6 directions and 5 weights"), "{error}");
    }
}
