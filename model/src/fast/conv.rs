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
    /// 1 or 3, or 2 for a quarter of an [`super::up`] convolution.
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

/// `x`: `[b, in, h, w]`, `weight`: `[out, in, k, k]`, `bias`: `[out]` → `[b, out, h, w]`.
pub(super) fn forward(on: Machine, size: Geometry, x: &[f32], weight: &[f32], bias: &[f32]) -> Vec<f32> {
    if winograd::takes(size) {
        return winograd::convolve(on, size, x, |o, i| weight.as_chunks().0[o * size.cin + i], bias);
    }
    direct(on, size, x, weight, bias)
}

pub(super) fn direct(on: Machine, size: Geometry, x: &[f32], weight: &[f32], bias: &[f32]) -> Vec<f32> {
    let (size, taps) = (size.flat(), size.kernel * size.kernel);
    rows(on, size, &Source::new(&size.pad(x), size.cin), |o, i, t| weight[(o * size.cin + i) * taps + t], bias)
}

/// Gradients of [`forward`] for the gradient `g` of its answer.
pub(super) fn backward(on: Machine, size: Geometry, x: &[f32], weight: &[f32], g: &[f32], want_x: bool) -> Gradients {
    let (size, taps) = (size.flat(), size.kernel * size.kernel);
    let padded_g = size.pad(g);
    let x_gradient = want_x.then(|| {
        // A convolution with the kernel turned by 180° and inputs and outputs exchanged.
        let turned = Geometry { cin: size.cout, cout: size.cin, ..size };
        if winograd::takes(size) {
            let kernel = |o: usize, i: usize| {
                let mut kernel = weight.as_chunks::<9>().0[i * size.cin + o];
                kernel.reverse();
                kernel
            };
            return winograd::convolve(on, turned, g, kernel, &vec![0.0; size.cin]);
        }
        let at = |o: usize, i: usize, t: usize| weight[(i * size.cin + o) * taps + taps - 1 - t];
        rows(on, turned, &Source::new(&padded_g, size.cout), at, &vec![0.0; size.cin])
    });
    let padded_x = size.pad(x);
    let g_from = &padded_g.numbers[padded_g.first_pixel(size.kernel / 2)..];
    let weight = products(on, size, &padded_x, &padded_x.numbers, g_from);
    Gradients { x: x_gradient, weight, bias: plane_sums(size, g) }
}

/// Padded planes that a convolution reads.
#[derive(Debug)]
pub(super) struct Source<'a> {
    pub(super) numbers: &'a [f32],
    /// Numbers from row to row.
    pub(super) pitch: usize,
    /// Where the line of each input plane of the first sample starts.
    pub(super) lines: Vec<usize>,
    /// Numbers from sample to sample.
    pub(super) sample: usize,
}

impl<'a> Source<'a> {
    /// Samples of `channels` planes, one after the other.
    fn new(padded: &'a Padded, channels: usize) -> Self {
        let lines = (0..channels).map(|channel| channel * padded.plane).collect();
        Self { numbers: &padded.numbers, pitch: padded.pitch, lines, sample: channels * padded.plane }
    }
}

/// The convolution of padded planes; `weight(output, input, tap)`.
pub(super) fn rows(
    on: Machine,
    size: Geometry,
    x: &Source<'_>,
    weight: impl Fn(usize, usize, usize) -> f32 + Sync,
    bias: &[f32],
) -> Vec<f32> {
    if on.is_wide { rows_by::<8>(on, size, x, weight, bias) } else { rows_by::<4>(on, size, x, weight, bias) }
}

fn rows_by<const CO: usize>(
    on: Machine,
    size: Geometry,
    x: &Source<'_>,
    weight: impl Fn(usize, usize, usize) -> f32 + Sync,
    bias: &[f32],
) -> Vec<f32> {
    let (area, kernel) = (size.area(), size.kernel);
    let taps: Vec<usize> = (0..kernel * kernel).map(|t| t / kernel * x.pitch + t % kernel).collect();
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
            x: &x.numbers[sample * x.sample..],
            lines: &x.lines,
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

/// The weights' gradient, `[out, in, k, k]`, of inputs `x` and gradients `g`, both padded as `shape`; `x` starts at the
/// first tap and `g` at the first pixel.
///
/// Each task owns a few outputs and walks all samples in order, so there are no partial sums that depend on the threads.
pub(super) fn products(on: Machine, size: Geometry, shape: &Padded, x: &[f32], g: &[f32]) -> Vec<f32> {
    match (size.kernel, on.is_wide) {
        (1, true) => products_by::<4, 4, 1>(on, size, shape, x, g),
        (1, false) => products_by::<2, 4, 1>(on, size, shape, x, g),
        (2, true) => products_by::<4, 2, 2>(on, size, shape, x, g),
        (2, false) => products_by::<2, 2, 2>(on, size, shape, x, g),
        (_, true) => products_by::<4, 2, 3>(on, size, shape, x, g),
        (_, false) => products_by::<2, 2, 3>(on, size, shape, x, g),
    }
}

fn products_by<const CO: usize, const CI: usize, const TAPS: usize>(
    on: Machine,
    size: Geometry,
    shape: &Padded,
    x: &[f32],
    g: &[f32],
) -> Vec<f32> {
    let taps: Vec<[usize; TAPS]> = (0..size.kernel).map(|y| std::array::from_fn(|t| y * shape.pitch + t)).collect();
    let per_output = size.cin * size.kernel * size.kernel;
    let mut out = vec![0.0; size.cout * per_output];
    out.par_chunks_mut(CO * per_output).enumerate().for_each(|(block, out)| {
        on.run(Products::<CO, CI, TAPS> {
            g,
            x,
            plane: shape.plane,
            end: (size.height - 1) * shape.pitch + size.width,
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
