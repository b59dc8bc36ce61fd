//! The plan at the camera plane as cells of 8 map units: what is free, what is wall, what is furniture.
//!
//! Axis-aligned geometry keeps to multiples of 8, so the raster is exact there; oblique walls are rounded to cells.

use super::outline::{Polygon, bounds, spans_along};
use std::ops::Range;

/// Side of a cell, map units.
pub(crate) const CELL: i32 = 8;

/// What is at a cell at the height of the camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Cover {
    /// Solid between rooms; may be carved.
    Wall,
    /// Air.
    Free,
    /// A pillar or crate; never carved.
    Blocked,
}

/// The cells of a site whose lower corner is `(0, 0)`.
#[derive(Clone, Debug)]
pub(crate) struct Raster {
    columns: i32,
    rows: i32,
    cells: Vec<Cover>,
}

impl Raster {
    /// All wall; the size is in map units.
    pub(crate) fn new(width: i32, height: i32) -> Self {
        let (columns, rows) = (width / CELL, height / CELL);
        Self { columns, rows, cells: vec![Cover::Wall; (columns * rows).max(0) as usize] }
    }

    /// Size in map units.
    pub(crate) fn size(&self) -> [i32; 2] {
        [self.columns * CELL, self.rows * CELL]
    }

    fn index(&self, column: i32, row: i32) -> Option<usize> {
        let inside = (0..self.columns).contains(&column) && (0..self.rows).contains(&row);
        inside.then(|| (row * self.columns + column) as usize)
    }

    /// Cover at a point; wall outside.
    pub(crate) fn at(&self, x: f64, y: f64) -> Cover {
        let [column, row] = [x, y].map(|v| (v / f64::from(CELL)).floor() as i32);
        self.index(column, row).map_or(Cover::Wall, |index| self.cells[index])
    }

    /// Fills the cells whose middle lies in a polygon.
    pub(crate) fn fill(&mut self, polygon: &[[i32; 2]], cover: Cover) {
        for (row, columns) in self.spans(polygon) {
            for column in columns.start.max(0)..columns.end.min(self.columns) {
                if let Some(index) = self.index(column, row) {
                    self.cells[index] = cover;
                }
            }
        }
    }

    /// Whether every cell whose middle lies in a polygon has a cover.
    pub(crate) fn is_all(&self, polygon: &[[i32; 2]], wanted: Cover) -> bool {
        let cover = |column, row| self.index(column, row).map_or(Cover::Wall, |index| self.cells[index]);
        self.spans(polygon).into_iter().all(|(row, mut columns)| columns.all(|column| cover(column, row) == wanted))
    }

    /// Rows and columns of the cells whose middle lies in a polygon.
    fn spans(&self, polygon: &[[i32; 2]]) -> Vec<(i32, Range<i32>)> {
        let [low, high] = bounds(polygon);
        let mut spans = Vec::new();
        for row in low[1].div_euclid(CELL)..=high[1].div_euclid(CELL) {
            let y = (f64::from(row) + 0.5) * f64::from(CELL);
            for [from, to] in spans_along(polygon, 0, y) {
                let [from, to] = [from, to].map(|x| (x / f64::from(CELL) - 0.5).ceil() as i32);
                spans.push((row, from..to));
            }
        }
        spans
    }

    /// Whether every cell that a rectangle touches has one of the covers.
    pub(crate) fn all(&self, rect: Rect, accept: impl Fn(Cover) -> bool) -> bool {
        let [x0, y0] = rect.low.map(|v| v.div_euclid(CELL));
        let [x1, y1] = rect.high.map(|v| (v - 1).div_euclid(CELL));
        (y0..=y1)
            .all(|row| (x0..=x1).all(|column| accept(self.index(column, row).map_or(Cover::Wall, |i| self.cells[i]))))
    }

    /// Number of free cells.
    pub(crate) fn free_cells(&self) -> usize {
        self.cells.iter().filter(|&&cover| cover == Cover::Free).count()
    }
}

/// An axis-aligned rectangle, map units.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Rect {
    /// Lower corner.
    pub(crate) low: [i32; 2],
    /// Upper corner.
    pub(crate) high: [i32; 2],
}

impl Rect {
    /// From two opposite corners in any order.
    pub(crate) fn spanning(a: [i32; 2], b: [i32; 2]) -> Self {
        Self { low: [a[0].min(b[0]), a[1].min(b[1])], high: [a[0].max(b[0]), a[1].max(b[1])] }
    }

    /// Of a size around a middle.
    pub(crate) fn around(middle: [i32; 2], size: [i32; 2]) -> Self {
        let low = [middle[0] - size[0] / 2, middle[1] - size[1] / 2];
        Self { low, high: [low[0] + size[0], low[1] + size[1]] }
    }

    /// Larger by a margin on all sides.
    pub(crate) fn grown(self, margin: i32) -> Self {
        Self { low: self.low.map(|v| v - margin), high: self.high.map(|v| v + margin) }
    }

    /// Whether two rectangles share area.
    pub(crate) fn overlaps(self, other: Self) -> bool {
        (0..2).all(|axis| self.low[axis] < other.high[axis] && other.low[axis] < self.high[axis])
    }

    /// Width and height.
    pub(crate) fn size(self) -> [i32; 2] {
        [self.high[0] - self.low[0], self.high[1] - self.low[1]]
    }

    /// Its four corners.
    pub(crate) fn polygon(self) -> Polygon {
        vec![self.low, [self.high[0], self.low[1]], self.high, [self.low[0], self.high[1]]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fill_covers_the_polygon() {
        let mut raster = Raster::new(256, 256);
        let room = Rect { low: [64, 32], high: [128, 160] };
        raster.fill(&room.polygon(), Cover::Free);
        assert_eq!(raster.free_cells(), 8 * 16);
        assert!(raster.all(room, |cover| cover == Cover::Free));
        assert!(!raster.all(room.grown(1), |cover| cover == Cover::Free));
        assert_eq!(raster.at(63.9, 40.0), Cover::Wall);
        assert_eq!(raster.at(-5.0, 1e9), Cover::Wall);
        let beside = Rect { low: [128, 32], high: [136, 160] };
        assert!(raster.is_all(&room.polygon(), Cover::Free) && raster.is_all(&beside.polygon(), Cover::Wall));
    }
}
