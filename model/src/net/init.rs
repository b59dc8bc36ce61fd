//! First values of the weights: PyTorch's defaults, drawn from streams of our own.
//!
//! Burn's generator is one for each back end, so the same seed would give another network on another device. Here every
//! tensor has its own stream, named after its place in the network, and all devices start from the same bytes.

use burn::prelude::*;
use burn::tensor::TensorData;
use nbp_env::seed::SeedTree;
use rand::Rng as _;

/// A place in the network at which layers are made.
pub(crate) struct Init<'a> {
    device: &'a Device,
    /// `None` fills with zeros, for weights that are about to be loaded.
    stream: Option<SeedTree>,
}

impl<'a> Init<'a> {
    pub(crate) fn seeded(seed: u64, device: &'a Device) -> Self {
        Self { device, stream: Some(SeedTree::new(seed).child("weights", 0)) }
    }

    pub(crate) fn zeros(device: &'a Device) -> Self {
        Self { device, stream: None }
    }

    /// The place of a part.
    pub(crate) fn of(&self, part: &str) -> Self {
        Self { device: self.device, stream: self.stream.map(|stream| stream.child(part, 0)) }
    }

    pub(crate) fn device(&self) -> &Device {
        self.device
    }

    /// Uniform in `±1/√fan_in`: what Kaiming's uniform rule with a = √5 comes to for weights, and PyTorch's rule for
    /// biases.
    pub(crate) fn uniform<const D: usize>(&self, name: &str, shape: [usize; D], fan_in: usize) -> Tensor<D> {
        self.within(name, shape, 1.0 / (fan_in as f32).sqrt())
    }

    /// Uniform in `±bound`.
    pub(crate) fn within<const D: usize>(&self, name: &str, shape: [usize; D], bound: f32) -> Tensor<D> {
        let Some(stream) = self.stream else { return Tensor::zeros(shape, self.device) };
        let mut rng = stream.child(name, 0).rng();
        let values: Vec<f32> = (0..shape.iter().product())
            .map(|_| {
                let unit = (rng.next_u32() >> 8) as f32 / (1u32 << 24) as f32;
                (2.0 * unit - 1.0) * bound
            })
            .collect();
        Tensor::from_data(TensorData::new(values, shape), self.device)
    }
}
