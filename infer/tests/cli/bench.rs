//! `infer bench`: the same bytes however it was run, and what it says of what it cannot do.

use super::{fails, infer, json, succeeds, write_checkpoint, write_network, write_scenes, write_views};
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

/// `bench.toml`: three rows, one of them with a network, in two scenes.
fn write_bench(folder: &Path) {
    write_scenes(folder);
    write_checkpoint(folder);
    let text = "starts = 2\n[[data]]\nname = 'rooms'\nsteps = 8\npaths = ['scenes']\n\
        paper.fbe = { coverage = 0.5, auc = 0.4 }\n\
        [[policies]]\nname = 'random'\nseeds = 2\n[[policies]]\nname = 'fbe'\n\
        [[policies]]\nname = 'net'\npolicy = 'nbp'\ncheckpoint = 'net'\nset = { policy.blocking_pixels = 1 }\n";
    fs::write(folder.join("bench.toml"), text).unwrap();
}

/// Names and bytes of the files below a folder, but for the times of decisions.
fn files(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        if path.is_dir() {
            let below = files(&path).into_iter().map(|(below, bytes)| (format!("{name}/{below}"), bytes));
            found.extend(below);
        } else if name != "timing.csv" {
            found.push((name, fs::read(&path).unwrap()));
        }
    }
    found.sort();
    found
}

fn merged(folder: &Path) -> Vec<(String, Vec<u8>)> {
    files(folder).into_iter().filter(|(name, _)| !name.starts_with("cells/")).collect()
}

fn cells(folder: &Path) -> Vec<(String, Vec<u8>)> {
    files(folder).into_iter().filter(|(name, _)| name.starts_with("cells/")).collect()
}

fn says(folder: &Path, args: &str, words: &str) {
    let output = infer(folder, args);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && stderr.contains(words), "{args}: {stderr}");
}

#[test]
fn a_bench_has_the_same_bytes_in_shards_after_a_kill_and_on_any_threads() {
    let dir = tempfile::tempdir().unwrap();
    write_bench(dir.path());
    let bench = "bench --config bench.toml --out";
    let told = succeeds(dir.path(), &format!("{bench} one --threads 1"));
    assert!(told.contains("paper: Final Cov.") && told.contains("Δ AUC") && told.contains("ms a decision"), "{told}");
    let one = merged(&dir.path().join("one"));
    let names: Vec<&str> = one.iter().map(|(name, _)| name.as_str()).collect();
    let expected = [
        "bench.json",
        "coverage-rooms.svg",
        "curves.csv",
        "episode-rooms.svg",
        "episodes.csv",
        "report.html",
        "scatter-rooms.svg",
        "scenes/rooms/a.json",
        "scenes/rooms/b.json",
    ];
    assert_eq!(names, [&expected[..], &["summary.json", "summary.md"]].concat());
    let rows = &json(&dir.path().join("one/summary.json"))[0]["rows"];
    assert_eq!((rows[0]["episodes"].as_u64(), rows[2]["episodes"].as_u64()), (Some(8), Some(4)));
    assert!(
        rows[0]["coverage_difference"]["p"].as_f64().is_some() && rows[0]["released_auc"]["mean"].as_f64().is_some()
    );
    assert!(rows[1]["of_visible"]["mean"].as_f64() >= rows[1]["coverage"]["mean"].as_f64());

    // One shard alone is not enough, and says so.
    let told = succeeds(dir.path(), &format!("{bench} two --shard 1/2"));
    assert!(told.starts_with("3 of 6 cells done"), "{told}");
    assert!(!dir.path().join("two/summary.md").exists());
    fails(dir.path(), "bench --merge --out two", 1, "two is not complete: 4 of 8 files");
    let told = succeeds(dir.path(), &format!("{bench} two --shard 2/2 --threads 3"));
    assert!(told.contains("Final Cov."), "{told}");
    assert_eq!(merged(&dir.path().join("two")), one);
    // Side by side, and one of them killed as soon as it has written something.
    let shard = |shard: &str| {
        let args = format!("{bench} three -q --threads 1 --shard {shard}");
        let mut command = Command::new(env!("CARGO_BIN_EXE_infer"));
        command.current_dir(dir.path()).args(args.split_whitespace()).stdout(Stdio::null()).spawn().unwrap()
    };
    let (mut first, mut second) = (shard("1/2"), shard("2/2"));
    let out = dir.path().join("three");
    let is_there = |cell: &str| out.join("cells/rooms").join(cell).exists();
    while first.try_wait().unwrap().is_none() && !is_there("a/random.json") && !is_there("a/net.json") {
        std::thread::yield_now();
    }
    first.kill().unwrap();
    first.wait().unwrap();
    assert!(second.wait().unwrap().success());
    let begun = cells(&out);
    succeeds(dir.path(), &format!("{bench} three --shard 1/2"));
    let kept = cells(&out);
    assert!(
        begun.iter().filter(|(name, _)| !name.ends_with(".tmp")).all(|cell| kept.contains(cell)),
        "none is done twice"
    );
    let without_leftovers: Vec<_> = merged(&out).into_iter().filter(|(name, _)| !name.ends_with(".tmp")).collect();
    assert_eq!(without_leftovers, one);
    succeeds(dir.path(), "bench --merge --out three");
}

