//! Training from end to end: what it leaves behind, the same bytes again, and what a crash cannot destroy.

use std::fs;
use std::path::Path;
use std::process::Stdio;
use std::thread::sleep;
use std::time::Duration;
use tests::{program, refuse, run, succeed};

const SMOKE: &[&str] = &["--config", "configs/smoke.toml"];

fn train(folder: &Path, more: &[&str]) -> String {
    let run = ["--run", folder.to_str().unwrap()];
    succeed("train", &[SMOKE, &run, more].concat())
}

fn weights(run: &Path, which: &str) -> Vec<u8> {
    fs::read(run.join("checkpoints").join(which).join("model.safetensors")).unwrap()
}

#[test]
fn a_run_leaves_a_table_a_checkpoint_and_its_record() {
    let folder = tempfile::tempdir().unwrap();
    let run_folder = folder.path().join("run");
    let table = train(&run_folder, &[]);
    for policy in ["random", "fbe", "nbp", "nbp-published"] {
        assert!(table.contains(policy), "{table}");
    }
    for file in [
        "config.toml",
        "metrics.jsonl",
        "learning-curve.csv",
        "learning-curve.svg",
        "eval/summary.json",
        "eval/episodes.csv",
        "checkpoints/best/config.json",
    ] {
        assert!(run_folder.join(file).is_file(), "{file}");
    }
    let metrics = fs::read_to_string(run_folder.join("metrics.jsonl")).unwrap();
    let lines: Vec<serde_json::Value> = metrics.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    for key in [
        "train/total",
        "train/sigma_value",
        "train/learning_rate",
        "validation/obstacle_bce",
        "collect/coverage_mean",
        "walks/auc",
        "time/network",
        "time_total/simulator",
    ] {
        assert!(lines.iter().any(|line| line[key].as_f64().is_some_and(f64::is_finite)), "{key}");
    }
    let events = fs::read_dir(run_folder.join("tb")).unwrap().next().unwrap().unwrap().path();
    assert!(fs::metadata(events).unwrap().len() > 10_000, "scalars and pictures");

    // The resolved configuration serves the other program, too.
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    succeed("dataset", &["generate", "--level", "simple", "--count", "1", "--seed", "3", "--out", &path("maps")]);
    let eval = ["eval", "--scenes", &path("maps"), "--config", &path("run/config.toml"), "--out", &path("out")];
    assert!(succeed("infer", &[&eval[..], &["--policies", "fbe"]].concat()).contains("fbe"));

    let (code, again, talk) = run("train", &[SMOKE, &["--run", run_folder.to_str().unwrap()]].concat());
    assert_eq!((code, again), (0, table));
    assert!(talk.contains("complete"), "{talk}");
    let other = [SMOKE, &["--run", run_folder.to_str().unwrap(), "--set", "optim.lr=0.5"]].concat();
    refuse("train", &other, &["optim.lr: 0.001 → 0.5", "--run"]);

    let rows: serde_json::Value =
        serde_json::from_slice(&fs::read(run_folder.join("eval/summary.json")).unwrap()).unwrap();
    assert_eq!(rows.as_array().unwrap().len(), 4);
    assert!(rows[2]["auc_mean"].as_f64().unwrap() > 0.0);
    assert_ne!(rows[2]["auc_mean"], rows[3]["auc_mean"], "another network, with settings of its own");
}

