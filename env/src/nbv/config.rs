//! Sizes and distances of the next-best-view baselines.

use serde::{Deserialize, Serialize};

/// Sizes and distances, the same in training and in use. The default is for a processor without a graphics card: the networks
/// cost about 25 million operations a query and 3 million a drawn proxy, and the published sizes take seconds a step.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct NbvConfig {
    /// Points drawn in the scene's box (released code: 50,000).
    pub proxies: usize,
    /// A proxy seen through is carved when it lay farther than this in front of the surface, metres (released code: 5, which
    /// is ten of its units and carves next to nothing in rooms).
    pub carving: f32,
    /// Side of a cell of the cloud, metres. Cells reach over the full height of the box.
    pub cell: f32,
    /// One point is kept in each cube of this side, metres.
    pub voxel: f32,
    /// Points of the cloud around a cell that the network sees (published: 2048).
    pub cloud_points: usize,
    /// Around fewer points than this nothing is asked, and the proxies count as empty (published: 64).
    pub min_points: usize,
    /// Cells whose cloud the network sees in a step (published: all in view).
    pub cells: usize,
    /// Proxies asked about in a step, the nearest and longest unasked first (published: all).
    pub queries: usize,
    /// Proxies drawn in the frustum of a candidate, with repetition (published: 2048).
    pub draws: usize,
    /// Proxies that are less likely solid than this are not drawn (published: 0.1).
    pub min_probability: f32,
    /// Farther proxies are worth less, by the square of the distance, metres (released code: 8.5).
    pub full_distance: f32,
}

impl Default for NbvConfig {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// A setting that the baselines cannot work with.
#[derive(Debug, thiserror::Error)]
#[error("{field} is {value}: it must be {want}")]
pub struct NbvConfigError {
    field: &'static str,
    value: String,
    want: &'static str,
}

impl NbvConfig {
    /// For a processor without a graphics card.
    pub const DEFAULT: Self = Self {
        proxies: 10_000,
        carving: 0.25,
        cell: 6.0,
        voxel: 0.25,
        cloud_points: 512,
        min_points: 64,
        cells: 4,
        queries: 64,
        draws: 64,
        min_probability: 0.1,
        full_distance: 8.5,
    };

    /// The sizes of the released code.
    pub const PUBLISHED: Self = Self {
        proxies: 50_000,
        carving: 5.0,
        cell: 6.0,
        voxel: 0.1,
        cloud_points: 2048,
        min_points: 64,
        cells: 10_000,
        queries: 50_000,
        draws: 2048,
        min_probability: 0.1,
        full_distance: 8.5,
    };

    /// Checks every number.
    ///
    /// # Errors
    /// Naming the first setting that is out of range.
    pub fn validate(&self) -> Result<(), NbvConfigError> {
        let counts = [
            ("proxies", self.proxies, 1..=1_000_000, "from 1 to 1,000,000"),
            ("cloud_points", self.cloud_points, 64..=65_536, "from 64 to 65,536"),
            // So many that three scales with neighbours for each query can be drawn from them.
            ("min_points", self.min_points, 64..=65_536, "from 64 to 65,536"),
            ("cells", self.cells, 1..=1_000_000, "from 1 to 1,000,000"),
            ("queries", self.queries, 1..=1_000_000, "from 1 to 1,000,000"),
            ("draws", self.draws, 1..=65_536, "from 1 to 65,536"),
        ];
        let lengths = [
            ("carving", self.carving, 0.0..=100.0, "from 0 to 100 m"),
            ("cell", self.cell, 1.0..=1000.0, "from 1 to 1000 m"),
            ("voxel", self.voxel, 0.01..=10.0, "from 1 cm to 10 m"),
            ("min_probability", self.min_probability, 0.0..=1.0, "a probability, 0 to 1"),
            ("full_distance", self.full_distance, 0.1..=1000.0, "from 0.1 to 1000 m"),
        ];
        let count = counts.into_iter().find(|(_, value, range, _)| !range.contains(value));
        let length = lengths.into_iter().find(|(_, value, range, _)| !range.contains(value));
        let fault = count.map(|(field, value, _, want)| (field, value.to_string(), want));
        match fault.or(length.map(|(field, value, _, want)| (field, value.to_string(), want))) {
            Some((field, value, want)) => Err(NbvConfigError { field, value, want }),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn out_of_range_settings_are_named_and_unknown_ones_refused() {
        for good in [NbvConfig::default(), NbvConfig::PUBLISHED] {
            good.validate().unwrap();
            let text = serde_json::to_string(&good).unwrap();
            assert_eq!(serde_json::from_str::<NbvConfig>(&text).unwrap(), good);
        }
        let good = NbvConfig::default();
        for (bad, named) in [
            (NbvConfig { draws: 0, ..good }, "draws is 0"),
            (NbvConfig { min_points: 10, ..good }, "min_points is 10"),
            (NbvConfig { carving: f32::NAN, ..good }, "carving is NaN"),
            (NbvConfig { cell: 0.5, ..good }, "cell is 0.5: it must be from 1 to 1000 m"),
        ] {
            let error = bad.validate().unwrap_err().to_string();
            assert!(error.contains(named), "{error}");
        }
        assert!(serde_json::from_str::<NbvConfig>(r#"{"tau": 5.0}"#).unwrap_err().to_string().contains("tau"));
    }
}
