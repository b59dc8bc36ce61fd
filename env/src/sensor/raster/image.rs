//! The image while it is drawn: 1/depth in each pixel, and what is hidden behind it.
//!
//! Every pixel holds the largest 1/depth drawn so far, so the order of drawing does not change the result. With `MARKED`,
//! it also holds which triangle that was; without, that costs nothing.

use super::pyramid::{Pyramid, TILE};
use super::spans::{ROWS, Spans, Triangle, smallest};
use super::view::{Extent, nearest_whole};
use super::{high, low};
use crate::sensor::{Camera, Frame, NO_TRIANGLE};

/// Pixels written at once: a row of a tile.
const CHUNK: usize = TILE;

/// The image being drawn, in the memory of a frame.
pub(super) struct Image<'a, const MARKED: bool> {
    /// Row-major, with some pixels to spare at the end: chunks may reach beyond a row's end, but change nothing there.
    pixels: &'a mut Vec<f32>,
    /// Which triangle each pixel shows, laid out like `pixels`; untouched unless `MARKED`.
    marks: &'a mut Vec<u32>,
    pyramid: &'a mut Pyramid,
    width: usize,
    height: usize,
    /// Pixels from one row to the next: the width, but at least a chunk.
    stride: usize,
    /// Centre of pixel `(0, 0)`, from the image's centre.
    origin: [f32; 2],
    /// Last column, from the image's centre.
    border: f32,
}

impl<'a, const MARKED: bool> Image<'a, MARKED> {
    /// An empty image.
    #[inline(always)]
    pub(super) fn start(
        camera: &Camera,
        far: f32,
        pyramid: &'a mut Pyramid,
        marks: &'a mut Vec<u32>,
        out: &'a mut Frame,
    ) -> Self {
        let (width, height, stride) = (camera.width, camera.height, camera.width.max(CHUNK));
        (out.width, out.height) = (width, height);
        out.depth.clear();
        out.depth.resize(stride * height + 2 * CHUNK, far);
        out.colour.clear();
        if MARKED {
            marks.clear();
            marks.resize(out.depth.len(), NO_TRIANGLE);
        }
        pyramid.start(width.div_ceil(TILE), height.div_ceil(TILE), far);
        let ([x, y], [border, _]) = (camera.offsets(0, 0), camera.offsets(width - 1, 0));
        Self { pixels: &mut out.depth, marks, pyramid, width, height, stride, origin: [x, y], border }
    }

    /// Turns 1/depth into depth.
    #[inline(always)]
    pub(super) fn finish(self, far: f32) {
        for pixel in self.pixels.iter_mut() {
            let inverse = *pixel;
            let depth = 1.0 / inverse;
            *pixel = if inverse > far { depth } else { 0.0 };
        }
        if self.stride != self.width {
            for row in 1..self.height {
                let from = row * self.stride;
                self.pixels.copy_within(from..from + self.width, row * self.width);
                if MARKED {
                    self.marks.copy_within(from..from + self.width, row * self.width);
                }
            }
        }
        self.pixels.truncate(self.width * self.height);
        if MARKED {
            self.marks.truncate(self.width * self.height);
        }
    }

    /// Whether a surface within an extent could be nearer than what is drawn.
    #[inline(always)]
    pub(super) fn may_show(&mut self, extent: &Extent) -> bool {
        self.pyramid.may_show(extent)
    }

    /// Draws one triangle, to be remembered as `mark`. Some of what it hides is known only after [`Image::refresh`].
    #[inline(always)]
    pub(super) fn draw(&mut self, triangle: &Triangle, mark: u32) {
        match triangle.extent.x1 - triangle.extent.x0 {
            1..=8 => self.draw_narrow::<1>(triangle, mark),
            9..=16 => self.draw_narrow::<2>(triangle, mark),
            _ => self.draw_wide(triangle, mark),
        }
    }

    /// Draws a triangle of at most `CHUNKS` chunks in each row, without asking tile by tile what is hidden.
    #[inline(always)]
    fn draw_narrow<const CHUNKS: usize>(&mut self, triangle: &Triangle, mark: u32) {
        let Extent { x0, x1, y0, y1, .. } = triangle.extent;
        let (x0, y0, x1, y1) = (x0 as usize, y0 as usize, x1 as usize, y1 as usize);
        let (mut x, mut part) = ([[0.0; CHUNK]; CHUNKS], [[0.0; CHUNK]; CHUNKS]);
        for c in 0..CHUNKS {
            for i in 0..CHUNK {
                x[c][i] = self.origin[0] + x0 as f32 + (c * CHUNK + i) as f32;
                part[c][i] = triangle.inverse.x * x[c][i];
            }
        }
        let mut top = y0;
        while top < y1 {
            let spans = Spans::new(triangle, self.origin[1] + top as f32, self.border);
            for row in top..y1.min(top + ROWS) {
                let (left, right, along) = (spans.left[row - top], spans.right[row - top], spans.along[row - top]);
                let at = row * self.stride + x0;
                let pixels = &mut self.pixels[at..][..CHUNKS * CHUNK];
                for (c, chunk) in pixels.as_chunks_mut::<CHUNK>().0.iter_mut().enumerate() {
                    let before = *chunk;
                    draw_chunk(chunk, &x[c], &part[c], left, right, along);
                    if MARKED {
                        mark_chunk(&mut self.marks[at + c * CHUNK..], &before, chunk, mark);
                    }
                }
            }
            top += ROWS;
        }
        for ty in y0 / TILE..(y1 - 1) / TILE + 1 {
            for tx in x0 / TILE..(x1 - 1) / TILE + 1 {
                self.pyramid.touch(tx, ty);
            }
        }
    }

