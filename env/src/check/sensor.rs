//! Whether a sensor sees the scene: depths against those of [`RayCamera`].

use super::Fault;
use crate::scene::Scene;
use crate::seed::SeedTree;
use crate::sensor::{Frame, RayCamera, Sensor};

/// Poses at which a sensor is tried.
const POSES: usize = 4;

/// A depth is wrong from this share of the true one; noise is below, a wrong unit or axis above.
const DEPTH_TOLERANCE: f32 = 0.2;

/// Of the depths, at most so many may be wrong: noise makes few outliers, a wrong axis many.
const MAX_WRONG: f32 = 0.25;

/// Of the pixels that show a surface, at least so many must have a depth; real sensors drop a fifth.
const MIN_VALID: f32 = 0.5;

/// What is wrong with a sensor, tried at a few poses of a scene; empty if nothing.
pub fn check_sensor(sensor: &dyn Sensor, scene: &Scene) -> Vec<Fault> {
    let camera = sensor.camera();
    let (mut frame, mut again, mut truth) = (Frame::default(), Frame::default(), Frame::default());
    let (mut wrong, mut valid, mut shown) = (0_usize, 0_usize, 0_usize);
    let (mut axial, mut along) = (0.0, 0.0);
    for pose in scene.graph().spread_poses(POSES, SeedTree::new(0)) {
        let pose = scene.lattice().pose(pose);
        sensor.capture(scene, &pose, &mut frame);
        sensor.capture(scene, &pose, &mut again);
        RayCamera(*camera).capture(scene, &pose, &mut truth);
        let (expected, found) = ([camera.width, camera.height], [frame.width, frame.height]);
        if found != expected || frame.depth.len() != camera.width * camera.height {
            return vec![Fault::Size { expected, found, depths: frame.depth.len() }];
        }
        let is_depth = |depth: f32| depth == 0.0 || (depth > 0.0 && depth <= camera.range);
        if let Some(at) = frame.depth.iter().position(|&depth| !is_depth(depth)) {
            let (depth, col, row, range) = (frame.depth[at], at % camera.width, at / camera.width, camera.range);
            return vec![Fault::Depth { depth, col, row, range }];
        }
        if frame.depth.iter().map(|d| d.to_bits()).ne(again.depth.iter().map(|d| d.to_bits())) {
            return vec![Fault::SensorVaries];
        }
        shown += truth.depth.iter().filter(|&&truth| truth > 0.0).count();
        let (eye, depths) = (camera.at(&pose), frame.depth.iter().zip(&truth.depth).enumerate());
        for (at, (&depth, &truth)) in depths.filter(|&(_, (&depth, &truth))| depth > 0.0 && truth > 0.0) {
            valid += 1;
            wrong += usize::from((depth - truth).abs() > DEPTH_TOLERANCE * truth);
            let distance = truth * eye.ray(at % camera.width, at / camera.width).length();
            axial += f64::from((depth - truth).abs());
            along += f64::from((depth - distance).abs());
        }
    }
    let share = |part: usize, whole: usize| part as f32 / whole.max(1) as f32;
    let mut faults = Vec::new();
    if share(valid, shown) < MIN_VALID && shown > 0 {
        faults.push(Fault::Blind { share: 100.0 * share(valid, shown) });
    }
    // A sensor that is merely noisy lies nearer to the truth than to another meaning.
    if 2.0 * along < axial {
        let mean = |sum: f64| sum / valid.max(1) as f64;
        faults.push(Fault::AlongTheRay { along: mean(along), axial: mean(axial) });
    } else if share(wrong, valid) > MAX_WRONG {
        faults.push(Fault::NotTheScene { share: 100.0 * share(wrong, valid) });
    }
    faults
}

#[cfg(test)]
mod tests {
    use super::super::tests::SMALL;
    use super::*;
    use crate::pose::Pose;
    use crate::sensor::{Camera, DepthCamera};
    use rand::RngExt as _;
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
        assert!(matches!(faults(|f, _| f.depth.truncate(7))[..], [Fault::Size { depths: 7, .. }]));
        let swapped = |f: &mut Frame, _| (f.width, f.height) = (f.height, f.width);
        assert!(matches!(faults(swapped)[..], [Fault::Size { found: [64, 112], .. }]));
        assert!(matches!(faults(|f, _| f.depth[113] = f32::NAN)[..], [Fault::Depth { col: 1, row: 1, .. }]));
        assert_eq!(faults(|f, n| f.depth[3] += n as f32 * 1e-3), [Fault::SensorVaries]);
        let in_pairs_of_metres = |f: &mut Frame, _| f.depth.iter_mut().for_each(|d| *d *= 0.5);
        assert!(matches!(faults(in_pairs_of_metres)[..], [Fault::NotTheScene { .. }]));
        assert_eq!(faults(|f, _| f.depth.fill(0.0)), [Fault::Blind { share: 0.0 }]);
        let one_in_three = |f: &mut Frame, _| f.depth.iter_mut().step_by(3).for_each(|d| *d *= 1.5);
        assert!(matches!(faults(one_in_three)[..], [Fault::NotTheScene { .. }]));
    }

    /// Depths along the ray, at a field of view.
    struct Ranger(Camera);

    impl Sensor for Ranger {
        fn camera(&self) -> &Camera {
            &self.0
        }

        fn capture(&self, scene: &Scene, pose: &Pose, out: &mut Frame) {
            DepthCamera(self.0).capture(scene, pose, out);
            let eye = self.0.at(pose);
            let pixels = out.depth.iter_mut().enumerate();
            pixels.for_each(|(at, d)| *d *= eye.ray(at % self.0.width, at / self.0.width).length());
        }
    }

    #[test]
    fn depth_along_the_ray_is_found_out_at_any_field_of_view() {
        for hfov_degrees in [120.0, 90.0, 40.0] {
            let faults = check_sensor(&Ranger(Camera { hfov_degrees, ..SMALL }), &Scene::two_rooms());
            assert!(matches!(faults[..], [Fault::AlongTheRay { .. }]), "{hfov_degrees}: {faults:?}");
        }
    }

    #[test]
    fn noise_is_no_fault() {
        let noisy = |frame: &mut Frame, _| {
            let mut rng = SeedTree::new(1).rng();
            for depth in frame.depth.iter_mut().filter(|d| **d > 0.0) {
                // The sum of twelve has a standard deviation of 1: here 5 %. One pixel in five is lost.
                let normal = (0..12).map(|_| rng.random::<f32>()).sum::<f32>() - 6.0;
                *depth = if rng.random_bool(0.2) { 0.0 } else { *depth * (1.0 + 0.05 * normal) };
            }
        };
        assert_eq!(check_sensor(&Spoilt(noisy, AtomicU32::new(0)), &Scene::two_rooms()), []);
    }
}
