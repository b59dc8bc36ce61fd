//! How fast the network is on the CPU: `cargo bench -p model`, or for a first look `cargo bench -p model -- --quick`.
//!
//! Every task at every size runs in a process of its own, in turns where it is compared; medians are reported. `profile`
//! takes a training step apart. `model/benches/peers/measure.py` holds the same work against PyTorch.

mod clock;
mod profile;
mod table;
mod work;
mod worker;

use burn::tensor::{Device, Tensor};
use clock::Time;
use serde_json::{Value, json};
use std::path::PathBuf;
use std::process::{Command, ExitCode};
use std::str::FromStr;
use work::Row;

const USAGE: &str = "\
cargo bench -p model -- [ROW ...] [--quick] [--burn] [--json FILE]   measure and print

  ROW          side/base/batch; without any: 128/16/8 128/16/16 128/32/8 256/64/1
  --quick      3 turns instead of 7
  --burn       also Burn's own operators on every row; otherwise on the first of several
  --json FILE  also write the figures

cargo bench -p model -- --profile ROW     what a training step is made of
cargo bench -p model -- --export ROW DIR  write the row's network, for other programs
cargo bench -p model -- --serve TASK ROW ours|burn
               prepare TASK (train, infer or decide), then answer each line `N` with the median seconds on the clock of N
               calls, their mean seconds of the processor and the first call's check (loss, or mean of the maps), and
               `memory` with the most MiB held at once, `sgemm` with the GFLOP/s of a matrix product";

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// A benchmark stops at the first failure.
type Failure = Box<dyn std::error::Error>;

/// Which operators the network runs on.
#[derive(Clone, Copy, PartialEq)]
enum Operators {
    Ours,
    Burn,
}

impl Operators {
    fn name(self) -> &'static str {
        if self == Self::Ours { "ours" } else { "burn" }
    }
}

impl FromStr for Operators {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        [Self::Ours, Self::Burn].into_iter().find(|one| one.name() == text).ok_or(format!("`{text}`: say ours or burn"))
    }
}

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<(), Failure> {
    let (mut rows, mut turns, mut burn_too, mut json_file) = (Vec::new(), 7, false, None);
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let mut next = || arguments.next().ok_or(format!("{argument}: more is needed\n\n{USAGE}"));
        match argument.as_str() {
            "--bench" => {} // cargo adds it
            "--help" | "-h" => {
                println!("{USAGE}");
                return Ok(());
            }
            "--quick" => turns = 3,
            "--burn" => burn_too = true,
            "--json" => json_file = Some(PathBuf::from(next()?)),
            "--serve" => return worker::serve(next()?.parse()?, next()?.parse()?, next()?.parse()?),
            "--export" => return next()?.parse::<Row>()?.export(&PathBuf::from(next()?)),
            "--profile" => return profile::print(next()?.parse()?),
            row => rows.push(row.parse().map_err(|error| format!("{error}\n\n{USAGE}"))?),
        }
    }
    if rows.is_empty() {
        for row in ["128/16/8", "128/16/16", "128/32/8", "256/64/1"] {
            rows.push(row.parse()?);
        }
    }
    let machine = machine();
    let text = |key: &str| machine[key].to_string().replace('"', "");
    println!("{}, {} threads, commit {}, load {}", text("cpu"), text("threads"), text("commit"), text("load"));
    let peak = sgemm_peak();
    println!("matrix product of 1024³: {peak:.0} GFLOP/s");
    let figures = table::measure(&rows, turns, burn_too)?;
    if let Some(file) = json_file {
        let all = json!({ "machine": machine, "turns": turns, "sgemm_gflops": peak, "rows": figures });
        std::fs::write(&file, serde_json::to_string_pretty(&all)? + "\n")
            .map_err(|error| format!("cannot write {}: {error}", file.display()))?;
    }
    Ok(())
}

/// What the machine can do, in 10⁹ operations a second: Burn's product of two matrices, by the `gemm` crate.
fn sgemm_peak() -> f64 {
    let n = 1024;
    let [a, b] = [0.5, 0.25].map(|value| Tensor::<2>::full([n, n], value, &Device::flex()));
    let product = || Time::of(|| a.clone().matmul(b.clone()).into_data()).0.wall;
    product();
    let least = (0..101).map(|_| product()).fold(f64::INFINITY, f64::min);
    2.0 * (n * n * n) as f64 / least / 1e9
}

fn machine() -> Value {
    let read = |file: &str| std::fs::read_to_string(file).unwrap_or_default();
    let info = read("/proc/cpuinfo");
    let cpu = info.lines().find_map(|line| line.strip_prefix("model name")).unwrap_or("unknown CPU");
    let git = Command::new("git").args(["describe", "--always", "--dirty"]).output();
    let commit = git.map(|output| String::from_utf8_lossy(&output.stdout).trim().to_owned()).unwrap_or_default();
    let load = read("/proc/loadavg").split(' ').next().unwrap_or_default().to_owned();
    json!({
        "cpu": cpu.trim_start_matches(['\t', ' ', ':']), "threads": rayon::current_num_threads(), "commit": commit,
        "load": load,
    })
}