    /// Draws a triangle tile by tile, leaving out those that hide it.
    #[inline(always)]
    fn draw_wide(&mut self, triangle: &Triangle, mark: u32) {
        let extent = &triangle.extent;
        for ty in extent.y0 as usize / TILE..(extent.y1 - 1) as usize / TILE + 1 {
            let spans = Spans::new(triangle, self.origin[1] + (ty * TILE) as f32, self.border);
            let [first, last] = spans.bounds();
            let first = high(first - self.origin[0], extent.x0 as f32);
            let last = low(last - self.origin[0], (extent.x1 - 1) as f32);
            if first > last {
                continue;
            }
            // The first whole column is not to the left of the nearest, the last not to the right.
            for tx in nearest_whole(first).0 as usize / TILE..nearest_whole(last).0 as usize / TILE + 1 {
                let first = self.origin[0] + (tx * TILE) as f32;
                let nearest = spans.nearest(&triangle.inverse, first, first + (TILE - 1) as f32);
                if low(extent.nearest, nearest) <= self.pyramid.floor(tx, ty) {
                    continue;
                }
                let (mut x, mut part) = ([0.0; CHUNK], [0.0; CHUNK]);
                for i in 0..CHUNK {
                    x[i] = first + i as f32;
                    part[i] = triangle.inverse.x * x[i];
                }
                let mut least = [f32::INFINITY; CHUNK];
                let (rows, at) = self.tile(tx, ty);
                for row in 0..rows {
                    let Some(chunk) = self.pixels[at + row * self.stride..].first_chunk_mut() else { break };
                    let (left, right, along) = (spans.left[row], spans.right[row], spans.along[row]);
                    let before = *chunk;
                    draw_chunk(chunk, &x, &part, left, right, along);
                    if MARKED {
                        mark_chunk(&mut self.marks[at + row * self.stride..], &before, chunk, mark);
                    }
                    for i in 0..CHUNK {
                        least[i] = low(chunk[i], least[i]);
                    }
                }
                self.pyramid.raise(tx, ty, smallest(least));
            }
        }
    }

    /// Computes the floors of the tiles that were drawn into.
    #[inline(always)]
    pub(super) fn refresh(&mut self) {
        while let Some([tx, ty]) = self.pyramid.next_stale() {
            let mut least = [f32::INFINITY; CHUNK];
            let (rows, at) = self.tile(tx, ty);
            for row in 0..rows {
                let Some(chunk) = self.pixels[at + row * self.stride..].first_chunk::<CHUNK>() else { break };
                for i in 0..CHUNK {
                    least[i] = low(chunk[i], least[i]);
                }
            }
            self.pyramid.raise(tx, ty, smallest(least));
        }
    }

    /// Number of rows of a tile, and the place of its first pixel. At the right border its rows reach into the next row
    /// of the image: what is drawn stops at the border, and the smallest of more pixels is a lower bound as well.
    #[inline(always)]
    fn tile(&self, tx: usize, ty: usize) -> (usize, usize) {
        // Always `TILE` at most, which also is what `Spans` has; said here, it saves asking again in each row.
        ((self.height - ty * TILE).min(TILE).min(ROWS), ty * TILE * self.stride + tx * TILE)
    }
}

/// Draws a part of a row: columns `x` with `left ≤ x ≤ right`, at 1/depth `part + along`.
#[inline(always)]
fn draw_chunk(pixels: &mut [f32; CHUNK], x: &[f32; CHUNK], part: &[f32; CHUNK], left: f32, right: f32, along: f32) {
    for i in 0..CHUNK {
        let new = part[i] + along;
        let new = if x[i] >= left { new } else { 0.0 };
        let new = if x[i] <= right { new } else { 0.0 };
        pixels[i] = high(new, pixels[i]);
    }
}

/// Marks the pixels of a part of a row that came nearer.
#[inline(always)]
fn mark_chunk(marks: &mut [u32], before: &[f32; CHUNK], after: &[f32; CHUNK], mark: u32) {
    let Some(marks) = marks.first_chunk_mut::<CHUNK>() else { return };
    for i in 0..CHUNK {
        marks[i] = if after[i] > before[i] { mark } else { marks[i] };
    }
}
