//! The product of two matrices that lie as the kernel reads them.

use pulp::Simd;

/// `out[k][column] = Σ weights[input][k] · x[input][column]` for `CO` outputs; lines have `columns` numbers.
#[inline(always)]
pub(super) fn product<S: Simd, const CO: usize>(
    simd: S,
    weights: &[[f32; CO]],
    x: &[f32],
    columns: usize,
    out: &mut [f32],
) {
    let mut column = 0;
    while column + 2 * S::F32_LANES <= columns {
        tile::<S, CO, 2>(simd, weights, x, columns, column, out);
        column += 2 * S::F32_LANES;
    }
    while column < columns {
        tile::<S, CO, 1>(simd, weights, x, columns, column, out);
        column += S::F32_LANES;
    }
}

#[inline(always)]
fn tile<S: Simd, const CO: usize, const N: usize>(
    simd: S,
    weights: &[[f32; CO]],
    x: &[f32],
    columns: usize,
    column: usize,
    out: &mut [f32],
) {
    // Copied once they are whole: sums that are also looked up by index would live in memory, not in registers.
    let mut sums = [[simd.splat_f32s(0.0); N]; CO];
    sum::<S, CO, N>(simd, weights, &x[column..], columns, &mut sums);
    for (sums, out) in sums.iter().zip(out.chunks_exact_mut(columns)) {
        S::as_mut_simd_f32s(&mut out[column..column + N * S::F32_LANES]).0.copy_from_slice(sums);
    }
}

#[inline(always)]
fn sum<S: Simd, const CO: usize, const N: usize>(
    simd: S,
    weights: &[[f32; CO]],
    x: &[f32],
    columns: usize,
    sums: &mut [[S::f32s; N]; CO],
) {
    let mut local = [[simd.splat_f32s(0.0); N]; CO];
    for (weights, x) in weights.iter().zip(x.chunks(columns)) {
        let x = S::as_simd_f32s(&x[..N * S::F32_LANES]).0;
        let mut pixels = [simd.splat_f32s(0.0); N];
        for n in 0..N {
            pixels[n] = x[n];
        }
        for k in 0..CO {
            let weight = simd.splat_f32s(weights[k]);
            for n in 0..N {
                local[k][n] = simd.mul_add_e_f32s(weight, pixels[n], local[k][n]);
            }
        }
    }
    *sums = local;
}
