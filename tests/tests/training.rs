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
    for policy in ["random", "fbe", "nbp"] {
        assert!(table.contains(policy), "{table}");
    }
    for file in
        ["config.toml", "metrics.jsonl", "eval/summary.json", "eval/episodes.csv", "checkpoints/best/config.json"]
    {
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
        "time/network",
        "time_total/simulator",
    ] {
        assert!(lines.iter().any(|line| line[key].as_f64().is_some_and(f64::is_finite)), "{key}");
    }
    let events = fs::read_dir(run_folder.join("tb")).unwrap().next().unwrap().unwrap().path();
    assert!(fs::metadata(events).unwrap().len() > 10_000, "scalars and pictures");

    let (code, again, talk) = run("train", &[SMOKE, &["--run", run_folder.to_str().unwrap()]].concat());
    assert_eq!((code, again), (0, table));
    assert!(talk.contains("complete"), "{talk}");
    let other = [SMOKE, &["--run", run_folder.to_str().unwrap(), "--set", "optim.lr=0.5"]].concat();
    refuse("train", &other, &["optim.lr: 0.001 → 0.5", "--run"]);

    let rows: serde_json::Value =
        serde_json::from_slice(&fs::read(run_folder.join("eval/summary.json")).unwrap()).unwrap();
    assert_eq!(rows.as_array().unwrap().len(), 3);
    assert!(rows[2]["auc_mean"].as_f64().unwrap() > 0.0);
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