#[test]
fn a_bench_computes_again_what_no_longer_holds_and_never_becomes_smaller() {
    let dir = tempfile::tempdir().unwrap();
    write_bench(dir.path());
    let (bench, out) = ("bench --config bench.toml --out out", dir.path().join("out"));
    succeeds(dir.path(), bench);
    let (tables, first) = (merged(&out), cells(&out));
    says(dir.path(), bench, "8 of 8 files are there");
    assert_eq!((merged(&out), cells(&out)), (tables.clone(), first.clone()), "a second run computes nothing");

    // Damaged, cut short, gone.
    let cell = |name: &str| out.join("cells/rooms").join(name);
    let text = fs::read_to_string(cell("a/fbe.json")).unwrap();
    fs::write(cell("a/fbe.json"), text.replacen("\"bumps\":0", "\"bumps\":1", 1)).unwrap();
    fs::write(cell("b/random.json"), &text[..100]).unwrap();
    fs::remove_file(cell("b/net.json")).unwrap();
    fs::write(out.join("scenes/rooms/a.json"), "{}").unwrap();
    fails(dir.path(), "bench --merge --out out", 1, "4 of 8 files are missing");
    says(dir.path(), bench, "3 files are damaged and computed again: scenes/rooms/a.json, …");
    assert_eq!(merged(&out), tables);

    // Another setting of one row makes its cells useless, and only those.
    let config = fs::read_to_string(dir.path().join("bench.toml")).unwrap();
    let write = |text: String| fs::write(dir.path().join("bench.toml"), text).unwrap();
    let before = cells(&out);
    write(config.replace("blocking_pixels = 1", "blocking_pixels = 3"));
    fails(dir.path(), &format!("{bench} --merge"), 1, "computed with another configuration");
    fails(dir.path(), bench, 1, "has 2 files of other settings");
    assert_eq!((cells(&out), merged(&out)), (before.clone(), tables.clone()), "nothing is lost");
    let again = "bench --config bench.toml --out out --replace";
    says(dir.path(), again, "2 files are of other settings");
    let after = cells(&out);
    let changed: Vec<&str> =
        before.iter().zip(&after).filter(|(a, b)| a != b).map(|((name, _), _)| name.as_str()).collect();
    assert_eq!(changed, ["cells/rooms/a/net.json", "cells/rooms/b/net.json"]);
    // So do other weights.
    let weights = dir.path().join("net/model.safetensors");
    let mut bytes = fs::read(&weights).unwrap();
    let at = bytes.len() - 4;
    bytes[at] ^= 1;
    fs::write(&weights, bytes).unwrap();
    says(dir.path(), again, "2 files are of other settings");

    // What cannot start changes nothing.
    let before = files(&out);
    fs::create_dir_all(dir.path().join("cut")).unwrap();
    fs::copy(dir.path().join("net/config.json"), dir.path().join("cut/config.json")).unwrap();
    fs::write(dir.path().join("cut/model.safetensors"), &fs::read(&weights).unwrap()[..99]).unwrap();
    let config = config.replace("blocking_pixels = 1", "blocking_pixels = 3");
    write(config.clone() + "[[policies]]\nname = 'cut'\npolicy = 'nbp'\ncheckpoint = 'cut'\n");
    fails(dir.path(), bench, 1, "row cut: ");
    assert!(files(&out) == before, "old tables stay");

    // A further row takes over what is there; fewer of anything is refused.
    write(config.replace(
        "[[policies]]\nname = 'fbe'",
        "[[policies]]\nname = 'chance'\npolicy = 'random'\n[[policies]]\nname = 'fbe'",
    ));
    says(dir.path(), bench, "holds another bench");
    assert_eq!(json(&out.join("summary.json"))[0]["rows"].as_array().unwrap().len(), 4);
    write(config.clone());
    fails(dir.path(), bench, 1, "holds a bench with row chance");
    fs::remove_file(out.join("bench.json")).unwrap();
    succeeds(dir.path(), bench);
    for (args, lost) in [
        ("--policies random,fbe", "row net"),
        ("--starts 1", "2 starts, not 1"),
        ("--seeds 1", "2 seeds of row random, not 1"),
        ("--steps 7", "8 steps on data set rooms, not 7"),
        ("--data rooms=scenes/a", "scene b of data set rooms"),
    ] {
        fails(dir.path(), &format!("{bench} {args}"), 1, lost);
    }
    for (from, to, lost) in [
        ("starts = 2", "starts = 2\nvisible = false", "coverage as a share of what is visible"),
        ("starts = 2", "starts = 2\nreleased = false", "coverage as the released code counts it"),
        ("paper.fbe", "# ", "published figures of fbe on data set rooms"),
    ] {
        write(config.replacen(from, to, 1));
        fails(dir.path(), again, 1, &format!("holds a bench with {lost}"));
    }
    assert!(out.join("summary.md").exists());
}

