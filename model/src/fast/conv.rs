//! A same-size convolution, forwards and backwards, on plain arrays.

use super::buffer::Padded;
use super::kernel::{Cover, Machine, Products, Rows};
use super::winograd;
use rayon::prelude::*;

/// Sizes of a convolution with stride 1 and zero padding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Geometry {
    pub(super) batch: usize,
    pub(super) cin: usize,
    pub(super) cout: usize,
    pub(super) height: usize,
    pub(super) width: usize,
    /// 1 or 3.
    pub(super) kernel: usize,
}

/// Gradients of a convolution.
#[derive(Debug)]
pub(super) struct Gradients {
    /// As the input, if it was asked for.
    pub(super) x: Option<Vec<f32>>,
    /// As the weights.
    pub(super) weight: Vec<f32>,
    /// As the bias.
    pub(super) bias: Vec<f32>,
}

impl Geometry {
    /// A kernel of one pixel does not look at neighbours: to it, a plane is one long row.
    fn flat(self) -> Self {
        if self.kernel == 1 { Self { height: 1, width: self.area(), ..self } } else { self }
    }

    pub(super) fn area(&self) -> usize {
        self.height * self.width
    }

    fn pad(&self, planes: &[f32]) -> Padded {
        Padded::new(planes, self.height, self.width, self.kernel / 2)
    }
}

/// What a convolution applies.
#[derive(Clone, Copy, Debug)]
pub(super) struct Kernels<'a> {
    /// `[out, in, k, k]`.
    pub(super) weight: &'a [f32],
    /// `[out]`.
    pub(super) bias: &'a [f32],
    /// `[out]`, a factor of all weights of an output: a batch norm that follows. `None`: 1.
    pub(super) scale: Option<&'a [f32]>,
    /// Whether negative answers become zero.
    pub(super) relu: bool,
}

impl Kernels<'_> {
    /// The nine weights of an output and an input.
    #[inline(always)]
    pub(super) fn nine(&self, size: Geometry, output: usize, input: usize) -> [f32; 9] {
        let mut nine = self.weight.as_chunks::<9>().0[output * size.cin + input];
        if let Some(scale) = self.scale {
            for weight in &mut nine {
                *weight *= scale[output];
            }
        }
        nine
    }
}

/// `x`: `[b, in, h, w]` → `[b, out, h, w]`.
pub(super) fn forward(on: Machine, size: Geometry, x: &[f32], kernels: Kernels<'_>) -> Vec<f32> {
    if winograd::takes(size) {
        return winograd::convolve(on, size, x, |o, i| kernels.nine(size, o, i), kernels.bias, kernels.relu);
    }
    let (size, taps) = (size.flat(), size.kernel * size.kernel);
    let Kernels { weight, bias, scale, relu } = kernels;
    let at = |o: usize, i: usize, t: usize| weight[(o * size.cin + i) * taps + t] * scale.map_or(1.0, |scale| scale[o]);
    let mut out = rows(on, size, &size.pad(x), at, bias);
    if relu {
        // Not `max`, which would turn a NaN into zero and hide a diverged network.
        out.par_iter_mut().filter(|y| **y < 0.0).for_each(|y| *y = 0.0);
    }
    out
}

/// Gradients of [`forward`] for the gradient `g` of its answer.
pub(super) fn backward(on: Machine, size: Geometry, x: &[f32], weight: &[f32], g: &[f32], want_x: bool) -> Gradients {
    // To the input, a convolution with the kernel turned by 180° and inputs and outputs exchanged.
    let turned = |size: Geometry| Geometry { cin: size.cout, cout: size.cin, ..size };
    let (no_bias, bias) = (vec![0.0; size.cin], plane_sums(size, g));
    if winograd::takes(size) {
        let kernel = |o: usize, i: usize| {
            let mut kernel = weight.as_chunks::<9>().0[i * size.cin + o];
            kernel.reverse();
            kernel
        };
        let x_gradient = want_x.then(|| winograd::convolve(on, turned(size), g, kernel, &no_bias, false));
        return Gradients { x: x_gradient, weight: winograd::weight_gradient(on, size, x, g), bias };
    }
    let (size, taps) = (size.flat(), size.kernel * size.kernel);
    let padded_g = size.pad(g);
    let at = |o: usize, i: usize, t: usize| weight[(i * size.cin + o) * taps + taps - 1 - t];
    let x_gradient = want_x.then(|| rows(on, turned(size), &padded_g, at, &no_bias));
    Gradients { x: x_gradient, weight: products(on, size, &size.pad(x), &padded_g), bias }
}

