//! Batch normalisation with an optional ReLU behind it, forwards and backwards, on plain arrays.

use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// Sizes of a batch of images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Planes {
    pub(super) batch: usize,
    pub(super) channels: usize,
    pub(super) area: usize,
}

impl Planes {
    /// Numbers in a channel.
    fn count(&self) -> f64 {
        (self.batch * self.area) as f64
    }

    /// The planes of a channel.
    fn channel<'a>(&self, x: &'a [f32], channel: usize) -> impl Iterator<Item = &'a [f32]> + use<'a> {
        let Self { batch, channels, area } = *self;
        (0..batch).map(move |sample| &x[(sample * channels + channel) * area..][..area])
    }

    /// Fills an answer plane by plane, from channel and offset of each.
    fn fill(&self, write: impl Fn(usize, usize, &mut [f32]) + Sync) -> Vec<f32> {
        let mut out = vec![0.0; self.batch * self.channels * self.area];
        out.par_chunks_mut(self.area)
            .enumerate()
            .for_each(|(plane, out)| write(plane % self.channels, plane * self.area, out));
        out
    }
}

/// Mean and biased variance of each channel.
pub(super) fn statistics(size: Planes, x: &[f32]) -> (Vec<f32>, Vec<f32>) {
    (0..size.channels)
        .into_par_iter()
        .map(|channel| {
            let mean = size.channel(x, channel).map(sum).sum::<f64>() / size.count();
            let squares = size.channel(x, channel).map(|plane| sum_of_squares(plane, mean as f32));
            (mean as f32, (squares.sum::<f64>() / size.count()) as f32)
        })
        .unzip()
}

/// A channel's `(x - centre) · scale + shift`. The centre is kept apart: folded into the shift, it would cost the digits
/// of a channel whose mean is far from zero.
#[derive(Clone, Copy, Debug)]
struct Affine {
    centre: f32,
    scale: f32,
    shift: f32,
}

impl Affine {
    #[inline(always)]
    fn of(self, x: f32) -> f32 {
        (x - self.centre) * self.scale + self.shift
    }
}

/// The parameters of each channel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Channels<'a> {
    pub(super) mean: &'a [f32],
    pub(super) var: &'a [f32],
    pub(super) weight: &'a [f32],
    pub(super) bias: &'a [f32],
    pub(super) epsilon: f32,
    /// Whether negative answers become zero.
    pub(super) relu: bool,
}

impl Channels<'_> {
    fn affine(&self, c: usize) -> Affine {
        let scale = self.weight[c] / (self.var[c] + self.epsilon).sqrt();
        Affine { centre: self.mean[c], scale, shift: self.bias[c] }
    }

    /// Factor of the weights and bias of a convolution that does what one with `bias` and this norm after it do.
    pub(super) fn folded(&self, bias: &[f32]) -> (Vec<f32>, Vec<f32>) {
        let affine = |(c, &bias): (usize, &f32)| (self.affine(c).scale, self.affine(c).of(bias));
        bias.iter().enumerate().map(affine).unzip()
    }

    fn floor(&self) -> f32 {
        if self.relu { 0.0 } else { f32::NEG_INFINITY }
    }
}

/// `[b, c, area]` → `[b, c, area]`.
pub(super) fn forward(size: Planes, x: &[f32], channels: Channels<'_>) -> Vec<f32> {
    let (arch, floor) = (Arch::new(), channels.floor());
    size.fill(|channel, at, out| {
        let affine = channels.affine(channel);
        let x = &x[at..at + size.area];
        // Not `max`, which would turn a NaN into the floor and hide a diverged network.
        arch.dispatch(Each { out, x, g: x, of: |x, _| if affine.of(x) < floor { floor } else { affine.of(x) } });
    })
}

/// Gradients of a batch norm whose mean and variance are those of `x`.
#[derive(Debug)]
pub(super) struct Gradients {
    /// As the input.
    pub(super) x: Vec<f32>,
    /// `[c]`.
    pub(super) weight: Vec<f32>,
    /// `[c]`.
    pub(super) bias: Vec<f32>,
}