#[test]
fn a_row_may_have_a_network_for_each_level() {
    let dir = tempfile::tempdir().unwrap();
    write_scenes(dir.path());
    write_network(&dir.path().join("nets/normal"), 1);
    write_network(&dir.path().join("nets/hard"), 2);
    let set = |name: &str| format!("[[data]]\nname = '{name}'\nsteps = 8\npaths = ['scenes']\n");
    let row =
        |name: &str, net: &str| format!("[[policies]]\nname = '{name}'\npolicy = 'nbp'\ncheckpoint = 'nets/{net}'\n");
    let config = [
        "starts = 2\nvisible = false\nreference = 'normal'\n".to_owned(),
        set("rooms") + "level = 'normal'\n",
        set("hard"),
        set("more") + "level = 'hard'\n",
        row("normal", "normal"),
        row("hard", "hard"),
        row("each", "{level}"),
    ];
    fs::write(dir.path().join("bench.toml"), config.concat()).unwrap();
    let bench = "bench --config bench.toml --out out";
    succeeds(dir.path(), bench);
    let walks = |set: &str, row: &str| {
        let cell = json(&dir.path().join(format!("out/cells/{set}/a/{row}.json")));
        cell["content"].as_array().unwrap().iter().map(|episode| episode["poses"].clone()).collect::<Vec<_>>()
    };
    for (set, row) in [("rooms", "normal"), ("hard", "hard"), ("more", "hard")] {
        assert_eq!(walks(set, "each"), walks(set, row), "{set}");
        assert_ne!(walks(set, "normal"), walks(set, "hard"), "{set}");
    }

    // Weights count where they are used: six cells of the row `hard`, four of the row `each`.
    write_network(&dir.path().join("nets/hard"), 3);
    fails(dir.path(), bench, 1, "has 10 files of other settings");
    write_network(&dir.path().join("nets/hard"), 2);
    fails(dir.path(), &format!("{bench} --checkpoint each=nets/normal"), 1, "has 4 files of other settings");
    fails(dir.path(), &format!("{bench} --checkpoint each=other/{{level}}"), 1, "other/normal is no checkpoint");
    // Without a row, for all rows of its architecture: `hard` has another network in `rooms`, `normal` in the other two.
    fails(dir.path(), &format!("{bench} --checkpoint nets/{{level}}"), 1, "has 6 files of other settings");
    fails(
        dir.path(),
        &format!("{bench} --data new=scenes --steps new=8"),
        1,
        "row each: nets/{level} is a network for each level",
    );
    let about = dir.path().join("nets/hard/config.json");
    let text = fs::read_to_string(&about).unwrap();
    fs::write(&about, text.replace("\"pixels\": 32", "\"pixels\": 64")).unwrap();
    fails(dir.path(), bench, 1, "row each: nets/normal was trained with other settings than nets/hard");
    for (from, to, says) in [
        ("level = 'hard'", "level = 'easy'", "data set more: \"easy\" is no level"),
        (
            "checkpoint = 'nets/{level}'",
            "obstacle_checkpoint = 'none/{level}'",
            "row each: cannot use the checkpoint: none/normal",
        ),
    ] {
        fs::write(dir.path().join("bench.toml"), config.concat().replace(from, to)).unwrap();
        fails(dir.path(), bench, 1, says);
    }
}

