//! The continuous world's agent: it goes forward and turns by fixed amounts, and stands anywhere (the convention of
//! Habitat and of Active Neural Mapping's Matterport3D experiments).
//!
//! One motion is one step. There is no sliding: a forward motion that would hit something does not happen, and its step
//! is spent. The agent moves in the plane of its camera, as in the lattice world.

use crate::pilot;
use crate::pose::Pose;
use crate::scene::RayIndex;
use serde::{Deserialize, Serialize};
use std::f32::consts::TAU;

/// What moves through the scene.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Agent {
    /// From node to node of a lattice of 1.5 m, 1.65 m above the floor, in eight headings (paper, section 5.1).
    ///
    /// In braces, so that settings of the other kind are refused here and not ignored.
    Lattice {},
    /// By small motions; a lattice remains as what policies plan on.
    Continuous(MotionConfig),
}

impl Default for Agent {
    fn default() -> Self {
        Self::Lattice {}
    }
}

/// How the continuous agent is built.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MotionConfig {
    /// Length of a forward motion, metres.
    pub forward: f32,
    /// Angle of a turn, degrees.
    pub turn_degrees: f32,
    /// Height of the camera above the floor, metres.
    pub camera_height: f32,
    /// Distance that the camera keeps from every surface, metres. A point (0) may come so near that its image plane,
    /// 1 mm in front of it, cuts the wall and it sees through.
    pub radius: f32,
    /// Spacing of the lattice that policies plan on, metres: half a metre finds a way through every door.
    pub lattice_step: f32,
}

impl Default for MotionConfig {
    fn default() -> Self {
        Self { forward: 0.065, turn_degrees: 10.0, camera_height: 1.25, radius: 0.02, lattice_step: 0.5 }
    }
}

impl MotionConfig {
    /// The first setting that is out of range: its path, its value and what is accepted.
    pub(crate) fn fault(&self) -> Option<(&'static str, String, &'static str)> {
        let checks = [
            // First: others are measured by it.
            ((0.05..=10.0).contains(&self.lattice_step), "agent.lattice_step", self.lattice_step, "from 0.05 to 10 m"),
            (
                (0.001..=self.lattice_step).contains(&self.forward),
                "agent.forward",
                self.forward,
                "from 1 mm to the lattice_step",
            ),
            // Beyond 45° some of the eight headings could not even nearly be taken.
            ((1.0..=45.0).contains(&self.turn_degrees), "agent.turn_degrees", self.turn_degrees, "from 1 to 45"),
            (
                (0.05..=10.0).contains(&self.camera_height),
                "agent.camera_height",
                self.camera_height,
                "from 0.05 to 10 m",
            ),
            (
                (0.0..=0.5 * self.lattice_step).contains(&self.radius),
                "agent.radius",
                self.radius,
                "from 0 m to half the lattice_step",
            ),
        ];
        checks.into_iter().find(|(ok, ..)| !ok).map(|(_, field, value, want)| (field, value.to_string(), want))
    }

    /// Angle of a turn, radians.
    pub fn turn(&self) -> f32 {
        self.turn_degrees.to_radians()
    }

    /// Distance that lattice moves keep from surfaces in the true graph, metres: the agent's own and what a pilot strays,
    /// so that whatever is possible there can be carried out.
    pub fn clearance(&self) -> f32 {
        self.radius + pilot::stray(self, self.lattice_step)
    }
}

/// One step of the continuous agent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Motion {
    /// Along the optical axis.
    Forward,
    /// Counter-clockwise seen from above: the azimuth grows.
    Left,
    /// Clockwise.
    Right,
}

impl Motion {
    /// All three.
    pub const ALL: [Self; 3] = [Self::Forward, Self::Left, Self::Right];
}

/// The body that motions move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Walker {
    config: MotionConfig,
    pose: Pose,
    first_azimuth: f32,
    /// Turns to the left minus turns to the right: summed as a number, so that angles do not drift.
    turns: i32,
}

impl Walker {
    /// An agent that stands at `pose`.
    pub fn new(config: MotionConfig, pose: Pose) -> Self {
        Self { config, pose, first_azimuth: pose.azimuth, turns: 0 }
    }

    /// Where the camera is.
    pub fn pose(&self) -> Pose {
        self.pose
    }

    /// How it is built.
    pub fn config(&self) -> &MotionConfig {
        &self.config
    }

    /// Performs a motion and says whether it happened; if not, nothing has changed.
    pub fn attempt(&mut self, motion: Motion, rays: &RayIndex) -> bool {
        match motion {
            Motion::Forward => {
                let target = self.pose.position + self.config.forward * self.pose.forward();
                let is_free = !rays.is_near(self.pose.position, target, self.config.radius);
                if is_free {
                    self.pose.position = target;
                }
                is_free
            }
            Motion::Left => self.turn(1),
            Motion::Right => self.turn(-1),
        }
    }

