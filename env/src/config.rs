//! The simulator's settings, and what is wrong with them.

use crate::coverage::CoverageConfig;
use crate::encode::EncodeConfig;
use crate::motion::Agent;
use crate::noise::NoiseConfig;
use crate::scene::SceneError;
use crate::sensor::{Camera, CameraError, Colour};
use glam::Vec3;
use serde::{Deserialize, Serialize};

/// The simulator's settings, the same for every policy that is compared.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SimConfig {
    /// What moves: `kind = "lattice"` or `kind = "continuous"`, with the settings of its motions.
    pub agent: Agent,
    /// The depth camera.
    pub camera: Camera,
    /// Colours of images and of the cloud: `off`, `nearest` or `bilinear`. Nothing but them depends on it; scenes must be
    /// loaded with their colours.
    pub colour: Colour,
    /// Errors of depths and believed poses, off by default.
    pub noise: NoiseConfig,
    /// What the network sees.
    pub encode: EncodeConfig,
    /// How coverage is measured.
    pub coverage: CoverageConfig,
    /// Share of a frame's pixels that become points, rounded to one in a whole number (released code: 0.05, one in 20).
    pub keep: f32,
    /// Captures during a step, the one at its end included (released code: 4). A motion has one.
    pub captures: usize,
}

impl Default for SimConfig {
    fn default() -> Self {
        Self {
            agent: Agent::Lattice {},
            camera: Camera::default(),
            colour: Colour::Off,
            noise: NoiseConfig::default(),
            encode: EncodeConfig::default(),
            coverage: CoverageConfig::default(),
            keep: 0.05,
            captures: 4,
        }
    }
}

/// A setting that the simulator cannot work with.
#[derive(Debug, thiserror::Error)]
pub enum SimError {
    /// In the camera.
    #[error("sim.{0}")]
    Camera(#[from] CameraError),
    /// The scene has no room for the agent.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// Nothing to cover.
    #[error(
        "scene {scene}: no triangle lies in the box from {low} to {high} m: check scene.x_min, scene.x_max and the units"
    )]
    NoSurface {
        /// Scene name.
        scene: String,
        /// Lower corner of its box.
        low: Vec3,
        /// Upper corner.
        high: Vec3,
    },
    /// Anywhere else.
    #[error("sim.{field} is {value}: it must be {want}")]
    Field {
        /// Path of the setting.
        field: &'static str,
        /// As given.
        value: String,
        /// What is accepted.
        want: &'static str,
    },
}

impl SimConfig {
    /// Checks every setting.
    ///
    /// # Errors
    /// Naming the first setting that is out of range.
    pub fn validate(&self) -> Result<(), SimError> {
        self.camera.validate()?;
        let encode = &self.encode;
        let pixels = encode.window.pixels;
        let is_positive = |v: f32| v.is_finite() && v > 0.0;
        let checks: [(bool, &'static str, String, &'static str); 8] = [
            (
                pixels >= 16 && pixels.is_multiple_of(16) && pixels <= 4096,
                "encode.window.pixels",
                pixels.to_string(),
                "a multiple of 16 from 16 to 4096",
            ),
            (
                (0.01..=10.0).contains(&encode.window.pixel()),
                "encode.window.metres",
                encode.window.metres.to_string(),
                "from 1 cm to 10 m for each of encode.window.pixels",
            ),
            (
                (0.01..=10.0).contains(&encode.input().pixel()),
                "encode.input_metres",
                encode.input().metres.to_string(),
                "from 1 cm to 10 m for each of encode.window.pixels",
            ),
            (
                (1..=64).contains(&encode.layers.count),
                "encode.layers.count",
                encode.layers.count.to_string(),
                "from 1 to 64",
            ),
            (
                is_positive(encode.layers.top - encode.layers.bottom),
                "encode.layers.top",
                encode.layers.top.to_string(),
                "above encode.layers.bottom, by a finite number of metres",
            ),
            (
                (1..=10_000_000).contains(&self.coverage.points) && (1e-6..=1e3).contains(&self.coverage.epsilon),
                "coverage",
                format!("{} points, epsilon {}", self.coverage.points, self.coverage.epsilon),
                "from 1 to 10,000,000 points and a positive epsilon from 1 µm to 1 km",
            ),
            (self.keep > 0.0 && self.keep <= 1.0, "keep", self.keep.to_string(), "above 0 and at most 1"),
            ((1..=64).contains(&self.captures), "captures", self.captures.to_string(), "from 1 to 64"),
        ];
        let motions = match &self.agent {
            Agent::Lattice {} => None,
            Agent::Continuous(config) => config.fault(),
        };
        let fault = checks.into_iter().find(|(ok, ..)| !ok).map(|(_, field, value, want)| (field, value, want));
        match fault.or(motions).or(self.noise.fault()) {
            Some((field, value, want)) => Err(SimError::Field { field, value, want }),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn out_of_range_settings_are_named() {
        let mut config = SimConfig::default();
        config.encode.window.pixels = 100;
        assert!(config.validate().unwrap_err().to_string().contains("encode.window.pixels"));
        let config = SimConfig { keep: 0.0, ..SimConfig::default() };
        assert!(config.validate().unwrap_err().to_string().contains("keep"));
    }
}
