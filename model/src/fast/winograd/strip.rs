//! Strips of tiles: their inputs at the points, and their answers.

use super::super::conv::Geometry;
use super::matrix::product;
use super::points::{ALIGN, Form, from_four, from_three, load, of_four, of_three, store};
use pulp::{Simd, WithSimd};
use std::ops::Range;

/// How the tiles of a batch are cut into strips: a few rows of one sample, or all rows of a few samples.
#[derive(Clone, Copy, Debug)]
pub(super) struct Strips {
    batch: usize,
    cin: usize,
    /// Of the image that is stored.
    height: usize,
    width: usize,
    /// Tiles from top to bottom, and from left to right.
    high: usize,
    wide: usize,
    /// Samples of a strip.
    samples: usize,
    /// Rows of tiles of a strip, in each of its samples.
    pub(super) rows: usize,
    points: usize,
    /// Length of the lines of its matrices.
    columns: usize,
    /// Length of all lines of a point.
    plane: usize,
}

impl Strips {
    pub(super) fn new(form: Form, size: Geometry) -> Self {
        Self::of(form, size, if size.cin > 64 { 32 } else { 64 })
    }

    /// Strips of about so many tiles.
    pub(super) fn of(form: Form, size: Geometry, wanted: usize) -> Self {
        let Geometry { batch, cin, height, width, .. } = size;
        let (high, wide) = (form.tiles(height), form.tiles(width));
        let rows = (wanted / wide).clamp(1, high);
        let samples = (wanted / (wide * high)).clamp(1, batch);
        // The last vector of a row may reach over its end, into the next row, which is written later.
        let columns = ((samples * rows - 1) * wide + wide.next_multiple_of(ALIGN)).next_multiple_of(ALIGN);
        // Not a power of two: points would all fall on the same lines of the cache. But one long matrix where they add up.
        let plane = cin * columns + if form == Form::Halved { 0 } else { ALIGN };
        Self { batch, cin, height, width, high, wide, samples, rows, points: form.points(), columns, plane }
    }

    pub(super) fn count(&self) -> usize {
        self.batch.div_ceil(self.samples) * self.high.div_ceil(self.rows)
    }

    pub(super) fn tiles(&self) -> usize {
        self.batch * self.high * self.wide
    }

    /// The strip of a sample's part.
    pub(super) fn at(&self, sample: usize, part: usize) -> usize {
        sample / self.samples * self.high.div_ceil(self.rows) + part
    }

    /// Tiles from top to bottom.
    pub(super) fn high(&self) -> usize {
        self.high
    }

    /// Tiles from left to right.
    pub(super) fn wide(&self) -> usize {
        self.wide
    }

    /// Length of the lines of a strip's matrices.
    pub(super) fn columns(&self) -> usize {
        self.columns
    }

    /// A point of [`Inputs::v`]: input, tile.
    pub(super) fn point<'a>(&self, v: &'a [f32], point: usize) -> &'a [f32] {
        &v[point * self.plane..][..self.cin * self.columns]
    }

    /// Samples and rows of tiles of a strip.
    pub(super) fn extent(&self, strip: usize) -> (Range<usize>, Range<usize>) {
        let parts = self.high.div_ceil(self.rows);
        let (sample, row) = (strip / parts * self.samples, strip % parts * self.rows);
        (sample..self.batch.min(sample + self.samples), row..self.high.min(row + self.rows))
    }

    /// Numbers of [`Inputs::v`].
    pub(super) fn inputs(&self) -> usize {
        self.points * self.plane
    }

    /// Numbers of a row of pixels, taken apart, with room for a vector beyond.
    fn line(&self) -> usize {
        self.wide.next_multiple_of(ALIGN) + 2 * ALIGN
    }

    /// Numbers of [`Inputs::lines`].
    pub(super) fn lines(&self) -> usize {
        (4 * 4 + 2) * self.line()
    }

    /// Numbers of [`Answers::scratch`] for some blocks of outputs.
    pub(super) fn answers<const CO: usize>(&self, blocks: usize) -> usize {
        blocks * self.points * CO * self.columns + 4 * self.columns
    }
}

