//! The gradient in the weights: at each point, inputs × tiles times tiles × outputs.
//!
//! Sums run over tiles, so here the outputs lie side by side in vectors, not tiles: the gradient's rows of pixels are
//! turned around as they are read.

use super::super::buffer::Buffer;
use super::super::conv::Geometry;
use super::super::kernel::Machine;
use super::points::{ALIGN, Form, load, store};
use super::strip::{Inputs, Strips};
use super::{TASKS, with_scratch};
use pulp::{Simd, WithSimd};
use rayon::prelude::*;
use std::ops::Range;

/// Numbers of all partial sums together. Where there is no room for a part for each task, tasks share the inputs instead.
const PARTIAL: usize = 1 << 21;
/// Numbers of both sides of the product that tasks share at a time.
const SHARED: usize = 1 << 21;
/// Tiles of a strip: sums are read and written once for each.
const TILES: usize = 256;
/// Inputs that are summed at a time.
const CI: usize = 8;

/// How the matrices of a strip lie.
#[derive(Clone, Copy, Debug)]
struct Shape {
    form: Form,
    size: Geometry,
    strips: Strips,
    /// Channels of both sides, up to whole blocks.
    inputs: usize,
    outputs: usize,
}

impl Shape {
    /// Numbers of a point of the gradient's side. Not a power of two: points would all fall on the same lines of the cache.
    fn plane(&self) -> usize {
        self.strips.columns() * self.outputs + ALIGN
    }

    /// Numbers of the gradient's side: point, tile, output.
    fn gradients(&self) -> usize {
        self.form.points() * self.plane()
    }

    /// Numbers of rows of pixels turned around.
    fn pixels(&self) -> usize {
        2 * 2 * self.strips.wide() * self.outputs
    }

    /// Numbers of the sums of a point.
    fn point(&self) -> usize {
        self.inputs * self.outputs
    }

    /// Takes both sides of a strip to the points, at once if there are threads to spare.
    fn spread(&self, on: Machine, strip: usize, [x, g]: [&[f32]; 2], [v, m]: [&mut [f32]; 2]) {
        let Self { form, strips, .. } = *self;
        rayon::join(
            || with_scratch(strips.lines(), |lines| on.run(Inputs { form, strips, strip, x, v, lines })),
            || with_scratch(self.pixels(), |pixels| on.run(Gradients { shape: *self, strip, g, m, pixels })),
        );
    }
}

/// The gradient in the weights, `[out, in, 3, 3]`, of a convolution of `x` whose answer has the gradient `g`; `size` is `x`'s.
///
/// Each number is summed in an order that does not depend on the threads.
pub(super) fn gradient(form: Form, on: Machine, size: Geometry, x: &[f32], g: &[f32]) -> Vec<f32> {
    if size.batch == 0 {
        return vec![0.0; size.cout * size.cin * 9];
    }
    let strips = Strips::of(form, size, TILES);
    let (inputs, outputs) = (size.cin.next_multiple_of(CI), size.cout.next_multiple_of(ALIGN));
    let shape = Shape { form, size, strips, inputs, outputs };
    let sums = form.points() * shape.point();
    let strips_of_part = if TASKS * sums <= PARTIAL { strips.count().div_ceil(2 * TASKS) } else { strips.count() };
    let mut parts = Buffer::take(strips.count().div_ceil(strips_of_part) * sums);
    let of_strip = [strips.inputs(), shape.gradients()];
    if parts.len() > sums {
        parts.par_chunks_mut(sums).enumerate().for_each(|(part, sums)| {
            let mut v = Buffer::take(of_strip[0]);
            let mut m = Buffer::take(of_strip[1]);
            let first = part * strips_of_part;
            for strip in first..strips.count().min(first + strips_of_part) {
                shape.spread(on, strip, [x, g], [&mut v, &mut m]);
                for (point, sums) in sums.chunks_mut(shape.point()).enumerate() {
                    let is_first = strip == first;
                    on.run(Sums { shape, strip, point, inputs: 0..inputs, v: &v, m: &m, is_first, sums });
                }
            }
        });
    } else {
        let at_a_time = (SHARED / (of_strip[0] + of_strip[1])).clamp(1, strips.count());
        let mut v = Buffer::take(at_a_time * of_strip[0]);
        let mut m = Buffer::take(at_a_time * of_strip[1]);
        for first in (0..strips.count()).step_by(at_a_time) {
            let several = first..strips.count().min(first + at_a_time);
            let both = v.par_chunks_mut(of_strip[0]).zip(m.par_chunks_mut(of_strip[1]));
            both.enumerate().take(several.len()).for_each(|(k, (v, m))| {
                shape.spread(on, first + k, [x, g], [v, m]);
            });
            // Of a point and some inputs at a time, so that a task's part of both sides stays in the cache.
            let of_task = inputs.div_ceil(4).next_multiple_of(CI);
            parts.par_chunks_mut(shape.point()).enumerate().for_each(|(point, sums)| {
                sums.par_chunks_mut(of_task * outputs).enumerate().for_each(|(task, sums)| {
                    let inputs = task * of_task..task * of_task + sums.len() / outputs;
                    for (k, strip) in several.clone().enumerate() {
                        let (v, m) = (&v[k * of_strip[0]..], &m[k * of_strip[1]..]);
                        let (inputs, is_first) = (inputs.clone(), strip == 0);
                        on.run(Sums { shape, strip, point, inputs, v, m, is_first, sums });
                    }
                });
            });
        }
    }
    let mut weight = vec![0.0; size.cout * size.cin * 9];
    weight.par_chunks_mut(ALIGN * size.cin * 9).enumerate().for_each(|(group, weight)| {
        on.run(Kernels { shape, first: group * ALIGN, parts: &parts, weight });
    });
    weight
}

