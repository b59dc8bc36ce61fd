//! Contracts that a sensor or a policy of one's own must keep, checked on a scene of one's own.
//!
//! For tests of extensions: `assert_eq!(check_policy(&mut MyPolicy::new(), &world), [])`. Each fault says what was
//! expected and what was found.

use crate::episode::{Action, Episode, World};
use crate::policy::Policy;
use crate::pose::LatticePose;
use crate::scene::Scene;
use crate::seed::SeedTree;
use crate::sensor::{Frame, RayCamera, Sensor};
use std::sync::Arc;

/// Poses at which a sensor is tried.
const POSES: usize = 4;

/// Episodes for which a policy is tried, and their steps.
const EPISODES: u64 = 2;
const STEPS: usize = 40;

/// A depth is wrong from this share of the true one; noise is below, a wrong unit or axis above.
const DEPTH_TOLERANCE: f32 = 0.2;

/// Something that does not keep its contract.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Fault {
    /// A frame of another size than the camera says.
    #[error("the frame has {found} depths, but its camera has {expected} pixels")]
    Size {
        /// Width times height of the camera.
        expected: usize,
        /// Depths in the frame.
        found: usize,
    },
    /// A depth that is no distance.
    #[error("depth {depth} at column {col}, row {row}: it must be 0 (nothing) or from the near plane up to {range} m")]
    Depth {
        /// As found.
        depth: f32,
        /// Pixel.
        col: usize,
        /// Pixel.
        row: usize,
        /// Range of the camera.
        range: f32,
    },
    /// Two captures of one pose differ.
    #[error(
        "the same pose gives two different frames: draw noise from the pose or a seed, never from a clock or a thread"
    )]
    SensorVaries,
    /// Most depths are not those of the scene.
    #[error(
        "{share:.0} % of the depths are more than 20 % off the distance to the surface along the optical axis: check the \
         axes, and that depth is not measured along the ray"
    )]
    NotTheScene {
        /// Percent.
        share: f32,
    },
    /// A policy failed.
    #[error("step {step}: {reason}")]
    Failed {
        /// Step of the episode.
        step: usize,
        /// Its own word.
        reason: String,
    },
    /// A policy acts otherwise in a second episode that is the same.
    #[error(
        "step {step}: {second:?} where the same episode had {first:?} before: `begin` must forget everything, and chance \
         come from `rng` alone"
    )]
    PolicyVaries {
        /// Step of the episode.
        step: usize,
        /// Before.
        first: Action,
        /// Now.
        second: Action,
    },
    /// A policy runs into a wall again and again.
    #[error("{count} bumps into the edge from {pose:?}: ask `MapView::bumps` before a move")]
    RepeatedBumps {
        /// Where the agent stood.
        pose: LatticePose,
        /// Number of bumps.
        count: u32,
    },
}

/// What is wrong with a sensor, tried at a few poses of a scene; empty if nothing.
pub fn check_sensor(sensor: &dyn Sensor, scene: &Scene) -> Vec<Fault> {
    let camera = sensor.camera();
    let (mut frame, mut again, mut truth) = (Frame::default(), Frame::default(), Frame::default());
    let (mut wrong, mut valid) = (0_usize, 0_usize);
    for pose in scene.graph().spread_poses(POSES, SeedTree::new(0)) {
        let pose = scene.lattice().pose(pose);
        sensor.capture(scene, &pose, &mut frame);
        sensor.capture(scene, &pose, &mut again);
        RayCamera(*camera).capture(scene, &pose, &mut truth);
        if frame.depth.len() != camera.width * camera.height {
            return vec![Fault::Size { expected: camera.width * camera.height, found: frame.depth.len() }];
        }
        let is_depth = |depth: f32| depth == 0.0 || (depth > 0.0 && depth <= camera.range);
        if let Some(at) = frame.depth.iter().position(|&depth| !is_depth(depth)) {
            let (depth, col, row, range) = (frame.depth[at], at % camera.width, at / camera.width, camera.range);
            return vec![Fault::Depth { depth, col, row, range }];
        }
        if frame.depth.iter().map(|d| d.to_bits()).ne(again.depth.iter().map(|d| d.to_bits())) {
            return vec![Fault::SensorVaries];
        }
        for (&depth, &truth) in frame.depth.iter().zip(&truth.depth).filter(|&(&a, &b)| a > 0.0 && b > 0.0) {
            valid += 1;
            wrong += usize::from((depth - truth).abs() > DEPTH_TOLERANCE * truth);
        }
    }
    match 2 * wrong > valid {
        true => vec![Fault::NotTheScene { share: 100.0 * wrong as f32 / valid as f32 }],
        false => Vec::new(),
    }
}

