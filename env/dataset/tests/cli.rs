//! The binary: what it writes, how it refuses, how it exits.

#![allow(clippy::unwrap_used)] // helpers of tests

use std::path::Path;
use std::process::{Command, Output};

fn dataset(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_dataset")).args(args).output().unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn files(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(files(&path));
        } else {
            found.push((path.file_name().unwrap().to_string_lossy().into_owned(), std::fs::read(&path).unwrap()));
        }
    }
    found.sort();
    found
}

#[test]
fn generate_does_not_depend_on_threads() {
    let folder = tempfile::tempdir().unwrap();
    let [one, two] = ["one", "two"].map(|name| folder.path().join(name));
    for (out, threads) in [(&one, "1"), (&two, "2")] {
        let out = out.to_str().unwrap();
        let args = ["generate", "--level", "simple", "--count", "4", "--seed", "9", "--out", out, "--threads", threads];
        let done = dataset(&args);
        assert!(done.status.success(), "{}", stderr(&done));
        assert!(String::from_utf8_lossy(&done.stdout).contains("mean ± sd"));
    }
    let written = files(&one);
    assert_eq!(written.len(), 16, "OBJ, MTL, settings and image of four scenes");
    assert!(written == files(&two));
}

#[test]
fn generated_wads_lie_beside_their_meshes_and_become_them() {
    let folder = tempfile::tempdir().unwrap();
    let [set, again] = ["set", "again"].map(|name| folder.path().join(name));
    let done = dataset(&["generate", "--level", "simple", "--count", "2", "--wad", "--out", set.to_str().unwrap()]);
    assert!(done.status.success(), "{}", stderr(&done));
    for name in ["simple_0_000", "simple_0_001"] {
        let wad = set.join(name).join(format!("{name}.wad"));
        let done = dataset(&["convert", wad.to_str().unwrap(), "--out", again.to_str().unwrap()]);
        assert!(done.status.success(), "{}", stderr(&done));
        let [a, b] = [&set, &again].map(|set| std::fs::read(set.join(name).join(format!("{name}.obj"))).unwrap());
        assert!(a == b, "{name}");
    }
}

#[test]
fn split_and_stats() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("set");
    let args = ["generate", "--level", "simple", "--count", "5", "--out", out.to_str().unwrap(), "--split"];
    assert!(dataset(&args).status.success());
    let count = |part: &str| std::fs::read_dir(out.join(part)).unwrap().count();
    assert_eq!((count("train"), count("test")), (4, 1));
    let measured = dataset(&["stats", out.to_str().unwrap(), "--json"]);
    assert!(measured.status.success(), "{}", stderr(&measured));
    let parsed: serde_json::Value = serde_json::from_slice(&measured.stdout).unwrap();
    assert_eq!(parsed["scenes"].as_array().unwrap().len(), 5);
    assert!(parsed["scenes"][0]["navigation_complexity"].as_f64().unwrap() > 1.0);
    assert_eq!(parsed["scenes"][0]["escaping_ray_share"], 0.0);
    assert!(parsed["mean"]["visible_share"].as_f64().unwrap() > 0.8, "{}", parsed["mean"]);
    let parts = ["train", "test"].map(|part| out.join(part).to_str().unwrap().to_string());
    let table = dataset(&["stats", &parts[0], &parts[1], "--markdown", "--quick"]);
    let rows: Vec<String> = String::from_utf8_lossy(&table.stdout).lines().map(str::to_string).collect();
    assert!(rows[2].starts_with("| train | 4 |") && rows[3].starts_with("| test | 1 |"), "{rows:?}");
    let again = dataset(&args);
    assert_eq!(again.status.code(), Some(1));
    assert!(stderr(&again).contains("--replace"), "{}", stderr(&again));
    // Of four scenes, the last one is to test on.
    let fewer = args.map(|arg| if arg == "5" { "4" } else { arg });
    assert!(dataset(&[&fewer[..], &["--replace"]].concat()).status.success());
    assert_eq!((count("train"), count("test")), (3, 2));
    // Pictures of scenes that share a name.
    let pictures = folder.path().join("pictures");
    let scene = |part: &str, name: &str| out.join(part).join(name).to_str().unwrap().to_string();
    std::fs::rename(scene("test", "simple_0_004"), scene("test", "simple_0_000")).unwrap();
    let drawn = dataset(&["stats", &parts[0], &parts[1], "--quick", "--pictures", pictures.to_str().unwrap()]);
    assert!(drawn.status.success(), "{}", stderr(&drawn));
    let names: Vec<String> = files(&pictures).into_iter().map(|(name, _)| name).collect();
    let [clashing, others] = [
        ["test", "train"].map(|part| format!("{part}-simple_0_000.png")),
        ["1", "2"].map(|n| format!("simple_0_00{n}.png")),
    ];
    assert!(clashing.iter().chain(&others).all(|name| names.contains(name)) && names.len() == 5, "{names:?}");
}

