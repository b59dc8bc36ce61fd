//! The two inner loops of a direct convolution (odd sides, or one pixel), on lines of numbers (see [`super::buffer`]).
//!
//! Vector registers hold a tile of sums; each number loaded is used several times before the next one is needed. `pulp`
//! picks the instruction set of the machine at run time, so sums are the same for any number of threads, but not on CPUs
//! with other vectors.

use pulp::{Arch, Simd, WithSimd};

/// Vectors of pixels that [`Rows`] sums at a time.
const ACROSS: usize = 3;

/// The instruction set to use.
#[derive(Clone, Copy, Debug)]
pub(super) struct Machine {
    arch: Arch,
    /// Numbers in a register.
    pub(super) lanes: usize,
    /// Whether there are registers for the larger tiles.
    pub(super) is_wide: bool,
}

impl Machine {
    /// The best that this computer has.
    pub(super) fn new() -> Self {
        Self::with(Arch::new())
    }

    fn with(arch: Arch) -> Self {
        let (lanes, registers) = arch.dispatch(Registers);
        Self { arch, lanes, is_wide: registers >= 32 }
    }

    /// All that this computer has.
    #[cfg(test)]
    pub(super) fn all() -> Vec<Self> {
        let mut all = vec![Self::new(), Self::with(Arch::Scalar)];
        #[cfg(target_arch = "x86_64")]
        all.extend(pulp::x86::V3::try_new().map(|v3| Self::with(Arch::V3(v3))));
        all
    }

    pub(super) fn run<Op: WithSimd>(self, op: Op) -> Op::Output {
        self.arch.dispatch(op)
    }
}

/// Lanes and number of the registers.
struct Registers;

impl WithSimd for Registers {
    type Output = (usize, usize);

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> (usize, usize) {
        (S::F32_LANES, S::REGISTER_COUNT)
    }
}

/// A vector of pixels of a padded plane and where its pixels go.
#[derive(Clone, Copy, Debug)]
pub(super) struct Vector {
    /// Its first number in the line, seen from the first tap.
    origin: usize,
    /// Its pixels are these of the [`Spans`].
    first: usize,
    last: usize,
}

/// Pixels of a vector that are neighbours in a row.
#[derive(Clone, Copy, Debug)]
struct Span {
    lane: usize,
    pixel: usize,
    len: usize,
}

/// How vectors cover a plane.
#[derive(Debug)]
pub(super) struct Cover {
    vectors: Vec<Vector>,
    spans: Vec<Span>,
}

impl Cover {
    pub(super) fn new(height: usize, width: usize, pitch: usize, lanes: usize) -> Self {
        let mut cover = Self { vectors: Vec::new(), spans: Vec::new() };
        if width.is_multiple_of(lanes) {
            for (y, x) in (0..height).flat_map(|y| (0..width).step_by(lanes).map(move |x| (y, x))) {
                cover.push(y * pitch + x, [Span { lane: 0, pixel: y * width + x, len: lanes }]);
            }
            return cover;
        }
        // Vectors run on over the borders, whose numbers are not kept: a short row would leave most lanes empty.
        for origin in (0..(height - 1) * pitch + width).step_by(lanes) {
            let rows = origin / pitch..height.min((origin + lanes).div_ceil(pitch));
            cover.push(
                origin,
                rows.filter_map(|y| {
                    let from = origin.max(y * pitch);
                    let to = (origin + lanes).min(y * pitch + width);
                    (from < to).then(|| Span {
                        lane: from - origin,
                        pixel: y * width + from - y * pitch,
                        len: to - from,
                    })
                }),
            );
        }
        cover
    }

    fn push(&mut self, origin: usize, spans: impl IntoIterator<Item = Span>) {
        let first = self.spans.len();
        self.spans.extend(spans);
        self.vectors.push(Vector { origin, first, last: self.spans.len() });
    }
}

/// `CO` planes of a convolution's answer.
pub(super) struct Rows<'a, const CO: usize> {
    /// One sample, padded.
    pub(super) x: &'a [f32],
    /// Where the line of each input plane starts.
    pub(super) lines: &'a [usize],
    /// Where each tap lies relative to the first.
    pub(super) taps: &'a [usize],
    /// Weights: input plane, tap, then `CO` outputs.
    pub(super) weights: &'a [[f32; CO]],
    pub(super) bias: [f32; CO],
    pub(super) cover: &'a Cover,
    /// Pixels of an output plane.
    pub(super) area: usize,
    /// Up to `CO` planes.
    pub(super) out: &'a mut [f32],
}

impl<const CO: usize> WithSimd for Rows<'_, CO> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let (tiles, rest) = self.cover.vectors.as_chunks::<ACROSS>();
        for &tile in tiles {
            self.tile::<S, ACROSS>(simd, tile);
        }
        for &vector in rest {
            self.tile::<S, 1>(simd, [vector]);
        }
    }
}

impl<const CO: usize> Rows<'_, CO> {
    /// `N` vectors of pixels for all `CO` planes.
    #[inline(always)]
    fn tile<S: Simd, const N: usize>(&mut self, simd: S, vectors: [Vector; N]) {
        // Copied once they are whole: sums that are also looked up by index would live in memory, not in registers.
        let mut sums = [[simd.splat_f32s(0.0); N]; CO];
        self.sum(simd, vectors, &mut sums);
        for (sums, plane) in sums.iter().zip(self.out.chunks_exact_mut(self.area)) {
            for (sum, vector) in sums.iter().zip(vectors) {
                for span in &self.cover.spans[vector.first..vector.last] {
                    let pixels = &mut plane[span.pixel..span.pixel + span.len];
                    match S::as_mut_simd_f32s(pixels).0 {
                        [whole] => *whole = *sum,
                        _ => {
                            let numbers: &[f32] = bytemuck::cast_slice(std::slice::from_ref(sum));
                            pixels.copy_from_slice(&numbers[span.lane..span.lane + span.len]);
                        }
                    }
                }
            }
        }
    }

    #[inline(always)]
    fn sum<S: Simd, const N: usize>(&self, simd: S, vectors: [Vector; N], sums: &mut [[S::f32s; N]; CO]) {
        let mut local: [[S::f32s; N]; CO] = std::array::from_fn(|k| [simd.splat_f32s(self.bias[k]); N]);
        for (&start, weights) in self.lines.iter().zip(self.weights.chunks_exact(self.taps.len())) {
            let lines = vectors.map(|vector| &self.x[start + vector.origin..]);
            for (weights, &tap) in weights.iter().zip(self.taps) {
                let pixels = lines.map(|line| S::as_simd_f32s(&line[tap..tap + S::F32_LANES]).0[0]);
                for k in 0..CO {
                    let weight = simd.splat_f32s(weights[k]);
                    for n in 0..N {
                        local[k][n] = simd.mul_add_e_f32s(weight, pixels[n], local[k][n]);
                    }
                }
            }
        }
        *sums = local;
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
