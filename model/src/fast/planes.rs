//! The two operations between convolutions that Burn does one number at a time: 2×2 maximum pool, and planes times one
//! plane (the attention gate).

use super::norm::Planes;
use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// Largest of each square of four: `[b, c, h, w]` → `[b, c, h/2, w/2]`, `h` and `w` even.
pub(super) fn pool(x: &[f32], width: usize) -> Vec<f32> {
    let half = width / 2;
    let mut out = vec![0.0; x.len() / 4];
    out.par_chunks_mut(half.max(1) * BAND).zip(x.par_chunks(4 * half.max(1) * BAND)).for_each(|(out, x)| {
        for (out, rows) in out.chunks_exact_mut(half).zip(x.chunks_exact(2 * width)) {
            let (upper, lower) = rows.split_at(width);
            let squares = upper.as_chunks::<2>().0.iter().zip(lower.as_chunks::<2>().0);
            for (out, (upper, lower)) in out.iter_mut().zip(squares) {
                *out = largest(largest(upper[0], upper[1]), largest(lower[0], lower[1]));
            }
        }
    });
    out
}

/// Gradient of [`pool`]: each square's goes to the first of its largest pixels, as in PyTorch.
pub(super) fn pool_backward(x: &[f32], width: usize, g: &[f32]) -> Vec<f32> {
    let (half, arch) = (width / 2, Arch::new());
    let mut out = vec![0.0; x.len()];
    let bands = out.par_chunks_mut(4 * half.max(1) * BAND).zip(x.par_chunks(4 * half.max(1) * BAND));
    bands.zip(g.par_chunks(half.max(1) * BAND)).for_each(|((out, x), g)| {
        arch.dispatch(Give { x, width, g, out });
    });
    out
}

/// A task of [`pool_backward`]: with wide instructions, and without branches, which nobody could predict.
struct Give<'a> {
    x: &'a [f32],
    width: usize,
    g: &'a [f32],
    out: &'a mut [f32],
}

impl WithSimd for Give<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { x, width, g, out } = self;
        let rows = out.chunks_exact_mut(2 * width).zip(x.chunks_exact(2 * width));
        for ((out, x), g) in rows.zip(g.chunks_exact(width / 2)) {
            let ((out_upper, out_lower), (upper, lower)) = (out.split_at_mut(width), x.split_at(width));
            let outs = out_upper.as_chunks_mut::<2>().0.iter_mut().zip(out_lower.as_chunks_mut::<2>().0);
            let squares = upper.as_chunks::<2>().0.iter().zip(lower.as_chunks::<2>().0);
            for (((out_upper, out_lower), (upper, lower)), &g) in outs.zip(squares).zip(g) {
                let is_lower = largest(lower[0], lower[1]) > largest(upper[0], upper[1]);
                let (upper_right, lower_right) = (upper[1] > upper[0], lower[1] > lower[0]);
                let give = |yes: bool| if yes { g } else { 0.0 };
                *out_upper = [give(!is_lower & !upper_right), give(!is_lower & upper_right)];
                *out_lower = [give(is_lower & !lower_right), give(is_lower & lower_right)];
            }
        }
    }
}

/// Output rows that make a task.
const BAND: usize = 64;

/// The larger number; a NaN on either side wins, so that a diverged network shows.
#[inline(always)]
fn largest(a: f32, b: f32) -> f32 {
    if (a > b) | a.is_nan() { a } else { b }
}

/// Every plane of a sample times the sample's one plane: `[b, c, area]` · `[b, 1, area]`.
pub(super) fn scale(size: Planes, x: &[f32], factor: &[f32]) -> Vec<f32> {
    let mut out = vec![0.0; x.len()];
    out.par_chunks_mut(size.area).zip(x.par_chunks(size.area)).enumerate().for_each(|(plane, (out, x))| {
        let factor = &factor[plane / size.channels * size.area..][..size.area];
        for ((out, x), factor) in out.iter_mut().zip(x).zip(factor) {
            *out = x * factor;
        }
    });
    out
}

/// Gradient of [`scale`] in the factor; that in `x` is [`scale`] itself.
pub(super) fn scale_backward(size: Planes, x: &[f32], g: &[f32]) -> Vec<f32> {
    let sample = size.channels * size.area;
    let mut out = vec![0.0; size.batch * size.area];
    out.par_chunks_mut(size.area).zip(x.par_chunks(sample).zip(g.par_chunks(sample))).for_each(|(out, (x, g))| {
        for (x, g) in x.chunks_exact(size.area).zip(g.chunks_exact(size.area)) {
            for ((out, x), g) in out.iter_mut().zip(x).zip(g) {
                *out += x * g;
            }
        }
    });
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pools_squares_and_returns_gradients_to_the_first_largest() {
        let x = [1.0, 5.0, 2.0, 2.0, 3.0, 4.0, 2.0, 2.0, -1.0, -2.0, 0.0, 7.0, -1.0, -3.0, 8.0, 7.0];
        assert_eq!(pool(&x, 4), [5.0, 2.0, -1.0, 8.0]);
        let want = [0., 10., 20., 0., 0., 0., 0., 0., 30., 0., 0., 0., 0., 0., 40., 0.];
        assert_eq!(pool_backward(&x, 4, &[10.0, 20.0, 30.0, 40.0]), want);
        for at in 0..4 {
            let mut x = [1.0, 2.0, 3.0, 4.0];
            x[at] = f32::NAN;
            assert!(pool(&x, 2)[0].is_nan());
        }
    }

    #[test]
    fn pools_more_rows_than_a_task_takes() {
        let (width, rows) = (6, 2 * BAND + 10);
        let x: Vec<f32> = (0..width * rows).map(|i| (i * 7919 % 101) as f32).collect();
        let pooled = pool(&x, width);
        for (at, &got) in pooled.iter().enumerate() {
            let (y, left) = (at / 3 * 2, at % 3 * 2);
            let square = [x[y * 6 + left], x[y * 6 + left + 1], x[y * 6 + 6 + left], x[y * 6 + 7 + left]];
            assert_eq!(got, square.into_iter().fold(0.0, f32::max));
        }
        let total: f32 = pool_backward(&x, width, &vec![1.0; pooled.len()]).iter().sum();
        assert_eq!(total, pooled.len() as f32);
    }

    #[test]
    fn scales_planes() {
        let size = Planes { batch: 2, channels: 2, area: 2 };
        let x = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0];
        assert_eq!(scale(size, &x, &[1.0, 10.0, 2.0, 0.5]), [1.0, 20.0, 3.0, 40.0, 10.0, 3.0, 14.0, 4.0]);
        assert_eq!(scale_backward(size, &x, &[1.0; 8]), [4.0, 6.0, 12.0, 14.0]);
    }
}
