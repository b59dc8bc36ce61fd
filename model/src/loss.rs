//! The loss of the paper: two tasks, weighed by learnt uncertainties (section 4.2; Kendall et al., 2018).
//!
//! `MSE / (2 σ₁²) + log σ₁ + BCE / σ₂² + log σ₂`, `σ = exp(log_vars)`. The mean squared error runs over the labelled
//! cells of the whole batch, the binary cross-entropy over all pixels. The released code takes the cross-entropy of a
//! sigmoid; ours takes it of the logit, the same number without its rounding (PyTorch cuts each logarithm at -100).

use crate::net::{Nbp, NetOutput};
use burn::prelude::*;
use burn::tensor::activation::log_sigmoid;
use serde::{Deserialize, Serialize};

/// Which of the two maps is learnt.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Tasks {
    /// Both, weighed by their uncertainties.
    #[default]
    Both,
    /// The value map: the other decoder stays as it was drawn.
    Value,
    /// The obstacle map, likewise.
    Obstacle,
}

/// What the network should have answered.
#[derive(Clone, Debug)]
pub struct Targets {
    /// `[b, k, S/4, S/4]`, percent points; 0 where there is no label.
    pub value_bkhw: Tensor<4>,
    /// `[b, k, S/4, S/4]`, 1 at labelled cells, else 0.
    pub mask_bkhw: Tensor<4>,
    /// Number of ones in the mask.
    pub labelled: usize,
    /// `[b, 1, S, S]`, 1 at obstacles, else 0.
    pub obstacle_b1hw: Tensor<4>,
}

/// The loss and its parts, still on the tape.
#[derive(Clone, Debug)]
pub struct Losses {
    /// `[1]`, what to differentiate.
    pub total: Tensor<1>,
    /// `[1]`, squared percent points; 0 without labels.
    pub mse: Tensor<1>,
    /// `[1]`, nats.
    pub bce: Tensor<1>,
    /// `[2]`.
    pub sigma: Tensor<1>,
}

/// The loss in plain numbers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct LossValues {
    /// The weighed sum.
    pub total: f32,
    /// Mean squared error over labelled cells, squared percent points.
    pub mse: f32,
    /// Mean binary cross-entropy, nats.
    pub bce: f32,
    /// Uncertainties of value and obstacle map.
    pub sigma: [f32; 2],
}

impl LossValues {
    /// Whether every number is finite: if not, the step must not reach the optimiser.
    pub fn is_finite(&self) -> bool {
        [self.total, self.mse, self.bce, self.sigma[0], self.sigma[1]].iter().all(|value| value.is_finite())
    }
}

impl Losses {
    /// Reads all numbers back at once.
    pub fn values(&self) -> LossValues {
        let parts = [&self.total, &self.mse, &self.bce, &self.sigma].map(|part| part.clone().detach());
        let numbers: Vec<f32> = Tensor::cat(parts.to_vec(), 0).into_data().iter::<f32>().collect();
        let at = |index: usize| numbers.get(index).copied().unwrap_or(f32::NAN);
        LossValues { total: at(0), mse: at(1), bce: at(2), sigma: [at(3), at(4)] }
    }
}