/// The inputs of a strip at the points.
pub(super) struct Inputs<'a> {
    pub(super) form: Form,
    pub(super) strips: Strips,
    pub(super) strip: usize,
    /// The whole batch.
    pub(super) x: &'a [f32],
    /// Point, input, tile.
    pub(super) v: &'a mut [f32],
    pub(super) lines: &'a mut [f32],
}

impl WithSimd for Inputs<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        match self.form {
            Form::Same => self.whole(simd, [0, 1, 2, 3]),
            Form::Halved => self.whole(simd, [0, 1, 3]),
            Form::Doubled => self.doubled(simd),
        }
    }
}

impl Inputs<'_> {
    /// Some of the points of each direction, of images as they are stored.
    #[inline(always)]
    fn whole<S: Simd, const SIDE: usize>(self, simd: S, points: [usize; SIDE]) {
        let Self { strips, strip, x, v, lines, .. } = self;
        let Strips { cin, height, width, wide, columns, plane, .. } = strips;
        let (samples, rows) = strips.extent(strip);
        // Number `j` of `odd` is column `2j - 1`, of `even` column `2j`.
        let (apart, ring) = lines.split_at_mut(2 * strips.line());
        let (odd, even) = apart.split_at_mut(strips.line());
        odd.fill(0.0);
        even.fill(0.0);
        for input in 0..cin {
            let mut to = input * columns;
            for sample in samples.clone() {
                let pixels = &x[(sample * cin + input) * height * width..][..height * width];
                for row in rows.clone() {
                    // Rows of pixels are counted from the border above the first; two are left from the tiles above.
                    let fresh = if row == rows.start { 0 } else { 2 };
                    for y in 2 * row + fresh..2 * row + 4 {
                        let ring = &mut ring[y % 4 * 4 * strips.line()..][..4 * strips.line()];
                        if !(1..=height).contains(&y) {
                            ring.fill(0.0);
                            continue;
                        }
                        let pairs = pixels[(y - 1) * width..y * width].as_chunks::<2>().0;
                        for ((pair, odd), even) in pairs.iter().zip(&mut odd[1..]).zip(&mut *even) {
                            (*even, *odd) = (pair[0], pair[1]);
                        }
                        for j in (0..wide).step_by(S::F32_LANES) {
                            let four =
                                [load::<S>(odd, j), load::<S>(even, j), load::<S>(odd, j + 1), load::<S>(even, j + 1)];
                            let four = of_four(simd, four);
                            for x in 0..SIDE {
                                store::<S>(ring, x * strips.line() + j, four[points[x]]);
                            }
                        }
                    }
                    for x in 0..SIDE {
                        let line = |y: usize| ((2 * row + y) % 4 * 4 + x) * strips.line();
                        let from = [line(0), line(1), line(2), line(3)];
                        for j in (0..wide).step_by(S::F32_LANES) {
                            let mut four = [simd.splat_f32s(0.0); 4];
                            for y in 0..4 {
                                four[y] = load::<S>(ring, from[y] + j);
                            }
                            let four = of_four(simd, four);
                            for y in 0..SIDE {
                                store::<S>(v, (SIDE * y + x) * plane + to + j, four[points[y]]);
                            }
                        }
                    }
                    to += wide;
                }
            }
        }
    }

    #[inline(always)]
    fn doubled<S: Simd>(self, simd: S) {
        let Self { strips, strip, x, v, lines, .. } = self;
        let Strips { cin, height, width, wide, columns, plane, .. } = strips;
        let (samples, rows) = strips.extent(strip);
        // Number `j` is column `j - 1`.
        let (padded, ring) = lines.split_at_mut(strips.line());
        padded.fill(0.0);
        for input in 0..cin {
            let mut to = input * columns;
            for sample in samples.clone() {
                let pixels = &x[(sample * cin + input) * height * width..][..height * width];
                for row in rows.clone() {
                    let fresh = if row == rows.start { 0 } else { 2 };
                    for y in row + fresh..row + 3 {
                        let ring = &mut ring[y % 3 * 3 * strips.line()..][..3 * strips.line()];
                        if !(1..=height).contains(&y) {
                            ring.fill(0.0);
                            continue;
                        }
                        padded[1..=width].copy_from_slice(&pixels[(y - 1) * width..y * width]);
                        for j in (0..wide).step_by(S::F32_LANES) {
                            let three = [load::<S>(padded, j), load::<S>(padded, j + 1), load::<S>(padded, j + 2)];
                            let three = of_three(simd, three);
                            for x in 0..3 {
                                store::<S>(ring, x * strips.line() + j, three[x]);
                            }
                        }
                    }
                    for x in 0..3 {
                        let line = |y: usize| ((row + y) % 3 * 3 + x) * strips.line();
                        let from = [line(0), line(1), line(2)];
                        for j in (0..wide).step_by(S::F32_LANES) {
                            let mut three = [simd.splat_f32s(0.0); 3];
                            for y in 0..3 {
                                three[y] = load::<S>(ring, from[y] + j);
                            }
                            let three = of_three(simd, three);
                            for y in 0..3 {
                                store::<S>(v, (3 * y + x) * plane + to + j, three[y]);
                            }
                        }
                    }
                    to += wide;
                }
            }
        }
    }
}

