//! Errors of real sensors: in the depths, and in the pose from which the reconstruction believes them taken. All off by
//! default, and free while off.
//!
//! A depth `z` gets an error with the standard deviation σ(z) = a + b·z², as structured-light and stereo cameras have,
//! because they measure a disparity, which is the inverse of depth. For the Kinect, Khoshelham and Elberink, "Accuracy and
//! Resolution of Kinect Depth Data for Indoor Mapping Applications" (Sensors 2012) give a = 0 and b = 0.001425/m (4 cm at
//! 5 m); Nguyen, Izadi and Lovell, "Modeling Kinect Sensor Noise for Improved 3D Reconstruction and Tracking" (3DIMPVT
//! 2012) measured σ = 1.2 mm + 1.9 mm · (z - 0.4)², z in metres, on surfaces not seen at a grazing angle.

use crate::pose::Pose;
use crate::seed::{Rng, SeedTree};
use crate::sensor::{Camera, Frame};
use glam::Vec3;
use rand::RngExt as _;
use serde::{Deserialize, Serialize};
use std::f32::consts::TAU;

/// How large the errors are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct NoiseConfig {
    /// `a` in the depths' standard deviation a + b·z², metres.
    pub depth: f32,
    /// `b` in it, 1/m (Kinect: 0.001425).
    pub depth_square: f32,
    /// Share of the pixels that measure nothing.
    pub dropout: f32,
    /// Standard deviation of the believed position along `x` and along `z`, metres, drawn anew for each frame.
    pub position: f32,
    /// Standard deviation of the believed azimuth, degrees, drawn anew for each frame.
    pub azimuth_degrees: f32,
}

/// How far a believed pose is from the true one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseError {
    shift: Vec3,
    turn: f32,
}

impl PoseError {
    /// What is believed of a true pose.
    pub fn of(&self, pose: &Pose) -> Pose {
        Pose { position: pose.position + self.shift, azimuth: (pose.azimuth + self.turn).rem_euclid(TAU) }
    }
}

impl NoiseConfig {
    /// The first setting that is out of range: its path, its value and what is accepted.
    pub(crate) fn fault(&self) -> Option<(&'static str, String, &'static str)> {
        let checks = [
            ((0.0..=1.0).contains(&self.depth), "noise.depth", self.depth, "from 0 to 1 m"),
            (
                (0.0..=1.0).contains(&self.depth_square),
                "noise.depth_square",
                self.depth_square,
                "from 0 to 1 per metre",
            ),
            ((0.0..1.0).contains(&self.dropout), "noise.dropout", self.dropout, "a share, from 0 to below 1"),
            ((0.0..=10.0).contains(&self.position), "noise.position", self.position, "from 0 to 10 m"),
            (
                (0.0..=180.0).contains(&self.azimuth_degrees),
                "noise.azimuth_degrees",
                self.azimuth_degrees,
                "from 0 to 180",
            ),
        ];
        checks.into_iter().find(|(ok, ..)| !ok).map(|(_, field, value, want)| (field, value.to_string(), want))
    }

    /// Disturbs the depths of a frame. Which error a pixel gets depends on `seed` and the pixel alone, its size on the
    /// depth. A depth that leaves the camera's range is lost.
    pub fn disturb(&self, frame: &mut Frame, camera: &Camera, seed: SeedTree) {
        let has_errors = self.depth > 0.0 || self.depth_square > 0.0;
        if has_errors {
            let mut rng = seed.child("depth", 0).rng();
            for pair in frame.depth.chunks_mut(2) {
                for (depth, error) in pair.iter_mut().zip(normals(&mut rng)).filter(|(depth, _)| **depth > 0.0) {
                    let measured = *depth + error * (self.depth + self.depth_square * *depth * *depth);
                    let is_measured = (Camera::NEAR..camera.range).contains(&measured);
                    *depth = if is_measured { measured } else { 0.0 };
                }
            }
        }
        if self.dropout > 0.0 {
            let mut rng = seed.child("dropout", 0).rng();
            for depth in &mut frame.depth {
                if rng.random::<f32>() < self.dropout {
                    *depth = 0.0;
                }
            }
        }
        if has_errors || self.dropout > 0.0 {
            // Black where nothing is measured, as in every frame.
            let colours = frame.colour.iter_mut().zip(&frame.depth);
            colours.filter(|&(_, &depth)| depth == 0.0).for_each(|(colour, _)| *colour = [0; 3]);
        }
    }

