//! What a network is made of, and what a checkpoint says about itself.

use nbp_env::pose::HEADINGS;
use nbp_env::window::WindowSize;
use serde::{Deserialize, Serialize};

/// How counts become the numbers that the first convolution sees.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum InputScale {
    /// Counts as they are, hundreds near a wall: what the released code does.
    #[default]
    Raw,
    /// `ln(1 + count)`, which keeps far, thinly seen surfaces visible beside near ones.
    Log1p,
}

impl InputScale {
    /// The scaled count.
    pub fn apply(self, count: u16) -> f32 {
        self.scale(f32::from(count))
    }

    /// The same for any number.
    pub fn scale(self, number: f32) -> f32 {
        match self {
            Self::Raw => number,
            Self::Log1p => number.ln_1p(),
        }
    }
}

/// Size of the network (paper, appendix B). Every width is a multiple of `base`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct NetConfig {
    /// Channels of the first encoder stage; the deepest has 16 times as many (paper: 64).
    pub base: usize,
    /// Input channels: layers of the point cloud, what else `sim.encode` shows, and the trajectory (paper: 4 + 1).
    pub in_channels: usize,
    /// Channels of the value map, one for each heading (paper: 8).
    pub headings: usize,
    /// Scale of the input (paper: raw).
    pub input_scale: InputScale,
}

impl Default for NetConfig {
    fn default() -> Self {
        Self { base: 64, in_channels: 5, headings: HEADINGS, input_scale: InputScale::Raw }
    }
}

/// A network that cannot be built.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// A field is out of range.
    #[error("net.{field} = {found} is impossible: {wanted}")]
    Field {
        /// Name of the field.
        field: &'static str,
        /// As given.
        found: usize,
        /// What would do.
        wanted: &'static str,
    },
}

impl NetConfig {
    /// Layers of the point cloud in the input, where it shows nothing else but the trajectory.
    pub fn layers(&self) -> usize {
        self.in_channels.saturating_sub(1)
    }

    /// Whether the network can be built.
    ///
    /// # Errors
    /// Names the field that is out of range.
    pub fn check(&self) -> Result<(), ConfigError> {
        let field = |field, found, wanted| Err(ConfigError::Field { field, found, wanted });
        if self.base < 2 || !self.base.is_multiple_of(2) || self.base > 512 {
            return field("base", self.base, "use an even number from 2 to 512 (the last gate has base / 2 channels)");
        }
        if !(2..=64).contains(&self.in_channels) {
            return field(
                "in_channels",
                self.in_channels,
                "use 2 to 64: layers, what else sim.encode shows, and the trajectory",
            );
        }
        if self.headings != HEADINGS {
            return field("headings", self.headings, "the lattice has 8 headings");
        }
        Ok(())
    }

    /// Trainable numbers, counted from the widths (49,964,669 for the paper's network).
    pub fn parameters(&self) -> usize {
        let conv = |kernel: usize, cin: usize, cout: usize| kernel * kernel * cin * cout + cout;
        let unit = |kernel, cin, cout| conv(kernel, cin, cout) + 2 * cout;
        let block = |cin, cout| unit(3, cin, cout) + unit(3, cout, cout);
        let gate = |c: usize| 2 * unit(1, c, c / 2) + unit(1, c / 2, 1);
        let stage = |c: usize| unit(3, 2 * c, c) + gate(c) + block(2 * c, c);
        let b = self.base;
        let encoder =
            block(self.in_channels, b) + [b, 2 * b, 4 * b, 8 * b].map(|c| block(c, 2 * c)).iter().sum::<usize>();
        let value = stage(8 * b) + stage(4 * b) + conv(1, 4 * b, self.headings);
        let obstacle = [8 * b, 4 * b, 2 * b, b].map(stage).iter().sum::<usize>() + conv(1, b, 1);
        encoder + value + obstacle + 2
    }
}

/// Name of the architecture in `config.json`.
pub const ARCHITECTURE: &str = "nbp";
/// Version of the layout of `config.json` and `model.safetensors`.
pub const VERSION: u32 = 1;

/// The `config.json` of a checkpoint: all that is needed to use its weights.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CheckpointConfig {
    /// [`ARCHITECTURE`].
    pub architecture: String,
    /// [`VERSION`].
    pub version: u32,
    /// Size of the network.
    pub net: NetConfig,
    /// The window that it was trained with.
    pub window: WindowSize,
    /// What other packages want to remember (how inputs are encoded, where the weights come from); not read here.
    #[serde(default, skip_serializing_if = "serde_json::Map::is_empty")]
    pub meta: serde_json::Map<String, serde_json::Value>,
}

impl CheckpointConfig {
    /// A checkpoint without notes.
    pub fn new(net: NetConfig, window: WindowSize) -> Self {
        Self { architecture: ARCHITECTURE.to_owned(), version: VERSION, net, window, meta: serde_json::Map::new() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_papers_network_has_49_964_669_parameters() {
        assert_eq!(NetConfig::default().parameters(), 49_964_669);
    }

    #[test]
    fn unknown_fields_are_refused_and_missing_ones_are_the_papers() {
        assert!(serde_json::from_str::<NetConfig>(r#"{"bass": 16}"#).is_err());
        let config: NetConfig = serde_json::from_str(r#"{"base": 16, "input_scale": "log1p"}"#).unwrap();
        assert_eq!(config, NetConfig { base: 16, input_scale: InputScale::Log1p, ..NetConfig::default() });
    }

    #[test]
    fn odd_widths_are_refused() {
        let error = NetConfig { base: 7, ..NetConfig::default() }.check().unwrap_err();
        assert!(error.to_string().contains("net.base = 7"), "{error}");
        assert!(NetConfig { in_channels: 1, ..NetConfig::default() }.check().is_err());
        assert!(NetConfig::default().check().is_ok());
    }
}
