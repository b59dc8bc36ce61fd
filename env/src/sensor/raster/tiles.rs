//! The image while it is drawn: 1/depth in tiles of 8×8 pixels, and the depth pyramid above them.
//!
//! Every pixel holds the largest 1/depth drawn so far, so the order of drawing does not change the result. The pyramid
//! holds the smallest 1/depth of each tile and of each block of 4×4 tiles: what is not nearer than that is hidden.

use super::view::Extent;
use super::{high, low};
use crate::sensor::{Camera, Frame};

/// Side of a tile, pixels.
pub(super) const TILE: usize = 8;

/// Side of a block, tiles.
const BLOCK: usize = 4;

/// One tile, row-major.
type Tile = [[f32; TILE]; TILE];

/// A plane over the image: `x · (col - col₀) + y · (row - row₀) + at` for a tile whose first pixel is `(col₀, row₀)`.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Plane {
    pub(super) x: f32,
    pub(super) y: f32,
    pub(super) at: f32,
}

impl Plane {
    /// The same plane seen from the tile with first pixel centre `(x, y)` from the image's centre.
    #[inline(always)]
    fn from_tile(&self, x: f32, y: f32) -> Self {
        Self { at: self.x * x + (self.y * y + self.at), ..*self }
    }

    /// Value at a pixel of the tile. Rounding keeps this monotonic in `col` and in `row`, so a bound at a corner of the
    /// tile bounds every pixel exactly.
    #[inline(always)]
    fn value(&self, col: f32, row: f32) -> f32 {
        self.x * col + (self.y * row + self.at)
    }

    /// Largest value in the tile.
    #[inline(always)]
    fn largest(&self) -> f32 {
        const END: f32 = (TILE - 1) as f32;
        self.value(if self.x > 0.0 { END } else { 0.0 }, if self.y > 0.0 { END } else { 0.0 })
    }

    /// Smallest value in the tile.
    #[inline(always)]
    fn smallest(&self) -> f32 {
        const END: f32 = (TILE - 1) as f32;
        self.value(if self.x > 0.0 { 0.0 } else { END }, if self.y > 0.0 { 0.0 } else { END })
    }
}

/// A triangle, ready to be drawn.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Triangle {
    /// Not negative inside.
    pub(super) edges: [Plane; 3],
    /// 1/depth.
    pub(super) inverse: Plane,
    /// Pixels that it may cover, and its largest 1/depth.
    pub(super) extent: Extent,
    /// Whether a part of it may lie before the near plane.
    pub(super) near: bool,
}

/// The image being drawn.
#[derive(Default)]
pub(super) struct Tiles {
    tiles: Vec<Tile>,
    /// Smallest 1/depth of each tile; rows of `stride`, filled up with infinity to whole blocks.
    floor: Vec<f32>,
    /// Smallest 1/depth of each block.
    block_floor: Vec<f32>,
    columns: usize,
    stride: usize,
    block_columns: usize,
    /// First pixel centre, from the image's centre.
    origin: [f32; 2],
}

impl Tiles {
    /// An empty image.
    pub(super) fn start(&mut self, camera: &Camera, far: f32) {
        let (columns, rows) = (camera.width.div_ceil(TILE), camera.height.div_ceil(TILE));
        let (block_columns, block_rows) = (columns.div_ceil(BLOCK), rows.div_ceil(BLOCK));
        (self.columns, self.block_columns, self.stride) = (columns, block_columns, block_columns * BLOCK);
        self.origin = camera.offsets(0, 0);
        self.tiles.clear();
        self.tiles.resize(columns * rows, [[far; TILE]; TILE]);
        self.floor.clear();
        self.floor.resize(self.stride * block_rows * BLOCK, f32::INFINITY);
        for line in self.floor.chunks_exact_mut(self.stride).take(rows) {
            line[..columns].fill(far);
        }
        self.block_floor.clear();
        self.block_floor.resize(block_columns * block_rows, far);
        // Pixels beyond the image's border must not keep their tile from filling up.
        for row in 0..rows * TILE {
            for col in camera.width..columns * TILE {
                self.tiles[row / TILE * columns + col / TILE][row % TILE][col % TILE] = f32::INFINITY;
            }
        }
        for row in camera.height..rows * TILE {
            for tile in &mut self.tiles[row / TILE * columns..][..columns] {
                tile[row % TILE] = [f32::INFINITY; TILE];
            }
        }
    }

    /// Whether a surface within an extent could be nearer than what is drawn.
    #[inline(always)]
    pub(super) fn may_show(&self, extent: &Extent) -> bool {
        if extent.x0 >= extent.x1 || extent.y0 >= extent.y1 {
            return false;
        }
        let (x0, x1) = (extent.x0 as usize / TILE, (extent.x1 - 1) as usize / TILE);
        let (y0, y1) = (extent.y0 as usize / TILE, (extent.y1 - 1) as usize / TILE);
        for by in y0 / BLOCK..=y1 / BLOCK {
            for bx in x0 / BLOCK..=x1 / BLOCK {
                if extent.nearest <= self.block_floor[by * self.block_columns + bx] {
                    continue;
                }
                for y in y0.max(by * BLOCK)..=y1.min(by * BLOCK + BLOCK - 1) {
                    let line = &self.floor[y * self.stride..][..self.stride];
                    let cells = &line[x0.max(bx * BLOCK)..=x1.min(bx * BLOCK + BLOCK - 1)];
                    if cells.iter().any(|&floor| extent.nearest > floor) {
                        return true;
                    }
                }
            }
        }
        false
    }

