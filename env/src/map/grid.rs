//! A dense grid over world cells that grows to what is written: the agent does not know how large the world is.
//!
//! Cells of one `z` lie together, from high to low `x`: rows of a grid are rows of the images ([`crate::window`]).

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
        let grown = Self { low: new_low, shape, cells: Vec::new() };
        for (z, row) in (self.low[1]..).zip(self.cells.chunks_exact(self.shape[0].max(1))) {
            if let Some(start) = grown.index([end(0) - 1, z]) {
                cells[start..start + row.len()].copy_from_slice(row);
            }
        }
        *self = Self { cells, ..grown };
    }

    /// Value of a cell.
    pub fn get(&self, cell: [i32; 2]) -> T {
        self.index(cell).map_or(T::default(), |at| self.cells[at])
    }

    /// The cell for writing; `None` outside what was included.
    pub fn get_mut(&mut self, cell: [i32; 2]) -> Option<&mut T> {
        self.index(cell).map(|at| &mut self.cells[at])
    }

    /// The part of row `z` from `x_high` down to `x_low`, with the `x` of its first cell.
    pub fn row(&self, z: i32, x_high: i32, x_low: i32) -> (i32, &[T]) {
        let from = x_high.min(self.low[0] + self.shape[0] as i32 - 1);
        let to = x_low.max(self.low[0]);
        match (self.index([from, z]), self.index([to, z])) {
            (Some(start), Some(end)) if to <= from => (from, &self.cells[start..=end]),
            _ => (x_high, &[]),
        }
    }

    /// Changes the cells of [`cells_between`] two positions that were included.
    pub fn change_between(&mut self, a: Vec3, b: Vec3, side: f32, mut change: impl FnMut(&mut T)) {
        let way = Traversal::new(a, b, side);
        // Segments and grids are convex: with both ends, all that lies between is inside.
        let (Some(mut at), Some(_)) = (self.index(way.start), self.index(way.end)) else { return };
        let strides = [-(way.step[0] as isize), way.step[1] as isize * self.shape[0] as isize];
        change(&mut self.cells[at]);
        for axis in way {
            at = at.wrapping_add_signed(if axis == 0 { strides[0] } else { strides[1] });
            change(&mut self.cells[at]);
        }
    }

    /// Number of cells of a kind.
    pub fn count(&self, is_counted: impl Fn(&T) -> bool) -> usize {
        self.cells.iter().filter(|cell| is_counted(cell)).count()
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
        // What lies below wraps around to more than any grid has.
        let [column, row] = [x.wrapping_sub(self.low[0]) as u32 as usize, z.wrapping_sub(self.low[1]) as u32 as usize];
        (column < self.shape[0] && row < self.shape[1]).then(|| (row + 1) * self.shape[0] - 1 - column)
    }
}

/// The cell of a coordinate: `floor`, without a call into the C library.
#[inline]
pub fn cell_of(coordinate: f32) -> i32 {
    // Adding this number leaves no bits for a fraction: what it moved by is the nearest whole number.
    const SHIFT: f32 = 1.5 * (1 << 23) as f32;
    if coordinate.abs() < (1 << 22) as f32 {
        let shifted = coordinate + SHIFT;
        let nearest = shifted.to_bits().wrapping_sub(SHIFT.to_bits()) as i32;
        nearest - i32::from(shifted - SHIFT > coordinate)
    } else {
        coordinate.floor() as i32
    }
}

/// Cells of side `side` metres that a segment crosses in the `(x, z)` plane, from its first end to its last, each once.
pub fn cells_between(a: Vec3, b: Vec3, side: f32) -> impl Iterator<Item = [i32; 2]> {
    let way = Traversal::new(a, b, side);
    let (mut current, step) = (way.start, way.step);
    std::iter::once(current).chain(way.map(move |axis| {
        current[axis] += step[axis];
        current
    }))
}

/// The axes across which a segment leaves its cells, in order (Amanatides and Woo, "A Fast Voxel Traversal Algorithm",
/// 1987).
struct Traversal {
    start: [i32; 2],
    end: [i32; 2],
    /// Direction along each axis: -1, 0 or 1.
    step: [i32; 2],
    /// Borders still to cross on each axis.
    left: [u32; 2],
    /// Share of the segment at which the next border of each axis is crossed; infinite once the axis has arrived, so that
    /// it does not move on, whatever rounding says.
    next: [f32; 2],
    /// Share of the segment between two borders of each axis.
    stride: [f32; 2],
}

impl Traversal {
    fn new(a: Vec3, b: Vec3, side: f32) -> Self {
        let (from, to) = ([a.x / side, a.z / side], [b.x / side, b.z / side]);
        let (start, end) = (from.map(cell_of), to.map(cell_of));
        let step = [0, 1].map(|axis| (end[axis] - start[axis]).signum());
        let left = [0, 1].map(|axis| end[axis].abs_diff(start[axis]));
        let stride = [0, 1].map(|axis| 1.0 / (to[axis] - from[axis]).abs().max(1e-9));
        let next = [0, 1].map(|axis| {
            let border = if step[axis] > 0 { start[axis] + 1 } else { start[axis] } as f32;
            if left[axis] == 0 { f32::INFINITY } else { (border - from[axis]).abs() * stride[axis] }
        });
        Self { start, end, step, left, next, stride }
    }
}

impl Iterator for Traversal {
    type Item = usize;

    fn next(&mut self) -> Option<usize> {
        if self.left[0] + self.left[1] == 0 {
            return None;
        }
        let axis = usize::from(self.next[1] < self.next[0]);
        // Both axes are computed and one is taken: which it is cannot be foretold, and a wrong guess costs more.
        for a in 0..2 {
            let moves = a == axis;
            self.left[a] -= u32::from(moves);
            let onward = self.next[a] + if moves { self.stride[a] } else { 0.0 };
            self.next[a] = if self.left[a] == 0 { f32::INFINITY } else { onward };
        }
        Some(axis)
    }
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
        let (start, cells) = grid.row(900, 42, -5_000_000);
        assert_eq!((start, cells[2]), (42, 3));
        let (_, cells) = grid.row(900, 5_000_000, 40);
        assert_eq!(cells.last(), Some(&3));
    }

    proptest! {
        #[test]
        fn cells_are_floors(bits: u32) {
            let coordinate = f32::from_bits(bits);
            for v in [coordinate, coordinate.fract() * 1e6, (bits as i32 / 3) as f32 / 256.0, (bits % 999) as f32 - 500.0] {
                prop_assert_eq!(cell_of(v), v.floor() as i32, "{}", v);
            }
        }

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
            let mut grid = WorldGrid::<u8>::default();
            grid.include([-40; 2], [40; 2]);
            grid.change_between(a, b, side, |count| *count += 1);
            prop_assert_eq!(grid.cells.iter().map(|&count| usize::from(count)).sum::<usize>(), cells.len());
            for cell in cells {
                prop_assert_eq!(grid.get(cell), 1);
                // Every cell lies within its own half-diagonal of the segment.
                let middle = Vec3::new(cell[0] as f32 + 0.5, 0.0, cell[1] as f32 + 0.5) * side;
                let t = ((middle - a).dot(b - a) / (b - a).length_squared().max(1e-9)).clamp(0.0, 1.0);
                prop_assert!(middle.distance(a + t * (b - a)) < 0.71 * side + 1e-3);
            }
        }
    }
}
