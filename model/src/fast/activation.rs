//! GELU and softmax in one pass over memory each, with an error function and an exponential that compute many numbers at a
//! time: those of the C library, which Burn calls, take one.
//!
//! Sums, products and quotients in a fixed order and nothing else: the same bits on every CPU.

use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;
use std::f32::consts::{FRAC_1_SQRT_2, LOG2_E, PI};

/// Numbers that make a task.
const TASK: usize = 1 << 14;
/// Partial sums side by side, so that additions need not wait for each other.
const LANES: usize = 16;

/// `x Φ(x)` of every number, within 1e-6 · max(1, |x|).
pub(super) fn gelu(x: &mut [f32]) {
    let arch = Arch::new();
    x.par_chunks_mut(TASK).for_each(|x| arch.dispatch(Gelu(x)));
}

/// Gradients `g` of the answers of [`gelu`] become those of `x`.
pub(super) fn gelu_backward(x: &[f32], g: &mut [f32]) {
    let arch = Arch::new();
    g.par_chunks_mut(TASK).zip(x.par_chunks(TASK)).for_each(|(g, x)| arch.dispatch(GeluBackward { x, g }));
}

/// Every row of so many numbers becomes its softmax.
pub(super) fn softmax(x: &mut [f32], row: usize) {
    let (arch, row) = (Arch::new(), row.max(1));
    x.par_chunks_mut((TASK / row).max(1) * row).for_each(|x| arch.dispatch(Softmax { x, row }));
}

/// Gradients `g` of the answers `y` of [`softmax`] become those of its numbers.
pub(super) fn softmax_backward(y: &[f32], g: &mut [f32], row: usize) {
    let (arch, row) = (Arch::new(), row.max(1));
    let task = (TASK / row).max(1) * row;
    g.par_chunks_mut(task).zip(y.par_chunks(task)).for_each(|(g, y)| arch.dispatch(SoftmaxBackward { y, g, row }));
}

/// The error function within 5e-7: Eigen's rational interpolant (`generic_fast_erf_float`; 1e-7 before rounding).
#[inline(always)]
fn erf(x: f32) -> f32 {
    /// From here on it is one but for rounding.
    const ONE: f32 = 3.92;
    const ABOVE: [f32; 7] = [
        -2.726_142_3e-10,
        2.770_681_4e-8,
        -2.101_024e-6,
        -5.692_506_5e-5,
        -7.349_906_3e-4,
        -2.954_6e-3,
        -1.609_603_3e-2,
    ];
    const BELOW: [f32; 5] = [-1.456_607_2e-5, -2.133_740_6e-4, -1.682_827e-3, -7.373_329e-3, -1.426_473_9e-2];
    let value = x * polynomial(ABOVE, x * x) / polynomial(BELOW, x * x);
    let value = if x > ONE { 1.0 } else { value };
    if x < -ONE { -1.0 } else { value }
}

/// The exponential of a number that is not above zero, within 2e-7 of itself, or zero where less than 2e-38: Cephes'
/// `expf`, a power of two times a polynomial in the rest.
#[inline(always)]
fn exp(x: f32) -> f32 {
    /// Too large for binary places: added to a number, it rounds that, and its last bits are the whole number.
    const ROUND: f32 = 12_582_912.0;
    /// The logarithm of two in two parts, the first of few enough bits that products with whole numbers are exact.
    const LN_2: [f32; 2] = [0.693_359_4, -2.121_944_4e-4];
    const REST: [f32; 6] = [1.987_569_2e-4, 1.398_199_9e-3, 8.333_452e-3, 4.166_579_6e-2, 1.666_666_5e-1, 0.5];
    let rounded = x * LOG2_E + ROUND;
    let whole = rounded - ROUND;
    let rest = x - whole * LN_2[0] - whole * LN_2[1];
    let power = f32::from_bits((rounded.to_bits() << 23).wrapping_add(1.0f32.to_bits()));
    let value = (polynomial(REST, rest) * rest * rest + rest + 1.0) * power;
    if x < -87.0 { 0.0 } else { value }
}

/// Coefficients from the highest power down.
#[inline(always)]
fn polynomial<const N: usize>(coefficients: [f32; N], x: f32) -> f32 {
    let mut value = coefficients[0];
    for &coefficient in &coefficients[1..] {
        value = value * x + coefficient;
    }
    value
}

struct Gelu<'a>(&'a mut [f32]);

impl WithSimd for Gelu<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for x in self.0 {
            *x *= 0.5 + 0.5 * erf(*x * FRAC_1_SQRT_2);
        }
    }
}

struct GeluBackward<'a> {
    x: &'a [f32],
    g: &'a mut [f32],
}

impl WithSimd for GeluBackward<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let peak = 1.0 / (2.0 * PI).sqrt();
        for (g, &x) in self.g.iter_mut().zip(self.x) {
            *g *= 0.5 + 0.5 * erf(x * FRAC_1_SQRT_2) + x * peak * exp(-0.5 * x * x);
        }
    }
}

struct Softmax<'a> {
    x: &'a mut [f32],
    row: usize,
}

impl WithSimd for Softmax<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for row in self.x.chunks_exact_mut(self.row) {
            let (whole, rest) = row.as_chunks_mut::<LANES>();
            // What fills up the last numbers has no exponential.
            let mut last = [f32::NEG_INFINITY; LANES];
            last[..rest.len()].copy_from_slice(rest);
            let largest = |a: f32, b: f32| if a > b { a } else { b };
            let tops = whole.iter().fold(last, |tops, x| std::array::from_fn(|n| largest(x[n], tops[n])));
            let top = folded(tops, largest);
            let mut sums = exponentials(whole, top, [0.0; LANES]);
            if !rest.is_empty() {
                sums = exponentials(std::slice::from_mut(&mut last), top, sums);
                rest.copy_from_slice(&last[..rest.len()]);
            }
            let inverse = 1.0 / folded(sums, |a, b| a + b);
            row.iter_mut().for_each(|x| *x *= inverse);
        }
    }
}

