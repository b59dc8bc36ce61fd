//! The optimiser of the paper, with PyTorch's defaults rather than Burn's.

use burn::optim::{AdamWConfig, ModuleOptimizer};
use serde::{Deserialize, Serialize};

/// AdamW. As in the released code it also decays the two log σ of the loss.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AdamW {
    /// Learning rate (paper: 1e-3).
    pub lr: f64,
    /// Decay of the two moments (paper: 0.9 and 0.999).
    pub betas: [f32; 2],
    /// Added to the root of the second moment (released code: 1e-8).
    pub eps: f32,
    /// Decoupled decay (released code: 0.01).
    pub weight_decay: f32,
}

impl Default for AdamW {
    fn default() -> Self {
        Self { lr: 1e-3, betas: [0.9, 0.999], eps: 1e-8, weight_decay: 0.01 }
    }
}

impl AdamW {
    /// A fresh optimiser. The learning rate is given to each of its steps: `net = optim.step(lr, net, grads)`.
    pub fn init(&self) -> ModuleOptimizer {
        AdamWConfig::new()
            .with_beta_1(self.betas[0])
            .with_beta_2(self.betas[1])
            .with_epsilon(self.eps)
            .with_weight_decay(self.weight_decay)
            .init()
    }
}