/// Gradients of [`forward`] with [`statistics`] for the gradient `g` of its answer.
pub(super) fn backward(size: Planes, x: &[f32], channels: Channels<'_>, g: &[f32]) -> Gradients {
    let (arch, floor) = (Arch::new(), channels.floor());
    let inverse = |c: usize| 1.0 / (channels.var[c] + channels.epsilon).sqrt();
    let (weight, bias): (Vec<f32>, Vec<f32>) = (0..size.channels)
        .into_par_iter()
        .map(|c| {
            let affine = channels.affine(c);
            let planes = size.channel(x, c).zip(size.channel(g, c));
            let (products, sums) = planes
                .map(|(x, g)| arch.dispatch(Pair { x, g, affine, floor }))
                .fold((0.0, 0.0), |total, part| (total.0 + part.0, total.1 + part.1));
            ((products * f64::from(inverse(c))) as f32, sums as f32)
        })
        .unzip();
    let x_gradient = size.fill(|c, at, out| {
        let affine = channels.affine(c);
        // scale · (g - mean of g - x̂ · mean of g·x̂)
        let along = affine.scale * weight[c] * inverse(c) / size.count() as f32;
        let constant = affine.scale * bias[c] / size.count() as f32;
        let (x, g) = (&x[at..at + size.area], &g[at..at + size.area]);
        let of = |x, g| {
            let g = if affine.of(x) > floor { g } else { 0.0 };
            g * affine.scale - (x - affine.centre) * along - constant
        };
        arch.dispatch(Each { out, x, g, of });
    });
    Gradients { x: x_gradient, weight, bias }
}

/// A pass over two planes into a third.
struct Each<'a, F> {
    out: &'a mut [f32],
    x: &'a [f32],
    g: &'a [f32],
    of: F,
}

impl<F: Fn(f32, f32) -> f32> WithSimd for Each<'_, F> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for ((out, &x), &g) in self.out.iter_mut().zip(self.x).zip(self.g) {
            *out = (self.of)(x, g);
        }
    }
}

/// Numbers summed in single precision before the sum is added up in double precision.
const RUN: usize = 1024;
/// Partial sums side by side, so that additions need not wait for each other.
const LANES: usize = 32;

/// Sum in a fixed order.
pub(super) fn sum(x: &[f32]) -> f64 {
    Arch::new().dispatch(Sum { x, of: |x| x })
}

fn sum_of_squares(x: &[f32], mean: f32) -> f64 {
    Arch::new().dispatch(Sum { x, of: |x| (x - mean) * (x - mean) })
}

struct Sum<'a, F> {
    x: &'a [f32],
    of: F,
}

impl<F: Fn(f32) -> f32> WithSimd for Sum<'_, F> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> f64 {
        let mut total = 0.0;
        for run in self.x.chunks(RUN) {
            let mut partial = [0.0f32; LANES];
            let (whole, rest) = run.as_chunks::<LANES>();
            for group in whole {
                for (partial, &x) in partial.iter_mut().zip(group) {
                    *partial += (self.of)(x);
                }
            }
            for (partial, &x) in partial.iter_mut().zip(rest) {
                *partial += (self.of)(x);
            }
            total += partial.iter().map(|&x| f64::from(x)).sum::<f64>();
        }
        total
    }
}

/// `Σ g·(x - centre)` and `Σ g` over the pixels that pass the ReLU.
struct Pair<'a> {
    x: &'a [f32],
    g: &'a [f32],
    affine: Affine,
    floor: f32,
}

impl WithSimd for Pair<'_> {
    type Output = (f64, f64);

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> (f64, f64) {
        let mut total = (0.0, 0.0);
        for (x, g) in self.x.chunks(RUN).zip(self.g.chunks(RUN)) {
            let (mut products, mut sums) = ([0.0f32; LANES], [0.0f32; LANES]);
            let mut add = |x: &[f32], g: &[f32]| {
                for ((product, sum), (&x, &g)) in products.iter_mut().zip(&mut sums).zip(x.iter().zip(g)) {
                    let g = if self.affine.of(x) > self.floor { g } else { 0.0 };
                    *product += g * (x - self.affine.centre);
                    *sum += g;
                }
            };
            let ((x, last_x), (g, last_g)) = (x.as_chunks::<LANES>(), g.as_chunks::<LANES>());
            x.iter().zip(g).for_each(|(x, g)| add(x, g));
            add(last_x, last_g);
            total.0 += products.iter().map(|&x| f64::from(x)).sum::<f64>();
            total.1 += sums.iter().map(|&x| f64::from(x)).sum::<f64>();
        }
        total
    }
}

#[cfg(test)]
mod tests;
