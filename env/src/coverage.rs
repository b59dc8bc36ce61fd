//! Which ground-truth surface points have been reconstructed: the labels' and the metric's common source.
//!
//! A point is covered once a kept point of the cloud lies closer than ε (paper, equation 2). The answer is exact.

use crate::map::grid::cell_of;
use crate::scene::{Scene, surface};
use glam::Vec3;
use serde::{Deserialize, Serialize};

/// How coverage is measured.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CoverageConfig {
    /// Ground-truth points (released code: 20,000 in training, 50,000 in testing).
    pub points: usize,
    /// Distance within which a point counts, metres (released code: 0.5).
    pub epsilon: f32,
    /// Whether the whole reconstruction counts.
    pub counting: Counting,
}

/// Which points of the reconstruction count.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Counting {
    /// All of them: the definition.
    #[default]
    Exact,
    /// After every step a random sample of the cloud, twice as many points as there are in the ground truth (released
    /// code). Reads lower the longer the episode, and may fall.
    AsReleased,
}

impl Default for CoverageConfig {
    fn default() -> Self {
        Self { points: 20_000, epsilon: 0.5, counting: Counting::Exact }
    }
}

/// More cells than this cost more memory than they save time.
const MAX_CELLS: f32 = 4e6;

/// Ground-truth points, filed under every grid cell from which they can be covered. Shared by all episodes of a scene.
#[derive(Debug)]
pub struct Surface {
    points: Vec<Vec3>,
    epsilon: f32,
    /// ε and a hair.
    reach: f32,
    low: Vec3,
    cell: f32,
    shape: [usize; 3],
    /// Where the candidates of each cell begin in `candidates`; one longer than there are cells.
    begin: Vec<u32>,
    candidates: Vec<u32>,
}

impl Surface {
    /// Samples the surface of a scene.
    pub fn of(scene: &Scene, config: &CoverageConfig) -> Self {
        Self::new(surface::sample(scene, config.points), config.epsilon)
    }

    /// Files `points`, to be covered within `epsilon` metres.
    pub fn new(points: Vec<Vec3>, epsilon: f32) -> Self {
        let bounds = |acc: [Vec3; 2], &p: &Vec3| [acc[0].min(p), acc[1].max(p)];
        let first = points.first().copied().unwrap_or_default();
        let [low, high] = points.iter().fold([first; 2], bounds);
        // A hair more than ε: rounding must not lose what the exact test would accept.
        let reach = 1.0001 * epsilon + 1e-6 * low.abs().max(high.abs()).max_element();
        let (low, extent) = (low - reach, high - low + 2.0 * reach);
        let cells_at = |cell: f32| (extent / cell).floor() + 1.0;
        let mut cell = epsilon.max(1e-3);
        while cells_at(cell).element_product() > MAX_CELLS {
            cell *= 1.25;
        }
        let shape = cells_at(cell).to_array().map(|n| n as usize);
        let mut surface = Self { points, epsilon, reach, low, cell, shape, begin: Vec::new(), candidates: Vec::new() };
        surface.file_points();
        surface
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// True without points.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// The points, metres.
    pub fn points(&self) -> &[Vec3] {
        &self.points
    }

    /// Numbers of the points that a cloud covers, ascending.
    pub fn covered_by(&self, cloud: &[Vec3]) -> Vec<u32> {
        let mut coverage = Coverage::new(self);
        coverage.add(self, cloud, 0);
        (0..self.points.len()).filter(|&n| coverage.first[n] != NEVER).map(|n| n as u32).collect()
    }

    fn file_points(&mut self) {
        let mut counts = vec![0_u32; self.shape.iter().product::<usize>() + 1];
        for index in 0..self.points.len() {
            self.cells_near(self.points[index], |cell| counts[cell + 1] += 1);
        }
        for cell in 1..counts.len() {
            counts[cell] += counts[cell - 1];
        }
        self.candidates = vec![0; counts.last().copied().unwrap_or(0) as usize];
        self.begin.clone_from(&counts);
        let mut candidates = std::mem::take(&mut self.candidates);
        for index in 0..self.points.len() {
            self.cells_near(self.points[index], |cell| {
                candidates[counts[cell] as usize] = index as u32;
                counts[cell] += 1;
            });
        }
        self.candidates = candidates;
    }

    /// Calls `visit` for every cell with a part within reach of `point`.
    fn cells_near(&self, point: Vec3, mut visit: impl FnMut(usize)) {
        let local = point - self.low;
        let last = |axis: usize| self.shape[axis] - 1;
        let range = |axis: usize| {
            let (from, to) = ((local[axis] - self.reach) / self.cell, (local[axis] + self.reach) / self.cell);
            from.max(0.0) as usize..=(to as usize).min(last(axis))
        };
        for x in range(0) {
            for y in range(1) {
                for z in range(2) {
                    let corner = Vec3::new(x as f32, y as f32, z as f32) * self.cell;
                    let nearest = local.clamp(corner, corner + self.cell);
                    if nearest.distance_squared(local) <= self.reach * self.reach {
                        visit((x * self.shape[1] + y) * self.shape[2] + z);
                    }
                }
            }
        }
    }

    fn cell_of(&self, point: Vec3) -> Option<usize> {
        // Cells below zero wrap around to more than there are.
        let [x, y, z] = ((point - self.low) / self.cell).to_array().map(|v| cell_of(v) as usize);
        // What is no number compares with nothing, and would cover all.
        (point.is_finite() && x < self.shape[0] && y < self.shape[1] && z < self.shape[2])
            .then(|| (x * self.shape[1] + y) * self.shape[2] + z)
    }
}

/// The step that stands for "never".
const NEVER: u32 = u32::MAX;

/// What one episode has covered so far.
#[derive(Debug, Clone)]
pub struct Coverage {
    /// Candidates as in [`Surface`], those still uncovered first in each cell.
    candidates: Vec<u32>,
    /// How many of a cell's candidates may still be uncovered.
    left: Vec<u32>,
    first: Vec<u32>,
    covered: usize,
}

impl Coverage {
    /// Nothing covered.
    pub fn new(surface: &Surface) -> Self {
        Self {
            candidates: surface.candidates.clone(),
            left: surface.begin.windows(2).map(|w| w[1] - w[0]).collect(),
            first: vec![NEVER; surface.len()],
            covered: 0,
        }
    }

