//! Attention over a set of points, and the encoder made of it: two residual steps, each behind a norm of its own.

use super::layers::{Linear, Norm, Padding};
use crate::fast;
use crate::net::init::Init;
use burn::prelude::*;

/// Multi-head attention of a set of points on itself; queries and keys are a quarter as wide as values.
#[derive(Module, Debug)]
pub struct Attention {
    query: Linear,
    key: Linear,
    value: Linear,
    out: Linear,
    heads: usize,
}

impl Attention {
    pub(super) fn new(features: usize, heads: usize, init: &Init<'_>) -> Self {
        Self {
            query: Linear::xavier(features, features / 4, &init.of("query")),
            key: Linear::xavier(features, features / 4, &init.of("key")),
            value: Linear::xavier(features, features, &init.of("value")),
            out: Linear::new(features, features, &init.of("out")),
            heads,
        }
    }

    /// # Shapes
    /// `[b, n, e]` → `[b, n, e]`.
    pub fn forward(&self, x_bne: Tensor<3>, padding: Option<&Padding>) -> Tensor<3> {
        let [b, n, e] = x_bne.dims();
        let split = |part: Tensor<3>| {
            let each = part.dims()[2] / self.heads;
            part.reshape([b, n, self.heads, each]).swap_dims(1, 2)
        };
        let query_bhnd = split(self.query.forward(x_bne.clone()));
        let key_bhnd = split(self.key.forward(x_bne.clone()));
        let value_bhnd = split(self.value.forward(x_bne));
        let scale = 1.0 / (query_bhnd.dims()[3] as f64).sqrt();
        let score_bhnn = query_bhnd.mul_scalar(scale).matmul(key_bhnd.swap_dims(2, 3));
        let score_bhnn = match padding {
            Some(padding) => score_bhnn + padding.bias_bn1.clone().reshape([b, 1, 1, n]),
            None => score_bhnn,
        };
        let mixed_bhnd = fast::softmax(score_bhnn).matmul(value_bhnd);
        self.out.forward(mixed_bhnd.swap_dims(1, 2).reshape([b, n, e]))
    }
}

/// One layer of the encoder: attention, then two linear layers on each point.
#[derive(Module, Debug)]
pub struct Layer {
    norm_a: Norm,
    attention: Attention,
    norm_b: Norm,
    wide: Linear,
    narrow: Linear,
}

impl Layer {
    pub(super) fn new(features: usize, heads: usize, init: &Init<'_>) -> Self {
        Self {
            norm_a: Norm::new(features, init),
            attention: Attention::new(features, heads, &init.of("attention")),
            norm_b: Norm::new(features, init),
            wide: Linear::new(features, 2 * features, &init.of("wide")),
            narrow: Linear::new(2 * features, features, &init.of("narrow")),
        }
    }

    fn forward(&self, x_bne: Tensor<3>, padding: Option<&Padding>) -> Tensor<3> {
        let x_bne = x_bne.clone() + self.attention.forward(self.norm_a.forward(x_bne), padding);
        let wide = self.wide.forward_gelu(self.norm_b.forward(x_bne.clone()));
        x_bne + self.narrow.forward(wide)
    }
}

/// Layers and a last norm.
#[derive(Module, Debug)]
pub struct Encoder {
    layers: Vec<Layer>,
    norm: Norm,
}

impl Encoder {
    pub(super) fn new(features: usize, heads: usize, layers: usize, init: &Init<'_>) -> Self {
        let layer = |n: usize| Layer::new(features, heads, &init.of(&format!("layer{n}")));
        Self { layers: (0..layers).map(layer).collect(), norm: Norm::new(features, init) }
    }

    /// # Shapes
    /// `[b, n, e]` → `[b, n, e]`.
    pub fn forward(&self, x_bne: Tensor<3>, padding: Option<&Padding>) -> Tensor<3> {
        let x_bne = self.layers.iter().fold(x_bne, |x_bne, layer| layer.forward(x_bne, padding));
        self.norm.forward(x_bne)
    }
}
