//! Time on the clock and of the processor, and the most memory that was ever held.

use std::fs;
use std::time::Instant;

/// What some work took.
#[derive(Clone, Copy)]
pub(crate) struct Time {
    /// Seconds on the clock.
    pub(crate) wall: f64,
    /// Seconds of the processor, all threads together.
    pub(crate) cpu: f64,
}

impl Time {
    /// Of one call.
    pub(crate) fn of<T>(work: impl FnOnce() -> T) -> (Self, T) {
        let (start, cpu) = (Instant::now(), cpu_seconds());
        let answer = work();
        let wall = start.elapsed().as_secs_f64();
        (Self { wall, cpu: cpu_seconds() - cpu }, answer)
    }
}

/// The middle of an odd number of times, the lower middle of an even one.
pub(crate) fn median(times: impl IntoIterator<Item = f64>) -> f64 {
    let mut sorted: Vec<f64> = times.into_iter().collect();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len().saturating_sub(1) / 2).copied().unwrap_or(f64::NAN)
}

/// Seconds that this process's threads have run: in nanoseconds, where `/proc/self/stat` counts ticks of 10 ms. 0 where
/// there is no Linux.
fn cpu_seconds() -> f64 {
    std::thread::yield_now(); // brings this thread's count up to date
    let threads = fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    let run = |thread: fs::DirEntry| {
        fs::read_to_string(thread.path().join("schedstat")).ok()?.split(' ').next()?.parse::<f64>().ok()
    };
    1e-9 * threads.filter_map(run).sum::<f64>()
}

/// The most memory that this process has held at once, in MiB; 0 where there is no Linux.
pub(crate) fn peak_memory() -> f64 {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    line.and_then(|line| line.trim().strip_suffix(" kB")?.trim().parse::<f64>().ok()).unwrap_or(0.0) / 1024.0
}
