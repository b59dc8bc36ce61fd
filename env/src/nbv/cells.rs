//! The agent's cloud, thinned and filed in square cells over the full height of the scene's box.

use super::neighbours::Neighbours;
use crate::seed::Rng;
use glam::Vec3;
use std::collections::HashSet;

/// Points in cells.
#[derive(Clone, Debug)]
pub struct Cells {
    bounds: [Vec3; 2],
    side: f32,
    voxel: f32,
    size: [usize; 2],
    cells: Vec<Vec<Vec3>>,
    /// Only asked, never iterated: its order is chance.
    taken: HashSet<[i32; 3]>,
}

impl Cells {
    /// No points yet, in a box cut into cells of `side` metres, from which one point is kept in each cube of `voxel` metres.
    pub fn new(bounds: [Vec3; 2], side: f32, voxel: f32) -> Self {
        let extent = (bounds[1] - bounds[0]).max(Vec3::ZERO);
        let size = [extent.x, extent.z].map(|length| ((length / side).ceil() as usize).max(1));
        Self { bounds, side, voxel, size, cells: vec![Vec::new(); size[0] * size[1]], taken: HashSet::new() }
    }

    /// Adds those points whose cube is still empty.
    pub fn add(&mut self, points: impl Iterator<Item = Vec3>) {
        for point in points {
            if self.taken.insert((point / self.voxel).floor().as_ivec3().to_array()) {
                let cell = self.cell_of(point);
                self.cells[cell].push(point);
            }
        }
    }

    /// The cell of a point; outside of the box, the nearest at its border.
    pub fn cell_of(&self, point: Vec3) -> usize {
        let away = (point - self.bounds[0]) / self.side;
        let index = |value: f32, count: usize| (value.max(0.0) as usize).min(count - 1);
        index(away.x, self.size[0]) * self.size[1] + index(away.z, self.size[1])
    }

    /// Middle of a cell, halfway up the box, metres.
    pub fn middle(&self, cell: usize) -> Vec3 {
        let [low, high] = self.bounds;
        let (x, z) = ((cell / self.size[1]) as f32 + 0.5, (cell % self.size[1]) as f32 + 0.5);
        Vec3::new(low.x + x * self.side, 0.5 * (low.y + high.y), low.z + z * self.side)
    }

    /// Length of a cell's diagonal, metres.
    pub fn diagonal(&self) -> f32 {
        let height = self.bounds[1].y - self.bounds[0].y;
        Vec3::new(self.side, height, self.side).length()
    }

    /// Number of cells.
    pub fn len(&self) -> usize {
        self.cells.len()
    }

    /// True without cells, which cannot be.
    pub fn is_empty(&self) -> bool {
        self.cells.is_empty()
    }

    /// Points in each cell and its eight neighbours.
    pub fn counts(&self) -> Vec<u32> {
        let count = |cell| self.around(cell).map(|cell| self.cells[cell].len() as u32).sum();
        (0..self.cells.len()).map(count).collect()
    }

    /// `amount` different points at random of a cell and its neighbours, or all where there are fewer, in an order drawn
    /// anew: ready to be asked for nearest neighbours.
    pub fn draw(&self, cell: usize, amount: usize, place: impl Fn(Vec3) -> Vec3, rng: &mut Rng) -> Neighbours {
        let all: Vec<Vec3> = self.around(cell).flat_map(|cell| self.cells[cell].iter().copied()).collect();
        let chosen = rand::seq::index::sample(rng, all.len(), amount.min(all.len()));
        Neighbours::new(chosen.into_iter().map(|index| place(all[index])).collect())
    }

    /// Whether a kept point of the cell and its neighbours lies within `reach` metres.
    pub fn is_within(&self, point: Vec3, reach: f32) -> bool {
        let mut near = self.around(self.cell_of(point)).flat_map(|cell| &self.cells[cell]);
        near.any(|other| other.distance_squared(point) <= reach * reach)
    }

    fn around(&self, cell: usize) -> impl Iterator<Item = usize> + '_ {
        let (i, k) = (cell / self.size[1], cell % self.size[1]);
        let range = |at: usize, count: usize| at.saturating_sub(1)..(at + 2).min(count);
        range(i, self.size[0]).flat_map(move |i| range(k, self.size[1]).map(move |k| i * self.size[1] + k))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::seed::SeedTree;
    use rand::RngExt as _;

    #[test]
    fn neighbourhoods_are_the_cells_around_and_cubes_keep_one_point() {
        let bounds = [Vec3::new(-3.0, 0.0, 1.0), Vec3::new(10.0, 4.0, 9.0)];
        let mut cells = Cells::new(bounds, 3.0, 0.5);
        assert_eq!(cells.len(), 5 * 3);
        let mut rng = SeedTree::new(2).rng();
        let size = bounds[1] - bounds[0];
        let points: Vec<Vec3> =
            (0..4000).map(|_| bounds[0] + size * Vec3::from([(); 3].map(|()| rng.random::<f32>()))).collect();
        cells.add(points.iter().copied());
        cells.add(points.iter().copied());
        let mut kept: Vec<Vec3> = Vec::new();
        for point in points {
            let cube = |p: &Vec3| (p / 0.5).floor();
            if !kept.iter().any(|other| cube(other) == cube(&point)) {
                kept.push(point);
            }
        }
        for (cell, count) in cells.counts().into_iter().enumerate() {
            let middle = cells.middle(cell);
            assert_eq!(cells.cell_of(middle), cell);
            let is_around = |p: &&Vec3| (p.x - middle.x).abs() < 4.5 && (p.z - middle.z).abs() < 4.5;
            assert_eq!(kept.iter().filter(is_around).count(), count as usize);
            let drawn = cells.draw(cell, 20, |p| p, &mut rng);
            let mut points: Vec<[f32; 3]> = drawn.points(20);
            assert!(points.iter().all(|&p| kept.iter().filter(is_around).any(|k| k.to_array() == p)));
            points.sort_by(|a, b| a.partial_cmp(b).unwrap());
            points.dedup();
            assert_eq!(points.len(), 20);
        }
        assert_eq!(cells.cell_of(Vec3::splat(1e6)), 14);
        assert_eq!(cells.cell_of(Vec3::splat(f32::NAN)), 0);
    }
}
