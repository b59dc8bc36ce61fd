//! The network of the paper (section 4.1, appendix B): an attention U-Net with one encoder and two decoders.
//!
//! Shape suffixes: `b` batch, `c` channels, `i` inner channels of a gate, `k` headings, `h` rows, `w` columns. `S` is the
//! side of the input in pixels, a multiple of 16.

mod block;
mod conv;
mod decoder;
mod encoder;
mod gate;
#[cfg(test)]
pub(crate) mod gradients;
pub(crate) mod init;
mod norm;

pub use block::{ConvBlock, Up};
pub use conv::Conv;
pub use decoder::{ObstacleDecoder, Stage, ValueDecoder};
pub use encoder::{Encoder, Features};
pub use gate::Gate;
pub use norm::Norm;

use crate::config::{ConfigError, NetConfig};
use burn::module::Param;
use burn::prelude::*;
use init::Init;

/// The NextBestPath network.
///
/// It trains on an autodiff device (`device.autodiff()`) and infers on a plain one; `net.valid()` makes the copy for
/// inference. Running statistics sit behind a shared pointer, so a *clone* shares them with its origin; `valid()` does
/// not.
#[derive(Module, Debug)]
pub struct Nbp {
    encoder: Encoder,
    value: ValueDecoder,
    obstacle: ObstacleDecoder,
    /// `[2]`: log σ of the value and of the obstacle term of the loss (Kendall et al., 2018).
    pub log_vars: Param<Tensor<1>>,
}

/// The network's answer to a batch.
#[derive(Clone, Debug)]
pub struct NetOutput {
    /// `[b, k, S/4, S/4]`, percent points of coverage, unbounded.
    pub value_bkhw: Tensor<4>,
    /// `[b, 1, S, S]`, logits: their sigmoid is the probability of an obstacle.
    pub obstacle_b1hw: Tensor<4>,
}

impl Nbp {
    /// A fresh network, PyTorch's default initialisation; the same seed gives the same weights on every device.
    ///
    /// # Errors
    /// When a width is out of range.
    pub fn new(config: &NetConfig, seed: u64, device: &Device) -> Result<Self, ConfigError> {
        Self::build(config, &Init::seeded(seed, device))
    }

    /// A network whose convolutions are zero, to load weights into.
    pub(crate) fn blank(config: &NetConfig, device: &Device) -> Result<Self, ConfigError> {
        Self::build(config, &Init::zeros(device))
    }

    fn build(config: &NetConfig, init: &Init<'_>) -> Result<Self, ConfigError> {
        config.check()?;
        Ok(Self {
            encoder: Encoder::new(config.in_channels, config.base, &init.of("encoder")),
            value: ValueDecoder::new(config.base, config.headings, &init.of("value")),
            obstacle: ObstacleDecoder::new(config.base, &init.of("obstacle")),
            log_vars: Param::from_tensor(Tensor::zeros([2], init.device())),
        })
    }

    /// # Shapes
    /// `[b, in, S, S]` → `[b, k, S/4, S/4]` and `[b, 1, S, S]`.
    pub fn forward(&self, x_bchw: Tensor<4>) -> NetOutput {
        let features = self.encoder.forward(x_bchw);
        NetOutput { value_bkhw: self.value.forward(&features), obstacle_b1hw: self.obstacle.forward(&features) }
    }

    /// The encoder's features alone.
    pub fn features(&self, x_bchw: Tensor<4>) -> Features {
        self.encoder.forward(x_bchw)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::module::ModuleVisitor;

    fn small(base: usize) -> NetConfig {
        NetConfig { base, ..NetConfig::default() }
    }

    /// Numbers that the optimiser sees.
    #[derive(Default)]
    struct Trainable {
        numbers: usize,
        in_state: bool,
    }

    impl ModuleVisitor for Trainable {
        fn enter_module(&mut self, name: &str, _: &str) {
            self.in_state = name.starts_with("running");
        }

        fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
            if !self.in_state {
                self.numbers += param.lazy_shape().num_elements();
            }
        }
    }

    #[test]
    fn parameters_are_as_many_as_the_widths_say() {
        for config in [small(2), small(16), NetConfig { in_channels: 3, ..small(8) }, NetConfig::default()] {
            let mut count = Trainable::default();
            Nbp::blank(&config, &Device::flex()).unwrap().visit(&mut count);
            assert_eq!(count.numbers, config.parameters());
        }
    }

    #[test]
    fn shapes_follow_the_input() {
        let net = Nbp::new(&small(4), 1, &Device::flex()).unwrap();
        for side in [16, 32, 48, 64, 128] {
            let x_bchw = Tensor::zeros([2, 5, side, side], &Device::flex());
            assert_eq!(net.features(x_bchw.clone()).x5.dims(), [2, 64, side / 16, side / 16]);
            let output = net.forward(x_bchw);
            assert_eq!(output.value_bkhw.dims(), [2, 8, side / 4, side / 4]);
            assert_eq!(output.obstacle_b1hw.dims(), [2, 1, side, side]);
        }
    }

    #[test]
    fn the_papers_shapes() {
        let net = Nbp::new(&NetConfig::default(), 1, &Device::flex()).unwrap();
        let x_bchw = Tensor::zeros([1, 5, 256, 256], &Device::flex());
        assert_eq!(net.features(x_bchw.clone()).x5.dims(), [1, 1024, 16, 16]);
        let output = net.forward(x_bchw);
        assert_eq!(output.value_bkhw.dims(), [1, 8, 64, 64]);
        assert_eq!(output.obstacle_b1hw.dims(), [1, 1, 256, 256]);
    }

    #[test]
    fn weights_depend_on_the_seed_alone_and_keep_pytorchs_bounds() {
        let weight = |seed| {
            let net = Nbp::new(&small(4), seed, &Device::flex()).unwrap();
            net.value.head.weight.val().into_data().try_to_vec::<f32>().unwrap()
        };
        assert_eq!(weight(7), weight(7));
        assert_ne!(weight(7), weight(8));
        // fan-in 16: uniform in ±1/4, so its standard deviation is 1/4/√3.
        let w = weight(7);
        assert!(w.iter().all(|x| x.abs() <= 0.25));
        let deviation = (w.iter().map(|x| x * x).sum::<f32>() / w.len() as f32).sqrt();
        assert!((deviation - 0.144).abs() < 0.025, "{deviation}");
    }

    #[test]
    fn training_moves_the_running_statistics_and_inference_does_not() {
        let norm = Norm::new(1, &Init::zeros(&Device::flex()));
        let x = |device: &Device| Tensor::<4>::from_floats([[[[1.0, 3.0], [5.0, 7.0]]]], device);
        let read = |state: &burn::module::RunningState<Tensor<1>>| state.value_sync().into_scalar::<f32>();
        let _ = norm.forward(x(&Device::flex()));
        assert_eq!((read(&norm.running_mean), read(&norm.running_var)), (0.0, 1.0));

        let norm = Norm::new(1, &Init::zeros(&Device::flex().autodiff()));
        let y = norm.forward(x(&Device::flex().autodiff())).into_data().try_to_vec::<f32>().unwrap();
        let scale = 1.0 / 5.0f32.sqrt();
        for (got, want) in y.iter().zip([-3.0, -1.0, 1.0, 3.0].map(|v| v * scale)) {
            assert!((got - want).abs() < 1e-5, "{y:?}");
        }
        // Mean 4, unbiased variance 20/3, each with weight 0.1.
        assert!((read(&norm.running_mean) - 0.4).abs() < 1e-6);
        assert!((read(&norm.running_var) - (0.9 + 2.0 / 3.0)).abs() < 1e-6);
    }
}