#[test]
fn refusals_are_clear() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    std::fs::write(path("text.wad"), "hello").unwrap();
    let (out, file) = (path("out"), path("file"));
    std::fs::write(&file, "").unwrap();
    for (args, code, want) in [
        (vec!["convert", &path("text.wad"), "--out", &out], 1, "not a WAD file"),
        (vec!["convert", &path("none.wad"), "--out", &out], 1, "none.wad"),
        (vec!["stats", &path("nowhere")], 1, "nowhere"),
        (vec!["generate", "--level", "simple", "--out", &format!("{file}/below")], 1, "cannot write"),
        (vec!["generate", "--level", "easy", "--out", &out], 2, "simple, normal, hard or insane"),
        (vec!["generate", "--out", &out], 2, "--level"),
        (vec!["stats", &out, "--threads", "100000"], 2, "1..=1024"),
    ] {
        let done = dataset(&args);
        assert_eq!(done.status.code(), Some(code), "{args:?}: {}", stderr(&done));
        assert!(stderr(&done).contains(want), "{args:?}: {}", stderr(&done));
        assert!(!stderr(&done).contains("panicked"), "{args:?}");
    }
    let help = dataset(&["convert", "--help"]);
    assert!(help.status.success() && String::from_utf8_lossy(&help.stdout).contains("Examples:"));
}

#[test]
fn generated_maps_pass_through_a_wad() {
    use nbp_dataset::{Level, generate, scene_from_wad, wad::to_bytes};
    use nbp_env::scene::LoadOptions;
    let folder = tempfile::tempdir().unwrap();
    let wads = folder.path().join("wads");
    std::fs::create_dir(&wads).unwrap();
    let made = generate(Level::Simple, 4).unwrap();
    let path = wads.join("made.wad");
    std::fs::write(&path, to_bytes(&made.map, "MAP01").unwrap()).unwrap();
    std::fs::write(wads.join("broken.wad"), b"PWAD").unwrap();
    let out = folder.path().join("out");
    let done = dataset(&["convert", wads.to_str().unwrap(), "--out", out.to_str().unwrap()]);
    assert_eq!(done.status.code(), Some(0), "one map is enough: {}", stderr(&done));
    assert!(stderr(&done).contains("refused") && stderr(&done).contains("broken.wad"), "{}", stderr(&done));
    let scene = scene_from_wad(&path, None, LoadOptions::default()).unwrap();
    assert_eq!(scene.name(), "made");
    assert_eq!(scene.mesh(), &made.scene.mesh.clone().bare());
    assert!(scene_from_wad(&path, Some("E1M1"), LoadOptions::default()).unwrap_err().to_string().contains("E1M1"));
}

