//! Real Doom maps, where there are any: the folder in `NBP_DOOM_MAPS`, or `../shared/data` beside the workspace. Their
//! figures were measured by an independent prototype.

#![allow(clippy::unwrap_used)] // helpers of tests

mod prototype;

use nbp_dataset::doom_map::Name;
use nbp_dataset::wad::{Textures, Wad};
use nbp_dataset::{ConvertOptions, DoomMap, Level, SceneBundle, convert, generate, to_scene};
use nbp_env::check::Escape;
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The folder with maps, or a word on why the test is skipped.
fn maps() -> Option<PathBuf> {
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    let folder = std::env::var_os("NBP_DOOM_MAPS").map_or(beside, PathBuf::from);
    if folder.join("obsidian/manifest.csv").is_file() {
        return Some(folder);
    }
    println!("skipped: no Doom maps in {}; set NBP_DOOM_MAPS", folder.display());
    None
}

/// Rows of a table, by column.
fn table(path: &Path) -> Vec<BTreeMap<String, String>> {
    let text = std::fs::read_to_string(path).unwrap();
    let mut lines = text.lines().map(|line| line.split(',').map(str::to_string));
    let heads: Vec<String> = lines.next().unwrap().collect();
    lines.map(|row| heads.iter().cloned().zip(row).collect()).collect()
}

fn number(row: &BTreeMap<String, String>, column: &str) -> f64 {
    row[column].parse().unwrap()
}

fn scene(path: &Path, map: &str) -> SceneBundle {
    let map = Wad::open(path).unwrap().map(map).unwrap();
    convert(&map, ConvertOptions::default()).unwrap()
}

/// Of the 80 maps at least so many have each of the prototype's figures.
const AGREEING: usize = 76;

/// What the manifest says of a map, and what the prototype's measure finds in ours: floor area, connected area, complexity.
fn figures(row: &BTreeMap<String, String>, map: &DoomMap) -> [[f64; 2]; 3] {
    let scene = convert(map, ConvertOptions::default()).unwrap();
    let name = &row["seed"];
    assert_eq!(f64::from(scene.report.modal_floor), number(row, "mode_floor"), "{name}");
    assert!(scene.report.plane_area > 0.9 * scene.report.floor_area, "{name}");
    assert!(scene.report.conflict_area < 1.0, "{name}");
    let ours = prototype::measure(map, &scene);
    [
        [scene.report.map_area, number(row, "floor_area_m2")],
        [ours.area, number(row, "modeplane_comp_m2")],
        [ours.complexity, number(row, "modeplane_nc")],
    ]
}

/// Boom's generalized floors: we lower them as the game does and the prototype left them up. Hidden rooms lie behind.
fn is_generalized_floor(special: u16) -> bool {
    (0x6000..0x8000).contains(&special)
}

fn differs([ours, theirs]: &[f64; 2]) -> bool {
    (ours / theirs - 1.0).abs() > 0.03
}

#[test]
fn obsidian_maps_have_the_prototypes_figures() {
    let Some(folder) = maps() else { return };
    let rows = table(&folder.join("obsidian/manifest.csv"));
    assert_eq!(rows.len(), 80);
    let measure = |row: &BTreeMap<String, String>| {
        let name = format!("{}_{}", row["level"], row["seed"]);
        let wad = Wad::open(&folder.join(format!("obsidian/{}/{name}.wad", row["level"]))).unwrap();
        let mut map = wad.map("MAP01").unwrap();
        let found = figures(row, &map);
        if found.iter().any(differs) {
            map.linedefs.iter_mut().filter(|l| is_generalized_floor(l.special)).for_each(|l| l.special = 0);
            let left_up = figures(row, &map);
            assert!(!left_up.iter().any(differs), "{name} differs for another reason: {left_up:?}");
        }
        (name, found)
    };
    let measured: Vec<(String, [[f64; 2]; 3])> = rows.par_iter().map(measure).collect();
    for (figure, what) in ["floor area", "connected area", "navigation complexity"].into_iter().enumerate() {
        let exceptions: Vec<_> = measured.iter().filter(|(_, found)| differs(&found[figure])).collect();
        let agreeing = measured.len() - exceptions.len();
        println!("{what}: {agreeing} of {} agree to 3 %; the others have generalized floors", measured.len());
        for (name, found) in exceptions {
            println!("  {name}: {:.1}, not {}", found[figure][0], found[figure][1]);
        }
        assert!(agreeing >= AGREEING, "{what}");
    }
}