#[test]
fn a_bench_that_cannot_be_says_why() {
    let dir = tempfile::tempdir().unwrap();
    write_bench(dir.path());
    write_views(dir.path());
    let config = fs::read_to_string(dir.path().join("bench.toml")).unwrap();
    fs::create_dir_all(dir.path().join("empty")).unwrap();
    let long = format!("{}.obj", "x".repeat(200));
    fs::copy(dir.path().join("scenes/a/a.obj"), dir.path().join(&long)).unwrap();
    fs::create_dir_all(dir.path().join("unet")).unwrap();
    fs::copy(dir.path().join("net/model.safetensors"), dir.path().join("unet/model.safetensors")).unwrap();
    let about = fs::read_to_string(dir.path().join("net/config.json")).unwrap();
    fs::write(dir.path().join("unet/config.json"), about.replace("\"nbp\"", "\"unet\"")).unwrap();
    for (args, code, says) in [
        ("", 2, "--config"),
        ("--merge", 1, "o holds no bench"),
        ("--merge --starts 3", 2, "need a --config FILE"),
        ("--merge --policies fbe", 2, "need a --config FILE"),
        ("--merge --replace", 2, "cannot be used with"),
        ("--config nowhere.toml", 1, "cannot read the configuration nowhere.toml"),
        ("--config bench.toml --shard 0/2", 2, "I from 1 to N"),
        ("--config bench.toml --shard 3/2", 2, "I from 1 to N"),
        ("--config bench.toml --shard 1", 2, "I from 1 to N"),
        ("--config bench.toml --merge", 1, "o holds no bench"),
        ("--config bench.toml --policies fbe,nbp", 1, "no row is called nbp, only random, fbe, net"),
        ("--config bench.toml --policies random", 1, "reference fbe is no row: name one of random"),
        ("--config bench.toml --reference nbp", 1, "reference nbp is no row"),
        ("--config bench.toml --sets simple", 1, "no data set is called simple, only rooms"),
        ("--config bench.toml --checkpoint fbe=net", 1, "row fbe: policy fbe asks no network"),
        (
            "--config bench.toml --checkpoint unet",
            1,
            "row net: cannot use the checkpoint: unet holds the network of unet, not of nbp: give a checkpoint of nbp",
        ),
        (
            "--config bench.toml --checkpoint net=nowhere",
            1,
            "row net: cannot use the checkpoint: nowhere is no checkpoint",
        ),
        ("--config bench.toml --data rooms=empty", 1, "empty holds no scene"),
        ("--config bench.toml --data rooms=scenes/a,nowhere", 1, "there is no"),
        ("--config bench.toml --data rooms", 2, "NAME=PATH"),
        ("--config bench.toml --data more=scenes/a", 1, "--steps more=100"),
        ("--config bench.toml --starts 0", 2, "--starts"),
        (&format!("--config bench.toml --data rooms={long}"), 1, "data set rooms: the name of one of the scenes, xxx"),
        ("--config bench.toml --steps 1000000000000", 1, "steps is 1000000000000: it must be at most 100000"),
    ] {
        fails(dir.path(), &format!("bench --out o {args}"), code, says);
    }
    for (from, to, says) in [
        ("name = 'random'", "name = 'fbe'", "two rows are called fbe"),
        (
            "policy = 'nbp'\ncheckpoint = 'net'\nset = { policy.blocking_pixels = 1 }",
            "policy = 'scone'\ncheckpoint = 'views'\nobstacle_checkpoint = 'net'",
            "row net: policy scone asks for no obstacle map",
        ),
        ("policy = 'nbp'", "policy = 'nbv'", "row net: no policy is called `nbv`"),
        ("blocking_pixels = 1", "blocking_pixel = 1", "row net: set policy.blocking_pixel: there is no blocking_pixel"),
        ("blocking_pixels = 1", "blocking_pixels = 0", "row net: policy: blocking_pixels is 0"),
        (
            "policy.blocking_pixels = 1",
            "sim.camera.width = 32",
            "rows random and net are not compared on equal terms: sim.camera.width is 456 and 32",
        ),
        ("policy.blocking_pixels = 1", "sim.encode.window.pixels = 64", "a window of 32 pixels over 20 m"),
        ("steps = 8", "steps = 8\nlast = 3", "data set rooms holds 2 scenes, fewer"),
        ("name = 'random'", "name = \"a\\u001b\"\npolicy = 'random'", "leave the control characters out"),
        ("steps = 8", "step = 8", "unknown field `step`"),
    ] {
        fs::write(dir.path().join("other.toml"), config.replacen(from, to, 1)).unwrap();
        fails(dir.path(), "bench --config other.toml --out o", 1, says);
    }
    // [sim] holds for all rows, so they are equal again.
    fs::write(dir.path().join("sim.toml"), "starts = 1\n[sim]\ncamera.width = 32\ncamera.height = 18").unwrap();
    succeeds(dir.path(), "bench --config bench.toml --config sim.toml --out equal --steps 2 --data rooms=scenes/a");
    fs::create_dir_all(dir.path().join("o")).unwrap();
    let left: Vec<_> = fs::read_dir(dir.path().join("o")).unwrap().collect();
    assert!(left.is_empty(), "failed commands leave nothing: {left:?}");
    fs::write(dir.path().join("o/bench.json"), "{}").unwrap();
    fails(dir.path(), "bench --config bench.toml --out o", 1, "bench.json cannot be read");
}