/// What is wrong with a policy, tried for a few episodes in a world; empty if nothing.
pub fn check_policy(policy: &mut dyn Policy, world: &Arc<World>) -> Vec<Fault> {
    let mut faults = Vec::new();
    for number in 0..EPISODES {
        let seed = SeedTree::new(number).child("check", 0);
        let first = match rollout(policy, world, seed, &mut faults) {
            Ok(actions) => actions,
            Err(fault) => return vec![fault],
        };
        let second = match rollout(policy, world, seed, &mut Vec::new()) {
            Ok(actions) => actions,
            Err(fault) => return vec![fault],
        };
        if let Some(step) = first.iter().zip(&second).position(|(a, b)| a != b) {
            faults.push(Fault::PolicyVaries { step, first: first[step], second: second[step] });
        }
    }
    faults
}

fn rollout(
    policy: &mut dyn Policy,
    world: &Arc<World>,
    seed: SeedTree,
    faults: &mut Vec<Fault>,
) -> Result<Vec<Action>, Fault> {
    let mut episode = Episode::random(Arc::clone(world), STEPS, seed);
    let (mut rng, mut actions) = (seed.child("policy", 0).rng(), Vec::new());
    policy.begin();
    while !episode.is_over() {
        let step = episode.steps();
        let action =
            policy.act(&episode.view(), &mut rng).map_err(|error| Fault::Failed { step, reason: error.to_string() })?;
        let pose = episode.pose();
        if let (true, Some(direction)) = (episode.step(action).bumped, action.direction) {
            // Three are the common rule's limit for one edge.
            let count = episode.view().bumps(pose.node, pose.node.step(direction));
            if count == 4 {
                faults.push(Fault::RepeatedBumps { pose, count });
            }
        }
        actions.push(action);
    }
    Ok(actions)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::episode::SimConfig;
    use crate::map::MapView;
    use crate::policy::{PolicyError, fbe::Fbe, random::Random};
    use crate::pose::{Direction, Heading, Pose};
    use crate::seed::Rng;
    use crate::sensor::{Camera, DepthCamera};
    use std::sync::atomic::{AtomicU32, Ordering};

    const SMALL: Camera = Camera { width: 112, height: 64, hfov_degrees: 90.0, range: 35.0 };

    /// Changes what the depth camera says.
    struct Spoilt(fn(&mut Frame, u32), AtomicU32);

    impl Sensor for Spoilt {
        fn camera(&self) -> &Camera {
            &SMALL
        }

        fn capture(&self, scene: &Scene, pose: &Pose, out: &mut Frame) {
            DepthCamera(SMALL).capture(scene, pose, out);
            self.0(out, self.1.fetch_add(1, Ordering::Relaxed));
        }
    }

    #[test]
    fn spoilt_sensors_are_found_out() {
        let scene = Scene::two_rooms();
        assert_eq!(check_sensor(&DepthCamera(SMALL), &scene), []);
        let faults = |spoil| check_sensor(&Spoilt(spoil, AtomicU32::new(0)), &scene);
        assert!(matches!(faults(|f, _| f.depth.truncate(7))[..], [Fault::Size { found: 7, .. }]));
        assert!(matches!(faults(|f, _| f.depth[113] = f32::NAN)[..], [Fault::Depth { col: 1, row: 1, .. }]));
        assert_eq!(faults(|f, n| f.depth[3] += n as f32 * 1e-3), [Fault::SensorVaries]);
        let in_pairs_of_metres = |f: &mut Frame, _| f.depth.iter_mut().for_each(|d| *d *= 0.5);
        assert!(matches!(faults(in_pairs_of_metres)[..], [Fault::NotTheScene { .. }]));
    }

    /// Walks north, and never looks where it goes; may remember how many actions it took.
    struct Stubborn {
        remembers: bool,
        taken: usize,
    }

    impl Policy for Stubborn {
        fn name(&self) -> &'static str {
            "stubborn"
        }

        fn begin(&mut self) {
            self.taken *= usize::from(self.remembers);
        }

        fn act(&mut self, _: &MapView<'_>, _: &mut Rng) -> Result<Action, PolicyError> {
            self.taken += 1;
            Ok(Action { direction: Some(Direction::PlusZ), heading: Heading::new(self.taken % 7) })
        }
    }

    #[test]
    fn policies_that_forget_nothing_or_learn_nothing_are_found_out() {
        let config = SimConfig { camera: SMALL, ..SimConfig::default() };
        let world = Arc::new(World::new(Scene::two_rooms(), &config).unwrap());
        assert_eq!(check_policy(&mut Random, &world), []);
        assert_eq!(check_policy(&mut Fbe::default(), &world), []);
        let faults = |remembers| check_policy(&mut Stubborn { remembers, taken: 1 }, &world);
        assert!(faults(false).iter().all(|fault| matches!(fault, Fault::RepeatedBumps { .. })));
        assert!(faults(true).iter().any(|fault| matches!(fault, Fault::PolicyVaries { step: 0, .. })));
    }
}
