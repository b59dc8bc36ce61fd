//! A convolution that keeps the size of its input.

use super::init::Init;
use super::norm::{self, Norm};
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
        self.apply(x_bchw, false)
    }

    /// [`Self::forward`] of the input at twice its size, each pixel a square of four.
    ///
    /// # Shapes
    /// `[b, in, h, w]` → `[b, out, 2h, 2w]`.
    pub fn forward_doubled(&self, x_bchw: Tensor<4>) -> Tensor<4> {
        self.apply(x_bchw, true)
    }

    /// [`Self::forward`], or [`Self::forward_doubled`], then batch norm, and ReLU if asked for. For inference on the CPU one
    /// operation: the norm is folded into the weights.
    pub(crate) fn forward_norm(&self, x_bchw: Tensor<4>, doubled: bool, norm: &Norm, relu: bool) -> Tensor<4> {
        let folded = (!x_bchw.device().is_autodiff()).then(|| {
            let (weight, bias) = (self.weight.val(), self.bias.val());
            fast::conv_norm(&x_bchw, &weight, &bias, doubled, norm.channels(), norm::EPSILON, relu)
        });
        folded.flatten().unwrap_or_else(|| {
            let y_bchw = self.apply(x_bchw, doubled);
            if relu { norm.forward_relu(y_bchw) } else { norm.forward(y_bchw) }
        })
    }

    fn apply(&self, x_bchw: Tensor<4>, doubled: bool) -> Tensor<4> {
        let (weight, bias) = (self.weight.val(), self.bias.val());
        fast::conv(&x_bchw, &weight, &bias, doubled).unwrap_or_else(|| {
            let x_bchw = if doubled { double(x_bchw) } else { x_bchw };
            let pad = weight.dims()[2] / 2;
            conv2d(x_bchw, weight, Some(bias), ConvOptions::new([1, 1], [pad, pad], [1, 1], 1))
        })
    }
}

/// Every pixel becomes a square of four.
fn double(x_bchw: Tensor<4>) -> Tensor<4> {
    let [b, c, h, w] = x_bchw.dims();
    x_bchw.reshape([b, c, h, 1, w, 1]).expand([b, c, h, 2, w, 2]).reshape([b, c, 2 * h, 2 * w])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn doubling_repeats_pixels() {
        let x = Tensor::<4>::from_floats([[[[1.0, 2.0], [3.0, 4.0]]]], &Device::flex());
        let want = [1.0, 1.0, 2.0, 2.0, 1.0, 1.0, 2.0, 2.0, 3.0, 3.0, 4.0, 4.0, 3.0, 3.0, 4.0, 4.0];
        assert_eq!(double(x).into_data().try_to_vec::<f32>().unwrap(), want);
    }
}