/// The gradient's side of a strip at the points: what takes points back to pixels, turned around.
struct Gradients<'a> {
    shape: Shape,
    strip: usize,
    g: &'a [f32],
    /// Point, tile, output.
    m: &'a mut [f32],
    pixels: &'a mut [f32],
}

impl WithSimd for Gradients<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { shape, strip, g, m, pixels } = self;
        let Shape { form, size, strips, outputs, .. } = shape;
        let (side, plane, wide) = (form.side(), shape.plane(), 2 * strips.wide());
        let area = 2 * strips.high() * wide;
        let (samples, rows) = strips.extent(strip);
        let mut to = 0;
        for sample in samples {
            let planes = &g[sample * size.cout * area..][..size.cout * area];
            for row in rows.clone() {
                let (upper, lower) = pixels.split_at_mut(wide * outputs);
                turn(planes, area, 2 * row * wide, outputs, &mut upper[..wide * outputs]);
                turn(planes, area, (2 * row + 1) * wide, outputs, &mut lower[..wide * outputs]);
                for tile in 0..strips.wide() {
                    for output in (0..outputs).step_by(S::F32_LANES) {
                        let from = 2 * tile * outputs + output;
                        let upper = [load::<S>(upper, from), load::<S>(upper, from + outputs)];
                        let lower = [load::<S>(lower, from), load::<S>(lower, from + outputs)];
                        let (upper, lower) = (to_points(simd, form, upper), to_points(simd, form, lower));
                        for x in 0..side {
                            let column = to_points(simd, form, [upper[x], lower[x]]);
                            for y in 0..side {
                                store::<S>(m, (side * y + x) * plane + to + output, column[y]);
                            }
                        }
                    }
                    to += outputs;
                }
            }
        }
    }
}

/// Turns a row of pixels of each plane into pixels of `channels`.
#[inline(always)]
fn turn(planes: &[f32], area: usize, from: usize, channels: usize, pixels: &mut [f32]) {
    let width = pixels.len() / channels;
    for (group, planes) in planes.chunks(ALIGN * area).enumerate() {
        for x in (0..width).step_by(ALIGN) {
            let across = ALIGN.min(width - x);
            let mut square = [[0.0; ALIGN]; ALIGN];
            for (plane, line) in planes.chunks_exact(area).zip(&mut square) {
                match plane[from + x..].first_chunk::<ALIGN>() {
                    Some(whole) if across == ALIGN => *line = *whole,
                    _ => line[..across].copy_from_slice(&plane[from + x..from + x + across]),
                }
            }
            for (k, pixel) in pixels[x * channels..].chunks_mut(channels).enumerate().take(across) {
                if let Some(pixel) = pixel[group * ALIGN..].first_chunk_mut::<ALIGN>() {
                    for channel in 0..ALIGN {
                        pixel[channel] = square[channel][k];
                    }
                }
            }
        }
    }
}

/// Two pixels of a gradient at the points of a direction.
#[inline(always)]
fn to_points<S: Simd>(simd: S, form: Form, [a, b]: [S::f32s; 2]) -> [S::f32s; 4] {
    let minus = simd.neg_f32s(b);
    let sum = simd.add_f32s(a, b);
    if form == Form::Same { [a, sum, simd.sub_f32s(a, b), minus] } else { [a, sum, minus, minus] }
}

/// Adds the products of a strip at a point, for some inputs, to the sums.
struct Sums<'a> {
    shape: Shape,
    strip: usize,
    point: usize,
    inputs: Range<usize>,
    v: &'a [f32],
    m: &'a [f32],
    /// Whether there is nothing yet to add to.
    is_first: bool,
    /// Input, output.
    sums: &'a mut [f32],
}

