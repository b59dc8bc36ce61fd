//! A 3×3 convolution in Winograd's form F(2×2, 3×3): 16 multiplications for a square of four output pixels instead of 36
//! (Lavin & Gray, 2016), or 9 if the image is seen at twice its size.
//!
//! A *tile* is a square of four output pixels and the input pixels that it looks at. Inputs and weights are taken to
//! *points* of the transform domain ([`points`]), at each of which the tiles' answers are a product of matrices
//! ([`matrix`]), outputs × inputs times inputs × tiles; a last transform takes the products back to pixels. A strip of tiles
//! goes through all of it while it is in the cache ([`strip`]). Only where there are few tiles for the channels are the
//! inputs of all strips stored, and shared by tasks that each have outputs of their own.

// Loops over numbers of points and lanes: `copy_from_slice` and iterators with closures would put arrays of registers into
// memory.
#![allow(clippy::manual_memcpy, clippy::needless_range_loop)]

mod gradient;
mod matrix;
mod points;
mod strip;

use super::buffer::Buffer;
use super::conv::Geometry;
use super::kernel::Machine;
use points::{Form, Weights};
use rayon::prelude::*;
use std::cell::Cell;
use strip::{Answers, Inputs, Strips};

/// Whether [`convolve`] can do it: a 3×3 kernel, and sides that tiles fill.
pub(super) fn takes(size: Geometry) -> bool {
    size.kernel == 3 && size.height.is_multiple_of(2) && size.width.is_multiple_of(2)
}

/// The same-size convolution of `x`, `[b, in, h, w]`; `kernel(output, input)` → `[b, out, h, w]`;
/// with `relu`, what is negative becomes zero.
pub(super) fn convolve(
    on: Machine,
    size: Geometry,
    x: &[f32],
    kernel: impl Fn(usize, usize) -> [f32; 9] + Sync,
    bias: &[f32],
    relu: bool,
) -> Vec<f32> {
    convolve_as(Form::Same, on, size, x, kernel, bias, relu)
}

/// [`convolve`] of the image at twice its size: `[b, in, h, w]` → `[b, out, 2h, 2w]`, of any sides.
pub(super) fn convolve_doubled(
    on: Machine,
    size: Geometry,
    x: &[f32],
    kernel: impl Fn(usize, usize) -> [f32; 9] + Sync,
    bias: &[f32],
    relu: bool,
) -> Vec<f32> {
    convolve_as(Form::Doubled, on, size, x, kernel, bias, relu)
}

/// The gradient of [`convolve_doubled`] in its input, for the gradient `g` of its answer; `size` has `g`'s sides, and its
/// planes as inputs. `kernel(output, input)`: as in [`convolve_doubled`].
pub(super) fn convolve_halved(
    on: Machine,
    size: Geometry,
    g: &[f32],
    kernel: impl Fn(usize, usize) -> [f32; 9] + Sync,
) -> Vec<f32> {
    convolve_as(Form::Halved, on, size, g, |o, i| kernel(i, o), &vec![0.0; size.cout], false)
}

/// The gradient of [`convolve`] in its weights, for the gradient `g` of its answer.
pub(super) fn weight_gradient(on: Machine, size: Geometry, x: &[f32], g: &[f32]) -> Vec<f32> {
    gradient::gradient(Form::Same, on, size, x, g)
}

/// The gradient of [`convolve_doubled`] in its weights, for the gradient `g` of its answer; `size` is `x`'s.
pub(super) fn weight_gradient_doubled(on: Machine, size: Geometry, x: &[f32], g: &[f32]) -> Vec<f32> {
    gradient::gradient(Form::Doubled, on, size, x, g)
}

fn convolve_as(
    form: Form,
    on: Machine,
    size: Geometry,
    x: &[f32],
    kernel: impl Fn(usize, usize) -> [f32; 9] + Sync,
    bias: &[f32],
    relu: bool,
) -> Vec<f32> {
    if on.is_wide {
        convolve_by::<8>(form, on, size, x, kernel, bias, relu)
    } else {
        convolve_by::<4>(form, on, size, x, kernel, bias, relu)
    }
}

/// Tasks that a convolution is cut into at least, twice as many for weights' gradients: what more than 16 threads would do
/// is not known. Fixed, since sums depend on it.
const TASKS: usize = 8;

