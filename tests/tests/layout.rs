//! What must hold of the workspace itself.

use std::path::PathBuf;
use std::process::Command;
use tests::{root, succeed};

/// Packages that `package` pulls in, by name.
fn dependencies(package: &str) -> Vec<String> {
    let output = Command::new(env!("CARGO"))
        .args(["tree", "--offline", "--prefix", "none", "-e", "normal", "-p", package])
        .current_dir(root())
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    text.lines().filter_map(|line| line.split_whitespace().next().map(str::to_string)).collect()
}

#[test]
fn a_room_looks_only_to_its_left() {
    for room in ["env", "dataset"] {
        let pulled = dependencies(room);
        assert!(pulled.iter().all(|name| !name.starts_with("burn")), "{room} pulls in Burn");
        assert!(!pulled.iter().any(|name| ["model", "infer", "train"].contains(&name.as_str())), "{room}");
    }
    assert!(!dependencies("env").contains(&"dataset".to_string()));
    assert!(!dependencies("model").iter().any(|name| ["infer", "train", "dataset"].contains(&name.as_str())));
    assert!(!dependencies("infer").contains(&"train".to_string()));
}

fn configurations(folder: PathBuf) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() { found.extend(configurations(path)) } else { found.push(path) }
    }
    found
}

#[test]
fn every_configuration_is_valid() {
    let all = configurations(root().join("configs"));
    let (bench, training): (Vec<_>, Vec<_>) =
        all.into_iter().partition(|path| path.starts_with(root().join("configs/bench")));
    assert!(training.len() >= 7 && bench.len() >= 3, "{training:?} {bench:?}");
    // Data sets alone are no bench: they are laid over the rows.
    let rows = std::fs::read_to_string(root().join("configs/bench/aimdoom.toml")).unwrap();
    for path in bench {
        let text = std::fs::read_to_string(&path).unwrap();
        let config = nbp_infer::bench::config::BenchConfig::parse(&[&rows, &text]);
        assert!(config.is_ok(), "{}: {}", path.display(), config.unwrap_err());
    }
    for path in training {
        let shown = ["--config", path.to_str().unwrap(), "--print-config"];
        if path.parent().unwrap().ends_with("scone") {
            for recipe in ["scone", "macarons"] {
                assert!(succeed("train", &[&["--recipe", recipe], &shown[..]].concat()).contains("[nbv]"));
            }
            continue;
        }
        let again: nbp_train::config::Config = toml_of(&succeed("train", &shown));
        again.validate().unwrap();
    }
}

fn toml_of(text: &str) -> nbp_train::config::Config {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("config.toml");
    std::fs::write(&path, text).unwrap();
    nbp_train::config::Config::load(&[path], &[]).unwrap()
}

#[test]
fn help_shows_examples() {
    for program in ["train", "infer", "dataset"] {
        let help = succeed(program, &["--help"]);
        let (_, examples) = help.split_once("Examples:").unwrap();
        assert!(examples.lines().filter(|line| line.contains(program)).count() >= 2, "{help}");
    }
}
