//! Whether a sensor sees the scene: depths against those of [`RayCamera`].

use super::Fault;
use crate::scene::Scene;
use crate::seed::SeedTree;
use crate::sensor::{Frame, RayCamera, Sensor};

/// Poses at which a sensor is tried.
const POSES: usize = 4;

/// A depth is wrong from this share of the true one; noise is below, a wrong unit or axis above.
const DEPTH_TOLERANCE: f32 = 0.2;

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

#[cfg(test)]
mod tests {
    use super::super::tests::SMALL;
    use super::*;
    use crate::pose::Pose;
    use crate::sensor::{Camera, DepthCamera};
    use std::sync::atomic::{AtomicU32, Ordering};

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
}