#[test]
fn scans_become_scenes() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    // A room of 6 x 6 x 3 m in centimetres, z up.
    let room = "v 0 0 0\nv 600 0 0\nv 600 600 0\nv 0 600 0\nv 0 0 300\nv 600 0 300\nv 600 600 300\nv 0 600 300\n\
        f 1 2 3 4\nf 5 8 7 6\nf 1 5 6 2\nf 2 6 7 3\nf 3 7 8 4\nf 4 8 5 1\n";
    std::fs::write(path("my room.obj"), room).unwrap();
    std::fs::write(path("broken.ply"), "ply\n").unwrap();
    let out = path("out");
    let args = ["import", &path("my room.obj"), &path("broken.ply"), "--out", &out];
    let done = dataset(&args);
    assert!(done.status.success(), "{}", stderr(&done));
    let told = String::from_utf8_lossy(&done.stdout).into_owned();
    for want in
        ["up        z, guessed", "unit      0.01 m, guessed: rooms are 3.00 m", "my-room: ", "16 connected", "closed"]
    {
        assert!(told.contains(want), "{want}: {told}");
    }
    assert!(stderr(&done).contains("refused") && stderr(&done).contains("broken.ply"), "{}", stderr(&done));
    let scene = nbp_env::Scene::load(&Path::new(&out).join("my-room")).unwrap();
    assert_eq!((scene.graph().largest_component().len(), scene.mesh().bounds()[1].y), (16, 3.0));
    let record = std::fs::read(Path::new(&out).join("my-room/import.json")).unwrap();
    let record: serde_json::Value = serde_json::from_slice(&record).unwrap();
    assert_eq!(
        (record["assumed"]["up"]["value"].as_str(), record["storey"]["open"].as_bool()),
        (Some("z"), Some(false))
    );
    let again = dataset(&args);
    assert!(again.status.code() == Some(1) && stderr(&again).contains("--replace"), "{}", stderr(&again));
    // A name is taken once, even where scenes may be replaced.
    std::fs::create_dir(path("other")).unwrap();
    std::fs::write(path("other/my room.obj"), room).unwrap();
    let twice = dataset(&["import", &path("my room.obj"), &path("other/my room.obj"), "--out", &out, "--replace"]);
    assert!(stderr(&twice).contains("1 scenes") && stderr(&twice).contains("like another"), "{}", stderr(&twice));
    let zero = dataset(&["import", &path("my room.obj"), "--scale", "0", "--out", &out]);
    assert!(zero.status.code() == Some(2) && stderr(&zero).contains("positive"), "{}", stderr(&zero));
}

#[test]
fn sets_are_split_checked_and_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_string();
    let (set, parted, image) = (path("set"), path("parted"), path("sheet.png"));
    assert!(dataset(&["generate", "--level", "simple", "--count", "3", "--out", &set]).status.success());
    let planned = dataset(&["split", &set, "--seed", "5", "--dry-run"]);
    assert_eq!(String::from_utf8_lossy(&planned.stdout).lines().count(), 3);
    for seed in ["5", "5"] {
        let done = dataset(&["split", &set, "--seed", seed, "--out", &parted, "--copy"]);
        let again = Path::new(&parted).join("test").exists() && !done.status.success();
        assert!(done.status.success() || again && stderr(&done).contains("holds scenes already"), "{}", stderr(&done));
    }
    let checked = dataset(&["check", &parted, "--quick"]);
    let told = String::from_utf8_lossy(&checked.stdout).into_owned();
    assert!(checked.status.success() && told.contains("3 scenes, 0 faults"), "{told}{}", stderr(&checked));
    let test = std::fs::read_dir(Path::new(&parted).join("test")).unwrap().next().unwrap().unwrap().path();
    std::fs::remove_file(test.join("settings.json")).unwrap();
    let broken = dataset(&["check", &parted, "--quick", "--json"]);
    assert_eq!(broken.status.code(), Some(1));
    let report: serde_json::Value = serde_json::from_slice(&broken.stdout).unwrap();
    assert_eq!((&report["scenes"], &report["findings"][0]["severity"]), (&3.into(), &"fault".into()), "{report}");
    let drawn = dataset(&["preview", &parted, "--out", &image, "--side", "120"]);
    assert!(drawn.status.success(), "{}", stderr(&drawn));
    assert!(std::fs::read(&image).unwrap().starts_with(b"\x89PNG"));
}

/// Other people's programs, where there are any: Python with what `tests/exchange/requirements.txt` names.
#[test]
fn scenes_open_in_other_programs() {
    let python = std::env::var("NBP_EXCHANGE_PYTHON").unwrap_or("python3".into());
    let has_all = Command::new(&python).args(["-c", "import trimesh, open3d"]).output();
    if !has_all.is_ok_and(|tried| tried.status.success()) {
        println!("skipped: {python} lacks trimesh or open3d; name another by NBP_EXCHANGE_PYTHON");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    for (seed, units) in [("1", "metres"), ("2", "published")] {
        let args = ["generate", "--level", "simple", "--seed", seed, "--units", units, "--out", out];
        assert!(dataset(&args).status.success());
    }
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/exchange/open_scenes.py");
    let opened = Command::new(&python).arg(script).arg(out).output().unwrap();
    let told = String::from_utf8_lossy(&opened.stdout).into_owned();
    assert!(opened.status.success(), "{told}{}", stderr(&opened));
    assert!(told.contains("2 of 2 scenes") && told.contains("scene_scale_factor 10 as released"), "{told}");
}