    /// Counts points of the reconstruction taken at `step`.
    pub fn add(&mut self, surface: &Surface, cloud: &[Vec3], step: u32) {
        self.add_and_tell(surface, cloud, step, |_| ());
    }

    /// Numbers of the points that a cloud covers by itself, ascending. Nothing may be covered before, and nothing is after:
    /// much cheaper than a new coverage for each frame.
    pub(crate) fn glance(&mut self, surface: &Surface, cloud: &[Vec3]) -> Vec<u32> {
        let mut changed = Vec::new();
        self.add_and_tell(surface, cloud, 0, |cell| changed.push(cell));
        for cell in changed {
            self.left[cell] = surface.begin[cell + 1] - surface.begin[cell];
        }
        self.covered = 0;
        let seen = (0..).zip(&mut self.first).filter(|(_, first)| **first != NEVER);
        seen.map(|(point, first)| {
            *first = NEVER;
            point
        })
        .collect()
    }

    /// Calls `tell` for each cell whose candidates it has moved, at least once.
    fn add_and_tell(&mut self, surface: &Surface, cloud: &[Vec3], step: u32, mut tell: impl FnMut(usize)) {
        let epsilon_squared = surface.epsilon * surface.epsilon;
        for &point in cloud {
            let Some(cell) = surface.cell_of(point) else { continue };
            let begin = surface.begin[cell] as usize;
            let mut left = self.left[cell] as usize;
            let mut at = 0;
            while at < left {
                let candidate = self.candidates[begin + at] as usize;
                let is_new = self.first[candidate] == NEVER;
                if is_new && surface.points[candidate].distance_squared(point) >= epsilon_squared {
                    at += 1;
                    continue;
                }
                if is_new {
                    self.first[candidate] = step;
                    self.covered += 1;
                }
                left -= 1;
                self.candidates.swap(begin + at, begin + left);
            }
            if left as u32 != self.left[cell] {
                self.left[cell] = left as u32;
                tell(cell);
            }
        }
    }

