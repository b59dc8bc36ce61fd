//! Maps without Doom: rooms, corridors, doors, windows, pillars, in Doom's own structure.
//!
//! `rooms → links → detail → complexity → trim → sectors → DoomMap`, and the converter that serves WAD files measures the
//! result. The same level and seed give the same map, whatever else runs.

mod bars;
mod complexity;
mod detail;
mod draft;
mod level;
mod links;
mod low;
mod niche;
mod outline;
mod raster;
mod rooms;
mod sectors;
mod shape;
mod theme;
mod trim;

pub use level::Level;

use crate::convert::{ConvertOptions, SceneBundle, convert};
use crate::doom_map::{DoomMap, LATTICE_UNITS, UNITS_PER_METRE};
use crate::navigation::Navigation;
use draft::Draft;
use level::Targets;
use nbp_env::scene::{LatticeGraph, RayIndex};
use nbp_env::{Rng, SeedTree};
use rooms::{BLOCK, Site};
use theme::Theme;

/// Drafts of a map before it is given up.
const MAX_TRIES: u64 = 64;

/// Drafts with the same targets; the next ones draw new targets.
const TRIES_PER_TARGET: u64 = 8;

/// A map must be connected at the camera plane over this share of its floor.
const MIN_PLANE_SHARE: f64 = 0.9;

/// The same on the 1.5 m lattice, on which agents walk; doors must be hit by its lines.
const MIN_LATTICE_SHARE: f64 = 0.85;

/// Factor on the tolerances while only the raster's figures are known.
const RASTER_SLACK: f64 = 1.15;

/// Accepted distance from the target area, as a share.
const AREA_TOLERANCE: f64 = 0.25;

/// Doors are opened until the complexity is under the target times this: the last door overshoots by about as much.
const OVERSHOOT: f64 = 1.1;

/// Accepted distance from the target complexity, as a share.
const COMPLEXITY_TOLERANCE: f64 = 0.3;

/// Why a map could not be generated.
#[derive(Debug, thiserror::Error)]
#[error(
    "{level} map of seed {seed}: none of {tries} drafts was accepted, the last because {last}; choose another seed"
)]
pub struct GenerateError {
    /// Level.
    pub level: Level,
    /// Seed.
    pub seed: u64,
    /// Drafts made.
    pub tries: u64,
    /// Why the last one was not accepted.
    pub last: String,
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
        match finish(&name, &targets, draft, near_complexity, &mut root.child("trim", attempt).rng()) {
            Ok(done) => return Ok(Generated { tries: attempt + 1, ..done }),
            Err(reason) => last = reason,
        }
    }
    Err(GenerateError { level, seed, tries: MAX_TRIES, last })
}

/// Converts a draft and accepts it, or says why not.
fn finish(
    name: &str,
    targets: &Targets,
    mut draft: Draft,
    near_complexity: f64,
    rng: &mut Rng,
) -> Result<Generated, String> {
    // The raster's figures are near the exact ones: far drafts are dropped before the triangulation.
    let cell = f64::from(raster::CELL) / UNITS_PER_METRE;
    check(targets, draft.raster.free_cells() as f64 * cell * cell, near_complexity, RASTER_SLACK)?;
    trim::decorate(&mut draft, &targets.trim, rng);
    let map = sectors::to_map(name, &draft).map_err(|error| error.to_string())?;
    let scene = convert(&map, ConvertOptions::default()).map_err(|error| error.to_string())?;
    let graph = LatticeGraph::build(scene.lattice(), &RayIndex::build(&scene.mesh));
    let complexity = Navigation::of(&graph).complexity().ratio;
    let report = &scene.report;
    check(targets, report.floor_area, complexity, 1.0)?;
    let on_lattice = report.nodes as f64 * (LATTICE_UNITS / UNITS_PER_METRE).powi(2);
    for (what, area, least) in [
        ("connected at the camera plane", report.plane_area, MIN_PLANE_SHARE),
        ("connected on the lattice", on_lattice, MIN_LATTICE_SHARE),
    ] {
        if area < least * report.map_area {
            return Err(format!("only {area:.0} m² of its {:.0} m² are {what}", report.map_area));
        }
    }
    let (target_area, target_complexity) = (targets.area, targets.complexity);
    Ok(Generated { map, scene, target_area, target_complexity, complexity, tries: 1 })
}