#[test]
fn no_ray_escapes_from_real_maps() {
    let Some(folder) = maps() else { return };
    let mut scenes: Vec<SceneBundle> = ["simple/simple_1004", "hard/hard_3009"]
        .map(|name| scene(&folder.join(format!("obsidian/{name}.wad")), "MAP01"))
        .into();
    let freedoom = folder.join("freedoom/freedoom2_maps_textures.wad");
    scenes.extend(["MAP07", "MAP20"].map(|map| scene(&freedoom, map)));
    scenes.into_par_iter().for_each(|bundle| {
        let scene = to_scene(bundle).unwrap();
        let escape = Escape::of(&scene);
        assert_eq!((escape.rays, escape.escaped), (64_000, 0), "{}: {escape:?}", scene.name());
    });
}

#[test]
fn freedoom_maps_convert() {
    let Some(folder) = maps() else { return };
    let rows = table(&folder.join("freedoom/freedoom_maps.csv"));
    assert_eq!(rows.len(), 68);
    let wads = ["freedoom1", "freedoom2"]
        .map(|name| Wad::open(&folder.join(format!("freedoom/{name}_maps_textures.wad"))).unwrap());
    let measure = |row: &BTreeMap<String, String>| {
        let wad = &wads[usize::from(row["wad"] == "freedoom2.wad")];
        let map = wad.map(&row["map"]).unwrap();
        let ratio = |relief: bool| {
            let report = convert(&map, ConvertOptions { relief, ..ConvertOptions::default() }).unwrap().report;
            (report.plane_area / report.map_area, report.map_area)
        };
        let ((plane, area), floor) = (ratio(false), number(row, "floor_area_m2"));
        // The prototype left ceilings down that a player can raise: hidden rooms of E2M8.
        assert!((0.99..1.03).contains(&(area / floor)), "{row:?}: {area} m²");
        (row["recommended"] == "1").then(|| [plane, ratio(true).0])
    };
    let recommended: Vec<[f64; 2]> = rows.par_iter().filter_map(measure).collect();
    let [plane, pressed] = [0, 1].map(|n| recommended.iter().map(|r| r[n]).sum::<f64>() / recommended.len() as f64);
    println!("share of the floor reached by the plane: {plane:.3}, with the relief compressed {pressed:.3}");
    assert!(plane > 0.5 && pressed > 0.8, "{plane} {pressed}");
}

#[test]
fn generated_maps_name_textures_that_freedoom_has() {
    let Some(folder) = maps() else { return };
    let wad = Wad::open(&folder.join("freedoom/freedoom2_maps_textures.wad")).unwrap();
    let textures = Textures::read(&[Arc::new(wad)]).unwrap().unwrap();
    let (mut walls, mut flats) = (BTreeSet::new(), BTreeSet::new());
    for seed in 0..24 {
        let map = generate(Level::Simple, seed).unwrap().map;
        walls.extend(map.sidedefs.iter().flat_map(|side| [side.upper, side.lower, side.middle]));
        flats.extend(map.sectors.iter().flat_map(|sector| [sector.floor_flat, sector.ceiling_flat]));
    }
    walls.remove(&Name::NONE);
    assert!(walls.len() > 30 && flats.len() > 30, "three themes: {walls:?} {flats:?}");
    walls.iter().for_each(|&name| assert!(textures.wall(name).is_ok(), "{name}"));
    flats.iter().for_each(|&name| assert!(textures.flat(name).is_ok(), "{name}"));
}