#[test]
fn values_of_looks_are_learnt_and_walks_choose_the_best_weights() {
    let folder = tempfile::tempdir().unwrap();
    let run_folder = folder.path().join("run");
    let settings = [
        "scenes.train.level=mixed",
        "sim.encode.occupancy=true",
        "collect.labels=looks",
        "collect.policy.goals=surroundings",
        "policy.goals=surroundings",
        "policy.replan=every-step",
        "policy.sweeps=true",
        "train.schedule=cosine",
        "train.iterations=3",
        "eval.published=false",
    ];
    let table = train(&run_folder, &settings.map(|setting| ["--set", setting]).concat());
    assert!(table.contains("nbp") && !table.contains("published"), "{table}");
    let curve = fs::read_to_string(run_folder.join("learning-curve.csv")).unwrap();
    let rows: Vec<Vec<f64>> =
        curve.lines().skip(1).map(|line| line.split(',').map(|number| number.parse().unwrap()).collect()).collect();
    assert_eq!(rows.len(), 3, "{curve}");
    assert!(rows.is_sorted_by(|a, b| (0..4).all(|column| a[column] < b[column] || column == 3)), "{curve}");
    let auc: Vec<f64> = rows.iter().map(|row| row[5]).collect();
    let is_last_best = auc[2] > auc[0].max(auc[1]);
    assert_eq!(weights(&run_folder, "best") == weights(&run_folder, "last"), is_last_best, "{curve}");
    let metrics = fs::read_to_string(run_folder.join("metrics.jsonl")).unwrap();
    let rates: Vec<f64> = metrics
        .lines()
        .filter_map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap()["train/learning_rate"].as_f64())
        .collect();
    assert!(rates.is_sorted_by(|a, b| a > b) && rates[0] == 1e-3 && rates[rates.len() - 1] < 2e-4, "{rates:?}");
}

#[test]
fn a_run_may_begin_with_the_weights_of_another() {
    let folder = tempfile::tempdir().unwrap();
    let [first, second, third] = ["first", "second", "third"].map(|name| folder.path().join(name));
    train(&first, &[]);
    let init = format!("train.init={}", first.join("checkpoints/last").display());
    // So small a step moves no weight: all but the running statistics of batch norm stays.
    let still = ["--set", "optim.lr=1e-30", "--set", "train.iterations=1"];
    train(&second, &[&still[..], &["--set", &init]].concat());
    let table = train(&third, &[&still[..], &["--set", "sim.captures=3"]].concat());
    assert!(!table.contains("published"), "it has four captures a step, and walks no other episodes: {table}");
    let kept = |run: &Path| {
        let (ours, theirs) = (weights(run, "last"), weights(&first, "last"));
        let pairs = ours.chunks_exact(4).zip(theirs.chunks_exact(4));
        pairs.filter(|(ours, theirs)| ours == theirs).count() as f64 / (ours.len() / 4) as f64
    };
    assert!(kept(&second) > 0.9 && kept(&third) < 0.5, "{} {}", kept(&second), kept(&third));
    let run = third.with_file_name("fourth");
    let other = ["--run", run.to_str().unwrap(), "--set", &init, "--set", "net.base=4"];
    refuse("train", &[SMOKE, &other].concat(), &["train.init", "base: 2", "base: 4"]);
    let other = ["--run", run.to_str().unwrap(), "--set", &init, "--set", "sim.encode.trajectory=captures"];
    refuse("train", &[SMOKE, &other].concat(), &["train.init", "KeyPoses", "Captures"]);
    let nowhere = ["--run", run.to_str().unwrap(), "--set", "train.init=nowhere"];
    refuse("train", &[SMOKE, &nowhere].concat(), &["train.init", "no such file or folder"]);
    // What was refused has made nothing that refuses what is right.
    train(&run, &[&still[..], &["--set", &init]].concat());
    assert_eq!(weights(&run, "last"), weights(&second, "last"));
}

#[test]
fn the_same_seed_gives_the_same_bytes_on_any_number_of_threads_and_whatever_is_kept() {
    let folder = tempfile::tempdir().unwrap();
    let [one, three, other] = ["one", "three", "other"].map(|name| folder.path().join(name));
    train(&one, &["--threads", "1"]);
    train(&three, &["--threads", "3", "--set", "train.gradient_checkpointing=false"]);
    train(&other, &["--seed", "99"]);
    assert!(
        weights(&one, "last") == weights(&three, "last"),
        "weights depend on the number of threads or on what is kept"
    );
    assert_eq!(fs::read(one.join("memory/train.bin")).unwrap(), fs::read(three.join("memory/train.bin")).unwrap());
    assert!(weights(&one, "last") != weights(&other, "last"));
}