/// The answers of some strips for a few blocks of `CO` outputs.
pub(super) struct Answers<'a, 'out, const CO: usize> {
    pub(super) form: Form,
    pub(super) strips: Strips,
    pub(super) strip: Range<usize>,
    /// [`Inputs::v`] of each strip.
    pub(super) v: &'a [f32],
    /// Block, point, input, output.
    pub(super) weights: &'a [f32],
    /// Of the outputs to do.
    pub(super) bias: &'a [f32],
    /// Whether negative answers become zero.
    pub(super) relu: bool,
    /// Sample, output, strip of the sample: its rows of pixels.
    pub(super) out: Vec<&'out mut [f32]>,
    pub(super) scratch: &'a mut [f32],
}

impl<const CO: usize> WithSimd for Answers<'_, '_, CO> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { form, strips, strip, v, weights, bias, relu, mut out, scratch } = self;
        let Strips { cin, high, wide, points, columns, plane, .. } = strips;
        let weights = weights.as_chunks::<CO>().0;
        let (outputs, blocks) = (bias.len(), bias.len().div_ceil(CO));
        let parts = if strip.len() == 1 { 1 } else { high.div_ceil(strips.rows) };
        let first_sample = strips.extent(strip.start).0.start;
        let width = form.pixels() * wide;
        let (m, lines) = scratch.split_at_mut(blocks * points * CO * columns);
        let (upper, lower) = lines.split_at_mut(2 * columns);
        let ((y00, y01), (y10, y11)) = (upper.split_at_mut(columns), lower.split_at_mut(columns));
        for (v, strip) in v.chunks(points * plane).zip(strip) {
            let (samples, rows) = strips.extent(strip);
            if form == Form::Halved {
                for (output, m) in m.chunks_mut(CO * columns).enumerate().take(blocks) {
                    let weights = &weights[output * points * cin..][..points * cin];
                    product::<S, CO>(simd, weights, v, columns, m);
                }
                for (output, &bias) in bias.iter().enumerate() {
                    let mut from = output * columns;
                    for sample in samples.clone() {
                        let piece = ((sample - first_sample) * outputs + output) * parts;
                        let pixels = &mut out[piece + if parts == 1 { 0 } else { rows.start / strips.rows }];
                        for (to, &sum) in pixels.iter_mut().zip(&m[from..]) {
                            *to = sum + bias;
                        }
                        from += pixels.len();
                    }
                }
                continue;
            }
            for point in 0..points {
                let v = &v[point * plane..][..cin * columns];
                for block in 0..blocks {
                    let weights = &weights[(block * points + point) * cin..][..cin];
                    let m = &mut m[(block * points + point) * CO * columns..][..CO * columns];
                    product::<S, CO>(simd, weights, v, columns, m);
                }
            }
            for (output, &bias) in bias.iter().enumerate() {
                let m = &m[(output / CO * points * CO + output % CO) * columns..];
                let bias = simd.splat_f32s(bias);
                match form {
                    Form::Same => {
                        for j in (0..columns).step_by(S::F32_LANES) {
                            let mut pairs = [[simd.splat_f32s(0.0); 2]; 4];
                            for x in 0..4 {
                                let mut four = [simd.splat_f32s(0.0); 4];
                                for y in 0..4 {
                                    four[y] = load::<S>(m, (4 * y + x) * CO * columns + j);
                                }
                                pairs[x] = from_four(simd, four);
                            }
                            let upper = from_four(simd, [pairs[0][0], pairs[1][0], pairs[2][0], pairs[3][0]]);
                            let lower = from_four(simd, [pairs[0][1], pairs[1][1], pairs[2][1], pairs[3][1]]);
                            store::<S>(y00, j, rectified(simd, simd.add_f32s(upper[0], bias), relu));
                            store::<S>(y01, j, rectified(simd, simd.add_f32s(upper[1], bias), relu));
                            store::<S>(y10, j, rectified(simd, simd.add_f32s(lower[0], bias), relu));
                            store::<S>(y11, j, rectified(simd, simd.add_f32s(lower[1], bias), relu));
                        }
                    }
                    _ => {
                        for j in (0..columns).step_by(S::F32_LANES) {
                            let mut pairs = [[simd.splat_f32s(0.0); 2]; 3];
                            for x in 0..3 {
                                let mut three = [simd.splat_f32s(0.0); 3];
                                for y in 0..3 {
                                    three[y] = load::<S>(m, (3 * y + x) * CO * columns + j);
                                }
                                pairs[x] = from_three(simd, three);
                            }
                            let upper = from_three(simd, [pairs[0][0], pairs[1][0], pairs[2][0]]);
                            let lower = from_three(simd, [pairs[0][1], pairs[1][1], pairs[2][1]]);
                            store::<S>(y00, j, rectified(simd, simd.add_f32s(upper[0], bias), relu));
                            store::<S>(y01, j, rectified(simd, simd.add_f32s(upper[1], bias), relu));
                            store::<S>(y10, j, rectified(simd, simd.add_f32s(lower[0], bias), relu));
                            store::<S>(y11, j, rectified(simd, simd.add_f32s(lower[1], bias), relu));
                        }
                    }
                }
                let mut from = 0;
                for sample in samples.clone() {
                    let piece = ((sample - first_sample) * outputs + output) * parts;
                    let pixels = &mut out[piece + if parts == 1 { 0 } else { rows.start / strips.rows }];
                    for rows in pixels.chunks_exact_mut(2 * width) {
                        let (upper, lower) = rows.split_at_mut(width);
                        interleave(upper, &y00[from..], &y01[from..]);
                        interleave(lower, &y10[from..], &y11[from..]);
                        from += wide;
                    }
                }
            }
        }
    }
}

/// Not the larger of both, which would turn a NaN into zero and hide a diverged network.
#[inline(always)]
fn rectified<S: Simd>(simd: S, value: S::f32s, relu: bool) -> S::f32s {
    let zero = simd.splat_f32s(0.0);
    if relu { simd.select_f32s(simd.less_than_f32s(value, zero), zero, value) } else { value }
}

/// Even and odd columns of a row of pixels.
#[inline(always)]
fn interleave(row: &mut [f32], even: &[f32], odd: &[f32]) {
    for ((pair, &even), &odd) in row.as_chunks_mut::<2>().0.iter_mut().zip(even).zip(odd) {
        *pair = [even, odd];
    }
}