/// The convolution of padded planes; `weight(output, input, tap)`.
fn rows(
    on: Machine,
    size: Geometry,
    x: &Padded,
    weight: impl Fn(usize, usize, usize) -> f32 + Sync,
    bias: &[f32],
) -> Vec<f32> {
    if on.is_wide { rows_by::<8>(on, size, x, weight, bias) } else { rows_by::<4>(on, size, x, weight, bias) }
}

fn rows_by<const CO: usize>(
    on: Machine,
    size: Geometry,
    x: &Padded,
    weight: impl Fn(usize, usize, usize) -> f32 + Sync,
    bias: &[f32],
) -> Vec<f32> {
    let (area, kernel) = (size.area(), size.kernel);
    let taps: Vec<usize> = (0..kernel * kernel).map(|t| t / kernel * x.pitch + t % kernel).collect();
    let lines: Vec<usize> = (0..size.cin).map(|input| input * x.plane).collect();
    let cover = Cover::new(size.height, size.width, x.pitch, on.lanes);
    let per_block = size.cin * taps.len();
    // Weights in the order in which the kernel reads them; a block that is not full gets zeros.
    let mut packed = vec![[0.0; CO]; size.cout.div_ceil(CO) * per_block];
    packed.par_chunks_mut(per_block).enumerate().for_each(|(block, packed)| {
        let outputs = block * CO..size.cout.min((block + 1) * CO);
        for (input, packed) in packed.chunks_exact_mut(taps.len()).enumerate() {
            for (k, output) in outputs.clone().enumerate() {
                packed.iter_mut().enumerate().for_each(|(tap, packed)| packed[k] = weight(output, input, tap));
            }
        }
    });
    let mut out = vec![0.0; size.batch * size.cout * area];
    let tasks: Vec<_> = out
        .chunks_mut(size.cout * area)
        .enumerate()
        .flat_map(|(sample, out)| out.chunks_mut(CO * area).enumerate().map(move |(block, out)| (sample, block, out)))
        .collect();
    tasks.into_par_iter().for_each(|(sample, block, out)| {
        on.run(Rows::<CO> {
            x: &x.numbers[sample * size.cin * x.plane..],
            lines: &lines,
            taps: &taps,
            weights: &packed[block * per_block..(block + 1) * per_block],
            bias: std::array::from_fn(|k| bias.get(block * CO + k).copied().unwrap_or(0.0)),
            cover: &cover,
            area,
            out,
        });
    });
    out
}

/// The weights' gradient, `[out, in, k, k]`.
///
/// Each task owns a few outputs and walks all samples in order, so there are no partial sums that depend on the threads.
fn products(on: Machine, size: Geometry, x: &Padded, g: &Padded) -> Vec<f32> {
    match (size.kernel, on.is_wide) {
        (1, true) => products_by::<4, 4, 1>(on, size, x, g),
        (1, false) => products_by::<2, 4, 1>(on, size, x, g),
        (_, true) => products_by::<4, 2, 3>(on, size, x, g),
        (_, false) => products_by::<2, 2, 3>(on, size, x, g),
    }
}

fn products_by<const CO: usize, const CI: usize, const TAPS: usize>(
    on: Machine,
    size: Geometry,
    x: &Padded,
    g: &Padded,
) -> Vec<f32> {
    let taps: Vec<[usize; TAPS]> = (0..size.kernel).map(|y| std::array::from_fn(|t| y * x.pitch + t)).collect();
    let per_output = size.cin * size.kernel * size.kernel;
    let mut out = vec![0.0; size.cout * per_output];
    out.par_chunks_mut(CO * per_output).enumerate().for_each(|(block, out)| {
        on.run(Products::<CO, CI, TAPS> {
            g: &g.numbers[g.first_pixel(size.kernel / 2)..],
            x: &x.numbers,
            plane: x.plane,
            end: (size.height - 1) * x.pitch + size.width,
            batch: size.batch,
            cin: size.cin,
            cout: size.cout,
            first: block * CO,
            taps: &taps,
            out,
        });
    });
    out
}

/// Sums of each output plane over pixels and samples, in a fixed order.
pub(super) fn plane_sums(size: Geometry, g: &[f32]) -> Vec<f32> {
    let area = size.area();
    (0..size.cout)
        .into_par_iter()
        .map(|output| {
            let planes = (0..size.batch).map(|sample| &g[(sample * size.cout + output) * area..][..area]);
            planes.map(super::norm::sum).sum::<f64>() as f32
        })
        .collect()
}

#[cfg(test)]
mod tests;
