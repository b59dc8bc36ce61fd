//! Repeats, and what is reported of them.

use serde_json::{Value, json};
use std::time::Instant;

/// How much is measured.
#[derive(Clone, Copy, PartialEq)]
pub(crate) struct Effort {
    /// Repeats of what is quick.
    pub(crate) repeats: usize,
    /// Repeats of what takes seconds.
    pub(crate) slow_repeats: usize,
    /// Steps of a measured episode.
    pub(crate) steps: usize,
    /// One of so many lattice nodes is asked what it sees.
    pub(crate) nodes_stride: usize,
}

impl Effort {
    pub(crate) const FULL: Self = Self { repeats: 9, slow_repeats: 9, steps: 100, nodes_stride: 1 };
    pub(crate) const QUICK: Self = Self { repeats: 3, slow_repeats: 1, steps: 40, nodes_stride: 16 };
}

/// Repeats of one measurement.
#[derive(Default)]
pub(crate) struct Times(Vec<f64>);

impl Times {
    pub(crate) fn push(&mut self, time: f64) {
        self.0.push(time);
    }

    pub(crate) fn median(&self) -> f64 {
        let mut sorted = self.0.clone();
        sorted.sort_by(f64::total_cmp);
        sorted.get(sorted.len() / 2).copied().unwrap_or(f64::NAN)
    }

    pub(crate) fn least(&self) -> f64 {
        self.0.iter().copied().fold(f64::INFINITY, f64::min)
    }

    pub(crate) fn json(&self) -> Value {
        json!({ "median": self.median(), "least": self.least() })
    }
}

/// Seconds of the processor that something takes on this thread, the end of its result included. On a busy machine a long
/// piece of work is interrupted and a short one is not: the clock on the wall would flatter the short one.
pub(crate) fn cpu_seconds<T>(work: impl FnOnce() -> T) -> f64 {
    let (wall, start) = (Instant::now(), on_cpu());
    drop(std::hint::black_box(work()));
    match (start, on_cpu()) {
        (Some(start), Some(end)) => 1e-9 * (end - start),
        _ => wall.elapsed().as_secs_f64(),
    }
}

/// Nanoseconds that this thread has run; only Linux tells. It is brought up to date when the thread offers to yield.
fn on_cpu() -> Option<f64> {
    std::thread::yield_now();
    let run = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?.split(' ').next()?.parse().ok()?;
    Some(run).filter(|&nanoseconds| nanoseconds > 0.0)
}

/// Seconds that something takes, the end of its result included.
pub(crate) fn seconds<T>(work: impl FnOnce() -> T) -> f64 {
    let start = Instant::now();
    drop(std::hint::black_box(work()));
    start.elapsed().as_secs_f64()
}
