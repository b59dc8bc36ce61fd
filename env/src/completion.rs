//! Comp. % and Comp. cm: how near the reconstruction comes to the ground truth (Active Neural Mapping's evaluation).
//!
//! A slower and finer measure than [`coverage`](crate::coverage): one exact nearest-neighbour search for each
//! ground-truth point at the end of an episode.

use glam::Vec3;

/// The evaluation that the published figures come from counts no distance beyond this, metres.
pub const PUBLISHED_CAP: f32 = 1.0;

/// How complete a reconstruction is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Completion {
    /// Share of the ground-truth points with a reconstructed point nearer than the threshold, 0 to 1.
    pub share: f64,
    /// Mean distance from a ground-truth point to the nearest reconstructed point, metres. Infinite for an empty cloud
    /// without a cap.
    pub mean_distance: f64,
}

impl Completion {
    /// Compares `truth` with a `cloud`; distances are cut at `cap` metres.
    pub fn of(truth: &[Vec3], cloud: &[Vec3], threshold: f32, cap: Option<f32>) -> Self {
        let grid = PointGrid::new(cloud);
        let (mut near, mut sum) = (0_usize, 0.0);
        for &point in truth {
            let distance = grid.nearest(point).min(cap.unwrap_or(f32::INFINITY));
            near += usize::from(distance < threshold);
            sum += f64::from(distance);
        }
        let count = truth.len().max(1) as f64;
        Self { share: near as f64 / count, mean_distance: sum / count }
    }
}

/// Points sorted into cubes.
struct PointGrid {
    low: Vec3,
    cell: f32,
    shape: [i32; 3],
    begin: Vec<u32>,
    points: Vec<Vec3>,
}

/// Cells for each point: fewer make long lists, more make long walks through empty cells.
const CELLS_PER_POINT: f32 = 2.0;

impl PointGrid {
    fn new(points: &[Vec3]) -> Self {
        let first = points.first().copied().unwrap_or_default();
        let [low, high] = points.iter().fold([first; 2], |[low, high], &p| [low.min(p), high.max(p)]);
        let extent = (high - low).max(Vec3::splat(1e-3));
        let cell = (extent.element_product() / (CELLS_PER_POINT * points.len().max(1) as f32)).cbrt();
        // Flat clouds would get cells without end along their long sides.
        let cell = cell.max(extent.max_element() / 1024.0);
        let shape = (extent / cell).to_array().map(|n| n as i32 + 1);
        let mut grid = Self { low, cell, shape, begin: Vec::new(), points: vec![Vec3::ZERO; points.len()] };
        let cells: Vec<usize> = points.iter().map(|&p| grid.index(grid.cell_of(p)).unwrap_or(0)).collect();
        let mut next = vec![0_u32; shape.iter().map(|&n| n as usize).product::<usize>() + 1];
        cells.iter().for_each(|&cell| next[cell + 1] += 1);
        (1..next.len()).for_each(|cell| next[cell] += next[cell - 1]);
        grid.begin.clone_from(&next);
        for (&point, &cell) in points.iter().zip(&cells) {
            grid.points[next[cell] as usize] = point;
            next[cell] += 1;
        }
        grid
    }

    /// May lie outside of the grid.
    fn cell_of(&self, point: Vec3) -> [i32; 3] {
        ((point - self.low) / self.cell).floor().to_array().map(|n| n as i32)
    }

    fn index(&self, [x, y, z]: [i32; 3]) -> Option<usize> {
        let inside =
            (0..self.shape[0]).contains(&x) && (0..self.shape[1]).contains(&y) && (0..self.shape[2]).contains(&z);
        inside.then(|| ((x * self.shape[1] + y) as usize) * self.shape[2] as usize + z as usize)
    }

    /// Distance to the nearest point; infinite without points. Searches cubes around `point`, shell by shell.
    fn nearest(&self, point: Vec3) -> f32 {
        if self.points.is_empty() {
            return f32::INFINITY;
        }
        let middle = self.cell_of(point);
        let last = |axis: usize| self.shape[axis] - 1;
        let outside = |axis: usize| (-middle[axis]).max(middle[axis] - last(axis)).max(0);
        let farthest = (0..3).map(|axis| middle[axis].max(last(axis) - middle[axis])).max().unwrap_or(0);
        let mut best = f32::INFINITY;
        // Shells nearer than the grid are empty.
        let mut shell = (0..3).map(outside).max().unwrap_or(0);
        while shell <= farthest && ((shell - 1).max(0) as f32 * self.cell).powi(2) < best {
            self.visit_shell(middle, shell, |p| best = best.min(p.distance_squared(point)));
            shell += 1;
        }
        best.sqrt()
    }

    fn visit_shell(&self, middle: [i32; 3], shell: i32, mut visit: impl FnMut(Vec3)) {
        let range = |axis: usize| (middle[axis] - shell).max(0)..=(middle[axis] + shell).min(self.shape[axis] - 1);
        for x in range(0) {
            for y in range(1) {
                let is_face = (x - middle[0]).abs() == shell || (y - middle[1]).abs() == shell;
                // Inside of the shell's box only its two ends belong to it.
                let step = if is_face { 1 } else { (2 * shell).max(1) };
                let mut z = middle[2] - shell;
                while z <= middle[2] + shell {
                    if let Some(cell) = self.index([x, y, z]) {
                        let points = self.begin[cell] as usize..self.begin[cell + 1] as usize;
                        self.points[points].iter().for_each(|&p| visit(p));
                    }
                    z += step;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn points(count: std::ops::Range<usize>, range: f32) -> impl Strategy<Value = Vec<Vec3>> {
        let axis = move || -range..range;
        prop::collection::vec((axis(), axis(), axis()).prop_map(|(x, y, z)| Vec3::new(x, y, z)), count)
    }

    proptest! {
        #[test]
        fn agrees_with_brute_force(
            truth in points(1..40, 4.0), cloud in points(1..300, 2.0), flat in any::<bool>(), cap in prop::option::of(0.2_f32..2.0),
        ) {
            let cloud: Vec<Vec3> = cloud.into_iter().map(|p| if flat { p.with_y(1.0) } else { p }).collect();
            let nearest = |p: &Vec3| cloud.iter().map(|q| q.distance_squared(*p)).fold(f32::INFINITY, f32::min).sqrt();
            let distances: Vec<f32> = truth.iter().map(|p| nearest(p).min(cap.unwrap_or(f32::INFINITY))).collect();
            let measured = Completion::of(&truth, &cloud, 0.5, cap);
            let mean = distances.iter().map(|&d| f64::from(d)).sum::<f64>() / truth.len() as f64;
            prop_assert!((measured.mean_distance - mean).abs() < 1e-9, "{} {mean}", measured.mean_distance);
            let near = distances.iter().filter(|&&d| d < 0.5).count();
            prop_assert_eq!(measured.share, near as f64 / truth.len() as f64);
        }
    }

    #[test]
    fn what_was_never_seen_counts_as_the_cap() {
        let truth = [Vec3::ZERO, Vec3::X * 9.0];
        let capped = Completion::of(&truth, &[Vec3::ZERO], 0.05, Some(PUBLISHED_CAP));
        assert_eq!((capped.share, capped.mean_distance), (0.5, 0.5));
        assert_eq!(Completion::of(&truth, &[Vec3::ZERO], 0.05, None).mean_distance, 4.5);
        assert_eq!(Completion::of(&truth, &[], 0.05, None).mean_distance, f64::INFINITY);
        assert_eq!(Completion::of(&[], &[], 0.05, None).share, 0.0);
    }
}
