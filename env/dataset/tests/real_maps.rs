//! Real Doom maps, where there are any: the folder in `NBP_DOOM_MAPS`, or `../shared/data` beside the workspace. Their
//! figures were measured by an independent prototype.

#![allow(clippy::unwrap_used)] // helpers of tests

use nbp_dataset::wad::Wad;
use nbp_dataset::{ConvertOptions, SceneBundle, convert, to_scene};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

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

#[test]
fn obsidian_maps_have_the_prototypes_areas() {
    let Some(folder) = maps() else { return };
    let rows = table(&folder.join("obsidian/manifest.csv"));
    assert_eq!(rows.len(), 80);
    rows.par_iter().for_each(|row| {
        let (level, seed) = (&row["level"], &row["seed"]);
        let scene = scene(&folder.join(format!("obsidian/{level}/{level}_{seed}.wad")), "MAP01");
        let report = &scene.report;
        let floor = number(row, "floor_area_m2");
        assert!((report.map_area - floor).abs() < 0.01 * floor, "{level}_{seed}: {} m², not {floor}", report.map_area);
        assert_eq!(f64::from(report.modal_floor), number(row, "mode_floor"), "{level}_{seed}");
        // The prototype kept a margin to walls, so its connected area is some percent smaller.
        let connected = number(row, "modeplane_comp_m2");
        let ratio = report.plane_area / connected;
        assert!((0.98..1.3).contains(&ratio), "{level}_{seed}: {} m² connected, not {connected}", report.plane_area);
        assert!(report.plane_area > 0.9 * report.floor_area, "{level}_{seed}");
        assert!(report.conflict_area < 1.0, "{level}_{seed}");
    });
}

#[test]
fn meshes_of_real_maps_are_closed() {
    let Some(folder) = maps() else { return };
    for name in ["simple/simple_1004", "hard/hard_3009"] {
        let bundle = scene(&folder.join(format!("obsidian/{name}.wad")), "MAP01");
        let scene = to_scene(bundle).unwrap();
        let (mut rays, mut escaped) = (0, 0);
        for (n, &node) in scene.graph().largest_component().iter().enumerate() {
            for k in 0..40 {
                // Directions spread over the sphere without a random generator.
                let (turn, height) = (2.399_963 * k as f32 + n as f32, (k as f32 + 0.5) / 20.0 - 1.0);
                let flat = (1.0 - height * height).sqrt();
                let direction = glam::Vec3::new(flat * turn.cos(), height, flat * turn.sin());
                rays += 1;
                let origin = scene.lattice().position(node);
                escaped += usize::from(scene.rays().nearest(origin, direction, f32::INFINITY).is_none());
            }
        }
        assert_eq!(escaped, 0, "{name}: of {rays} rays from inside");
    }
}

#[test]
fn freedoom_maps_convert() {
    let Some(folder) = maps() else { return };
    let rows = table(&folder.join("freedoom/freedoom_maps.csv"));
    assert_eq!(rows.len(), 68);
    let wads = ["freedoom1", "freedoom2"]
        .map(|name| Wad::open(&folder.join(format!("freedoom/{name}_maps_textures.wad"))).unwrap());
    rows.par_iter().for_each(|row| {
        let wad = &wads[usize::from(row["wad"] == "freedoom2.wad")];
        let map = wad.map(&row["map"]).unwrap();
        let scene = convert(&map, ConvertOptions::default()).unwrap();
        let floor = number(row, "floor_area_m2");
        assert!((scene.report.map_area - floor).abs() < 0.01 * floor, "{row:?}: {} m²", scene.report.map_area);
    });
}
