//! The bricks of both networks: linear layers, norms, embeddings of points, and what is known of padding.

use crate::fast;
use crate::net::init::Init;
use burn::module::Param;
use burn::prelude::*;
use burn::tensor::module::{layer_norm, linear};

/// Of the variance, as PyTorch's layer norm.
const EPSILON: f64 = 1e-5;

/// `x W + b` on the last axis.
#[derive(Module, Debug)]
pub(super) struct Linear {
    /// `[in, out]`, transposed to PyTorch's.
    weight: Param<Tensor<2>>,
    /// `[out]`.
    bias: Param<Tensor<1>>,
}

impl Linear {
    /// Kaiming's uniform rule for weights (variance 2 / fan-in), PyTorch's for biases.
    pub(super) fn new(from: usize, to: usize, init: &Init<'_>) -> Self {
        Self::bounded(from, to, (6.0 / from as f32).sqrt(), init)
    }

    /// Xavier's uniform rule for weights (variance 2 / (fan-in + fan-out)), PyTorch's for biases.
    pub(super) fn xavier(from: usize, to: usize, init: &Init<'_>) -> Self {
        Self::bounded(from, to, (6.0 / (from + to) as f32).sqrt(), init)
    }

    fn bounded(from: usize, to: usize, bound: f32, init: &Init<'_>) -> Self {
        Self {
            weight: Param::from_tensor(init.within("weight", [from, to], bound)),
            bias: Param::from_tensor(init.uniform("bias", [to], from)),
        }
    }

    /// # Shapes
    /// `[…, in]` → `[…, out]`.
    pub(super) fn forward<const D: usize>(&self, x: Tensor<D>) -> Tensor<D> {
        linear(x, self.weight.val(), Some(self.bias.val()))
    }

    /// The same with GELU behind it.
    pub(super) fn forward_gelu<const D: usize>(&self, x: Tensor<D>) -> Tensor<D> {
        fast::gelu(self.forward(x))
    }
}

/// Layer norm on the last axis.
#[derive(Module, Debug)]
pub(super) struct Norm {
    weight: Param<Tensor<1>>,
    bias: Param<Tensor<1>>,
}

impl Norm {
    pub(super) fn new(features: usize, init: &Init<'_>) -> Self {
        Self {
            weight: Param::from_tensor(Tensor::ones([features], init.device())),
            bias: Param::from_tensor(Tensor::zeros([features], init.device())),
        }
    }

    /// # Shapes
    /// `[…, e]` → `[…, e]`.
    pub(super) fn forward<const D: usize>(&self, x: Tensor<D>) -> Tensor<D> {
        layer_norm(x, self.weight.val(), Some(self.bias.val()), EPSILON)
    }
}

/// Which rows of a batch of point sets are points, and which fill up to the largest set.
#[derive(Clone, Debug)]
pub struct Padding {
    /// `[b, n, 1]`: 0 at points, [`Padding::AWAY`] elsewhere.
    pub bias_bn1: Tensor<3>,
    /// `[b, n, 1]`: 1 / number of points at points, 0 elsewhere.
    pub share_bn1: Tensor<3>,
}

impl Padding {
    /// Added to what must not count: its exponential is zero to the last bit.
    pub const AWAY: f32 = -1e9;

    /// Of sets of so many points each, filled up to `rows`.
    pub fn new(counts: &[usize], rows: usize, device: &Device) -> Self {
        let shape = [counts.len(), rows, 1];
        let fill = |point: &dyn Fn(usize) -> f32, away: f32| {
            let row = |&count: &usize| (0..rows).map(move |n| if n < count { point(count) } else { away });
            let numbers: Vec<f32> = counts.iter().flat_map(row).collect();
            Tensor::from_data(TensorData::new(numbers, shape), device)
        };
        Self { bias_bn1: fill(&|_| 0.0, Self::AWAY), share_bn1: fill(&|count| 1.0 / count as f32, 0.0) }
    }
}

/// The largest of each feature over a set of points.
///
/// # Shapes
/// `[b, n, e]` → `[b, 1, e]`.
pub(super) fn largest(x_bne: Tensor<3>, padding: Option<&Padding>) -> Tensor<3> {
    match padding {
        Some(padding) => (x_bne + padding.bias_bn1.clone()).max_dim(1),
        None => x_bne.max_dim(1),
    }
}

/// The mean of each feature over a set of points.
///
/// # Shapes
/// `[b, n, e]` → `[b, 1, e]`.
pub(super) fn mean(x_bne: Tensor<3>, padding: Option<&Padding>) -> Tensor<3> {
    match padding {
        Some(padding) => (x_bne * padding.share_bn1.clone()).sum_dim(1),
        None => x_bne.mean_dim(1),
    }
}