fn convolve_by<const CO: usize>(
    form: Form,
    on: Machine,
    size: Geometry,
    x: &[f32],
    kernel: impl Fn(usize, usize) -> [f32; 9] + Sync,
    bias: &[f32],
    relu: bool,
) -> Vec<f32> {
    if size.batch == 0 {
        return Vec::new();
    }
    let strips = Strips::new(form, size);
    let blocks = size.cout.div_ceil(CO);
    let per_block = form.points() * size.cin * CO;
    let is_deep = strips.tiles() <= 2 * size.cout || strips.count() < 4;
    let (of_strips, of_blocks) = if is_deep {
        (strips.count(), (blocks / TASKS).clamp(1, 4))
    } else {
        let groups = TASKS.div_ceil(strips.count()).min(blocks);
        (1, blocks.div_ceil(groups))
    };
    let groups = blocks.div_ceil(of_blocks);
    let make_weights = |block: usize, packed: &mut [f32]| {
        let outputs = CO.min(size.cout - block * CO);
        let kernel = |k, input| kernel(block * CO + k, input);
        on.run(Weights::<_, CO> { form, cin: size.cin, outputs, kernel, packed });
    };

    let mut shared_weights = Buffer::take(if is_deep { 0 } else { blocks * per_block });
    shared_weights.par_chunks_mut(per_block).enumerate().for_each(|(block, packed)| make_weights(block, packed));
    let per_strip = strips.inputs();
    let mut shared_inputs = Buffer::take(if is_deep { strips.count() * per_strip } else { 0 });
    shared_inputs.par_chunks_mut(per_strip).enumerate().for_each(|(strip, v)| {
        with_scratch(strips.lines(), |lines| on.run(Inputs { form, strips, strip, x, v, lines }));
    });

    let [height, width] = [size.height, size.width].map(|pixels| form.pixels() * form.tiles(pixels));
    let mut out = vec![0.0; size.batch * size.cout * height * width];
    let mut tasks: Vec<Vec<&mut [f32]>> = Vec::new();
    tasks.resize_with(strips.count().div_ceil(of_strips) * groups, Vec::new);
    for (plane, pixels) in out.chunks_mut(height * width).enumerate() {
        let (sample, output) = (plane / size.cout, plane % size.cout);
        for (part, rows) in pixels.chunks_mut(strips.rows * form.pixels() * width).enumerate() {
            tasks[strips.at(sample, part) / of_strips * groups + output / (of_blocks * CO)].push(rows);
        }
    }
    tasks.into_par_iter().enumerate().for_each(|(task, out)| {
        let first = task % groups * of_blocks;
        let of_blocks = of_blocks.min(blocks - first);
        let outputs = (of_blocks * CO).min(size.cout - first * CO);
        let bias = &bias[first * CO..first * CO + outputs];
        let own = if is_deep { of_blocks * per_block } else { per_strip };
        with_scratch(own + strips.lines().max(strips.answers::<CO>(of_blocks)), |scratch| {
            let (own, scratch) = scratch.split_at_mut(own);
            if is_deep {
                own.chunks_mut(per_block).enumerate().for_each(|(k, packed)| make_weights(first + k, packed));
                let v = &shared_inputs;
                on.run(Answers::<CO> {
                    form,
                    strips,
                    strip: 0..strips.count(),
                    v,
                    weights: own,
                    bias,
                    relu,
                    out,
                    scratch,
                });
            } else {
                let strip = task / groups;
                on.run(Inputs { form, strips, strip, x, v: own, lines: scratch });
                let weights = &shared_weights[first * per_block..(first + of_blocks) * per_block];
                on.run(Answers::<CO> {
                    form,
                    strips,
                    strip: strip..strip + 1,
                    v: own,
                    weights,
                    bias,
                    relu,
                    out,
                    scratch,
                });
            }
        });
    });
    out
}

/// Calls with `count` numbers of no particular value, on a line of the cache, in memory that the thread keeps: fresh pages
/// from the system cost more than filling them.
fn with_scratch(count: usize, call: impl FnOnce(&mut [f32])) {
    thread_local! {
        static SCRATCH: Cell<Vec<f32>> = const { Cell::new(Vec::new()) };
    }
    let mut scratch = SCRATCH.take();
    if scratch.len() < count + points::ALIGN {
        scratch.resize(count + points::ALIGN, 0.0);
    }
    let start = scratch.as_ptr().align_offset(64).min(points::ALIGN);
    call(&mut scratch[start..start + count]);
    SCRATCH.set(scratch);
}
