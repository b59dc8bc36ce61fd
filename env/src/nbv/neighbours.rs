//! The nearest points of a small cloud, at three scales.

use super::{NEIGHBOURS, SCALES};
use glam::Vec3;

/// A cloud in random order; each scale looks at the first part of what the scale before looked at, which is as good as a
/// random part. Coordinates lie apart from each other so that distances are computed eight at a time: a grid would not be
/// faster for so few points.
#[derive(Clone, Debug, Default)]
pub struct Neighbours {
    x: Vec<f32>,
    y: Vec<f32>,
    z: Vec<f32>,
}

impl Neighbours {
    /// Of these points.
    pub fn new(points: Vec<Vec3>) -> Self {
        let axis = |axis: usize| points.iter().map(|point| point[axis]).collect();
        Self { x: axis(0), y: axis(1), z: axis(2) }
    }

    /// `amount` points; where there are fewer, they repeat from the first on.
    pub fn points(&self, amount: usize) -> Vec<[f32; 3]> {
        let all = 0..self.x.len();
        all.map(|n| [self.x[n], self.y[n], self.z[n]]).cycle().take(amount).collect()
    }

    /// How many points each scale has: SCONE thins by the root of what would leave eight times the neighbours.
    pub fn scales(&self) -> [usize; SCALES] {
        let count = self.x.len();
        let thin = match ((count as f32 / (NEIGHBOURS * 8) as f32).sqrt()) as usize {
            0 => 2,
            thin => thin,
        };
        [count, count / thin, count / thin / thin]
    }

    /// From `query` to its nearest points at each scale, nearest first, of equally near ones the earlier. Where a scale has
    /// fewer, the last one repeats.
    pub fn offsets(&self, query: Vec3) -> [[[f32; 3]; NEIGHBOURS]; SCALES] {
        let axes = self.x.iter().zip(&self.y).zip(&self.z);
        let distances: Vec<f32> = axes
            .map(|((x, y), z)| {
                let (x, y, z) = (x - query.x, y - query.y, z - query.z);
                x * x + y * y + z * z
            })
            .collect();
        self.scales().map(|count| {
            let mut nearest = [(f32::INFINITY, 0); NEIGHBOURS];
            let mut found = 0;
            for (index, &distance) in distances[..count].iter().enumerate() {
                if distance < nearest[NEIGHBOURS - 1].0 {
                    let place = nearest.partition_point(|&(other, _)| other <= distance);
                    nearest.copy_within(place..NEIGHBOURS - 1, place + 1);
                    nearest[place] = (distance, index);
                    found = (found + 1).min(NEIGHBOURS);
                }
            }
            std::array::from_fn(|n| match nearest[..found].get(n).or(nearest[..found].last()) {
                Some(&(_, at)) => [self.x[at] - query.x, self.y[at] - query.y, self.z[at] - query.z],
                None => [0.0; 3],
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn points(count: std::ops::Range<usize>) -> impl Strategy<Value = Vec<Vec3>> {
        // Few different coordinates, so that many distances are equal.
        let axis = || (-9..9_i32).prop_map(|n| n as f32 * 0.25);
        prop::collection::vec((axis(), axis(), axis()).prop_map(|(x, y, z)| Vec3::new(x, y, z)), count)
    }

    proptest! {
        #[test]
        fn neighbours_are_those_of_a_full_sort(cloud in points(64..600), queries in points(1..6)) {
            let neighbours = Neighbours::new(cloud.clone());
            for query in queries {
                for (count, offsets) in neighbours.scales().into_iter().zip(neighbours.offsets(query)) {
                    prop_assert!(count >= NEIGHBOURS);
                    let mut order: Vec<usize> = (0..count).collect();
                    order.sort_by(|&a, &b| {
                        let distance = |n: usize| cloud[n].distance_squared(query);
                        distance(a).total_cmp(&distance(b)).then(a.cmp(&b))
                    });
                    for (offset, at) in offsets.into_iter().zip(order) {
                        prop_assert_eq!(offset, (cloud[at] - query).to_array());
                    }
                }
            }
        }
    }

    #[test]
    fn small_clouds_repeat() {
        let few = Neighbours::new(vec![Vec3::X, Vec3::Y]);
        assert_eq!(few.points(3), [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]);
        assert_eq!(few.offsets(Vec3::X)[0][15], [-1.0, 1.0, 0.0]);
        assert_eq!(Neighbours::default().offsets(Vec3::X)[2][0], [0.0; 3]);
        assert_eq!(Neighbours::new(vec![Vec3::X; 2048]).scales(), [2048, 512, 128]);
    }
}
