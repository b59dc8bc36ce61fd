//! How fast the simulator is: `cargo bench -p env`, or for a first look `cargo bench -p env -- --quick`.
//!
//! Everything in three synthetic houses of 36 × 36 m, on one thread where nothing else is said. What is compared is measured
//! in turns, so that a busy machine disturbs all alike; medians are reported, with the least repeat where it helps. Frames,
//! coverage and late over early are in time of the processor, the rest in that of the clock.
//! `env/benches/peers/measure.py` holds the same houses and walks against Embree, Open3D and the released code's recipe.

mod clock;
mod colours;
mod coverage;
mod frames;
mod house;
mod memory;
mod peers;
mod plain_rays;
#[allow(dead_code)]
#[path = "../scenes/mod.rs"]
mod scenes;
mod steps;
mod visibility;

use clock::Effort;
use house::House;
use peak_alloc::PeakAlloc;
use serde_json::{Map, Value, json};
use std::error::Error;
use std::path::PathBuf;
use std::process::Command;

/// Counts what is allocated: that is how memory is measured.
#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

const USAGE: &str = "\
cargo bench -p env -- [--quick] [--json FILE]   measure and print
cargo bench -p env -- --export DIR              write the houses, poses and depths for other programs
cargo bench -p env -- --answer                  answer `frame N`, `obvhs N`, `rays N`, `step N K` (house N: 0, 1, 2; step K of the
                                                exported walk) with milliseconds, line by line";

fn main() -> Result<(), Box<dyn Error>> {
    let (mut effort, mut json_file, mut export, mut answer) = (Effort::FULL, None, None, false);
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let mut path = || arguments.next().map(PathBuf::from).ok_or(format!("{argument}: give a path\n{USAGE}"));
        match argument.as_str() {
            "--bench" => {} // cargo adds it
            "--quick" => effort = Effort::QUICK,
            "--json" => json_file = Some(path()?),
            "--export" => export = Some(path()?),
            "--answer" => answer = true,
            _ => return Err(format!("{argument} is not understood\n{USAGE}").into()),
        }
    }
    let houses = house::all()?;
    if let Some(folder) = export {
        return peers::export(&houses, &folder);
    }
    if answer {
        return peers::answer(&houses);
    }
    let machine = machine();
    let text = |key: &str| machine[key].to_string().replace('"', "");
    println!("{}, {} cores, commit {}", text("cpu"), text("cores"), text("commit"));
    let mut figures: Vec<Map<String, Value>> = houses.iter().map(House::about).collect();
    let sections: [Section; 6] = [
        ("frames", frames::measure),
        ("colours", colours::measure),
        ("steps", steps::measure),
        ("coverage", coverage::measure),
        ("visibility", visibility::measure),
        ("memory", memory::measure),
    ];
    for (name, measure) in sections {
        println!();
        for (figures, measured) in figures.iter_mut().zip(measure(&houses, effort)?) {
            figures.insert(name.into(), measured);
        }
    }
    if let Some(file) = json_file {
        let all = json!({ "machine": machine, "quick": effort == Effort::QUICK, "houses": figures });
        std::fs::write(&file, serde_json::to_string_pretty(&all)? + "\n")
            .map_err(|error| format!("cannot write {}: {error}", file.display()))?;
    }
    Ok(())
}

/// A table of the output: prints a row for each house and returns its figures.
type Section = (&'static str, fn(&[House], Effort) -> Result<Vec<Value>, Box<dyn Error>>);

fn machine() -> Value {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let cpu = info.lines().find_map(|line| line.strip_prefix("model name")).unwrap_or("unknown CPU");
    let git = Command::new("git").args(["describe", "--always", "--dirty"]).output();
    let commit = git.map(|output| String::from_utf8_lossy(&output.stdout).trim().to_owned()).unwrap_or_default();
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    json!({ "cpu": cpu.trim_start_matches(['\t', ' ', ':']), "cores": cores, "commit": commit })
}