    fn turn(&mut self, by: i32) -> bool {
        self.turns += by;
        let turned = (f64::from(self.turns) * f64::from(self.config.turn_degrees)).rem_euclid(360.0);
        self.pose.azimuth = (self.first_azimuth + (turned as f32).to_radians()).rem_euclid(TAU);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::Heading;
    use crate::scene::Scene;
    use crate::seed::SeedTree;
    use glam::Vec3;
    use rand::RngExt as _;

    fn walker(radius: f32) -> Walker {
        let pose = Pose { position: Vec3::new(3.0, 1.25, 4.5), azimuth: Heading::new(1).azimuth() };
        Walker::new(MotionConfig { radius, ..MotionConfig::default() }, pose)
    }

    #[test]
    fn a_walk_never_crosses_a_wall() {
        let scene = Scene::two_rooms();
        let rays = scene.rays();
        for (radius, motions) in [(0.0, 60_000), (0.1, 60_000)] {
            let mut rng = SeedTree::new(3).rng();
            let mut walker = walker(radius);
            let (mut blocked, mut was_in) = (0, [false; 2]);
            for _ in 0..motions {
                let before = walker;
                // Mostly forward, or it would never meet a wall.
                let motion = Motion::ALL[[0, 0, 0, 0, 0, 1, 2][rng.random_range(0..7_usize)]];
                let happened = walker.attempt(motion, rays);
                let (from, to) = (before.pose.position, walker.pose.position);
                assert!(!rays.segment_is_blocked(from, to) && !rays.is_near(to, to, radius));
                assert!((0.0..=12.0).contains(&to.x) && (0.0..=9.0).contains(&to.z), "{to}");
                let in_pillar = (8.5..=9.1).contains(&to.x) && (6.0..=6.6).contains(&to.z);
                let in_partition = (5.9..=6.1).contains(&to.x) && !(3.0..=5.0).contains(&to.z);
                assert!(!in_pillar && !in_partition, "{to}");
                if !happened {
                    blocked += 1;
                    assert_eq!(walker, before);
                    let bits = |pose: Pose| {
                        [pose.position.x, pose.position.y, pose.position.z, pose.azimuth].map(f32::to_bits)
                    };
                    assert_eq!(bits(walker.pose), bits(before.pose));
                } else if motion == Motion::Forward {
                    assert!((from.distance(to) - 0.065).abs() < 1e-5 && from.y == to.y);
                }
                was_in[usize::from(to.x > 6.0)] = true;
            }
            assert!(blocked > 1000 && was_in == [true, true], "{blocked} {was_in:?}");
        }
    }

    #[test]
    fn turns_do_not_drift() {
        let scene = Scene::two_rooms();
        let mut walker = walker(0.0);
        let first = walker.pose();
        for n in 1..=36_000 {
            walker.attempt(Motion::Left, scene.rays());
            assert!(n % 36 != 0 || walker.pose() == first);
            assert!(n != 9 || (walker.pose().azimuth - Heading::new(3).azimuth()).abs() < 1e-6, "left of 45° is 135°");
        }
        walker.attempt(Motion::Right, scene.rays());
        assert!((walker.pose().azimuth - 35.0_f32.to_radians()).abs() < 1e-6);
    }

    #[test]
    fn the_kind_is_said_in_the_settings() {
        let read = |json: &str| serde_json::from_str::<Agent>(json);
        assert_eq!(read(r#"{"kind":"lattice"}"#).unwrap(), Agent::Lattice {});
        let built = MotionConfig { forward: 0.25, turn_degrees: 30.0, ..MotionConfig::default() };
        let said = r#"{"kind":"continuous","forward":0.25,"turn_degrees":30.0}"#;
        assert_eq!(read(said).unwrap(), Agent::Continuous(built));
        assert!(read(r#"{"kind":"continuous","forwards":0.25}"#).is_err());
        assert!(read(r#"{"kind":"lattice","forward":0.25}"#).unwrap_err().to_string().contains("forward"));
        assert!(read(r#"{"kind":"flying"}"#).unwrap_err().to_string().contains("lattice"));
        for (config, field) in [
            (MotionConfig { forward: 0.0, ..built }, "agent.forward"),
            (MotionConfig { forward: f32::NAN, ..built }, "agent.forward"),
            (MotionConfig { turn_degrees: 90.0, ..built }, "agent.turn_degrees"),
            (MotionConfig { radius: 0.3, ..built }, "agent.radius"),
            (MotionConfig { lattice_step: 0.0, ..built }, "agent.lattice_step"),
            (MotionConfig { lattice_step: f32::NAN, ..built }, "agent.lattice_step"),
        ] {
            assert_eq!(config.fault().unwrap().0, field);
        }
        assert_eq!(built.fault(), None);
    }
}
