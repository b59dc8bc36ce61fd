//! The two bricks of encoder and decoders.

use super::conv::Conv;
use super::init::Init;
use super::norm::Norm;
use burn::prelude::*;

/// Two times 3×3 convolution, batch norm, ReLU.
#[derive(Module, Debug)]
pub struct ConvBlock {
    conv_a: Conv,
    norm_a: Norm,
    conv_b: Conv,
    norm_b: Norm,
}

impl ConvBlock {
    pub(crate) fn new(cin: usize, cout: usize, init: &Init<'_>) -> Self {
        Self {
            conv_a: Conv::new(3, cin, cout, &init.of("conv_a")),
            norm_a: Norm::new(cout, init),
            conv_b: Conv::new(3, cout, cout, &init.of("conv_b")),
            norm_b: Norm::new(cout, init),
        }
    }

    /// # Shapes
    /// `[b, in, h, w]` → `[b, out, h, w]`.
    pub fn forward(&self, x_bchw: Tensor<4>) -> Tensor<4> {
        let y_bchw = self.norm_a.forward_relu(self.conv_a.forward(x_bchw));
        self.norm_b.forward_relu(self.conv_b.forward(y_bchw))
    }
}

/// Twice the size by nearest neighbour, then 3×3 convolution, batch norm, ReLU.
#[derive(Module, Debug)]
pub struct Up {
    conv: Conv,
    norm: Norm,
}

impl Up {
    pub(crate) fn new(cin: usize, cout: usize, init: &Init<'_>) -> Self {
        Self { conv: Conv::new(3, cin, cout, &init.of("conv")), norm: Norm::new(cout, init) }
    }

    /// # Shapes
    /// `[b, in, h, w]` → `[b, out, 2h, 2w]`.
    pub fn forward(&self, x_bchw: Tensor<4>) -> Tensor<4> {
        self.norm.forward_relu(self.conv.forward(double(x_bchw)))
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