    /// The error of the pose believed for a frame; `None` where there is none.
    pub fn pose_error(&self, seed: SeedTree) -> Option<PoseError> {
        if self.position <= 0.0 && self.azimuth_degrees <= 0.0 {
            return None;
        }
        let mut rng = seed.child("pose", 0).rng();
        let ([x, z], [turn, _]) = (normals(&mut rng), normals(&mut rng));
        let shift = self.position * Vec3::new(x, 0.0, z);
        Some(PoseError { shift, turn: self.azimuth_degrees.to_radians() * turn })
    }
}

/// Two independent standard normal numbers (Box and Muller 1958).
fn normals(rng: &mut Rng) -> [f32; 2] {
    // From above 0 to 1: the logarithm of 0 is none.
    let radius = (-2.0 * (1.0 - rng.random::<f32>()).ln()).sqrt();
    let (sin, cos) = (TAU * rng.random::<f32>()).sin_cos();
    [radius * cos, radius * sin]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::SimConfig;
    use crate::episode::{Action, Episode};
    use crate::motion::{Agent, Motion, MotionConfig};
    use crate::pose::{Direction, Heading};
    use crate::scene::Scene;
    use crate::world::World;
    use std::sync::Arc;

    const CAMERA: Camera = Camera { width: 200, height: 100, hfov_degrees: 90.0, range: 35.0 };

    fn moments(values: impl Iterator<Item = f32> + Clone) -> [f32; 2] {
        let count = values.clone().count() as f32;
        let mean = values.clone().sum::<f32>() / count;
        [mean, (values.map(|v| (v - mean).powi(2)).sum::<f32>() / count).sqrt()]
    }

    #[test]
    fn errors_are_as_large_as_the_settings_say() {
        let config =
            NoiseConfig { depth: 0.01, depth_square: 0.002, dropout: 0.1, position: 0.05, azimuth_degrees: 2.0 };
        for z in [1.0_f32, 4.0, 9.0] {
            let flat = || Frame { width: 200, height: 100, depth: vec![z; 20_000], colour: vec![[9; 3]; 20_000] };
            let (mut frame, mut again) = (flat(), flat());
            config.disturb(&mut frame, &CAMERA, SeedTree::new(z as u64));
            config.disturb(&mut again, &CAMERA, SeedTree::new(z as u64));
            assert_eq!(frame, again);
            let lost = frame.depth.iter().filter(|&&depth| depth == 0.0).count();
            assert_eq!(lost, frame.colour.iter().filter(|&&colour| colour == [0; 3]).count());
            // Four standard errors of 20,000 draws.
            assert!((lost as f32 / 20_000.0 - 0.1).abs() < 4.0 * 0.0022, "{lost}");
            let sigma = 0.01 + 0.002 * z * z;
            let errors = frame.depth.iter().filter(|&&depth| depth > 0.0).map(|depth| (depth - z) / sigma);
            let [mean, spread] = moments(errors.clone());
            assert!(mean.abs() < 0.03 && (spread - 1.0).abs() < 0.025, "{mean} {spread}");
            let beyond = errors.clone().filter(|error| error.abs() > 1.96).count() as f32 / errors.count() as f32;
            assert!((beyond - 0.05).abs() < 0.007, "normal: {beyond}");
        }
        let pose = Pose { position: Vec3::new(1.0, 1.65, 2.0), azimuth: 3.0 };
        let believed: Vec<Pose> = (0..4000).map(|n| config.pose_error(SeedTree::new(n)).unwrap().of(&pose)).collect();
        for (values, sigma) in [
            (believed.iter().map(|p| p.position.x - 1.0).collect::<Vec<f32>>(), 0.05),
            (believed.iter().map(|p| p.position.z - 2.0).collect(), 0.05),
            (believed.iter().map(|p| p.azimuth - 3.0).collect(), 2.0_f32.to_radians()),
        ] {
            let [mean, spread] = moments(values.into_iter());
            assert!(mean.abs() < 4.0 * sigma / 63.0 && (spread / sigma - 1.0).abs() < 0.05, "{mean} {spread} {sigma}");
        }
        assert!(believed.iter().all(|p| p.position.y == 1.65));
    }

    fn episode(noise: NoiseConfig, agent: Agent, seed: u64) -> Episode {
        let world = World::new(Scene::two_rooms(), &SimConfig { camera: CAMERA, agent, noise, ..SimConfig::default() });
        let world = Arc::new(world.unwrap());
        let start = world.scene().starts()[0];
        let mut episode = Episode::new(world, start, 6, SeedTree::new(seed)).unwrap();
        for n in 0..6 {
            if n % 2 == 0 && episode.is_continuous() {
                episode.move_by(Motion::ALL[n / 2]);
            } else {
                episode.step(Action { direction: Some(Direction::ALL[n % 4]), heading: Heading::new(3 * n) });
            }
        }
        episode
    }

    #[test]
    fn noise_is_in_the_reconstruction_and_repeats_itself() {
        let loud = NoiseConfig { depth: 0.02, depth_square: 0.001, dropout: 0.3, position: 0.1, azimuth_degrees: 3.0 };
        for agent in [Agent::Lattice {}, Agent::Continuous(MotionConfig::default())] {
            let told = |noise, seed| {
                let episode = episode(noise, agent, seed);
                let cloud: Vec<[u32; 3]> =
                    episode.view().cloud().iter().map(|p| p.to_array().map(f32::to_bits)).collect();
                (cloud, episode.track().to_vec(), episode.view().camera(), episode.curve().to_vec())
            };
            let (silent, noisy) = (told(NoiseConfig::default(), 1), told(loud, 1));
            assert_eq!(silent.1, noisy.1, "the true way is the same");
            assert_eq!(silent.2, silent.1[6]);
            let off = noisy.2.position.distance(noisy.1[6].position);
            assert!(off > 0.001 && off < 0.6, "{off}");
            assert!(noisy.0.len() < silent.0.len() * 8 / 10 && noisy.0.len() > silent.0.len() * 6 / 10);
            assert_eq!(noisy, told(loud, 1));
            assert_ne!(noisy.0, told(loud, 2).0);
            // Without pose noise, points that are kept leave their surface along their ray alone.
            let depth = told(NoiseConfig { depth: 1e-6, ..NoiseConfig::default() }, 1);
            assert_eq!((depth.0.len(), &depth.3), (silent.0.len(), &silent.3));
            assert_ne!(depth.0, silent.0);
        }
    }

    #[test]
    fn settings_out_of_range_are_named() {
        for (noise, field) in [
            (NoiseConfig { depth: -0.1, ..NoiseConfig::default() }, "sim.noise.depth is -0.1"),
            (NoiseConfig { depth_square: f32::NAN, ..NoiseConfig::default() }, "sim.noise.depth_square is NaN"),
            (NoiseConfig { dropout: 1.0, ..NoiseConfig::default() }, "sim.noise.dropout is 1"),
            (NoiseConfig { position: f32::INFINITY, ..NoiseConfig::default() }, "sim.noise.position is inf"),
            (NoiseConfig { azimuth_degrees: 181.0, ..NoiseConfig::default() }, "sim.noise.azimuth_degrees is 181"),
        ] {
            let error = SimConfig { noise, ..SimConfig::default() }.validate().unwrap_err().to_string();
            assert!(error.contains(field), "{error}");
        }
        assert_eq!(NoiseConfig::default().fault(), None);
    }
}
