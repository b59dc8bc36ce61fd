//! The optimiser of the paper, with PyTorch's defaults rather than Burn's.

use crate::fast;
use burn::optim::{AdamWConfig, AdamWState, AdaptiveMomentumState, ModuleOptimizer, Optimizer};
use burn::prelude::*;
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
        let burn = AdamWConfig::new()
            .with_beta_1(self.betas[0])
            .with_beta_2(self.betas[1])
            .with_epsilon(self.eps)
            .with_weight_decay(self.weight_decay)
            .build();
        Stepper { settings: *self, burn }.into()
    }
}

/// Burn's optimiser, in one pass where `fast` can.
#[derive(Clone)]
struct Stepper {
    settings: AdamW,
    burn: burn::optim::AdamW,
}

impl Optimizer for Stepper {
    type State<const D: usize> = AdamWState<D>;

    fn step<const D: usize>(
        &self,
        lr: f64,
        weight: Tensor<D>,
        gradient: Tensor<D>,
        mut state: Option<AdamWState<D>>,
    ) -> (Tensor<D>, Option<AdamWState<D>>) {
        // The first step makes the moments.
        let Some(AdamWState { mut momentum }) = state.take_if(|_| fast::takes(&weight)) else {
            return self.burn.step(lr, weight, gradient, state);
        };
        momentum.time += 1;
        let AdamW { betas, eps, weight_decay, .. } = self.settings;
        let rule = fast::Rule { lr, betas, epsilon: eps, weight_decay, time: momentum.time as i32 };
        let moments = [momentum.moment_1, momentum.moment_2];
        let [weight, moment_1, moment_2] = fast::adamw(rule, weight, gradient, moments);
        (weight, Some(AdamWState::new(AdaptiveMomentumState::new(momentum.time, moment_1, moment_2))))
    }

    fn to_device<const D: usize>(state: AdamWState<D>, device: &Device) -> AdamWState<D> {
        <burn::optim::AdamW as Optimizer>::to_device(state, device)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tensorize::tests::input;
    use crate::{Batch, Nbp, NetConfig, SampleRef, Tasks, loss};
    use burn::module::{ModuleVisitor, Param};
    use burn::optim::GradientsParams;

    fn net(base: usize) -> Nbp {
        Nbp::new(&NetConfig { base, ..NetConfig::default() }, 3, &Device::flex().autodiff()).unwrap()
    }

    #[test]
    fn steps_as_pytorchs_adamw() {
        let settings = AdamW { lr: 0.05, ..AdamW::default() };
        let (mut net, mut optim) = (net(2), settings.init());
        let (mut x, mut first, mut second) = ([0.0f64; 2], [0.0f64; 2], [0.0f64; 2]);
        let [b1, b2] = settings.betas.map(f64::from);
        for step in 1..=20 {
            let target = Tensor::<1>::from_floats([1.0, -0.3], &Device::flex().autodiff());
            let error = (net.log_vars.val() - target).powi_scalar(2).sum();
            let gradients = GradientsParams::from_grads(error.backward(), &net);
            net = optim.step(settings.lr, net, gradients);
            for (i, target) in [1.0, -0.3].into_iter().enumerate() {
                let g = 2.0 * (x[i] - target);
                x[i] *= 1.0 - settings.lr * f64::from(settings.weight_decay);
                first[i] = b1 * first[i] + (1.0 - b1) * g;
                second[i] = b2 * second[i] + (1.0 - b2) * g * g;
                let (m, v) = (first[i] / (1.0 - b1.powi(step)), second[i] / (1.0 - b2.powi(step)));
                x[i] -= settings.lr * m / (v.sqrt() + f64::from(settings.eps));
            }
        }
        let got = net.log_vars.val().into_data().try_to_vec::<f32>().unwrap();
        for (got, want) in got.iter().zip(x) {
            assert!((f64::from(*got) - want).abs() < 1e-5, "{got} {want}");
        }
    }

    #[derive(Default)]
    struct Bits(Vec<u32>);

    impl ModuleVisitor for Bits {
        fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
            self.0.extend(param.val().into_data().iter::<f32>().map(f32::to_bits));
        }
    }

    fn taped() -> Device {
        Device::flex().autodiff()
    }

    /// Three steps on one batch: the weights' bits, and the losses.
    fn trained(mut optim: ModuleOptimizer, device: &Device) -> (Vec<u32>, Vec<f32>) {
        let settings = AdamW::default();
        let config = NetConfig { base: 4, ..NetConfig::default() };
        let mut net = Nbp::new(&config, 3, device).unwrap();
        let inputs = [input(48, 5, 1), input(48, 5, 2), input(48, 5, 3)];
        let walls: Vec<u8> = (0..48 * 48).map(|i| u8::from(i % 7 == 0)).collect();
        let samples = inputs.each_ref().map(|input| SampleRef { input, labels: &[], obstacle: &walls });
        let batch = Batch::new(&samples, &config, device).unwrap();
        let losses = (0..3)
            .map(|_| {
                let losses = loss(&net, net.forward(batch.x_bchw.clone()), &batch.targets, Tasks::Both);
                let gradients = GradientsParams::from_grads(losses.total.clone().backward(), &net);
                net = optim.step(settings.lr, net.clone(), gradients);
                losses.values().total
            })
            .collect();
        let mut bits = Bits::default();
        net.valid().visit(&mut bits);
        (bits.0, losses)
    }

    #[test]
    fn one_pass_gives_the_bits_of_burns_operations() {
        let AdamW { eps, weight_decay, .. } = AdamW::default();
        let burns = AdamWConfig::new().with_epsilon(eps).with_weight_decay(weight_decay).init();
        assert!(trained(AdamW::default().init(), &taped()).0 == trained(burns, &taped()).0);
    }

    #[test]
    fn what_is_made_again_on_the_way_back_is_the_same() {
        let train = |device: Device| trained(AdamW::default().init(), &device);
        assert!(train(taped().gradient_checkpointing()) == train(taped()));
    }

    #[test]
    fn training_is_the_same_bits_for_any_number_of_threads_and_goes_downhill() {
        let run = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let run = |threads| run(threads).install(|| trained(AdamW::default().init(), &taped()));
        let (bits, losses) = run(1);
        assert!(losses[2] < losses[0], "{losses:?}");
        for threads in [2, 5] {
            assert!(run(threads).0 == bits, "{threads} threads train another network than one");
        }
    }
}
