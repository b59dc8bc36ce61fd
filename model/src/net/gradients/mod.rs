//! Gradients of every part of the network, from definitions that share no code with the kernels.
//!
//! [`convolutions`] holds them against plain loops in double precision. [`parts`] differentiates every module twice: as
//! it trains, in single precision by the kernels, and in double precision by Burn's operators, which the kernels leave
//! alone; the latter are held against finite differences. [`nan`] sees that a diverged network shows.

mod convolutions;
mod nan;
pub(crate) mod parts;

use burn::prelude::*;
use burn::tensor::{DType, TensorData};
use nbp_env::seed::SeedTree;
use rand::Rng as _;

/// Numbers in `[-1, 1)` of the single-precision grid, the same for a name in every test.
pub(crate) fn noise(name: &str, count: usize) -> Vec<f64> {
    let mut rng = SeedTree::new(0).child(name, 0).rng();
    (0..count).map(|_| f64::from(rng.next_u32() >> 8) / f64::from(1u32 << 23) - 1.0).collect()
}

fn trained() -> Device {
    Device::flex().autodiff()
}

pub(crate) fn tensor<const D: usize>(numbers: &[f64], shape: [usize; D], dtype: DType) -> Tensor<D> {
    Tensor::from_data(TensorData::new(numbers.to_vec(), shape), (&trained(), dtype))
}

pub(crate) fn numbers<const D: usize>(tensor: Tensor<D>) -> Vec<f64> {
    tensor.without_autodiff().into_data().iter::<f64>().collect()
}