    /// Whether no point of the reconstruction in a box can cover anything any more. Boxes of more than `most` cells are not
    /// looked at: there it may.
    pub(crate) fn is_done_within(&mut self, surface: &Surface, corners: [Vec3; 2], most: usize) -> bool {
        let [low, high] = corners.map(|corner| ((corner - surface.low) / surface.cell).to_array().map(cell_of));
        let range = |axis: usize| {
            let end = high[axis].saturating_add(1).max(0) as usize;
            low[axis].max(0) as usize..end.min(surface.shape[axis])
        };
        let [x, y, z] = [range(0), range(1), range(2)];
        let count = x.len() * y.len() * z.len();
        let rows = x.flat_map(|x| y.clone().map(move |y| (x * surface.shape[1] + y) * surface.shape[2]));
        let mut cells = rows.flat_map(|row| row + z.start..row + z.end);
        count == 0 || count <= most && cells.all(|cell| self.is_done(surface, cell, corners))
    }

    /// Whether no uncovered candidate of a cell is within reach of a box. Forgets covered ones on its way.
    fn is_done(&mut self, surface: &Surface, cell: usize, [low, high]: [Vec3; 2]) -> bool {
        let begin = surface.begin[cell] as usize;
        let mut left = self.left[cell] as usize;
        while left > 0 && self.first[self.candidates[begin + left - 1] as usize] != NEVER {
            left -= 1;
        }
        self.left[cell] = left as u32;
        let is_open = |&candidate: &u32| {
            let point = surface.points[candidate as usize];
            let distance_squared = point.distance_squared(point.clamp(low, high));
            self.first[candidate as usize] == NEVER && distance_squared <= surface.reach * surface.reach
        };
        !self.candidates[begin..begin + left].iter().any(is_open)
    }

    /// Memory that it holds, bytes.
    pub fn bytes(&self) -> usize {
        (self.candidates.capacity() + self.left.capacity() + self.first.capacity()) * size_of::<u32>()
    }

    /// Number of covered points.
    pub fn covered(&self) -> usize {
        self.covered
    }

    /// Covered share, 0 to 1.
    pub fn share(&self) -> f32 {
        self.covered as f32 / self.first.len().max(1) as f32
    }

    /// The step at which each point was first covered.
    pub fn first_step(&self, point: usize) -> Option<u32> {
        self.first.get(point).copied().filter(|&step| step != NEVER)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn points(count: usize, range: f32) -> impl Strategy<Value = Vec<Vec3>> {
        let axis = move || -range..range;
        prop::collection::vec((axis(), axis(), axis()).prop_map(|(x, y, z)| Vec3::new(x, y, z)), 1..count)
    }

    proptest! {
        #[test]
        fn agrees_with_the_definition(
            truth in points(60, 3.0), clouds in prop::collection::vec(points(30, 4.0), 1..5), epsilon in 0.05_f32..1.5,
        ) {
            let surface = Surface::new(truth.clone(), epsilon);
            let mut coverage = Coverage::new(&surface);
            let mut last = 0;
            let mut glances = Coverage::new(&surface);
            for (step, cloud) in clouds.iter().enumerate() {
                prop_assert_eq!(glances.glance(&surface, cloud), surface.covered_by(cloud));
                coverage.add(&surface, cloud, step as u32);
                prop_assert!(coverage.covered() >= last);
                last = coverage.covered();
            }
            for (index, point) in truth.iter().enumerate() {
                let is_near = |cloud: &Vec<Vec3>| cloud.iter().any(|p| p.distance_squared(*point) < epsilon * epsilon);
                prop_assert_eq!(coverage.first_step(index), clouds.iter().position(is_near).map(|s| s as u32));
            }
            let covered = (0..truth.len()).filter(|&i| coverage.first_step(i).is_some()).count();
            prop_assert_eq!(coverage.covered(), covered);
            for (index, half) in (0..truth.len()).zip([0.0, 0.3, 1.0].into_iter().cycle()) {
                let corners = [truth[index] + 1.5 - half, truth[index] + 1.5 + half];
                let away = |i: usize| truth[i].distance(truth[i].clamp(corners[0], corners[1])) / epsilon;
                let nearest = (0..truth.len()).filter(|&i| coverage.first_step(i).is_none()).map(away).fold(9.0, f32::min);
                let is_done = coverage.is_done_within(&surface, corners, usize::MAX);
                prop_assert!(if is_done { nearest > 0.999 } else { nearest < 1.001 }, "{} {}", is_done, nearest);
            }
        }
    }

    #[test]
    fn points_that_are_no_numbers_cover_nothing() {
        let surface = Surface::new(vec![Vec3::ZERO, Vec3::ONE], 0.5);
        let odd = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY].map(|v| Vec3::new(0.0, v, 0.0));
        assert!(surface.covered_by(&odd).is_empty());
    }
}
