//! Twice the size by nearest neighbour, then a 3×3 convolution, without ever making the larger image.
//!
//! Of the nine taps of an output pixel some fall on the same input pixel. Which ones depends only on whether the pixel's
//! row and column are even or odd, so each of these four quarters of the output is a 2×2 convolution of the small image
//! with sums of weights: 16 multiplications instead of 36.

use super::buffer::Padded;
use super::conv::{Geometry, Gradients, Source, plane_sums, products, rows};
use super::kernel::Machine;
use super::winograd;
use rayon::prelude::*;

/// Input row (or column) of the 2×2 kernel that the three taps of even and of odd output rows fall on.
const FALLS_ON: [[usize; 3]; 2] = [[0, 1, 1], [0, 0, 1]];

/// Where a quarter's first tap lies in the padded small image.
fn shift(quarter: usize, pitch: usize) -> usize {
    quarter / 2 * pitch + quarter % 2
}

/// The sums of weights: quarter, output, input, tap.
fn quarter_weights(weight: &[f32]) -> Vec<[f32; 4]> {
    let kernels = weight.as_chunks::<9>().0;
    let mut sums = vec![[0.0; 4]; 4 * kernels.len()];
    sums.par_chunks_mut(kernels.len()).enumerate().for_each(|(quarter, sums)| {
        let (rows, cols) = (FALLS_ON[quarter / 2], FALLS_ON[quarter % 2]);
        for (sums, kernel) in sums.iter_mut().zip(kernels) {
            (0..9).for_each(|t| sums[rows[t / 3] * 2 + cols[t % 3]] += kernel[t]);
        }
    });
    sums
}

/// `x`: `[b, in, h, w]`, `weight`: `[out, in, 3, 3]`, `bias`: `[out]` → `[b, out, 2h, 2w]`; `size` has `x`'s height and width.
pub(super) fn forward(on: Machine, size: Geometry, x: &[f32], weight: &[f32], bias: &[f32]) -> Vec<f32> {
    winograd::convolve_doubled(on, size, x, |o, i| weight.as_chunks().0[o * size.cin + i], bias)
}

pub(super) fn direct(on: Machine, size: Geometry, x: &[f32], weight: &[f32], bias: &[f32]) -> Vec<f32> {
    let small = Geometry { kernel: 2, ..size };
    let padded = Padded::new(x, size.height, size.width, 1);
    let kernels = quarter_weights(weight);
    let quarters: Vec<Vec<f32>> = (0..4)
        .map(|quarter| {
            let lines = (0..size.cin).map(|channel| channel * padded.plane + shift(quarter, padded.pitch)).collect();
            let sample = size.cin * padded.plane;
            let source = Source { numbers: &padded.numbers, pitch: padded.pitch, lines, sample };
            let kernels = &kernels[quarter * size.cout * size.cin..];
            rows(on, small, &source, |o, i, t| kernels[o * size.cin + i][t], bias)
        })
        .collect();
    interleave(on, size, &quarters)
}

/// Puts the pixels of the four quarters in their places.
fn interleave(on: Machine, size: Geometry, quarters: &[Vec<f32>]) -> Vec<f32> {
    let (area, width) = (size.area(), size.width);
    let mut out = vec![0.0; 4 * size.batch * size.cout * area];
    out.par_chunks_mut(4 * area).enumerate().for_each(|(plane, out)| {
        on.run(|| {
            for (y, row) in out.chunks_exact_mut(2 * width).enumerate() {
                let from = plane * area + y / 2 * width;
                let [even, odd] = [0, 1].map(|x| &quarters[y % 2 * 2 + x][from..from + width]);
                for ((pair, &even), &odd) in row.as_chunks_mut::<2>().0.iter_mut().zip(even).zip(odd) {
                    *pair = [even, odd];
                }
            }
        });
    });
    out
}

