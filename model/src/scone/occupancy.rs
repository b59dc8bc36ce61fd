//! SconeOcc: the probability that a point is inside something, from the cloud around it, its neighbours at three scales
//! and the directions it was seen from (Guédon et al., SCONE, 2022).

use super::attention::Encoder;
use super::config::{HARMONICS, SCALES, SconeConfig};
use super::layers::{self, Linear, Padding};
use crate::net::init::Init;
use burn::prelude::*;

/// A point-cloud transformer: from a set of points to one vector.
#[derive(Module, Debug)]
pub struct Pct {
    embed_a: Linear,
    embed_b: Linear,
    encoder: Encoder,
    out: Linear,
}

impl Pct {
    /// `to` features of the whole set.
    fn new(config: &SconeConfig, to: usize, init: &Init<'_>) -> Self {
        let SconeConfig { width, heads, occupancy_layers, .. } = *config;
        Self {
            embed_a: Linear::new(3, width - 3, &init.of("embed_a")),
            embed_b: Linear::new(width - 3, width - 3, &init.of("embed_b")),
            encoder: Encoder::new(width, heads, occupancy_layers, &init.of("encoder")),
            out: Linear::new(width, to / 2, &init.of("out")),
        }
    }

    /// # Shapes
    /// `[b, n, 3]` → `[b, to]`.
    pub fn forward(&self, x_bn3: Tensor<3>, padding: Option<&Padding>) -> Tensor<2> {
        let embedded = self.embed_b.forward(self.embed_a.forward_gelu(x_bn3.clone()));
        let x_bne = self.encoder.forward(Tensor::cat(vec![embedded, x_bn3], 2), padding);
        let x_bnf = self.out.forward(x_bne);
        let pooled = vec![layers::largest(x_bnf.clone(), padding), layers::mean(x_bnf, padding)];
        Tensor::cat(pooled, 2).squeeze_dim(1)
    }
}

/// What is asked about points in one or several clouds.
#[derive(Clone, Debug)]
pub struct Queries {
    /// `[q]`: the cloud that each point lies in.
    pub cloud_q: Tensor<1, Int>,
    /// `[q, 3]`, in the network's frame.
    pub point_q3: Tensor<2>,
    /// `[q, 16, 3]`, nearest neighbours at each scale as offsets from the point.
    pub offsets_qn3: [Tensor<3>; SCALES],
    /// `[q, 64]`: the directions it was seen from.
    pub harmonics_qk: Tensor<2>,
}

/// The occupancy network.
#[derive(Module, Debug)]
pub struct SconeOcc {
    global: Pct,
    local_a: Pct,
    local_b: Pct,
    local_c: Pct,
    point_a: Linear,
    point_b: Linear,
    point_c: Linear,
    head_a: Linear,
    head_b: Linear,
    head_c: Linear,
}

impl SconeOcc {
    pub(super) fn new(config: &SconeConfig, init: &Init<'_>) -> Self {
        let w = config.width;
        let local = |name: &str| Pct::new(config, 2 * w, &init.of(name));
        Self {
            global: Pct::new(config, 4 * w, &init.of("global")),
            local_a: local("local_a"),
            local_b: local("local_b"),
            local_c: local("local_c"),
            point_a: Linear::new(3, w, &init.of("point_a")),
            point_b: Linear::new(w, 2 * w, &init.of("point_b")),
            point_c: Linear::new(2 * w, 4 * w, &init.of("point_c")),
            head_a: Linear::new(14 * w + HARMONICS, 4 * w, &init.of("head_a")),
            head_b: Linear::new(4 * w, 2 * w, &init.of("head_b")),
            head_c: Linear::new(2 * w, 1, &init.of("head_c")),
        }
    }

    /// What is known of each cloud as a whole.
    ///
    /// # Shapes
    /// `[l, n, 3]` → `[l, 4 width]`.
    pub fn clouds(&self, cloud_ln3: Tensor<3>, padding: Option<&Padding>) -> Tensor<2> {
        self.global.forward(cloud_ln3, padding)
    }

    /// Occupancy of points, given what [`Self::clouds`] made of their clouds: about 0 to 1, but not bounded.
    ///
    /// # Shapes
    /// `[l, 4 width]`, q queries → `[q]`.
    pub fn forward(&self, cloud_lg: Tensor<2>, queries: Queries) -> Tensor<1> {
        let Queries { cloud_q, point_q3, offsets_qn3, harmonics_qk } = queries;
        let global = cloud_lg.select(0, cloud_q);
        let locals = [&self.local_a, &self.local_b, &self.local_c].into_iter().zip(offsets_qn3);
        let locals = locals.map(|(pct, offsets_qn3)| pct.forward(offsets_qn3, None));
        let point = self.point_b.forward_gelu(self.point_a.forward_gelu(point_q3));
        let point = self.point_c.forward_gelu(point);
        let parts = std::iter::once(global).chain(locals).chain([point, harmonics_qk]).collect();
        let hidden = self.head_b.forward_gelu(self.head_a.forward_gelu(Tensor::cat(parts, 1)));
        self.head_c.forward_gelu(hidden).squeeze_dim(1)
    }
}
