//! What the visibility cache says that poses see, against every pixel and every ground-truth point.

use super::{MANY, for_all};
use nbp_env::coverage::CoverageConfig;
use nbp_env::sensor::{Camera, Frame};
use nbp_env::{Heading, LatticePose, Scene, SimConfig, World};
use rand::RngExt as _;
use rand::seq::IndexedRandom as _;

#[test]
fn gains_are_those_of_every_pixel() {
    let worlds: Vec<World> = [(0.5, 60), (0.15, 200), (1.0, 130)]
        .map(|(epsilon, points)| {
            let camera = Camera { width: 40, height: 24, range: 10.0, ..Camera::default() };
            let coverage = CoverageConfig { points, epsilon, ..CoverageConfig::default() };
            World::new(Scene::two_rooms(), &SimConfig { camera, coverage, ..SimConfig::default() }).unwrap()
        })
        .into();
    for_all("gains_are_those_of_every_pixel", MANY, |rng| {
        let world = worlds.choose(rng).unwrap();
        let (visibility, lattice) = (world.visibility(), world.scene().lattice());
        let (truth, epsilon) = (world.surface().points(), world.config().coverage.epsilon);
        let mut covered = visibility.nothing();
        let mut known = vec![false; truth.len()];
        let mut frame = Frame::default();
        for _ in 0..3 {
            let node = lattice.node(rng.random_range(0..lattice.len()));
            let pose = LatticePose { node, heading: Heading::new(rng.random_range(0..8)) };
            let gain = visibility.gain(pose, &covered);
            assert_eq!(gain, visibility.cover(pose, &mut covered));
            world.sensor().capture(world.scene(), &lattice.pose(pose), &mut frame);
            let seen: Vec<_> = frame.points(world.sensor().camera().at(&lattice.pose(pose))).collect();
            let mut expected = 0;
            for (known, p) in known.iter_mut().zip(truth) {
                if !*known && seen.iter().any(|q| q.distance_squared(*p) < epsilon * epsilon) {
                    *known = true;
                    expected += 1;
                }
            }
            assert_eq!(gain, expected, "{pose:?}");
            let numbers: Vec<u32> = (0..).zip(&known).filter(|&(_, &is)| is).map(|(n, _)| n).collect();
            assert_eq!(visibility.points(&covered), numbers);
        }
    });
}