/// One draft and the largest ratio among its near pairs.
fn draft(targets: &Targets, seed: SeedTree) -> (Draft, f64) {
    let rng = &mut seed.rng();
    let blocks = |metres: f64| (metres * UNITS_PER_METRE / f64::from(BLOCK)).round() as i32;
    let mut site = Site::new(targets.site.map(blocks));
    let square_units = targets.area * UNITS_PER_METRE * UNITS_PER_METRE;
    let theme = Theme::draw(rng);
    site.place_rooms(targets.room_share * square_units, &targets.rooms, theme, rng);
    let mut draft = Draft::new(site, theme);
    links::connect(&mut draft, targets.depth_first, rng);
    trim::shape_floors(&mut draft, &targets.trim, rng);
    detail::furnish(&mut draft, &targets.details, rng);
    let near_complexity = complexity::reduce(&mut draft, OVERSHOOT * targets.complexity, rng);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::doom_map::{Name, SideDef};
    use crate::to_scene;
    use crate::write::Model;
    use glam::Vec3;
    use rand::RngExt as _;
    use rayon::prelude::*;
    use std::collections::BTreeMap;

    #[test]
    fn the_same_seed_gives_the_same_bytes() {
        for level in [Level::Simple, Level::Hard] {
            let [a, b] = [(), ()].map(|()| generate(level, 11).unwrap());
            assert_eq!(a.map, b.map);
            let model = |made: &Generated| Model::of(&made.scene.name, &made.scene.mesh, 1.0).unwrap();
            assert_eq!(model(&a), model(&b));
            assert_eq!(a.scene.settings, b.scene.settings);
        }
        assert_ne!(generate(Level::Simple, 1).unwrap().map.vertices, generate(Level::Simple, 2).unwrap().map.vertices);
    }

    #[test]
    fn maps_keep_to_their_targets() {
        for (level, seeds) in [(Level::Simple, 12), (Level::Normal, 6), (Level::Hard, 3), (Level::Insane, 2)] {
            for seed in 0..seeds {
                let made = generate(level, seed).unwrap();
                let report = &made.scene.report;
                assert!((report.floor_area / made.target_area - 1.0).abs() <= AREA_TOLERANCE, "{level} {seed}");
                let off = (made.complexity / made.target_complexity - 1.0).abs();
                assert!(off <= COMPLEXITY_TOLERANCE, "{level} {seed}: {off}");
                assert!(report.plane_area >= MIN_PLANE_SHARE * report.map_area);
                assert_eq!(report.conflict_area, 0.0, "sectors are closed by construction");
                let starts = &made.scene.settings.camera.start_positions;
                let distinct: std::collections::BTreeSet<_> = starts.iter().map(|s| (s[0], s[2])).collect();
                assert_eq!(distinct.len(), 5);
                assert!(starts.iter().all(|s| s[1] == 0 && s[3] == 2));
            }
        }
    }

    #[test]
    fn means_are_the_published_ones() {
        let made: Vec<Generated> =
            (0..40_u64).into_par_iter().map(|seed| generate(Level::Simple, 500 + seed).unwrap()).collect();
        let mean = |of: fn(&Generated) -> f64| made.iter().map(of).sum::<f64>() / made.len() as f64;
        let (area, complexity) = (mean(|m| m.scene.report.floor_area), mean(|m| m.complexity));
        assert!((area / 633.0 - 1.0).abs() < 0.06, "{area} m²");
        assert!((complexity / 11.31 - 1.0).abs() < 0.15, "{complexity}");
        let density = mean(|m| m.scene.report.triangles as f64 / m.scene.report.floor_area);
        assert!((9.0..18.0).contains(&density), "as much detail as Obsidian's maps have: {density} triangles/m²");
    }

    #[test]
    fn every_wall_that_is_seen_has_a_texture() {
        let map = generate(Level::Simple, 3).unwrap().map;
        for line in &map.linedefs {
            let sides = [line.front, line.back].map(|side| side.map(|side| map.sidedefs[side as usize]));
            let sector = |side: &SideDef| map.sectors[side.sector as usize];
            match sides {
                [Some(front), None] => assert_ne!(front.middle, Name::NONE),
                [Some(front), Some(back)] => {
                    for (here, there) in [(front, back), (back, front)] {
                        let (low, high) = (sector(&here), sector(&there));
                        assert_eq!(high.floor > low.floor, here.lower != Name::NONE);
                        assert_eq!(high.ceiling < low.ceiling, here.upper != Name::NONE);
                        assert_eq!(here.middle, Name::NONE);
                    }
                }
                _ => panic!("a line without a front: {line:?}"),
            }
        }
        let lights: std::collections::BTreeSet<u16> = map.sectors.iter().map(|sector| sector.light).collect();
        assert!(lights.len() > 3, "{lights:?}");
    }

    #[test]
    fn meshes_are_closed_and_face_the_free_space() {
        for seed in 0..4 {
            let scene = generate(Level::Normal, seed).unwrap().scene;
            let mut balance: BTreeMap<(u32, u32), i32> = BTreeMap::new();
            for &[a, b, c] in scene.mesh.triangles() {
                for (from, to) in [(a, b), (b, c), (c, a)] {
                    *balance.entry((from.min(to), from.max(to))).or_default() += if from < to { 1 } else { -1 };
                }
            }
            assert!(balance.values().all(|&edge| edge == 0), "every edge is run both ways equally often");
            let scene = to_scene(scene).unwrap();
            let mut rng = SeedTree::new(seed).rng();
            for &node in scene.graph().largest_component() {
                for _ in 0..12 {
                    let direction = [(); 3].map(|()| rng.random_range(-1.0..1.0_f32));
                    let (origin, direction) = (scene.lattice().position(node), Vec3::from(direction));
                    let hit = scene.rays().nearest(origin, direction, f32::INFINITY);
                    let [a, b, c] = scene.mesh().corners(hit.expect("a ray escaped").triangle as usize);
                    assert!((b - a).cross(c - a).dot(direction) <= 1e-3, "seen from its free side");
                }
            }
        }
    }
}
