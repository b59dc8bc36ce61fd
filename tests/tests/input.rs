//! Bad input: a clear error, and nothing lost.

use std::fs;
use std::path::Path;
use tests::{refuse, succeed};

fn write(folder: &Path, name: &str, bytes: &[u8]) -> String {
    let path = folder.join(name);
    fs::write(&path, bytes).unwrap();
    path.to_str().unwrap().to_string()
}

fn rollout(scene: &str, out: &Path, needles: &[&str]) {
    let arguments = ["rollout", "--scene", scene, "--policy", "random", "--steps", "3", "--out", out.to_str().unwrap()];
    refuse("infer", &arguments, needles);
}

#[test]
fn scenes_that_are_none_are_refused_with_file_and_reason() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    rollout("nowhere.obj", &out, &["nowhere.obj"]);
    rollout(&write(folder.path(), "text.obj", b"this is no mesh"), &out, &["text.obj", "triangle"]);
    rollout(&write(folder.path(), "nan.obj", b"v 0 0 0\nv nan 0 1\nv 1 0 0\nf 1 2 3\n"), &out, &["nan.obj", "line 2"]);
    rollout(&write(folder.path(), "index.obj", b"v 0 0 0\nv 1 0 1\nv 1 0 0\nf 1 2 7\n"), &out, &["index.obj"]);
    rollout(&write(folder.path(), "flat.obj", b"v 0 0 0\nv 9 0 0\nv 0 9 0\nf 1 2 3\n"), &out, &["flat.obj", "free"]);
    rollout(&write(folder.path(), "short.wad", b"PWAD\x01"), &out, &["short.wad"]);
    let scene = folder.path().join("scene");
    fs::create_dir(&scene).unwrap();
    write(&scene, "scene.obj", b"v 0 0 0\nv 9 0 9\nv 9 0 0\nf 1 2 3\n");
    write(&scene, "settings.json", b"{\"scene\": 3}");
    rollout(scene.to_str().unwrap(), &out, &["settings.json"]);
    assert!(
        fs::read_dir(&out).map_or(true, |entries| entries.count() == 0),
        "nothing is written for a scene that cannot be read"
    );
}

#[test]
fn an_output_folder_that_cannot_be_written_is_found_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let file = write(folder.path(), "file", b"in the way");
    let scenes = folder.path().join("scenes");
    succeed(
        "dataset",
        &["generate", "--level", "simple", "--count", "1", "--seed", "3", "--out", scenes.to_str().unwrap()],
    );
    let below = format!("{file}/below");
    rollout(scenes.to_str().unwrap(), Path::new(&below), &["file"]);
    refuse("train", &["--config", "configs/smoke.toml", "--run", &below], &["file", "--run"]);
    refuse("dataset", &["generate", "--level", "simple", "--count", "1", "--out", &below], &["file"]);
    assert_eq!(fs::read(file).unwrap(), b"in the way");
}

#[test]
fn checkpoints_that_are_none_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let scenes = folder.path().join("scenes");
    succeed(
        "dataset",
        &["generate", "--level", "simple", "--count", "1", "--seed", "3", "--out", scenes.to_str().unwrap()],
    );
    let out = folder.path().join("out");
    let nbp = |checkpoint: &str, needles: &[&str]| {
        let (scenes, out) = (scenes.to_str().unwrap(), out.to_str().unwrap());
        let arguments =
            ["rollout", "--scene", scenes, "--policy", "nbp", "--steps", "2", "--out", out, "--checkpoint", checkpoint];
        refuse("infer", &arguments, needles);
    };
    nbp("nowhere", &["nowhere"]);
    let damaged = folder.path().join("damaged");
    fs::create_dir(&damaged).unwrap();
    write(&damaged, "model.safetensors", b"garbage");
    write(&damaged, "config.json", b"{}");
    nbp(damaged.to_str().unwrap(), &["config.json"]);
    refuse("infer", &["import", "nowhere.pth", "--out", out.to_str().unwrap()], &["nowhere.pth"]);
}

#[test]
fn configurations_that_are_none_are_refused() {
    refuse("train", &["--config", "nowhere.toml"], &["nowhere.toml"]);
    refuse("train", &["--set", "train.bathc=3"], &["bathc"]);
    refuse("train", &["--set", "train.batch=0", "--print-config"], &["train.batch"]);
    refuse("train", &["--set", "scenes.train.level=medium", "--print-config"], &["medium", "simple"]);
    // Built without its feature, as all tests are: what to do is said before anything is written.
    refuse("train", &["--device", "wgpu", "--run", "/dev/null/run"], &["cargo run -p train --features wgpu"]);
}
