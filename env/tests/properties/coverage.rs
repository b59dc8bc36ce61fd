//! Coverage against its definition: a point is covered once a kept point lies closer than ε.

use super::{MANY, for_all, point};
use glam::Vec3;
use nbp_env::coverage::{Coverage, Surface};
use rand::RngExt as _;
use rand::seq::SliceRandom as _;

#[test]
fn coverage_is_its_definition() {
    for_all("coverage_is_its_definition", MANY, |rng| {
        let epsilon: f32 = [0.05, 0.5, 1.0, rng.random_range(0.01..2.0)][rng.random_range(0..4_usize)];
        // Far from the origin, where f32 is coarse; and on a grid, where many distances are exactly ε.
        let offset = if rng.random_bool(0.3) { point(rng, 3000.0).round() } else { Vec3::ZERO };
        let on_grid = rng.random_bool(0.6);
        let mut cloud = |count: usize, reach: f32| -> Vec<Vec3> {
            let count = rng.random_range(1..=count);
            let mut draw = || {
                let p = point(rng, reach);
                let at = offset + if on_grid { (p / epsilon).round() * epsilon } else { p };
                // A unit in the last place more or less.
                match rng.random_range(0..3) {
                    0 => at,
                    1 => at.map(f32::next_up),
                    _ => at.map(f32::next_down),
                }
            };
            (0..count).map(|_| draw()).collect()
        };
        let truth = cloud(60, 3.0);
        let frames: Vec<Vec<Vec3>> = (0..4).map(|_| cloud(25, 4.0)).collect();
        let surface = Surface::new(truth.clone(), epsilon);
        let (mut coverage, mut shuffled) = (Coverage::new(&surface), Coverage::new(&surface));
        let mut before = 0;
        for (step, frame) in frames.iter().enumerate() {
            coverage.add(&surface, frame, step as u32);
            let mut other = frame.clone();
            other.shuffle(rng);
            shuffled.add(&surface, &other, step as u32);
            assert!(coverage.covered() >= before);
            before = coverage.covered();
        }
        let is_near = |frame: &Vec<Vec3>, p: Vec3| frame.iter().any(|q| q.distance_squared(p) < epsilon * epsilon);
        let expected: Vec<Option<u32>> =
            truth.iter().map(|&p| frames.iter().position(|frame| is_near(frame, p)).map(|s| s as u32)).collect();
        let steps = |c: &Coverage| (0..truth.len()).map(|n| c.first_step(n)).collect::<Vec<_>>();
        assert_eq!(steps(&coverage), expected, "epsilon {epsilon} at {offset}");
        assert_eq!(steps(&shuffled), expected, "the order of a frame's points");
        assert_eq!(coverage.covered(), expected.iter().flatten().count());
        let all: Vec<Vec3> = frames.concat();
        let numbers: Vec<u32> = (0..).zip(&expected).filter(|(_, step)| step.is_some()).map(|(n, _)| n).collect();
        assert_eq!(surface.covered_by(&all), numbers);
    });
}
