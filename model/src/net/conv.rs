//! A convolution that keeps the size of its input.

use super::init::Init;
use crate::fast;
use burn::module::Param;
use burn::prelude::*;
use burn::tensor::module::conv2d;
use burn::tensor::ops::ConvOptions;

/// Stride 1, zero padding, bias; the kernel's side is odd.
#[derive(Module, Debug)]
pub struct Conv {
    /// `[out, in, k, k]`, as in PyTorch.
    pub weight: Param<Tensor<4>>,
    /// `[out]`.
    pub bias: Param<Tensor<1>>,
}

impl Conv {
    pub(crate) fn new(kernel: usize, cin: usize, cout: usize, init: &Init<'_>) -> Self {
        let fan_in = cin * kernel * kernel;
        Self {
            weight: Param::from_tensor(init.uniform("weight", [cout, cin, kernel, kernel], fan_in)),
            bias: Param::from_tensor(init.uniform("bias", [cout], fan_in)),
        }
    }

    /// # Shapes
    /// `[b, in, h, w]` → `[b, out, h, w]`.
    pub fn forward(&self, x_bchw: Tensor<4>) -> Tensor<4> {
        let (weight, bias) = (self.weight.val(), self.bias.val());
        fast::conv(&x_bchw, &weight, &bias).unwrap_or_else(|| {
            let pad = weight.dims()[2] / 2;
            conv2d(x_bchw, weight, Some(bias), ConvOptions::new([1, 1], [pad, pad], [1, 1], 1))
        })
    }
}
