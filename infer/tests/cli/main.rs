//! The real program in a temporary folder: what it writes, what it takes over, and what it says about bad input.

#![allow(clippy::unwrap_used)] // helpers of tests are tests

mod bench;

use nbp_env::Scene;
use nbp_env::window::WindowSize;
use nbp_model::scone::{Scone, SconeConfig};
use nbp_model::weights::scone::{self, Baseline, SconeDescription};
use nbp_model::{CheckpointConfig, DeviceChoice, Nbp, NetConfig, NetPredictor, weights};
use safetensors::tensor::{Dtype, SafeTensors, TensorView, serialize};
use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

/// Runs the program in a folder.
fn infer(folder: &Path, args: &str) -> Output {
    let program = env!("CARGO_BIN_EXE_infer");
    Command::new(program).current_dir(folder).args(args.split_whitespace()).output().unwrap()
}

fn succeeds(folder: &Path, args: &str) -> String {
    let output = infer(folder, args);
    assert!(output.status.success(), "{args}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

fn fails(folder: &Path, args: &str, code: i32, says: &str) {
    let output = infer(folder, args);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{args}: {stderr}");
    assert!(stderr.contains(says), "{args}: {stderr}");
    assert!(!stderr.contains("panicked"), "{args}: {stderr}");
}

/// `scenes/a.obj` and `scenes/b/b.obj`, two rooms each.
fn write_scenes(folder: &Path) {
    let scene = Scene::two_rooms();
    let mut obj = String::new();
    for v in scene.mesh().vertices() {
        writeln!(obj, "v {} {} {}", v.x, v.y, v.z).unwrap();
    }
    for [a, b, c] in scene.mesh().triangles() {
        writeln!(obj, "f {} {} {}", a + 1, b + 1, c + 1).unwrap();
    }
    for (place, name) in [("scenes/a", "a.obj"), ("scenes/b", "b.obj")] {
        fs::create_dir_all(folder.join(place)).unwrap();
        fs::write(folder.join(place).join(name), &obj).unwrap();
    }
}

/// A tiny untrained network in `net`.
fn write_checkpoint(folder: &Path) {
    write_network(&folder.join("net"), 1);
}

fn write_network(folder: &Path, seed: u64) {
    let net = NetConfig { base: 2, ..NetConfig::default() };
    let device = DeviceChoice::Flex.resolve().unwrap();
    let config = CheckpointConfig::new(net, WindowSize { pixels: 32, metres: 20.0 });
    weights::save(folder, &Nbp::new(&net, seed, &device).unwrap(), &config).unwrap();
}

/// Tiny untrained networks of `scone` in `views`.
fn write_views(folder: &Path) {
    let net = SconeConfig { width: 16, ..SconeConfig::default() };
    let device = DeviceChoice::Flex.resolve().unwrap();
    let config = SconeDescription::new(Baseline::Scone, net);
    scone::save(&folder.join("views"), &Scone::new(&net, 1, &device).unwrap(), &config).unwrap();
}

fn json(path: &Path) -> serde_json::Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

#[test]
fn a_rollout_leaves_five_files_that_open() {
    let dir = tempfile::tempdir().unwrap();
    write_scenes(dir.path());
    let told = succeeds(dir.path(), "rollout --scene scenes/a/a.obj --policy fbe --steps 25 --out out/fbe");
    assert!(told.starts_with("a fbe: ") && told.contains("after 25 steps"), "{told}");
    let out = dir.path().join("out/fbe");
    let trajectory = json(&out.join("trajectory.json"));
    assert_eq!(trajectory["poses"].as_array().unwrap().len(), 26);
    let csv = fs::read_to_string(out.join("coverage.csv")).unwrap();
    let shares: Vec<f64> = csv.lines().skip(1).map(|line| line.split(',').nth(1).unwrap().parse().unwrap()).collect();
    assert_eq!(shares.len(), 26);
    assert!(shares.windows(2).all(|w| w[1] >= w[0]) && shares[25] > 0.5, "{shares:?}");
    assert!(fs::read(out.join("topdown.png")).unwrap().starts_with(b"\x89PNG\r\n\x1a\n"));
    assert!(fs::read_to_string(out.join("coverage.svg")).unwrap().starts_with("<svg"));
    let ply = fs::read(out.join("cloud.ply")).unwrap();
    let text = String::from_utf8_lossy(&ply[..200]);
    let points: usize = text.lines().find_map(|line| line.strip_prefix("element vertex ")).unwrap().parse().unwrap();
    assert!(points > 1000 && ply.len() > points * 15);
    assert_eq!(fs::read_dir(&out).unwrap().count(), 5, "nothing else is left there");
}

#[test]
fn a_network_walks_and_shows_its_plans() {
    let dir = tempfile::tempdir().unwrap();
    write_scenes(dir.path());
    write_checkpoint(dir.path());
    let base = "rollout -q --scene scenes/a --steps 6 --checkpoint net --plans --gif --out";
    let told = succeeds(dir.path(), &format!("{base} nbp --device flex"));
    assert_eq!(told.lines().count(), 1);
    assert!(dir.path().join("nbp/plans/0000_answered.png").is_file());
    assert!(fs::read(dir.path().join("nbp/episode.gif")).unwrap().starts_with(b"GIF89a"));
    let weights = "net/model.safetensors --policy oracle-obstacles --set sim.keep=0.1";
    succeeds(dir.path(), &format!("{base} oracle --checkpoint {weights}").replace("--checkpoint net ", ""));
    assert_eq!(json(&dir.path().join("oracle/trajectory.json"))["policy"], "oracle-obstacles");
    fails(dir.path(), &format!("{base} x --set sim.encode.window.pixels=64"), 1, "32 pixels over 20 m");
}

#[test]
fn policies_without_a_checkpoint_have_the_published_networks() {
    let dir = tempfile::tempdir().unwrap();
    write_scenes(dir.path());
    let told =
        succeeds(dir.path(), "eval --scenes scenes --policies nbp,scone,macarons --steps 2 --starts 1 --out all");
    assert_eq!(told.lines().count(), 4, "{told}");
    let rows = |args: &str, out: &str| {
        succeeds(dir.path(), &format!("eval --scenes scenes --policies nbp --steps 3 --starts 1 {args} --out {out}"));
        json(&dir.path().join(out).join("summary.json"))
    };
    let published = rows("--checkpoint published", "named");
    fails(dir.path(), "eval --scenes scenes --checkpoint my/published --out x", 1, "no such file or folder");
    assert_eq!(rows("", "unnamed")[0]["auc_mean"], published[0]["auc_mean"]);
    let told = json(&dir.path().join("unnamed/settings.json"))["checkpoints"].clone();
    assert_eq!(told.as_object().unwrap().keys().collect::<Vec<_>>(), ["nbp"]);
    assert!(told["nbp"].as_str().unwrap().ends_with("runs/published/nbp"), "{told}");
    write_checkpoint(dir.path());
    assert_ne!(rows("--checkpoint net", "mine")[0]["auc_mean"], published[0]["auc_mean"]);
}

#[test]
fn an_evaluation_goes_on_where_it_stopped() {
    let dir = tempfile::tempdir().unwrap();
    write_scenes(dir.path());
    let args = "eval --scenes scenes --policies random,fbe --steps 10 --starts 2 --out eval";
    let told = succeeds(dir.path(), args);
    assert_eq!(told.lines().count(), 3, "{told}");
    let out = dir.path().join("eval");
    let read = |name: &str| fs::read_to_string(out.join(name)).unwrap();
    let rows = json(&out.join("summary.json"));
    assert_eq!((rows[0]["policy"].as_str(), rows[1]["episodes"].as_u64()), (Some("random"), Some(4)));
    assert!(read("summary.md").contains("| fbe | 4 | 0."), "{}", read("summary.md"));
    let (episodes, journal) = (read("episodes.csv"), read("journal.jsonl"));
    assert_eq!((episodes.lines().count(), journal.lines().count()), (9, 8));
    assert!(episodes.lines().nth(1).unwrap().starts_with("a,random,0,0,10,"), "{episodes}");

    // Half an evaluation and a torn line are left: the times show what was taken over, the rest is run again.
    let mut lines = journal.lines();
    let (kept, torn): (Vec<_>, _) = (lines.by_ref().take(5).collect(), &lines.next().unwrap()[..50]);
    fs::write(out.join("journal.jsonl"), format!("{}\n{torn}", kept.join("\n"))).unwrap();
    fs::remove_file(out.join("episodes.csv")).unwrap();
    assert_eq!(succeeds(dir.path(), &format!("{args} --threads 1")), told);
    assert_eq!(read("journal.jsonl").lines().count(), 5 + 1 + 3);
    let same = read("episodes.csv").lines().filter(|line| episodes.lines().any(|old| old == *line)).count();
    assert!(same > 5, "{same}");
    // What was visible can be asked for later.
    let told = succeeds(dir.path(), &format!("{args} --visible"));
    assert!(told.lines().next().unwrap().ends_with("of visible"), "{told}");
    let shares = read("visible.csv");
    let share: f64 = shares.lines().nth(1).and_then(|line| line.strip_prefix("a,")).unwrap().parse().unwrap();
    assert!(share > 0.9 && share <= 1.0, "{shares}");
    let row = &json(&out.join("summary.json"))[0];
    assert!(row["of_visible_mean"].as_f64() >= row["final_coverage_mean"].as_f64(), "{row}");
    // Other settings do not take them over.
    succeeds(dir.path(), &format!("{args} --set sim.keep=0.1"));
    assert_eq!(read("journal.jsonl").lines().count(), 9 + 8);
}

#[test]
fn an_evaluation_takes_nothing_over_from_a_network_that_is_described_otherwise() {
    let dir = tempfile::tempdir().unwrap();
    write_scenes(dir.path());
    write_checkpoint(dir.path());
    let args = "eval --scenes scenes/a --policies nbp --checkpoint net --steps 2 --starts 1 --out eval";
    let episodes = || {
        succeeds(dir.path(), args);
        fs::read_to_string(dir.path().join("eval/journal.jsonl")).unwrap().lines().count()
    };
    assert_eq!([episodes(), episodes()], [1, 1]);
    let config = dir.path().join("net/config.json");
    let text = fs::read_to_string(&config).unwrap();
    assert!(text.contains("\"raw\""), "{text}");
    fs::write(&config, text.replace("\"raw\"", "\"log1p\"")).unwrap();
    assert_eq!(episodes(), 2);
}

#[test]
fn speed_is_one_json_object_of_five_figures() {
    let dir = tempfile::tempdir().unwrap();
    write_scenes(dir.path());
    let told = succeeds(dir.path(), "speed --scenes scenes --threads 2 --steps 8 --policy fbe --json");
    let figures: serde_json::Map<String, serde_json::Value> = serde_json::from_str(&told).unwrap();
    let mut keys: Vec<&str> = figures.keys().map(String::as_str).collect();
    keys.sort_unstable();
    assert_eq!(keys, ["coverage_us", "frame_ms", "input_us", "memory_mb", "steps_per_second"]);
    for (key, figure) in &figures {
        assert!(figure.as_f64().is_some_and(|figure| figure > 0.0), "{key}: {figure}");
    }
    // 116,736 depths, 20,000 surface points and four layers of 256² counts are not to be had for less.
    let megabytes = figures["memory_mb"].as_f64().unwrap();
    assert!((1.0..200.0).contains(&megabytes), "{megabytes}");
    let told = succeeds(dir.path(), "speed --scenes scenes/a --threads 1 --steps 2");
    assert!(told.starts_with("scenes: 1,") && told.contains("MB per environment"), "{told}");
    let config = "[sim.agent]\nkind = 'continuous'\n[sim.coverage]\npoints = 500\n[eval]\nsteps = 3";
    std::fs::write(dir.path().join("motions.toml"), config).unwrap();
    let told = succeeds(dir.path(), "speed --config motions.toml --scenes scenes/a --threads 0");
    assert!(told.contains("episodes of 3 steps"), "{told}");
    assert!(succeeds(dir.path(), "speed --help").contains("steps_per_second"));
}

#[test]
fn predictions_are_those_of_the_library() {
    let dir = tempfile::tempdir().unwrap();
    write_checkpoint(dir.path());
    let x: Vec<f32> = (0..2 * 5 * 32 * 32).map(|n| (n % 7) as f32 - 1.5).collect();
    let bytes: Vec<u8> = x.iter().flat_map(|v| v.to_le_bytes()).collect();
    let write = |name: &str, key: &str, shape: Vec<usize>| {
        let view = TensorView::new(Dtype::F32, shape, &bytes).unwrap();
        fs::write(dir.path().join(name), serialize([(key, view)], None).unwrap()).unwrap();
    };
    write("x.safetensors", "x", vec![2, 5, 32, 32]);
    let told = succeeds(dir.path(), "predict --checkpoint net --input x.safetensors --out new/y.safetensors");
    assert!(told.contains("value [2, 8, 8, 8]") && told.contains("obstacle [2, 1, 32, 32]"), "{told}");
    let device = DeviceChoice::Flex.resolve().unwrap();
    let expected = NetPredictor::load(&dir.path().join("net"), &device).unwrap().answer(&x, [2, 5, 32, 32]).unwrap();
    let file = fs::read(dir.path().join("new/y.safetensors")).unwrap();
    let file = SafeTensors::deserialize(&file).unwrap();
    for (name, numbers) in [("value", expected.value), ("obstacle", expected.obstacle)] {
        let bytes: Vec<u8> = numbers.iter().flat_map(|v| v.to_le_bytes()).collect();
        assert_eq!(file.tensor(name).unwrap().data(), bytes, "{name}");
    }

    let base = "predict --checkpoint net --out y.safetensors --input";
    write("other.safetensors", "image", vec![2, 5, 32, 32]);
    fails(dir.path(), &format!("{base} other.safetensors"), 1, "no tensor `x`; it has image");
    write("flat.safetensors", "x", vec![10, 1024]);
    fails(dir.path(), &format!("{base} flat.safetensors"), 1, "[N, channels, S, S] is needed");
    write("four.safetensors", "x", vec![5, 2, 32, 32]);
    fails(dir.path(), &format!("{base} four.safetensors"), 1, "number of channels is 2");
    fs::write(dir.path().join("cut.safetensors"), &bytes[..20]).unwrap();
    fails(dir.path(), &format!("{base} cut.safetensors"), 1, "is not a safetensors file");
    assert!(!dir.path().join("y.safetensors").exists());
}

#[test]
fn bad_input_is_an_error_that_says_what_to_do() {
    let dir = tempfile::tempdir().unwrap();
    write_scenes(dir.path());
    write_checkpoint(dir.path());
    fs::write(dir.path().join("file"), "text").unwrap();
    fs::write(dir.path().join("bad.obj"), "v 0 nan 0\n").unwrap();
    fs::write(dir.path().join("bad.wad"), "IWAD").unwrap();
    fs::create_dir_all(dir.path().join("unet")).unwrap();
    fs::copy(dir.path().join("net/model.safetensors"), dir.path().join("unet/model.safetensors")).unwrap();
    let config = fs::read_to_string(dir.path().join("net/config.json")).unwrap();
    fs::write(dir.path().join("unet/config.json"), config.replace("\"nbp\"", "\"unet\"")).unwrap();

    write_views(dir.path());

    let rollout = "rollout --policy fbe --steps 3 --out o --scene";
    for (args, code, says) in [
        ("", 2, "Usage"),
        ("rollout --scene scenes/a --out o --policy greedy", 2, "scone, macarons, nbp, oracle-obstacles"),
        (
            "rollout --scene scenes/a --out o --policy nbp --checkpoint views",
            2,
            "give --checkpoint DIR of nbp, not of scone",
        ),
        ("rollout --scene scenes/a --out o --policy fbe --device gpu", 2, "auto, flex"),
        ("rollout --scene scenes/a --out o --policy fbe --start 99", 1, "5 start poses"),
        ("rollout --scene scenes/a --out file --policy fbe", 1, "it is a file, not a folder"),
        ("rollout --scene scenes/a --out file/deep --policy fbe", 1, "cannot make the folder"),
        ("rollout --scene scenes/a --out o --checkpoint unet", 1, "another architecture (unet)"),
        ("rollout --scene scenes/a --out o --checkpoint file", 1, "is no checkpoint"),
        ("rollout --scene scenes/a --out o --checkpoint none", 1, "no such file or folder"),
        ("rollout --scene scenes/a --out o --policy fbe --set sim.kept=1", 1, "there is no kept"),
        ("rollout --scene scenes/a --out o --policy fbe --steps 0", 2, "at least 1"),
        (&format!("{rollout} nowhere"), 1, "there is no nowhere"),
        (&format!("{rollout} nowhere.wad:MAP01"), 1, "there is no nowhere.wad"),
        (&format!("{rollout} scenes"), 1, "holds 2 scenes"),
        (&format!("{rollout} bad.obj"), 1, "line 1"),
        (&format!("{rollout} bad.wad"), 1, "bad.wad"),
        (&format!("{rollout} file"), 1, "is not a scene"),
        (
            "eval --scenes scenes --out o --checkpoint views --obstacle-checkpoint net",
            1,
            "--obstacle-checkpoint is for nbp alone",
        ),
        ("eval --scenes net --out o", 1, "holds no scene"),
        ("eval --scenes scenes --out o --steps 1000000000000", 2, "at most 100000"),
        ("eval --scenes scenes --out o --seeds 0", 2, "not in 1..=10000"),
        ("speed --scenes nowhere", 1, "there is no nowhere"),
        ("speed --scenes net", 1, "holds no scene"),
        ("speed --scenes bad.obj", 1, "line 1"),
        ("speed --scenes scenes --steps 0", 2, "at least 1"),
        ("speed --scenes scenes --policy nbp", 2, "use random or fbe"),
        ("speed", 2, "--scenes"),
        ("import file --out o", 1, "cannot import the weights"),
        ("import nowhere.pth --out o", 1, "cannot read nowhere.pth"),
        ("predict --checkpoint net --input nowhere --out y", 1, "cannot read nowhere"),
        ("predict --checkpoint net --input nowhere --out scenes", 1, "it is a folder, name a file"),
    ] {
        fails(dir.path(), args, code, says);
    }
    let left: Vec<_> = fs::read_dir(dir.path().join("o")).unwrap().collect();
    assert!(left.is_empty(), "failed commands leave nothing: {left:?}");
}

#[cfg(not(feature = "cuda"))]
#[test]
fn a_device_that_is_not_built_in_names_the_command_that_builds_it() {
    let dir = tempfile::tempdir().unwrap();
    write_scenes(dir.path());
    write_checkpoint(dir.path());
    let args = "rollout --scene scenes/a --out o --steps 2 --checkpoint net --device cuda";
    fails(dir.path(), args, 1, "cargo run -p infer --features cuda -- --device cuda");
}

#[test]
fn an_exported_checkpoint_is_half_as_large_and_decides_the_same() {
    let dir = tempfile::tempdir().unwrap();
    write_scenes(dir.path());
    write_checkpoint(dir.path());
    let told = succeeds(dir.path(), "export --checkpoint net --out small --compare scenes --steps 5");
    let decisions = told.lines().find(|line| line.contains("decisions")).unwrap();
    let percent: f64 = decisions.split([':', '%']).nth(1).unwrap().trim().parse().unwrap();
    assert!(decisions.starts_with("50 decisions") && percent >= 95.0, "{told}");
    let bytes_of = |folder: &str, dtype: Dtype| -> usize {
        let bytes = fs::read(dir.path().join(folder).join(weights::WEIGHTS_FILE)).unwrap();
        let tensors = SafeTensors::deserialize(&bytes).unwrap();
        tensors.iter().filter(|(_, tensor)| tensor.dtype() == dtype).map(|(_, tensor)| tensor.data().len()).sum()
    };
    let (half, kept) = (bytes_of("small", Dtype::F16), bytes_of("small", Dtype::F32));
    // A few statistics keep their bits.
    assert_eq!(2 * half + kept, bytes_of("net", Dtype::F32));
    assert!(10 * kept < half, "{kept} bytes of {half} were not halved");
    assert_eq!(json(&dir.path().join("small/config.json")), json(&dir.path().join("net/config.json")));
    succeeds(dir.path(), "eval --scenes scenes/a --policies nbp --checkpoint small --steps 3 --starts 1 --out out");
    fails(dir.path(), "export --checkpoint net --out net", 1, "own folder");
    fails(dir.path(), "export --checkpoint net --out o --compare scenes --steps 0", 2, "at least 1");
    fs::create_dir_all(dir.path().join("run")).unwrap();
    fs::write(dir.path().join("run/state.json"), "{}").unwrap();
    fails(dir.path(), "export --checkpoint net --out run", 1, "training resumes from");
    assert!(!dir.path().join("run").join(weights::WEIGHTS_FILE).exists());
    fails(dir.path(), "export --checkpoint net --precision f8 --out o", 2, "use f32, f16 or bf16");
}