    /// Draws one triangle.
    #[inline(always)]
    pub(super) fn draw(&mut self, triangle: &Triangle) {
        let extent = &triangle.extent;
        if extent.x0 >= extent.x1 || extent.y0 >= extent.y1 {
            return;
        }
        let (x0, x1) = (extent.x0 as usize / TILE, (extent.x1 - 1) as usize / TILE);
        let (y0, y1) = (extent.y0 as usize / TILE, (extent.y1 - 1) as usize / TILE);
        for ty in y0..=y1 {
            let rows =
                (extent.y0 as usize).max(ty * TILE) - ty * TILE..(extent.y1 as usize).min(ty * TILE + TILE) - ty * TILE;
            for tx in x0..=x1 {
                let floor = self.floor[ty * self.stride + tx];
                if extent.nearest <= floor {
                    continue;
                }
                let (x, y) = (self.origin[0] + (tx * TILE) as f32, self.origin[1] + (ty * TILE) as f32);
                let edges = triangle.edges.map(|edge| edge.from_tile(x, y));
                if low(low(edges[0].largest(), edges[1].largest()), edges[2].largest()) < 0.0 {
                    continue;
                }
                let inverse = triangle.inverse.from_tile(x, y);
                if inverse.largest() <= floor {
                    continue;
                }
                let tile = &mut self.tiles[ty * self.columns + tx];
                let inside = low(low(edges[0].smallest(), edges[1].smallest()), edges[2].smallest()) >= 0.0;
                if inside & !triangle.near {
                    cover(tile, &inverse);
                } else {
                    // NaN-free limit: without a near part, nothing is cut away.
                    let limit = if triangle.near { 1.0 / Camera::NEAR } else { f32::INFINITY };
                    fill(tile, &edges, &inverse, rows.clone(), limit);
                }
                let raised = smallest(tile);
                self.raise(tx, ty, floor, raised);
            }
        }
    }

    /// Notes the new smallest 1/depth of a tile, and of its block if the tile was what held that down.
    #[inline(always)]
    fn raise(&mut self, tx: usize, ty: usize, floor: f32, raised: f32) {
        if raised <= floor {
            return;
        }
        self.floor[ty * self.stride + tx] = raised;
        let block = ty / BLOCK * self.block_columns + tx / BLOCK;
        if floor <= self.block_floor[block] {
            let first = ty / BLOCK * BLOCK * self.stride + tx / BLOCK * BLOCK;
            let mut least = [f32::INFINITY; BLOCK];
            for line in 0..BLOCK {
                let cells = &self.floor[first + line * self.stride..][..BLOCK];
                for (least, &cell) in least.iter_mut().zip(cells) {
                    *least = low(*least, cell);
                }
            }
            self.block_floor[block] = low(low(least[0], least[1]), low(least[2], least[3]));
        }
    }

    /// Writes depths.
    #[inline(always)]
    pub(super) fn finish(&self, far: f32, out: &mut Frame) {
        for (row, line) in out.depth.chunks_exact_mut(out.width).enumerate() {
            let tiles = &self.tiles[row / TILE * self.columns..][..self.columns];
            let depth = |inverse: f32| if inverse > far { 1.0 / inverse } else { 0.0 };
            let mut cells = line.chunks_exact_mut(TILE);
            for (cells, tile) in (&mut cells).zip(tiles) {
                for (cell, &inverse) in cells.iter_mut().zip(&tile[row % TILE]) {
                    *cell = depth(inverse);
                }
            }
            let rest = cells.into_remainder();
            if let Some(tile) = tiles.last() {
                for (cell, &inverse) in rest.iter_mut().zip(&tile[row % TILE]) {
                    *cell = depth(inverse);
                }
            }
        }
    }
}

/// Draws a plane over a whole tile.
#[inline(always)]
fn cover(tile: &mut Tile, inverse: &Plane) {
    for (row, line) in tile.iter_mut().enumerate() {
        for (col, pixel) in line.iter_mut().enumerate() {
            *pixel = high(inverse.value(col as f32, row as f32), *pixel);
        }
    }
}

/// Draws a triangle into some rows of a tile.
#[inline(always)]
fn fill(tile: &mut Tile, edges: &[Plane; 3], inverse: &Plane, rows: std::ops::Range<usize>, limit: f32) {
    for row in rows {
        let line = &mut tile[row];
        for (col, pixel) in line.iter_mut().enumerate() {
            let (col, row) = (col as f32, row as f32);
            let inside = low(low(edges[0].value(col, row), edges[1].value(col, row)), edges[2].value(col, row));
            let new = inverse.value(col, row);
            let kept = if (inside >= 0.0) & (new <= limit) { new } else { 0.0 };
            *pixel = high(kept, *pixel);
        }
    }
}

/// Smallest 1/depth in a tile.
#[inline(always)]
fn smallest(tile: &Tile) -> f32 {
    let mut least = tile[0];
    for line in &tile[1..] {
        for (least, &pixel) in least.iter_mut().zip(line) {
            *least = low(*least, pixel);
        }
    }
    let mut half = [0.0; TILE / 2];
    for (i, half) in half.iter_mut().enumerate() {
        *half = low(least[i], least[i + TILE / 2]);
    }
    low(low(half[0], half[1]), low(half[2], half[3]))
}
