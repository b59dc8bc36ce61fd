//! Batch normalisation with PyTorch's running statistics.
//!
//! Burn's own layer keeps the biased variance of a batch, PyTorch (and so the released weights) the unbiased one; that
//! is the only difference, and it matters where a batch has few pixels for each channel.

use super::init::Init;
use crate::fast;
use burn::module::{Param, RunningState};
use burn::prelude::*;
use burn::tensor::activation::relu;
use burn::tensor::module::{batch_norm, batch_norm_train};

/// Added to the variance.
pub(crate) const EPSILON: f64 = 1e-5;
/// Weight of the newest batch in the running statistics.
const MOMENTUM: f64 = 0.1;

/// Normalises each channel over batch, rows and columns, then scales and shifts it.
///
/// It uses the batch's statistics, and updates the running ones, if its input lives on an autodiff device, and the
/// running ones otherwise.
#[derive(Module, Debug)]
pub struct Norm {
    /// `[c]`, scale.
    pub weight: Param<Tensor<1>>,
    /// `[c]`, shift.
    pub bias: Param<Tensor<1>>,
    /// `[c]`, shared by clones of the module; `valid()` makes a copy.
    pub running_mean: RunningState<Tensor<1>>,
    /// `[c]`, unbiased.
    pub running_var: RunningState<Tensor<1>>,
}

impl Norm {
    pub(crate) fn new(channels: usize, init: &Init<'_>) -> Self {
        let device = init.device();
        Self {
            weight: Param::from_tensor(Tensor::ones([channels], device)),
            bias: Param::from_tensor(Tensor::zeros([channels], device)),
            running_mean: RunningState::new(Tensor::zeros([channels], device)),
            running_var: RunningState::new(Tensor::ones([channels], device)),
        }
    }

    /// # Shapes
    /// `[b, c, h, w]` → `[b, c, h, w]`.
    pub fn forward(&self, x_bchw: Tensor<4>) -> Tensor<4> {
        self.apply(x_bchw, false)
    }

    /// [`Self::forward`], then ReLU.
    pub fn forward_relu(&self, x_bchw: Tensor<4>) -> Tensor<4> {
        self.apply(x_bchw, true)
    }

    /// Scale, shift, mean and variance for inference.
    pub(crate) fn channels(&self) -> [Tensor<1>; 4] {
        [self.weight.val(), self.bias.val(), self.running_mean.value(), self.running_var.value()]
    }

    fn apply(&self, x_bchw: Tensor<4>, with_relu: bool) -> Tensor<4> {
        let (weight, bias) = (self.weight.val(), self.bias.val());
        let rectify = |y_bchw| if with_relu { relu(y_bchw) } else { y_bchw };
        if !x_bchw.device().is_autodiff() {
            return fast::norm(&x_bchw, self.channels(), EPSILON, with_relu).unwrap_or_else(|| {
                let [weight, bias, mean, var] = self.channels();
                rectify(batch_norm(x_bchw, weight, bias, mean, var, EPSILON))
            });
        }
        let [b, _, h, w] = x_bchw.dims();
        let (y_bchw, mean, var) = match fast::norm_train(&x_bchw, &weight, &bias, EPSILON, with_relu) {
            Some(normed) => (normed.y_bchw, normed.mean, normed.var),
            None => {
                let result = batch_norm_train(x_bchw, weight, bias, EPSILON);
                (rectify(result.output), result.mean, result.variance)
            }
        };
        self.observe(mean.detach(), var.detach(), b * h * w);
        y_bchw
    }

    /// Moves the running statistics towards those of a batch; `var` is biased, over `count` numbers.
    fn observe(&self, mean: Tensor<1>, var: Tensor<1>, count: usize) {
        let unbiased = count as f64 / count.saturating_sub(1).max(1) as f64;
        let step = |state: &RunningState<Tensor<1>>, batch: Tensor<1>| {
            let next = state.value_sync().mul_scalar(1.0 - MOMENTUM).add(batch.mul_scalar(MOMENTUM));
            state.update(next.detach());
        };
        step(&self.running_mean, mean);
        step(&self.running_var, var.mul_scalar(unbiased));
    }
}