/// Longer than a moment, so that there is something to interrupt.
const LONGER: &[&str] =
    &["--set", "train.iterations=4", "--set", "train.epochs=2", "--set", "train.checkpoint_minutes=0.0001"];

#[test]
fn kill_9_at_any_moment_changes_nothing_in_the_end() {
    let folder = tempfile::tempdir().unwrap();
    let [whole, killed] = ["whole", "killed"].map(|name| folder.path().join(name));
    train(&whole, LONGER);
    for wait in [60, 110, 170, 230, 300, 400] {
        let arguments = [SMOKE, &["--run", killed.to_str().unwrap()], LONGER].concat();
        let mut child = program("train").args(arguments).stderr(Stdio::null()).stdout(Stdio::null()).spawn().unwrap();
        sleep(Duration::from_millis(wait));
        child.kill().unwrap();
        child.wait().unwrap();
    }
    train(&killed, LONGER);
    assert!(
        weights(&whole, "last") == weights(&killed, "last"),
        "a resumed run differs from one that was never killed"
    );
    assert!(weights(&whole, "best") == weights(&killed, "best"));
}

#[cfg(unix)]
#[test]
fn ctrl_c_saves_and_the_same_command_resumes() {
    let folder = tempfile::tempdir().unwrap();
    let [whole, stopped] = ["whole", "stopped"].map(|name| folder.path().join(name));
    train(&whole, LONGER);
    let arguments = [SMOKE, &["--run", stopped.to_str().unwrap()], LONGER].concat();
    let child = program("train").args(arguments).stderr(Stdio::piped()).stdout(Stdio::null()).spawn().unwrap();
    while !stopped.join("checkpoints/last").exists() {
        sleep(Duration::from_millis(5));
    }
    let asked = std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(asked.success());
    let output = child.wait_with_output().unwrap();
    let talk = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "{talk}");
    assert!(talk.contains("the same command resumes"), "{talk}");
    let cost = ["--set", "collect.batch=2", "--set", "train.gradient_checkpointing=false"];
    train(&stopped, &[LONGER, &cost].concat());
    assert!(weights(&whole, "last") == weights(&stopped, "last"));
}

#[test]
fn damaged_checkpoints_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let run_folder = folder.path().join("run");
    let arguments = [SMOKE, &["--run", run_folder.to_str().unwrap()], LONGER].concat();
    let mut child = program("train").args(&arguments).stderr(Stdio::null()).stdout(Stdio::null()).spawn().unwrap();
    while !run_folder.join("checkpoints/last").exists() {
        sleep(Duration::from_millis(5));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let last = run_folder.join("checkpoints/last");
    let path = if last.exists() { last } else { run_folder.join("checkpoints/last.old") }.join("training.bpk");
    let mut bytes = fs::read(&path).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0xff;
    fs::write(&path, bytes).unwrap();
    refuse("train", &arguments, &["training.bpk", "checksum"]);
}

#[test]
fn numbers_that_are_not_finite_stop_before_the_weights_move() {
    let folder = tempfile::tempdir().unwrap();
    let run_folder = folder.path().join("run");
    let arguments = [SMOKE, &["--run", run_folder.to_str().unwrap(), "--set", "optim.lr=1e30"]].concat();
    refuse("train", &arguments, &["loss", "NaN", "step"]);
}

/// A baseline in seconds: two maps, small sensors, narrow networks.
const RECIPE: &[&str] = &[
    "--set",
    "scenes=[{level='simple', count=2, seed=1}]",
    "--set",
    "sim.camera={width=64, height=36}",
    "--set",
    "net.width=16",
    "--set",
    "nbv={proxies=1500, cloud_points=64, draws=12, queries=16}",
    "--set",
    "collect={steps=20, queries=24}",
    "--set",
    "train={rounds=2, steps=3, batch=3, checkpoint_minutes=0.0001}",
];