impl WithSimd for Sums<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { shape, strip, point, inputs, v, m, is_first, sums } = self;
        let Shape { size, strips, outputs, .. } = shape;
        let columns = strips.columns();
        let (samples, rows) = strips.extent(strip);
        let m = &m[point * shape.plane()..][..samples.len() * rows.len() * strips.wide() * outputs];
        let v = strips.point(v, point);
        if is_first {
            sums.fill(0.0);
        }
        for (first, sums) in inputs.step_by(CI).zip(sums.chunks_mut(CI * outputs)) {
            // Beyond the last input the last one is taken again, and its sums are dropped.
            let mut lines = [v; CI];
            for (k, line) in lines.iter_mut().enumerate() {
                *line = &v[(first + k).min(size.cin - 1) * columns..][..columns];
            }
            let mut output = 0;
            while output + 2 * S::F32_LANES <= outputs {
                add::<S, 2>(simd, lines, m, outputs, output, sums);
                output += 2 * S::F32_LANES;
            }
            while output < outputs {
                add::<S, 1>(simd, lines, m, outputs, output, sums);
                output += S::F32_LANES;
            }
        }
    }
}

/// `sums[k][output] += Σ lines[k][tile] · m[tile][output]`.
#[inline(always)]
fn add<S: Simd, const N: usize>(
    simd: S,
    lines: [&[f32]; CI],
    m: &[f32],
    outputs: usize,
    output: usize,
    sums: &mut [f32],
) {
    // Copied once they are whole: sums that are also looked up by index would live in memory, not in registers.
    let mut found = [[simd.splat_f32s(0.0); N]; CI];
    sum::<S, N>(simd, lines, &m[output..], outputs, &mut found);
    for (found, sums) in found.iter().zip(sums.chunks_exact_mut(outputs)) {
        let sums = S::as_mut_simd_f32s(&mut sums[output..output + N * S::F32_LANES]).0;
        for (sum, &found) in sums.iter_mut().zip(found) {
            *sum = simd.add_f32s(*sum, found);
        }
    }
}

#[inline(always)]
fn sum<S: Simd, const N: usize>(
    simd: S,
    lines: [&[f32]; CI],
    m: &[f32],
    outputs: usize,
    sums: &mut [[S::f32s; N]; CI],
) {
    let mut local = [[simd.splat_f32s(0.0); N]; CI];
    for (tile, m) in m.chunks(outputs).enumerate() {
        let m = S::as_simd_f32s(&m[..N * S::F32_LANES]).0;
        let mut across = [simd.splat_f32s(0.0); N];
        for n in 0..N {
            across[n] = m[n];
        }
        for k in 0..CI {
            let pixel = simd.splat_f32s(lines[k][tile]);
            for n in 0..N {
                local[k][n] = simd.mul_add_e_f32s(pixel, across[n], local[k][n]);
            }
        }
    }
    *sums = local;
}

/// From the sums of all parts to the kernels of some outputs.
struct Kernels<'a> {
    shape: Shape,
    first: usize,
    parts: &'a [f32],
    weight: &'a mut [f32],
}

impl WithSimd for Kernels<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { shape, first, parts, weight } = self;
        let Shape { form, size, .. } = shape;
        let side = form.side();
        for inputs in (0..size.cin).step_by(ALIGN) {
            // Whole lines of the cache go out to each output, which lie far apart.
            let mut lines = [[0.0; 9 * ALIGN]; ALIGN];
            let count = ALIGN.min(size.cin - inputs);
            for input in 0..count {
                let mut at = [[[0.0; ALIGN]; 4]; 4];
                for part in parts.chunks(form.points() * shape.point()) {
                    for (point, part) in part.chunks(shape.point()).enumerate() {
                        let part = &part[(inputs + input) * shape.outputs + first..][..ALIGN];
                        for (sum, &part) in at[point / side][point % side].iter_mut().zip(part) {
                            *sum += part;
                        }
                    }
                }
                let mut rows = [[[0.0; ALIGN]; 3]; 4];
                for (row, at) in rows.iter_mut().zip(&at).take(side) {
                    *row = taps(form, at);
                }
                for x in 0..3 {
                    let column = taps(form, &[rows[0][x], rows[1][x], rows[2][x], rows[3][x]]);
                    for (y, taps) in column.iter().enumerate() {
                        for (line, &tap) in lines.iter_mut().zip(taps) {
                            line[9 * input + 3 * y + x] = tap;
                        }
                    }
                }
            }
            for (kernels, line) in weight.chunks_mut(size.cin * 9).zip(&lines) {
                kernels[9 * inputs..9 * (inputs + count)].copy_from_slice(&line[..9 * count]);
            }
        }
    }
}

/// Sums at the points of a direction to those of the three taps.
#[inline(always)]
fn taps(form: Form, [a, b, c, d]: &[[f32; ALIGN]; 4]) -> [[f32; ALIGN]; 3] {
    let mut taps = [[0.0; ALIGN]; 3];
    for k in 0..ALIGN {
        (taps[0][k], taps[1][k], taps[2][k]) = if form == Form::Same {
            let (sum, difference) = (0.5 * (b[k] + c[k]), 0.5 * (b[k] - c[k]));
            (a[k] + sum, difference, sum + d[k])
        } else {
            (a[k] + b[k], b[k], b[k] + c[k])
        };
    }
    taps
}
