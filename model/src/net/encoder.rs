//! The encoder that both decoders share.

use super::block::ConvBlock;
use super::init::Init;
use crate::fast;
use burn::prelude::*;
use burn::tensor::module::max_pool2d;
use burn::tensor::ops::MaxPoolOptions;

/// Five blocks with a 2×2 maximum pool between them.
#[derive(Module, Debug)]
pub struct Encoder {
    conv1: ConvBlock,
    conv2: ConvBlock,
    conv3: ConvBlock,
    conv4: ConvBlock,
    conv5: ConvBlock,
}

/// What the encoder hands to the decoders; `x5` is the bottleneck, the others are skip connections.
#[derive(Clone, Debug)]
pub struct Features {
    /// `[b, base, S, S]`.
    pub x1: Tensor<4>,
    /// `[b, 2·base, S/2, S/2]`.
    pub x2: Tensor<4>,
    /// `[b, 4·base, S/4, S/4]`.
    pub x3: Tensor<4>,
    /// `[b, 8·base, S/8, S/8]`.
    pub x4: Tensor<4>,
    /// `[b, 16·base, S/16, S/16]`.
    pub x5: Tensor<4>,
}

impl Encoder {
    pub(crate) fn new(in_channels: usize, base: usize, init: &Init<'_>) -> Self {
        Self {
            conv1: ConvBlock::new(in_channels, base, &init.of("conv1")),
            conv2: ConvBlock::new(base, 2 * base, &init.of("conv2")),
            conv3: ConvBlock::new(2 * base, 4 * base, &init.of("conv3")),
            conv4: ConvBlock::new(4 * base, 8 * base, &init.of("conv4")),
            conv5: ConvBlock::new(8 * base, 16 * base, &init.of("conv5")),
        }
    }

    /// # Shapes
    /// `[b, in, S, S]` → see [`Features`]. `S` must be a multiple of 16.
    pub fn forward(&self, x_bchw: Tensor<4>) -> Features {
        let x1 = self.conv1.forward(x_bchw);
        let x2 = self.conv2.forward(halve(x1.clone()));
        let x3 = self.conv3.forward(halve(x2.clone()));
        let x4 = self.conv4.forward(halve(x3.clone()));
        let x5 = self.conv5.forward(halve(x4.clone()));
        Features { x1, x2, x3, x4, x5 }
    }
}

fn halve(x_bchw: Tensor<4>) -> Tensor<4> {
    fast::pool(&x_bchw).unwrap_or_else(|| max_pool2d(x_bchw, MaxPoolOptions::new([2, 2])))
}