/// Loss of an answer of `net`; all parts are measured, those of `tasks` make the total.
pub fn loss(net: &Nbp, output: NetOutput, targets: &Targets, tasks: Tasks) -> Losses {
    let error_bkhw = (output.value_bkhw - targets.value_bkhw.clone()) * targets.mask_bkhw.clone();
    let mse = error_bkhw.powi_scalar(2).sum().div_scalar(targets.labelled.max(1) as f32);

    // -t·log s(z) - (1-t)·log(1-s(z)) with log(1-s(z)) = log s(z) - z.
    let logit_b1hw = output.obstacle_b1hw;
    let free_b1hw = targets.obstacle_b1hw.clone().neg().add_scalar(1.0);
    let bce = (free_b1hw * logit_b1hw.clone() - log_sigmoid(logit_b1hw)).mean();

    let log_sigma = net.log_vars.val();
    let precision = log_sigma.clone().mul_scalar(-2.0).exp();
    // The other task is left out, not multiplied by zero: decay would wear down weights with gradients of zero.
    let alone =
        |half: Tensor<1>, task| half * precision.clone().narrow(0, task, 1) + log_sigma.clone().narrow(0, task, 1);
    let total = match tasks {
        Tasks::Both => {
            let halves = Tensor::cat(vec![mse.clone().mul_scalar(0.5), bce.clone()], 0);
            (halves * precision + log_sigma.clone()).sum()
        }
        Tasks::Value => alone(mse.clone().mul_scalar(0.5), 0),
        Tasks::Obstacle => alone(bce.clone(), 1),
    };
    Losses { total, mse, bce, sigma: log_sigma.exp() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::NetConfig;

    fn net() -> Nbp {
        let config = NetConfig { base: 2, ..NetConfig::default() };
        let mut net = Nbp::new(&config, 1, &Device::flex()).unwrap();
        net.log_vars = net.log_vars.map(|v| Tensor::from_floats([0.3, -0.2], &v.device()));
        net
    }

    fn full(value: f32, shape: [usize; 4]) -> Tensor<4> {
        Tensor::full(shape, value, &Device::flex())
    }

    #[test]
    fn agrees_with_the_formula() {
        let mut mask = vec![0.0; 8 * 16];
        mask[3] = 1.0;
        mask[77] = 1.0;
        let targets = Targets {
            value_bkhw: full(1.0, [1, 8, 4, 4]),
            mask_bkhw: Tensor::<1>::from_floats(mask.as_slice(), &Device::flex()).reshape([1, 8, 4, 4]),
            labelled: 2,
            obstacle_b1hw: full(1.0, [1, 1, 16, 16]),
        };
        let output = NetOutput { value_bkhw: full(4.0, [1, 8, 4, 4]), obstacle_b1hw: full(-0.5, [1, 1, 16, 16]) };
        let of = |tasks| loss(&net(), output.clone(), &targets, tasks).values();
        let got = of(Tasks::Both);
        let (mse, bce) = (9.0f32, (1.0 + 0.5f32.exp()).ln());
        let want = mse / (2.0 * 0.6f32.exp()) + 0.3 + bce / (-0.4f32).exp() - 0.2;
        assert!((got.mse - mse).abs() < 1e-5 && (got.bce - bce).abs() < 1e-5, "{got:?}");
        assert!((got.total - want).abs() < 1e-5, "{got:?} {want}");
        let [value, obstacle] = [Tasks::Value, Tasks::Obstacle].map(of);
        assert!((value.total - (mse / (2.0 * 0.6f32.exp()) + 0.3)).abs() < 1e-5 && value.bce == got.bce);
        assert!((value.total + obstacle.total - got.total).abs() < 1e-5);
        assert!((got.sigma[0] - 0.3f32.exp()).abs() < 1e-6 && (got.sigma[1] - (-0.2f32).exp()).abs() < 1e-6);
    }

    #[test]
    fn a_batch_without_labels_and_huge_logits_stay_finite() {
        let targets = Targets {
            value_bkhw: full(0.0, [1, 8, 4, 4]),
            mask_bkhw: full(0.0, [1, 8, 4, 4]),
            labelled: 0,
            obstacle_b1hw: full(0.0, [1, 1, 16, 16]),
        };
        let output = NetOutput { value_bkhw: full(4.0, [1, 8, 4, 4]), obstacle_b1hw: full(200.0, [1, 1, 16, 16]) };
        let got = loss(&net(), output, &targets, Tasks::Both).values();
        assert!(got.is_finite() && got.mse == 0.0 && (got.bce - 200.0).abs() < 1e-3, "{got:?}");
    }
}
