//! A dense grid over world cells that grows to what is written: the agent does not know how large the world is.

use glam::Vec3;

/// Cells are named by world index `[x, z]`; cells never written read as the default.
#[derive(Debug, Clone)]
pub struct WorldGrid<T> {
    low: [i32; 2],
    shape: [usize; 2],
    cells: Vec<T>,
}

/// Growth is rounded up to this many cells, so that a walk does not reallocate at every step.
const MARGIN: i32 = 64;

impl<T: Copy + Default> Default for WorldGrid<T> {
    fn default() -> Self {
        Self { low: [0; 2], shape: [0; 2], cells: Vec::new() }
    }
}

impl<T: Copy + Default> WorldGrid<T> {
    /// Grows to hold every cell from `low` to `high`, both included.
    pub fn include(&mut self, low: [i32; 2], high: [i32; 2]) {
        let end = |axis: usize| self.low[axis] + self.shape[axis] as i32;
        let fits = |axis: usize| low[axis] >= self.low[axis] && high[axis] < end(axis);
        if !self.cells.is_empty() && fits(0) && fits(1) {
            return;
        }
        let empty = self.cells.is_empty();
        let from = |axis: usize| if empty { low[axis] } else { low[axis].min(self.low[axis]) };
        let to = |axis: usize| if empty { high[axis] } else { high[axis].max(end(axis) - 1) };
        let new_low = [0, 1].map(|a| if empty || low[a] < self.low[a] { from(a) - MARGIN } else { from(a) });
        let new_high = [0, 1].map(|a| if empty || high[a] >= end(a) { to(a) + MARGIN } else { to(a) });
        let shape = [0, 1].map(|a| (new_high[a] - new_low[a] + 1) as usize);
        let mut cells = vec![T::default(); shape[0] * shape[1]];
        for x in 0..self.shape[0] {
            let column = (self.low[0] - new_low[0]) as usize + x;
            let start = column * shape[1] + (self.low[1] - new_low[1]) as usize;
            cells[start..start + self.shape[1]]
                .copy_from_slice(&self.cells[x * self.shape[1]..(x + 1) * self.shape[1]]);
        }
        *self = Self { low: new_low, shape, cells };
    }

    /// Value of a cell.
    pub fn get(&self, cell: [i32; 2]) -> T {
        self.index(cell).map_or(T::default(), |at| self.cells[at])
    }

    /// The cell for writing; `None` outside what was included.
    pub fn get_mut(&mut self, cell: [i32; 2]) -> Option<&mut T> {
        self.index(cell).map(|at| &mut self.cells[at])
    }

    /// The part of column `x` that lies in rows `z_low..=z_high`, with the row of its first cell.
    pub fn column(&self, x: i32, z_low: i32, z_high: i32) -> (i32, &[T]) {
        let from = z_low.max(self.low[1]);
        let to = z_high.min(self.low[1] + self.shape[1] as i32 - 1);
        match (self.index([x, from]), self.index([x, to])) {
            (Some(start), Some(end)) if from <= to => (from, &self.cells[start..=end]),
            _ => (z_low, &[]),
        }
    }

    /// Memory that it holds, bytes.
    pub fn bytes(&self) -> usize {
        self.cells.capacity() * size_of::<T>()
    }

    /// Lowest cell and number of cells along `x` and `z`.
    pub fn extent(&self) -> ([i32; 2], [usize; 2]) {
        (self.low, self.shape)
    }

    fn index(&self, [x, z]: [i32; 2]) -> Option<usize> {
        let column = usize::try_from(x.checked_sub(self.low[0])?).ok()?;
        let row = usize::try_from(z.checked_sub(self.low[1])?).ok()?;
        (column < self.shape[0] && row < self.shape[1]).then_some(column * self.shape[1] + row)
    }
}

/// Cells of side `cell` metres that a segment crosses in the `(x, z)` plane, from its first end to its last, each once.
pub fn cells_between(a: Vec3, b: Vec3, cell: f32) -> impl Iterator<Item = [i32; 2]> {
    let (from, to) = ([a.x / cell, a.z / cell], [b.x / cell, b.z / cell]);
    let (start, end) = (from.map(|v| v.floor() as i32), to.map(|v| v.floor() as i32));
    let step = [0, 1].map(|axis| (end[axis] - start[axis]).signum());
    // Share of the segment between two borders of each axis, and at which the next one is crossed.
    let stride = [0, 1].map(|axis| 1.0 / (to[axis] - from[axis]).abs().max(1e-9));
    let mut next = [0, 1].map(|axis| {
        let border = if step[axis] > 0 { start[axis] + 1 } else { start[axis] } as f32;
        (border - from[axis]).abs() * stride[axis]
    });
    let crossings = (end[0] - start[0]).unsigned_abs() + (end[1] - start[1]).unsigned_abs();
    let mut current = start;
    (0..=crossings).map(move |n| {
        if n > 0 {
            // An axis that has arrived must not move on, whatever rounding says.
            let axis = usize::from(current[0] == end[0] || (current[1] != end[1] && next[1] < next[0]));
            current[axis] += step[axis];
            next[axis] += stride[axis];
        }
        current
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn growth_keeps_what_was_written() {
        let mut grid = WorldGrid::<u16>::default();
        assert_eq!(grid.get([3, 4]), 0);
        for (n, cell) in [[0, 0], [-500, 3], [40, 900], [-501, -7]].into_iter().enumerate() {
            grid.include(cell, cell);
            *grid.get_mut(cell).unwrap() = n as u16 + 1;
        }
        assert_eq!([[0, 0], [-500, 3], [40, 900], [-501, -7]].map(|c| grid.get(c)), [1, 2, 3, 4]);
        let (start, cells) = grid.column(40, 898, 5_000_000);
        assert_eq!((start, cells[2]), (898, 3));
    }

    proptest! {
        #[test]
        fn segments_cross_connected_cells_from_end_to_end(
            ax in -5.0_f32..5.0, az in -5.0_f32..5.0, bx in -5.0_f32..5.0, bz in -5.0_f32..5.0,
        ) {
            let (a, b, side) = (Vec3::new(ax, 0.0, az), Vec3::new(bx, 0.0, bz), 0.15);
            let cells: Vec<_> = cells_between(a, b, side).collect();
            let cell_of = |p: Vec3| [(p.x / side).floor() as i32, (p.z / side).floor() as i32];
            prop_assert_eq!(cells[0], cell_of(a));
            prop_assert_eq!(cells[cells.len() - 1], cell_of(b));
            for pair in cells.windows(2) {
                prop_assert_eq!((pair[0][0] - pair[1][0]).abs() + (pair[0][1] - pair[1][1]).abs(), 1);
            }
            for cell in cells {
                // Every cell lies within its own half-diagonal of the segment.
                let middle = Vec3::new(cell[0] as f32 + 0.5, 0.0, cell[1] as f32 + 0.5) * side;
                let t = ((middle - a).dot(b - a) / (b - a).length_squared().max(1e-9)).clamp(0.0, 1.0);
                prop_assert!(middle.distance(a + t * (b - a)) < 0.71 * side + 1e-3);
            }
        }
    }
}
