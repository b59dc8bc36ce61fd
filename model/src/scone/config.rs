//! How wide the two networks are.

use crate::config::ConfigError;
use serde::{Deserialize, Serialize};

pub use nbp_env::nbv::{HARMONICS, SCALES};

/// Widths of both networks; the defaults are the published ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SconeConfig {
    /// Features of a point of the occupancy network, half of those of the visibility network; all else is a multiple of it
    /// (published: 128).
    pub width: usize,
    /// Heads of every attention (published: 4).
    pub heads: usize,
    /// Attention layers of the occupancy network (published: 2).
    pub occupancy_layers: usize,
    /// Attention layers of the visibility network (published: 3).
    pub visibility_layers: usize,
}

impl Default for SconeConfig {
    fn default() -> Self {
        Self { width: 128, heads: 4, occupancy_layers: 2, visibility_layers: 3 }
    }
}

impl SconeConfig {
    /// Whether the networks can be built.
    ///
    /// # Errors
    /// Names the field that is out of range.
    pub fn check(&self) -> Result<(), ConfigError> {
        let field = |field, found, wanted| Err(ConfigError::Field { field, found, wanted });
        if !(1..=16).contains(&self.heads) {
            return field("heads", self.heads, "use 1 to 16");
        }
        if self.width < 8 || self.width > 512 || !self.width.is_multiple_of(4 * self.heads) {
            return field("width", self.width, "use a multiple of 4 × heads, from 8 to 512");
        }
        let layers = [("occupancy_layers", self.occupancy_layers), ("visibility_layers", self.visibility_layers)];
        match layers.into_iter().find(|(_, layers)| !(1..=16).contains(layers)) {
            Some((name, found)) => field(name, found, "use 1 to 16"),
            None => Ok(()),
        }
    }

    /// Trainable numbers of the occupancy and of the visibility network, counted from the widths (2,257,769 and 1,392,888
    /// as published).
    pub fn parameters(&self) -> [usize; 2] {
        let linear = |from: usize, to: usize| from * to + to;
        let norm = |e: usize| 2 * e;
        let layer =
            |e: usize| 2 * norm(e) + 2 * linear(e, e / 4) + 2 * linear(e, e) + linear(e, 2 * e) + linear(2 * e, e);
        let w = self.width;
        let pct = |to: usize| {
            linear(3, w - 3) + linear(w - 3, w - 3) + self.occupancy_layers * layer(w) + norm(w) + linear(w, to / 2)
        };
        let point = linear(3, w) + linear(w, 2 * w) + linear(2 * w, 4 * w);
        let head = linear(14 * w + HARMONICS, 4 * w) + linear(4 * w, 2 * w) + linear(2 * w, 1);
        let occupancy = pct(4 * w) + SCALES * pct(2 * w) + point + head;
        let embedding = linear(4, w - 2) + linear(w - 2, w - 2);
        let coefficients = linear(2 * w, 3 * w / 2) + linear(3 * w / 2 + HARMONICS, w) + linear(w, HARMONICS);
        [occupancy, embedding + self.visibility_layers * layer(2 * w) + norm(2 * w) + coefficients]
    }
}
