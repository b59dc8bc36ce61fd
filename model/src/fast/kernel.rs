//! The two inner loops of a convolution, on lines of numbers (see [`super::buffer`]).
//!
//! Vector registers hold a tile of sums; each number loaded is used several times before the next one is needed. `pulp`
//! picks the instruction set of the machine at run time, so sums are the same for any number of threads, but not on CPUs
//! with other vectors.

use pulp::{Arch, Simd, WithSimd};

/// Vectors of neighbouring pixels that [`Rows`] sums at a time.
const ACROSS: usize = 3;

/// Whether the machine has registers for the larger tiles.
pub(super) fn is_wide() -> bool {
    struct Registers;
    impl WithSimd for Registers {
        type Output = bool;
        #[inline(always)]
        fn with_simd<S: Simd>(self, _: S) -> bool {
            S::REGISTER_COUNT >= 32
        }
    }
    Arch::new().dispatch(Registers)
}

/// `CO` planes of a convolution's answer.
pub(super) struct Rows<'a, const CO: usize> {
    /// One sample, padded, from its first plane on.
    pub(super) x: &'a [f32],
    pub(super) plane: usize,
    pub(super) pitch: usize,
    /// Where each tap lies relative to the first.
    pub(super) taps: &'a [usize],
    /// Weights: input plane, tap, then `CO` outputs.
    pub(super) weights: &'a [[f32; CO]],
    pub(super) bias: [f32; CO],
    pub(super) height: usize,
    pub(super) width: usize,
    /// Up to `CO` planes of `height · width`.
    pub(super) out: &'a mut [f32],
}

impl<const CO: usize> WithSimd for Rows<'_, CO> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let end = (self.height - 1) * self.pitch + self.width;
        let mut at = 0;
        while at < end {
            at += S::F32_LANES
                * match (end - at).div_ceil(S::F32_LANES) {
                    1 => self.tile::<S, 1>(simd, at),
                    2 => self.tile::<S, 2>(simd, at),
                    _ => self.tile::<S, ACROSS>(simd, at),
                };
        }
    }
}

impl<const CO: usize> Rows<'_, CO> {
    /// Sums `N` vectors of pixels for all `CO` planes; returns `N`.
    #[inline(always)]
    fn tile<S: Simd, const N: usize>(&mut self, simd: S, at: usize) -> usize {
        let mut sums: [[S::f32s; N]; CO] = std::array::from_fn(|k| [simd.splat_f32s(self.bias[k]); N]);
        let x = &self.x[at..];
        for (channel, weights) in self.weights.chunks_exact(self.taps.len()).enumerate() {
            let line = &x[channel * self.plane..];
            for (weights, &tap) in weights.iter().zip(self.taps) {
                let (pixels, _) = S::as_simd_f32s(&line[tap..tap + N * S::F32_LANES]);
                for k in 0..CO {
                    let weight = simd.splat_f32s(weights[k]);
                    for n in 0..N {
                        sums[k][n] = simd.mul_add_e_f32s(weight, pixels[n], sums[k][n]);
                    }
                }
            }
        }
        for (sums, plane) in sums.iter().zip(self.out.chunks_exact_mut(self.height * self.width)) {
            copy_rows(bytemuck::cast_slice(sums), at, self.pitch, self.width, plane);
        }
        N
    }
}

/// Copies those numbers of a line that starts at `at` which are pixels, not border, into a plane.
#[inline(always)]
fn copy_rows(line: &[f32], at: usize, pitch: usize, width: usize, plane: &mut [f32]) {
    let end = at + line.len();
    let mut from = at;
    while from < end {
        let (y, x) = (from / pitch, from % pitch);
        let to = end.min((y + 1) * pitch);
        if x < width {
            let len = (width - x).min(to - from);
            let Some(row) = plane.get_mut(y * width + x..y * width + x + len) else { return };
            row.copy_from_slice(&line[from - at..from - at + len]);
        }
        from = to;
    }
}

