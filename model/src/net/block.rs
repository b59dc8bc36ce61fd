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
        let y_bchw = self.conv_a.forward_norm(x_bchw, false, &self.norm_a, true);
        self.conv_b.forward_norm(y_bchw, false, &self.norm_b, true)
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
        self.conv.forward_norm(x_bchw, true, &self.norm, true)
    }
}
