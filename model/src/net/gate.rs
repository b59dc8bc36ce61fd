//! The attention gate on a skip connection (Oktay et al., 2018).

use super::conv::Conv;
use super::init::Init;
use super::norm::Norm;
use crate::fast;
use burn::prelude::*;
use burn::tensor::activation::{relu, sigmoid};

/// Weighs each pixel of a skip connection by how well it fits what the decoder is looking for.
#[derive(Module, Debug)]
pub struct Gate {
    conv_g: Conv,
    norm_g: Norm,
    conv_x: Conv,
    norm_x: Norm,
    conv_psi: Conv,
    norm_psi: Norm,
}

impl Gate {
    /// Signal and skip have `channels`, the space in which they meet half of that.
    pub(crate) fn new(channels: usize, init: &Init<'_>) -> Self {
        let inner = channels / 2;
        Self {
            conv_g: Conv::new(1, channels, inner, &init.of("conv_g")),
            norm_g: Norm::new(inner, init),
            conv_x: Conv::new(1, channels, inner, &init.of("conv_x")),
            norm_x: Norm::new(inner, init),
            conv_psi: Conv::new(1, inner, 1, &init.of("conv_psi")),
            norm_psi: Norm::new(1, init),
        }
    }

    /// `g`: the decoder's signal; `x`: the encoder's skip connection.
    ///
    /// # Shapes
    /// `[b, c, h, w]` twice → `[b, c, h, w]`.
    pub fn forward(&self, g_bchw: Tensor<4>, x_bchw: Tensor<4>) -> Tensor<4> {
        let g_bihw = self.conv_g.forward_norm(g_bchw, false, &self.norm_g, false);
        let x_bihw = self.conv_x.forward_norm(x_bchw.clone(), false, &self.norm_x, false);
        let psi_b1hw = self.conv_psi.forward_norm(relu(g_bihw + x_bihw), false, &self.norm_psi, false);
        let weight_b1hw = sigmoid(psi_b1hw);
        fast::scale(&x_bchw, &weight_b1hw).unwrap_or_else(|| x_bchw * weight_b1hw)
    }
}
