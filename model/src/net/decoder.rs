//! The two decoders: value map at a quarter of the input's size, obstacle map at its full size.

use super::block::{ConvBlock, Up};
use super::conv::Conv;
use super::encoder::Features;
use super::gate::Gate;
use super::init::Init;
use burn::prelude::*;

/// One step up: double the size, gate the skip connection, merge both.
#[derive(Module, Debug)]
pub struct Stage {
    up: Up,
    gate: Gate,
    merge: ConvBlock,
}

impl Stage {
    /// From `2·channels` to `channels`.
    pub(crate) fn new(channels: usize, init: &Init<'_>) -> Self {
        Self {
            up: Up::new(2 * channels, channels, &init.of("up")),
            gate: Gate::new(channels, &init.of("gate")),
            merge: ConvBlock::new(2 * channels, channels, &init.of("merge")),
        }
    }

    /// # Shapes
    /// `[b, 2c, h, w]` and the skip connection `[b, c, 2h, 2w]` → `[b, c, 2h, 2w]`.
    pub fn forward(&self, d_bchw: Tensor<4>, skip_bchw: Tensor<4>) -> Tensor<4> {
        let d_bchw = self.up.forward(d_bchw);
        let gated_bchw = self.gate.forward(d_bchw.clone(), skip_bchw);
        self.merge.forward(Tensor::cat(vec![gated_bchw, d_bchw], 1))
    }
}

/// Features → coverage gain for each heading and cell, percent points, unbounded.
#[derive(Module, Debug)]
pub struct ValueDecoder {
    stage5: Stage,
    stage4: Stage,
    pub(super) head: Conv,
}

impl ValueDecoder {
    pub(crate) fn new(base: usize, headings: usize, init: &Init<'_>) -> Self {
        Self {
            stage5: Stage::new(8 * base, &init.of("stage5")),
            stage4: Stage::new(4 * base, &init.of("stage4")),
            head: Conv::new(1, 4 * base, headings, &init.of("head")),
        }
    }

    /// # Shapes
    /// → `[b, headings, S/4, S/4]`.
    pub fn forward(&self, features: &Features) -> Tensor<4> {
        let d_bchw = self.stage5.forward(features.x5.clone(), features.x4.clone());
        let d_bchw = self.stage4.forward(d_bchw, features.x3.clone());
        self.head.forward(d_bchw)
    }
}

/// Features → logit of an obstacle for each pixel.
#[derive(Module, Debug)]
pub struct ObstacleDecoder {
    stage5: Stage,
    stage4: Stage,
    stage3: Stage,
    stage2: Stage,
    pub(super) head: Conv,
}

impl ObstacleDecoder {
    pub(crate) fn new(base: usize, init: &Init<'_>) -> Self {
        Self {
            stage5: Stage::new(8 * base, &init.of("stage5")),
            stage4: Stage::new(4 * base, &init.of("stage4")),
            stage3: Stage::new(2 * base, &init.of("stage3")),
            stage2: Stage::new(base, &init.of("stage2")),
            head: Conv::new(1, base, 1, &init.of("head")),
        }
    }

    /// # Shapes
    /// → `[b, 1, S, S]`, logits.
    pub fn forward(&self, features: &Features) -> Tensor<4> {
        let d_bchw = self.stage5.forward(features.x5.clone(), features.x4.clone());
        let d_bchw = self.stage4.forward(d_bchw, features.x3.clone());
        let d_bchw = self.stage3.forward(d_bchw, features.x2.clone());
        let d_bchw = self.stage2.forward(d_bchw, features.x1.clone());
        self.head.forward(d_bchw)
    }
}
