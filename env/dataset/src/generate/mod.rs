//! Maps without Doom: rooms, corridors, doors, windows, pillars, in Doom's own structure (aimdoom.md, section 3).
//!
//! `rooms → links → detail → complexity → sectors → DoomMap`, and the converter that serves WAD files measures the
//! result. The same level and seed give the same map on every machine.

mod complexity;
mod detail;
mod draft;
mod level;
mod links;
mod raster;
mod rooms;
mod sectors;

pub use level::Level;

use crate::convert::{ConvertError, ConvertOptions, SceneBundle, convert};
use crate::doom_map::{DoomMap, UNITS_PER_METRE};
use crate::navigation::Navigation;
use crate::triangulate::TriangulateError;
use draft::Draft;
use level::Targets;
use nbp_env::SeedTree;
use nbp_env::scene::{LatticeGraph, RayIndex};
use rooms::{BLOCK, Site};

/// Drafts of a map before it is given up.
const MAX_TRIES: u64 = 64;

/// Drafts with the same targets; the next ones draw new targets.
const TRIES_PER_TARGET: u64 = 8;

/// A map must be connected at the camera plane over this share of its floor.
const MIN_PLANE_SHARE: f64 = 0.9;

/// Accepted distance from the target area, as a share.
const AREA_TOLERANCE: f64 = 0.25;

/// Accepted distance from the target complexity, as a share.
const COMPLEXITY_TOLERANCE: f64 = 0.3;

/// Why a map could not be generated.
#[derive(Debug, thiserror::Error)]
pub enum GenerateError {
    /// No draft was near enough to the targets.
    #[error(
        "{level} map of seed {seed}: none of {tries} drafts was accepted, the last because {last}; choose another seed"
    )]
    NotAccepted {
        /// Level.
        level: Level,
        /// Seed.
        seed: u64,
        /// Drafts made.
        tries: u64,
        /// In words.
        last: String,
    },
    /// The union of the pieces failed.
    #[error("{level} map of seed {seed}: {source}")]
    Triangulate {
        /// Level.
        level: Level,
        /// Seed.
        seed: u64,
        /// Where.
        source: TriangulateError,
    },
    /// The converter refused the map.
    #[error("{level} map of seed {seed}: {source}")]
    Convert {
        /// Level.
        level: Level,
        /// Seed.
        seed: u64,
        /// Why.
        source: ConvertError,
    },
}

/// A generated map with its scene and what it was to be.
#[derive(Debug, Clone)]
pub struct Generated {
    /// The map in Doom's structure.
    pub map: DoomMap,
    /// Its scene.
    pub scene: SceneBundle,
    /// Floor area that was aimed at, m².
    pub target_area: f64,
    /// Navigation complexity that was aimed at.
    pub target_complexity: f64,
    /// Navigation complexity, all pairs.
    pub complexity: f64,
    /// Drafts, the accepted one included.
    pub tries: u64,
}

/// Generates the map of a level and a seed; its scene is called `<level>_<seed>`.
///
/// # Errors
/// When no draft of the seed comes near its targets, which a change of the level's numbers may cause.
pub fn generate(level: Level, seed: u64) -> Result<Generated, GenerateError> {
    let root = SeedTree::new(seed).child("generate", level as u64);
    let name = format!("{level}_{seed}");
    let mut last = String::new();
    for attempt in 0..MAX_TRIES {
        let targets = level.draw_targets(&mut root.child("targets", attempt / TRIES_PER_TARGET).rng());
        let (draft, near_complexity) = draft(&targets, root.child("draft", attempt));
        let free = draft.raster.free_cells() as f64 * f64::from(raster::CELL * raster::CELL) / UNITS_PER_METRE.powi(2);
        // The raster's figures are near the exact ones: far drafts are dropped before the triangulation.
        if let Err(reason) = check(&targets, free * 1.02, near_complexity, 1.15) {
            last = reason;
            continue;
        }
        let map = sectors::to_map(&name, &draft.pieces()).map_err(|source| GenerateError::Triangulate {
            level,
            seed,
            source,
        })?;
        let scene = convert(&map, ConvertOptions::default()).map_err(|source| GenerateError::Convert {
            level,
            seed,
            source,
        })?;
        let complexity = complexity_of(&scene);
        let share = scene.report.plane_area / scene.report.map_area;
        match check(&targets, scene.report.floor_area, complexity, 1.0) {
            Err(reason) => last = reason,
            Ok(()) if share < MIN_PLANE_SHARE => {
                last = format!("only {:.0} % of its floor are connected at the camera plane", 100.0 * share);
            }
            Ok(()) => {
                let Targets { area, complexity: target_complexity, .. } = targets;
                let tries = attempt + 1;
                if std::env::var("DBG").is_ok() {
                    println!("{} rooms {} passages", draft.site.rooms.len(), draft.passages.len());
                }
                return Ok(Generated { map, scene, target_area: area, target_complexity, complexity, tries });
            }
        }
    }
    Err(GenerateError::NotAccepted { level, seed, tries: MAX_TRIES, last })
}

/// One draft and the largest ratio among its near pairs.
fn draft(targets: &Targets, seed: SeedTree) -> (Draft, f64) {
    let rng = &mut seed.rng();
    let blocks = |metres: f64| (metres * UNITS_PER_METRE / f64::from(BLOCK)).round() as i32;
    let mut site = Site::new(targets.site.map(blocks));
    let square_units = targets.area * UNITS_PER_METRE * UNITS_PER_METRE;
    site.place_rooms(targets.room_share * square_units, &targets.rooms, rng);
    let mut draft = Draft::new(site);
    links::connect(&mut draft, targets.depth_first, rng);
    detail::furnish(&mut draft, &targets.details, rng);
    let near_complexity = complexity::reduce(&mut draft, targets.complexity, rng);
    (draft, near_complexity)
}

/// Compares a draft with its targets; `slack` widens the tolerances.
fn check(targets: &Targets, area: f64, complexity: f64, slack: f64) -> Result<(), String> {
    if (area / targets.area - 1.0).abs() > AREA_TOLERANCE * slack {
        return Err(format!("its floor has {area:.0} m² instead of {:.0}", targets.area));
    }
    if (complexity / targets.complexity - 1.0).abs() > COMPLEXITY_TOLERANCE * slack {
        return Err(format!("its complexity is {complexity:.1} instead of {:.1}", targets.complexity));
    }
    Ok(())
}

fn complexity_of(scene: &SceneBundle) -> f64 {
    let graph = LatticeGraph::build(scene.lattice(), &RayIndex::build(&scene.mesh));
    Navigation::of(&graph).complexity().ratio
}
