//! Twice the size by nearest neighbour, then a 3×3 convolution, without ever making the larger image.

use super::conv::{Geometry, Gradients, Kernels, plane_sums};
use super::kernel::Machine;
use super::winograd;

/// `x`: `[b, in, h, w]` → `[b, out, 2h, 2w]`, kernels of 3×3; `size` has `x`'s height and width.
pub(super) fn forward(on: Machine, size: Geometry, x: &[f32], kernels: Kernels<'_>) -> Vec<f32> {
    winograd::convolve_doubled(on, size, x, |o, i| kernels.nine(size, o, i), kernels.bias, kernels.relu)
}

/// Gradients of [`forward`] for the gradient `g` of its answer.
pub(super) fn backward(on: Machine, size: Geometry, x: &[f32], weight: &[f32], g: &[f32], want_x: bool) -> Gradients {
    let large = Geometry { height: 2 * size.height, width: 2 * size.width, ..size };
    let x_gradient = want_x.then(|| {
        let turned = Geometry { cin: size.cout, cout: size.cin, ..large };
        winograd::convolve_halved(on, turned, g, |o, i| weight.as_chunks().0[o * size.cin + i])
    });
    let weight = winograd::weight_gradient_doubled(on, size, x, g);
    Gradients { x: x_gradient, weight, bias: plane_sums(large, g) }
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

            let kernels = Kernels { weight: &weight, bias: &bias, scale: None, relu: false };
            for on in Machine::all() {
                assert_close("y", &forward(on, size, &x, kernels), &conv::forward(on, large, &doubled, kernels));
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