/// Gradients of [`forward`] for the gradient `g` of its answer.
pub(super) fn backward(on: Machine, size: Geometry, x: &[f32], weight: &[f32], g: &[f32], want_x: bool) -> Gradients {
    let padded_g = Padded::quarters(g, size.height, size.width);
    let quarter_len = size.batch * size.cout * padded_g.plane;
    let x_gradient = want_x.then(|| {
        let turned =
            Geometry { cin: size.cout, cout: size.cin, height: 2 * size.height, width: 2 * size.width, ..size };
        return winograd::convolve_halved(on, turned, g, |o, i| weight.as_chunks().0[o * size.cin + i]);
        // To the input, the quarters are four times as many planes, each with its kernel turned by 180°.
        let turned = Geometry { cin: 4 * size.cout, cout: size.cin, kernel: 2, ..size };
        let line = |quarter: usize, output: usize| {
            quarter * quarter_len + output * padded_g.plane + shift(3 - quarter, padded_g.pitch)
        };
        let lines = (0..4).flat_map(|quarter| (0..size.cout).map(move |output| line(quarter, output))).collect();
        let sample = size.cout * padded_g.plane;
        let source = Source { numbers: &padded_g.numbers, pitch: padded_g.pitch, lines, sample };
        let kernels = quarter_weights(weight);
        rows(on, turned, &source, |o, i, t| kernels[i * size.cin + o][3 - t], &vec![0.0; size.cin])
    });

    let padded_x = Padded::new(x, size.height, size.width, 1);
    let small = Geometry { kernel: 2, ..size };
    let mut weight_gradient = vec![0.0; weight.len()];
    for quarter in 0..4 {
        let x_from = &padded_x.numbers[shift(quarter, padded_x.pitch)..];
        let g_from = &padded_g.numbers[quarter * quarter_len + padded_g.first_pixel(1)..];
        let sums = products(on, small, &padded_x, x_from, g_from);
        let (rows, cols) = (FALLS_ON[quarter / 2], FALLS_ON[quarter % 2]);
        for (kernel, sums) in weight_gradient.as_chunks_mut::<9>().0.iter_mut().zip(sums.as_chunks::<4>().0) {
            (0..9).for_each(|t| kernel[t] += sums[rows[t / 3] * 2 + cols[t % 3]]);
        }
    }
    let large = Geometry { height: 2 * size.height, width: 2 * size.width, ..size };
    Gradients { x: x_gradient, weight: weight_gradient, bias: plane_sums(large, g) }
}

#[cfg(test)]
mod tests {
    use super::super::conv;
    use super::*;

    /// Numbers in `[-1, 1)` without a pattern.
    fn noise(count: usize, seed: u64) -> Vec<f32> {
        let mix = |i: u64| {
            (i + seed * 1_000_003)
                .wrapping_mul(0x9e37_79b9_7f4a_7c15)
                .rotate_left(23)
                .wrapping_mul(0xbf58_476d_1ce4_e5b9)
        };
        (0..count as u64).map(|i| (mix(i) >> 40) as f32 / (1u64 << 23) as f32 - 1.0).collect()
    }

    fn assert_close(what: &str, got: &[f32], want: &[f32]) {
        assert_eq!(got.len(), want.len(), "{what}");
        let largest = want.iter().fold(1.0f32, |max, x| max.max(x.abs()));
        for (at, (got, want)) in got.iter().zip(want).enumerate() {
            assert!((got - want).abs() <= 1e-5 * largest, "{what}[{at}]: {got} {want}");
        }
    }

    #[test]
    fn equals_the_convolution_of_the_larger_image() {
        for (batch, cin, cout, height, width) in
            [(2, 3, 5, 4, 6), (1, 8, 8, 16, 16), (3, 6, 9, 1, 1), (1, 16, 4, 20, 33)]
        {
            let size = Geometry { batch, cin, cout, height, width, kernel: 3 };
            let large = Geometry { height: 2 * height, width: 2 * width, ..size };
            let x = noise(batch * cin * height * width, 1);
            let (weight, bias) = (noise(cout * cin * 9, 2), noise(cout, 3));
            let g = noise(batch * cout * 4 * height * width, 4);
            let at = |i: usize| {
                i / (4 * height * width) * height * width
                    + i / (2 * width) % (2 * height) / 2 * width
                    + i % (2 * width) / 2
            };
            let doubled: Vec<f32> = (0..4 * x.len()).map(|i| x[at(i)]).collect();

            for on in Machine::all() {
                assert_close(
                    "y",
                    &forward(on, size, &x, &weight, &bias),
                    &conv::forward(on, large, &doubled, &weight, &bias),
                );
                let (got, want) =
                    (backward(on, size, &x, &weight, &g, true), conv::backward(on, large, &doubled, &weight, &g, true));
                let mut x_gradient = vec![0.0; x.len()];
                want.x.unwrap().iter().enumerate().for_each(|(i, g)| x_gradient[at(i)] += g);
                assert_close("x gradient", &got.x.unwrap(), &x_gradient);
                assert_close("weight gradient", &got.weight, &want.weight);
                assert_close("bias gradient", &got.bias, &want.bias);
            }
        }
    }
}
