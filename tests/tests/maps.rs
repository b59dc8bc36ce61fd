//! Real Doom maps, where they are at hand.

use std::fs;
use tests::{doom_maps, succeed};

#[test]
fn a_real_map_converts_and_is_explored() {
    let Some(maps) = doom_maps() else {
        eprintln!("skipped: no Doom maps; name their folder in NBP_DOOM_MAPS");
        return;
    };
    let wad = maps.join("obsidian/simple/simple_1001.wad");
    let folder = tempfile::tempdir().unwrap();
    let scenes = folder.path().join("scenes");
    succeed("dataset", &["convert", wad.to_str().unwrap(), "--out", scenes.to_str().unwrap()]);
    let stats = succeed("dataset", &["stats", scenes.to_str().unwrap()]);
    assert!(stats.contains("simple_1001"), "{stats}");
    let out = folder.path().join("rollout");
    let scene = format!("{}:MAP01", wad.display());
    let arguments = ["rollout", "--scene", &scene, "--policy", "fbe", "--steps", "20", "--out", out.to_str().unwrap()];
    succeed("infer", &arguments);
    for file in ["cloud.ply", "trajectory.json", "coverage.csv", "topdown.png", "coverage.svg"] {
        assert!(fs::metadata(out.join(file)).unwrap().len() > 100, "{file}");
    }
    let curve = fs::read_to_string(out.join("coverage.csv")).unwrap();
    let last: f32 = curve.lines().last().unwrap().split(',').nth(1).unwrap().parse().unwrap();
    assert!(last > 0.05, "{curve}");
}
