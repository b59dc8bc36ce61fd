//! What is hidden: the smallest 1/depth of each tile of 8×8 pixels, and of each block of 4×4 tiles.

use super::low;
use super::view::Extent;

/// Side of a tile, pixels.
pub(super) const TILE: usize = 8;

/// Side of a block, tiles.
const BLOCK: usize = 4;

/// Lower bounds ("floors") on the 1/depth that is drawn: what is not nearer is hidden.
#[derive(Default)]
pub(super) struct Pyramid {
    /// For each tile, in rows of `stride`, filled up with infinity to whole blocks and one block more.
    floor: Vec<f32>,
    /// For each block; lower than it could be where `block_is_stale`.
    block_floor: Vec<f32>,
    /// Whether a tile of the block was raised since.
    block_is_stale: Vec<bool>,
    /// Tiles, `[tx, ty]`, whose floors may be raised: something was drawn there.
    stale: Vec<[u16; 2]>,
    /// Whether a tile is in that list.
    is_stale: Vec<bool>,
    stride: usize,
    block_columns: usize,
}

impl Pyramid {
    /// For an empty image of `columns` by `rows` tiles.
    #[inline(always)]
    pub(super) fn start(&mut self, columns: usize, rows: usize, far: f32) {
        let (block_columns, block_rows) = (columns.div_ceil(BLOCK), rows.div_ceil(BLOCK));
        (self.block_columns, self.stride) = (block_columns, block_columns * BLOCK);
        self.floor.clear();
        self.floor.resize(self.stride * block_rows * BLOCK + BLOCK, f32::INFINITY);
        for line in self.floor.chunks_exact_mut(self.stride).take(rows) {
            line[..columns].fill(far);
        }
        self.block_floor.clear();
        self.block_floor.resize(block_columns * block_rows, far);
        self.block_is_stale.clear();
        self.block_is_stale.resize(block_columns * block_rows, false);
        self.stale.clear();
        self.is_stale.clear();
        self.is_stale.resize(self.floor.len(), false);
    }

    /// The floor of a tile.
    #[inline(always)]
    pub(super) fn floor(&self, tx: usize, ty: usize) -> f32 {
        self.floor[ty * self.stride + tx]
    }

    /// Whether a surface within an extent could be nearer than what is drawn.
    #[inline(always)]
    pub(super) fn may_show(&mut self, extent: &Extent) -> bool {
        if extent.x0 >= extent.x1 || extent.y0 >= extent.y1 {
            return false;
        }
        let (x0, x1) = (extent.x0 as usize / TILE, (extent.x1 - 1) as usize / TILE);
        let (y0, y1) = (extent.y0 as usize / TILE, (extent.y1 - 1) as usize / TILE);
        if x1 - x0 < BLOCK {
            // Most triangles: no questions on the way.
            let mut least = [f32::INFINITY; BLOCK];
            for y in y0..y1 + 1 {
                let cells = &self.floor[y * self.stride + x0..][..BLOCK];
                for i in 0..BLOCK {
                    least[i] = low(cells[i], least[i]);
                }
            }
            for (i, least) in least.iter_mut().enumerate() {
                *least = if i <= x1 - x0 { *least } else { f32::INFINITY };
            }
            return extent.nearest > low(low(least[0], least[2]), low(least[1], least[3]));
        }
        for by in y0 / BLOCK..y1 / BLOCK + 1 {
            for bx in x0 / BLOCK..x1 / BLOCK + 1 {
                if extent.nearest <= self.block_floor(bx, by) {
                    continue;
                }
                for y in y0.max(by * BLOCK)..(y1 + 1).min(by * BLOCK + BLOCK) {
                    let line = &self.floor[y * self.stride..][..self.stride];
                    let cells = &line[x0.max(bx * BLOCK)..(x1 + 1).min(bx * BLOCK + BLOCK)];
                    if cells.iter().any(|&floor| extent.nearest > floor) {
                        return true;
                    }
                }
            }
        }
        false
    }

    /// Notes that something was drawn into a tile.
    #[inline(always)]
    pub(super) fn touch(&mut self, tx: usize, ty: usize) {
        let is_stale = &mut self.is_stale[ty * self.stride + tx];
        if !*is_stale {
            *is_stale = true;
            self.stale.push([tx as u16, ty as u16]);
        }
    }

    /// Takes one tile from those that were drawn into.
    #[inline(always)]
    pub(super) fn next_stale(&mut self) -> Option<[usize; 2]> {
        let [tx, ty] = self.stale.pop()?.map(usize::from);
        self.is_stale[ty * self.stride + tx] = false;
        Some([tx, ty])
    }

    /// Raises the floor of a tile.
    #[inline(always)]
    pub(super) fn raise(&mut self, tx: usize, ty: usize, raised: f32) {
        self.floor[ty * self.stride + tx] = raised;
        // Looked at when somebody asks: a large triangle raises all the tiles of a block one after the other.
        self.block_is_stale[ty / BLOCK * self.block_columns + tx / BLOCK] = true;
    }

    #[inline(always)]
    fn block_floor(&mut self, bx: usize, by: usize) -> f32 {
        let block = by * self.block_columns + bx;
        if std::mem::take(&mut self.block_is_stale[block]) {
            let first = by * BLOCK * self.stride + bx * BLOCK;
            let mut least = [f32::INFINITY; BLOCK];
            for line in 0..BLOCK {
                let cells = &self.floor[first + line * self.stride..][..BLOCK];
                for i in 0..BLOCK {
                    least[i] = low(cells[i], least[i]);
                }
            }
            self.block_floor[block] = low(low(least[0], least[2]), low(least[1], least[3]));
        }
        self.block_floor[block]
    }
}
