//! Comp. % and Comp. cm: how near the reconstruction comes to the ground truth (Active Neural Mapping's evaluation).
//!
//! A slower and finer measure than [`coverage`](crate::coverage): one exact nearest-neighbour search for each
//! ground-truth point at the end of an episode.

use glam::Vec3;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Distance below which a point counts as reconstructed in the published figures, metres.
pub const PUBLISHED_THRESHOLD: f32 = 0.05;

/// The evaluation that the published figures come from counts no distance beyond this, metres.
pub const PUBLISHED_CAP: f32 = 1.0;

/// How complete a reconstruction is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Completion {
    /// Share of the ground-truth points with a reconstructed point nearer than the threshold, 0 to 1.
    pub share: f64,
    /// Mean distance from a ground-truth point to the nearest reconstructed point, metres. Infinite for an empty cloud
    /// without a cap.
    pub mean_distance: f64,
}

impl Completion {
    /// As the published figures are measured: Comp. % at 5 cm, Comp. cm with distances cut at 1 m.
    pub fn published(truth: &[Vec3], cloud: &[Vec3]) -> Self {
        Self::of(truth, cloud, PUBLISHED_THRESHOLD, Some(PUBLISHED_CAP))
    }

    /// Compares `truth` with a `cloud`; distances are cut at `cap` metres.
    pub fn of(truth: &[Vec3], cloud: &[Vec3], threshold: f32, cap: Option<f32>) -> Self {
        let tree = PointTree::new(cloud);
        let (mut near, mut sum) = (0_usize, 0.0);
        for &point in truth {
            let distance = tree.nearest(point, cap.unwrap_or(f32::INFINITY));
            near += usize::from(distance < threshold);
            sum += f64::from(distance);
        }
        let count = truth.len().max(1) as f64;
        Self { share: near as f64 / count, mean_distance: sum / count }
    }
}

/// A k-d tree: the middle of each range of points divides the others along one axis. A reconstruction is dense where it is
/// and empty elsewhere, which a grid of cells pays for.
struct PointTree {
    points: Vec<Vec3>,
    /// Axis along which each point divides its range.
    axes: Vec<u8>,
}

/// Shorter ranges are searched point by point.
const LEAF: usize = 12;

impl PointTree {
    fn new(points: &[Vec3]) -> Self {
        let mut tree = Self { points: points.to_vec(), axes: vec![0; points.len()] };
        divide(&mut tree.points, &mut tree.axes);
        tree
    }

    /// Distance to the nearest point, or `cap` if none is nearer.
    fn nearest(&self, point: Vec3, cap: f32) -> f32 {
        let mut square = cap * cap;
        self.search(0..self.points.len(), point, &mut square);
        square.sqrt().min(cap)
    }

    fn search(&self, range: Range<usize>, point: Vec3, square: &mut f32) {
        if range.len() <= LEAF {
            self.points[range].iter().for_each(|p| *square = square.min(p.distance_squared(point)));
            return;
        }
        let middle = range.start + range.len() / 2;
        let axis = usize::from(self.axes[middle]);
        let beyond = point[axis] - self.points[middle][axis];
        *square = square.min(self.points[middle].distance_squared(point));
        let (low, high) = (range.start..middle, middle + 1..range.end);
        let (near, far) = if beyond < 0.0 { (low, high) } else { (high, low) };
        self.search(near, point, square);
        if beyond * beyond < *square {
            self.search(far, point, square);
        }
    }
}

fn divide(points: &mut [Vec3], axes: &mut [u8]) {
    if points.len() <= LEAF {
        return;
    }
    let [low, high] = points.iter().fold([points[0]; 2], |[low, high], &p| [low.min(p), high.max(p)]);
    let (axis, middle) = ((high - low).max_position(), points.len() / 2);
    points.select_nth_unstable_by(middle, |a, b| a[axis].total_cmp(&b[axis]));
    axes[middle] = axis as u8;
    let (points, axes) = (points.split_at_mut(middle), axes.split_at_mut(middle));
    divide(points.0, axes.0);
    divide(&mut points.1[1..], &mut axes.1[1..]);
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
