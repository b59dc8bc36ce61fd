//! The transforms of pixels, weights and answers to and from the points of a tile.
//!
//! In one direction, for pixels `d`, weights `w` and answers `y = Aᵀ[(G w) ⊙ (Bᵀ d)]`, both directions the same way:
//!
//! ```text
//! Same      Bᵀ = 1  0 -1  0     G = 1   0   0     Aᵀ = 1  1  1  0     d = four pixels, the first left of the tile
//!                0  1  1  0         ½   ½   ½          0  1 -1 -1
//!                0 -1  1  0         ½  -½   ½
//!                0  1  0 -1         0   0   1
//!
//! Doubled   Bᵀ = 1 -1  0        G = 1   0   0     Aᵀ = 1  1  0        d = three pixels of the small image
//!                0  1  0            1   1   1          0  1 -1
//!                0  1 -1            0   0   1
//!
//! Halved    Bᵀ = 1  0 -1  0     G = 0   0   1     Aᵀ = 1  1  1        d = four pixels of the large gradient
//!                0  1  1  0         1   1   1
//!                0  1  0 -1        -1   0   0
//! ```
//!
//! `Doubled` is `Same` with `d = (p, q, q, r)`: its third point is `q - q = 0`, and the factor 2 of its second goes into the
//! weights. `Halved` is `Doubled` turned around (its transposed matrix), with the answers' `A` and the pixels' `B` joined, so
//! that what is left to do after the products is to add them up.

use pulp::{Simd, WithSimd};

/// Lines of numbers are a multiple of this, the widest vector.
pub(super) const ALIGN: usize = 16;

/// Which convolution.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Form {
    /// Of the image: 4 × 4 points.
    Same,
    /// Of the image at twice its size, whose pixels are equal in pairs, so that one point in each direction is always zero:
    /// 3 × 3 points.
    Doubled,
    /// The gradient of `Doubled` in its input: one pixel for each tile of the larger image. At the same three points in
    /// each direction, and the answers of all points are added up.
    Halved,
}

impl Form {
    /// Points in one direction.
    pub(super) fn side(self) -> usize {
        if self == Self::Same { 4 } else { 3 }
    }

    /// Points of a tile.
    pub(super) fn points(self) -> usize {
        self.side() * self.side()
    }

    /// Tiles in a direction of an image of so many pixels.
    pub(super) fn tiles(self, pixels: usize) -> usize {
        if self == Self::Doubled { pixels } else { pixels / 2 }
    }

    /// Output pixels in a direction of a tile.
    pub(super) fn pixels(self) -> usize {
        if self == Self::Halved { 1 } else { 2 }
    }

    /// Three weights at the points of one direction.
    #[inline(always)]
    fn along<const CO: usize>(self, [a, b, c]: &[[f32; CO]; 3]) -> [[f32; CO]; 4] {
        let mut points = [*a, [0.0; CO], [0.0; CO], *c];
        for k in 0..CO {
            let total = a[k] + b[k] + c[k];
            match self {
                Self::Same => {
                    let (sum, middle) = (0.5 * (a[k] + c[k]), 0.5 * b[k]);
                    (points[1][k], points[2][k]) = (sum + middle, sum - middle);
                }
                Self::Doubled => (points[1][k], points[2][k]) = (total, c[k]),
                Self::Halved => (points[0][k], points[1][k], points[2][k]) = (c[k], total, -a[k]),
            }
        }
        points
    }
}

/// The weights of up to `CO` outputs at each point, in the order in which [`super::matrix`] reads them.
pub(super) struct Weights<'a, Kernel, const CO: usize> {
    pub(super) form: Form,
    pub(super) cin: usize,
    /// Outputs to do; the others get zeros.
    pub(super) outputs: usize,
    /// Of an output and an input.
    pub(super) kernel: Kernel,
    /// Point, input, output.
    pub(super) packed: &'a mut [f32],
}

impl<Kernel: Fn(usize, usize) -> [f32; 9], const CO: usize> WithSimd for Weights<'_, Kernel, CO> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { form, cin, outputs, kernel, packed } = self;
        let (packed, side) = (packed.as_chunks_mut::<CO>().0, form.side());
        for input in 0..cin {
            let mut kernels = [[0.0; 9]; CO];
            for (k, to) in kernels.iter_mut().enumerate().take(outputs) {
                *to = kernel(k, input);
            }
            let mut taps = [[0.0; CO]; 9];
            for tap in 0..9 {
                for k in 0..CO {
                    taps[tap][k] = kernels[k][tap];
                }
            }
            let mut rows = [[[0.0; CO]; 4]; 3];
            for (row, taps) in rows.iter_mut().zip(taps.as_chunks::<3>().0) {
                *row = form.along(taps);
            }
            for x in 0..side {
                let column = form.along(&[rows[0][x], rows[1][x], rows[2][x]]);
                for y in 0..side {
                    packed[(side * y + x) * cin + input] = column[y];
                }
            }
        }
    }
}

/// Four pixels at four points.
#[inline(always)]
pub(super) fn of_four<S: Simd>(simd: S, [a, b, c, d]: [S::f32s; 4]) -> [S::f32s; 4] {
    [simd.sub_f32s(a, c), simd.add_f32s(b, c), simd.sub_f32s(c, b), simd.sub_f32s(b, d)]
}

/// Three pixels, the middle one twice, at three points.
#[inline(always)]
pub(super) fn of_three<S: Simd>(simd: S, [a, b, c]: [S::f32s; 3]) -> [S::f32s; 3] {
    [simd.sub_f32s(a, b), b, simd.sub_f32s(b, c)]
}

/// Two pixels from four points.
#[inline(always)]
pub(super) fn from_four<S: Simd>(simd: S, [a, b, c, d]: [S::f32s; 4]) -> [S::f32s; 2] {
    [simd.add_f32s(simd.add_f32s(a, b), c), simd.sub_f32s(simd.sub_f32s(b, c), d)]
}

/// Two pixels from three points.
#[inline(always)]
pub(super) fn from_three<S: Simd>(simd: S, [a, b, c]: [S::f32s; 3]) -> [S::f32s; 2] {
    [simd.add_f32s(a, b), simd.sub_f32s(b, c)]
}

#[inline(always)]
pub(super) fn load<S: Simd>(line: &[f32], at: usize) -> S::f32s {
    S::as_simd_f32s(&line[at..at + S::F32_LANES]).0[0]
}

#[inline(always)]
pub(super) fn store<S: Simd>(line: &mut [f32], at: usize, value: S::f32s) {
    S::as_mut_simd_f32s(&mut line[at..at + S::F32_LANES]).0[0] = value;
}
