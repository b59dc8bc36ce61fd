//! The four levels of difficulty and the numbers behind them.

use super::detail::DetailStyle;
use super::rooms::{RoomStyle, normal};
use nbp_env::Rng;
use std::fmt;
use std::str::FromStr;

/// A level of difficulty of AiMDoom.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Level {
    /// About 630 m², complexity about 11.
    Simple,
    /// About 1350 m², complexity about 18.
    Normal,
    /// About 3200 m², complexity about 36.
    Hard,
    /// About 5500 m², complexity about 45.
    Insane,
}

impl Level {
    /// All four, the easiest first.
    pub const ALL: [Self; 4] = [Self::Simple, Self::Normal, Self::Hard, Self::Insane];

    /// Name, as in folders and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Simple => "simple",
            Self::Normal => "normal",
            Self::Hard => "hard",
            Self::Insane => "insane",
        }
    }

    /// Draws what one map is to be.
    pub(crate) fn draw_targets(self, rng: &mut Rng) -> Targets {
        let (area, deviation, site, complexity, depth_first, side) = match self {
            Self::Simple => (633.0, 120.0, [48.0, 46.0], 11.0, 0.5, 4.8),
            Self::Normal => (1348.0, 220.0, [66.0, 65.0], 18.0, 0.6, 5.5),
            Self::Hard => (3214.0, 400.0, [92.0, 86.0], 36.0, 0.8, 6.0),
            Self::Insane => (5488.0, 600.0, [125.0, 116.0], 45.0, 0.8, 6.0),
        };
        let drawn: f64 = area + deviation * normal(rng).clamp(-2.0, 2.0);
        // Larger maps get larger sites: the fill of the bounding box is what a player sees.
        let scale = (drawn / area).sqrt();
        // The mean of exp(N(m, s²)) is exp(m + s²/2).
        let log = COMPLEXITY_SPREAD * normal(rng).clamp(-2.0, 2.0) - COMPLEXITY_SPREAD.powi(2) / 2.0;
        Targets {
            area: drawn,
            complexity: (complexity * log.exp()).max(LEAST_COMPLEXITY),
            site: site.map(|side| side * scale),
            depth_first,
            room_share: 0.88,
            rooms: RoomStyle { side, spread: 0.4, closets: 0.48, largest: 10, gaps: [0.65, 0.2, 0.1, 0.05] },
            details: DetailStyle { islands: 1.6, at_walls: 1.0, low: 3.0 },
        }
    }
}

/// Standard deviation of the logarithm of the complexity.
const COMPLEXITY_SPREAD: f64 = 0.45;

/// Maps with pillars and doors do not get below this.
const LEAST_COMPLEXITY: f64 = 4.0;

/// What one map is to be.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Targets {
    /// Floor, m².
    pub(crate) area: f64,
    /// Navigation complexity.
    pub(crate) complexity: f64,
    /// Largest extent, metres.
    pub(crate) site: [f64; 2],
    /// Probability of growing the tree from the newest room.
    pub(crate) depth_first: f64,
    /// Share of the floor in rooms; corridors and doors have the rest.
    pub(crate) room_share: f64,
    /// How rooms are drawn.
    pub(crate) rooms: RoomStyle,
    /// How rooms are furnished.
    pub(crate) details: DetailStyle,
}

impl fmt::Display for Level {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Level {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let found = Self::ALL.into_iter().find(|level| level.name() == name);
        found.ok_or_else(|| format!("{name:?} is no level; choose simple, normal, hard or insane"))
    }
}