fn train_recipe(recipe: &str, folder: &Path, more: &[&str]) -> String {
    succeed("train", &[&["--recipe", recipe, "--run", folder.to_str().unwrap()], RECIPE, more].concat())
}

#[test]
fn baselines_are_trained_on_any_number_of_threads_and_whatever_kills_them_to_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    for recipe in ["scone", "macarons"] {
        let [whole, killed] = ["whole", "killed"].map(|name| folder.path().join(format!("{recipe}-{name}")));
        let told = train_recipe(recipe, &whole, &["--threads", "1"]);
        assert!(told.contains("6 steps"), "{told}");
        for wait in [200, 600, 1200] {
            let run = ["--recipe", recipe, "--run", killed.to_str().unwrap()];
            let arguments = [&run, RECIPE].concat();
            let mut child =
                program("train").args(arguments).stderr(Stdio::null()).stdout(Stdio::null()).spawn().unwrap();
            sleep(Duration::from_millis(wait));
            child.kill().unwrap();
            child.wait().unwrap();
        }
        train_recipe(recipe, &killed, &["--threads", "3"]);
        for which in ["last", "best"] {
            assert!(weights(&whole, which) == weights(&killed, which), "{recipe}, {which}");
        }
        let metrics = fs::read_to_string(whole.join("metrics.jsonl")).unwrap();
        for key in ["train/occupancy", "train/gains", "validation/gains", "collect/samples"] {
            assert!(metrics.contains(key), "{key}");
        }
        let config = fs::read_to_string(whole.join("checkpoints/best/config.json")).unwrap();
        assert!(config.contains(&format!("\"architecture\": \"{recipe}\"")) && config.contains("carving"), "{config}");
        assert!(train_recipe(recipe, &whole, &[]).contains("6 steps"), "a finished run says what it came to");
    }
    let scone = folder.path().join("scone-whole");
    let other = [&["--recipe", "macarons", "--run", scone.to_str().unwrap()], RECIPE].concat();
    refuse("train", &other, &["collect.teacher", "--run"]);
    let nbp = [SMOKE, &["--run", scone.to_str().unwrap()]].concat();
    refuse("train", &nbp, &["config.toml"]);

    // Both at once, and what happens without them.
    let maps = folder.path().join("maps");
    let generate = ["generate", "--level", "simple", "--count", "1", "--seed", "3", "--out", maps.to_str().unwrap()];
    succeed("dataset", &generate);
    let checkpoint =
        |recipe: &str| folder.path().join(format!("{recipe}-whole/checkpoints/best")).display().to_string();
    let out = folder.path().join("out").display().to_string();
    let eval = ["eval", "--scenes", maps.to_str().unwrap(), "--out", &out, "--steps", "4", "--starts", "1"];
    let [scone, macarons] = ["scone", "macarons"].map(checkpoint);
    let table = succeed("infer", &[&eval[..], &["--checkpoint", &scone, "--checkpoint", &macarons]].concat());
    assert!(table.contains("scone") && table.contains("macarons") && !table.contains("nbp"), "{table}");
    let refused = |more: &[&str], needles: &[&str]| refuse("infer", &[&eval[..], more].concat(), needles);
    let (code, _, talk) = run("infer", &[&eval[..], &["--policies", "scone", "--checkpoint", &macarons]].concat());
    assert!(code == 2 && talk.contains("scone needs a network") && talk.contains("not of macarons"), "{talk}");
    refused(&["--checkpoint", &scone, "--checkpoint", &scone], &["both hold scone networks"]);
    let steered = ["--policies", "scone", "--checkpoint", &scone, "--set", "nbv.draws=0"];
    refused(&steered, &["draws is 0"]);
}
