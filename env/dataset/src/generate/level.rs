//! The four levels of difficulty and the numbers behind them.

use super::detail::DetailStyle;
use super::rooms::{RoomStyle, normal};
use super::trim::TrimStyle;
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

    /// The numbers of the level. Area and complexity are chosen so that the means over many maps come out as published;
    /// the rest so that walls, clearance and islands are those of Obsidian's maps.
    fn numbers(self) -> Numbers {
        match self {
            Self::Simple => Numbers {
                area: [593.0, 120.0],
                complexity: 11.8,
                site: [61.0, 58.0],
                depth_first: 0.5,
                side: 5.2,
                closets: 0.25,
                oblique: 0.67,
                bars: 0.65,
                walls: 0.9,
            },
            Self::Normal => Numbers {
                area: [1315.0, 220.0],
                complexity: 18.6,
                site: [72.0, 70.0],
                depth_first: 0.6,
                side: 6.2,
                closets: 0.2,
                oblique: 0.56,
                bars: 0.65,
                walls: 0.87,
            },
            Self::Hard => Numbers {
                area: [3200.0, 400.0],
                complexity: 35.3,
                site: [100.0, 94.0],
                depth_first: 0.8,
                side: 6.6,
                closets: 0.2,
                oblique: 0.69,
                bars: 0.9,
                walls: 0.8,
            },
            Self::Insane => Numbers {
                area: [5420.0, 600.0],
                complexity: 42.0,
                site: [132.0, 123.0],
                depth_first: 0.8,
                side: 7.0,
                closets: 0.15,
                oblique: 0.63,
                bars: 0.65,
                walls: 0.72,
            },
        }
    }

    /// Draws what one map is to be.
    pub(crate) fn draw_targets(self, rng: &mut Rng) -> Targets {
        let numbers = self.numbers();
        let [mean, deviation] = numbers.area;
        let area = mean + deviation * normal(rng).clamp(-2.0, 2.0);
        // Larger maps get larger sites: the fill of the bounding box is what a player sees.
        let scale = (area / mean).sqrt();
        // The mean of exp(N(m, s²)) is exp(m + s²/2).
        let log = COMPLEXITY_SPREAD * normal(rng).clamp(-2.0, 2.0) - COMPLEXITY_SPREAD.powi(2) / 2.0;
        Targets {
            area,
            complexity: (numbers.complexity * log.exp()).max(LEAST_COMPLEXITY),
            site: numbers.site.map(|side| side * scale),
            depth_first: numbers.depth_first,
            room_share: 0.88,
            rooms: RoomStyle {
                side: numbers.side,
                spread: 0.4,
                closets: numbers.closets,
                halls: 0.25,
                oblique: numbers.oblique,
                largest: 10,
                gaps: [0.78, 0.13, 0.06, 0.03],
                sprawl: 0.5,
            },
            trim: TrimStyle { walls: numbers.walls, ceilings: 1.0, floors: 0.5 },
            details: DetailStyle { islands: 1.0, at_walls: 1.0, low: 2.5, alcoves: 1.0, bars: numbers.bars },
        }
    }
}

/// What differs from level to level.
struct Numbers {
    /// Floor: mean and standard deviation, m².
    area: [f64; 2],
    /// Navigation complexity, mean.
    complexity: f64,
    /// Largest extent of a map of the mean area, metres.
    site: [f64; 2],
    /// Probability of growing the tree from the newest room.
    depth_first: f64,
    /// Median side of rooms, lattice cells.
    side: f64,
    /// Share of closets.
    closets: f64,
    /// Share of chamfered, octagonal and turned rooms among the others.
    oblique: f64,
    /// Barred windows for each 100 m².
    bars: f64,
    /// Share of the walls with recesses.
    walls: f64,
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
    /// How rooms are decorated.
    pub(crate) trim: TrimStyle,
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