/// Numbers become the exponentials of what they are below `top`, which are added to the sums.
#[inline(always)]
fn exponentials(x: &mut [[f32; LANES]], top: f32, mut sums: [f32; LANES]) -> [f32; LANES] {
    for x in x {
        for (x, sum) in x.iter_mut().zip(&mut sums) {
            *x = exp(*x - top);
            *sum += *x;
        }
    }
    sums
}

/// One of many, by halves.
#[inline(always)]
fn folded(mut x: [f32; LANES], of: impl Fn(f32, f32) -> f32) -> f32 {
    let mut half = LANES / 2;
    while half > 0 {
        for n in 0..half {
            x[n] = of(x[n], x[n + half]);
        }
        half /= 2;
    }
    x[0]
}

struct SoftmaxBackward<'a> {
    y: &'a [f32],
    g: &'a mut [f32],
    row: usize,
}

impl WithSimd for SoftmaxBackward<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        for (g, y) in self.g.chunks_exact_mut(self.row).zip(self.y.chunks_exact(self.row)) {
            let mut sums = [0.0; LANES];
            for (g, y) in g.chunks(LANES).zip(y.chunks(LANES)) {
                for (sum, (g, y)) in sums.iter_mut().zip(g.iter().zip(y)) {
                    *sum += g * y;
                }
            }
            let mean = folded(sums, |a, b| a + b);
            g.iter_mut().zip(y).for_each(|(g, y)| *g = (*g - mean) * y);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::prelude::*;
    use burn::tensor::{DType, activation};

    /// What Burn answers in double precision.
    fn exact(x: &[f32], shape: [usize; 2], of: impl Fn(Tensor<2>) -> Tensor<2>) -> Vec<f64> {
        let numbers: Vec<f64> = x.iter().copied().map(f64::from).collect();
        let x = Tensor::from_data(TensorData::new(numbers, shape), (&Device::flex(), DType::F64));
        of(x).into_data().try_to_vec().unwrap()
    }

    fn all(f: fn(f32) -> f32, x: &[f32]) -> Vec<f64> {
        x.iter().map(|&x| f64::from(f(x))).collect()
    }

    #[test]
    fn errors_are_as_small_as_they_are_said_to_be() {
        let x: Vec<f32> = (-60_000..=60_000).map(|n| n as f32 / 10_000.0).collect();
        let shape = [1, x.len()];
        let worst = |got: &[f64], want: &[f64], size: &dyn Fn(usize) -> f64| {
            let errors = got.iter().zip(want).enumerate().map(|(n, (got, want))| (got - want).abs() / size(n));
            errors.fold(0.0, f64::max)
        };
        assert!(worst(&all(erf, &x), &exact(&x, shape, |x| x.erf()), &|_| 1.0) < 5e-7);
        let mut answers = x.clone();
        gelu(&mut answers);
        let answers: Vec<f64> = answers.into_iter().map(f64::from).collect();
        let size = |n: usize| f64::from(x[n].abs().max(1.0));
        assert!(worst(&answers, &exact(&x, shape, activation::gelu), &size) < 1e-6);

        let below: Vec<f32> = x.iter().map(|x| (x - 6.0) * 7.25).collect();
        let want = exact(&below, shape, |x| x.exp());
        assert!(worst(&all(exp, &below), &want, &|n| want[n]) < 2e-7);
    }

    #[test]
    fn ends_of_the_range_keep_their_values() {
        assert_eq!([-9.0, -1e30, f32::NEG_INFINITY, 9.0, 1e30, f32::INFINITY].map(erf), [-1., -1., -1., 1., 1., 1.]);
        assert_eq!([0.0, -88.0, -1e9, f32::NEG_INFINITY].map(exp), [1.0, 0.0, 0.0, 0.0]);
        let mut x = [-50.0, -0.0, 50.0, f32::NAN];
        gelu(&mut x);
        assert!(x[..3] == [0.0, 0.0, 50.0] && x[3].is_nan(), "{x:?}");
        let mut x = [0.0, 1.0, f32::NAN, 2.0];
        softmax(&mut x, 2);
        assert!(x[..2].iter().all(|x| x.is_finite()) && x[2..].iter().all(|x| x.is_nan()), "{x:?}");
    }

    #[test]
    fn rows_are_as_burns_whatever_their_length_and_the_number_of_threads() {
        for row in [1, 5, 16, 37, 640] {
            let rows = 2 * TASK / row + 3;
            let start: Vec<f32> = (0..rows * row).map(|n| (n * 7919 % 1009) as f32 / 50.0).collect();
            let run = |threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                let mut x = start.clone();
                pool.install(|| softmax(&mut x, row));
                let mut g = start.clone();
                pool.install(|| softmax_backward(&x, &mut g, row));
                (x, g)
            };
            let (y, g) = run(1);
            assert!((y.clone(), g.clone()) == run(3), "{row}");
            let want = exact(&start, [rows, row], |x| activation::softmax(x, 1));
            assert!(y.iter().zip(&want).all(|(y, want)| (f64::from(*y) - want).abs() < 1e-6), "{row}");
            let want = exact(&start, [rows, row], |x| {
                let y = activation::softmax(x.clone(), 1);
                (x.clone() - (x * y.clone()).sum_dim(1)) * y
            });
            assert!(g.iter().zip(&want).all(|(g, want)| (f64::from(*g) - want).abs() < 2e-5), "{row}");
        }
    }
}