/// Weight gradients of up to `CO` outputs: sums over pixels of gradient times input.
pub(super) struct Products<'a, const CO: usize, const CI: usize, const TAPS: usize> {
    /// All samples, padded; starts at the first pixel of the first plane, so that borders fall on zeros.
    pub(super) g: &'a [f32],
    /// All samples, padded as `g`.
    pub(super) x: &'a [f32],
    pub(super) plane: usize,
    /// Length of the line from the first pixel of a plane to its last.
    pub(super) end: usize,
    pub(super) batch: usize,
    pub(super) cin: usize,
    pub(super) cout: usize,
    /// First of the outputs to do.
    pub(super) first: usize,
    /// Rows of taps, `TAPS` in each.
    pub(super) taps: &'a [[usize; TAPS]],
    /// Outputs to do, then inputs, then taps; added to.
    pub(super) out: &'a mut [f32],
}

/// Pixels of a line that are summed in registers before the sums go to memory; keeps all planes of a piece in the cache.
const PIECE: usize = 1024;

impl<const CO: usize, const CI: usize, const TAPS: usize> WithSimd for Products<'_, CO, CI, TAPS> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let group = (PIECE / self.end).max(1);
        let per_output = self.cin * self.taps.len() * TAPS;
        let outputs = self.out.len() / per_output;
        for sample in (0..self.batch).step_by(group) {
            let samples = sample..(sample + group).min(self.batch);
            for at in (0..self.end).step_by(PIECE) {
                let vectors = (self.end - at).min(PIECE).div_ceil(S::F32_LANES);
                for input in (0..self.cin).step_by(CI) {
                    for (row, taps) in self.taps.iter().enumerate() {
                        let mut sums = [[[simd.splat_f32s(0.0); TAPS]; CI]; CO];
                        for sample in samples.clone() {
                            // Beyond the last plane the last one is taken again, and its sums are dropped below.
                            let g = std::array::from_fn(|k| {
                                let output = (self.first + k).min(self.cout - 1);
                                &self.g[(sample * self.cout + output) * self.plane + at..]
                            });
                            let x = std::array::from_fn(|i| {
                                let input = (input + i).min(self.cin - 1);
                                taps.map(|tap| &self.x[(sample * self.cin + input) * self.plane + at + tap..])
                            });
                            accumulate::<S, CO, CI, TAPS>(simd, g, x, vectors, &mut sums);
                        }
                        for (k, sums) in sums.iter().enumerate().take(outputs) {
                            for (i, sums) in sums.iter().enumerate().take(self.cin - input) {
                                let to = k * per_output + ((input + i) * self.taps.len() + row) * TAPS;
                                for (out, &sum) in self.out[to..to + TAPS].iter_mut().zip(sums) {
                                    *out += simd.reduce_sum_f32s(sum);
                                }
                            }
                        }
                    }
                }
            }
        }
    }
}

#[inline(always)]
fn accumulate<S: Simd, const CO: usize, const CI: usize, const TAPS: usize>(
    simd: S,
    g: [&[f32]; CO],
    x: [[&[f32]; TAPS]; CI],
    vectors: usize,
    sums: &mut [[[S::f32s; TAPS]; CI]; CO],
) {
    let len = vectors * S::F32_LANES;
    let g = g.map(|line| S::as_simd_f32s(&line[..len]).0);
    let x = x.map(|lines| lines.map(|line| S::as_simd_f32s(&line[..len]).0));
    let mut local = *sums;
    for v in 0..vectors {
        let g: [S::f32s; CO] = std::array::from_fn(|k| g[k][v]);
        for i in 0..CI {
            for t in 0..TAPS {
                let pixels = x[i][t][v];
                for k in 0..CO {
                    local[k][i][t] = simd.mul_add_e_f32s(g[k], pixels, local[k][i][t]);
                }
            }
        }
    }
    *sums = local;
}
