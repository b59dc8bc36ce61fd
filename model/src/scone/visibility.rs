//! SconeVis: how visible each point in front of a camera would be, as a function of the direction it is seen from (Guédon
//! et al., SCONE, 2022).

use super::attention::Encoder;
use super::config::{HARMONICS, SconeConfig};
use super::layers::{self, Linear, Padding};
use crate::net::init::Init;
use burn::prelude::*;
use burn::tensor::activation::sigmoid;

/// What stands in front of cameras: one set of points each.
#[derive(Clone, Debug)]
pub struct Views {
    /// `[b, n, 4]`: place in the network's frame, occupancy.
    pub point_bn4: Tensor<3>,
    /// `[b, n, 64]`: the directions each was seen from.
    pub harmonics_bnk: Tensor<3>,
    /// `[b, n, 64]`: the harmonics at the direction from the point to the camera.
    pub basis_bnk: Tensor<3>,
    /// `[b, n]`: what a visible point counts; 0 where there is none.
    pub weight_bn: Tensor<2>,
    /// Which rows are points.
    pub padding: Padding,
}

/// The visibility network.
#[derive(Module, Debug)]
pub struct SconeVis {
    embed_a: Linear,
    embed_b: Linear,
    encoder: Encoder,
    out_a: Linear,
    out_b: Linear,
    out_c: Linear,
}

impl SconeVis {
    pub(super) fn new(config: &SconeConfig, init: &Init<'_>) -> Self {
        let SconeConfig { width, heads, visibility_layers, .. } = *config;
        let inner = 3 * width / 2;
        Self {
            embed_a: Linear::new(4, width - 2, &init.of("embed_a")),
            embed_b: Linear::new(width - 2, width - 2, &init.of("embed_b")),
            encoder: Encoder::new(2 * width, heads, visibility_layers, &init.of("encoder")),
            out_a: Linear::new(2 * width, inner, &init.of("out_a")),
            out_b: Linear::new(inner + HARMONICS, width, &init.of("out_b")),
            out_c: Linear::new(width, HARMONICS, &init.of("out_c")),
        }
    }

    /// Visibility of each point from its camera, 0 to 1.
    ///
    /// # Shapes
    /// b views of n points → `[b, n]`.
    pub fn visible(&self, views: &Views) -> Tensor<2> {
        let Views { point_bn4, harmonics_bnk, basis_bnk, padding, .. } = views;
        let [b, n, _] = point_bn4.dims();
        let own = self.embed_b.forward(self.embed_a.forward_gelu(point_bn4.clone()));
        let features = own.dims()[2];
        let all = layers::largest(own.clone(), Some(padding)).expand([b, n, features]);
        let x_bne = Tensor::cat(vec![own, all, point_bn4.clone()], 2);
        let inner = self.out_a.forward_gelu(self.encoder.forward(x_bne, Some(padding)));
        let inner = self.out_b.forward_gelu(Tensor::cat(vec![inner, harmonics_bnk.clone()], 2));
        let coefficients_bnk = self.out_c.forward(inner);
        sigmoid((coefficients_bnk * basis_bnk.clone()).sum_dim(2).squeeze_dim(2))
    }

    /// What each camera would gain, but for its mass: the weighted sum of what is visible.
    ///
    /// # Shapes
    /// b views of n points → `[b]`.
    pub fn forward(&self, views: &Views) -> Tensor<1> {
        (self.visible(views) * views.weight_bn.clone()).sum_dim(1).squeeze_dim(1)
    }
}
