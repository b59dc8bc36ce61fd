//! Where a run's time goes: seconds by what they were spent on, and how busy they kept the cores.
//!
//! The loop tells its [`Clock`] what each stretch of wall time was for. Where several threads do different things at
//! once, in a collection, their seconds are summed and the wall time is divided as the sum is.

use nbp_env::{EncoderInput, PredictError, Prediction, Predictor};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Seconds of work.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Spent {
    /// Training steps and validation.
    pub network: f64,
    /// Predictions for the policies of a collection.
    pub inference: f64,
    /// The rest of a collection: frames, maps, inputs, plans; and validation walks as a whole.
    pub simulator: f64,
    /// Labelling, packing and writing samples, waiting for them, checkpoints and the log.
    pub io: f64,
    /// All of it, and what is none of these.
    pub wall: f64,
    /// Processor time on all cores together; 0 where the system does not tell. Where other programs took the cores, it is
    /// less than was wanted.
    pub cpu: f64,
}

impl Spent {
    /// Shares of the wall time, and of the cores' time that was left idle by `threads` threads, if known; none where only
    /// the wall time is known.
    pub fn shares(&self, threads: usize) -> Vec<(&'static str, f64)> {
        let wall = self.wall.max(f64::MIN_POSITIVE);
        let parts =
            [("network", self.network), ("inference", self.inference), ("simulator", self.simulator), ("io", self.io)];
        if parts.iter().all(|&(_, seconds)| seconds == 0.0) {
            return Vec::new();
        }
        let idle = (self.cpu > 0.0).then(|| ("idle_cores", (1.0 - self.cpu / (wall * threads as f64)).max(0.0)));
        parts.map(|(name, seconds)| (name, seconds / wall)).into_iter().chain(idle).collect()
    }

    /// One line for people.
    pub fn tell(&self, threads: usize) -> String {
        let shares: Vec<String> = self
            .shares(threads)
            .iter()
            .map(|(name, share)| format!("{} {:.1} %", named(name), 100.0 * share))
            .collect();
        let colon = if shares.is_empty() { "" } else { ": " };
        format!("training took {:.0} s{colon}{}", self.wall, shares.join(", "))
    }

    fn zip(self, other: Self, with: impl Fn(f64, f64) -> f64) -> Self {
        Self {
            network: with(self.network, other.network),
            inference: with(self.inference, other.inference),
            simulator: with(self.simulator, other.simulator),
            io: with(self.io, other.io),
            wall: with(self.wall, other.wall),
            cpu: with(self.cpu, other.cpu),
        }
    }
}

fn named(share: &str) -> &str {
    match share {
        "io" => "reading and writing",
        "idle_cores" => "cores idle",
        other => other,
    }
}

/// Seconds that threads spent beside each other.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ThreadSeconds {
    /// Waiting for predictions.
    pub inference: f64,
    /// Labelling and packing samples.
    pub io: f64,
    /// All of it.
    pub all: f64,
}

/// Counts the time of a process, on top of what earlier processes spent on the same run.
#[derive(Debug)]
pub struct Clock {
    begun: Instant,
    cpu: f64,
    spent: Spent,
    before: Spent,
    lap: Spent,
}

impl Clock {
    /// Starts after `before`.
    pub fn start(before: Spent) -> Self {
        Self { begun: Instant::now(), cpu: cpu_seconds(), spent: Spent::default(), before, lap: Spent::default() }
    }

    /// Training or validation took so long.
    pub fn network(&mut self, time: Duration) {
        self.spent.network += time.as_secs_f64();
    }

    /// Reading or writing took so long.
    pub fn io(&mut self, time: Duration) {
        self.spent.io += time.as_secs_f64();
    }

    /// Validation walks took so long.
    pub fn walks(&mut self, time: Duration) {
        self.spent.simulator += time.as_secs_f64();
    }

    /// A collection took so long, in which its threads did this.
    pub fn collection(&mut self, time: Duration, threads: ThreadSeconds) {
        let per_second = time.as_secs_f64() / threads.all.max(f64::MIN_POSITIVE);
        self.spent.inference += per_second * threads.inference;
        self.spent.io += per_second * threads.io;
        self.spent.simulator += per_second * (threads.all - threads.inference - threads.io);
    }

    /// Everything spent on the run.
    pub fn total(&self) -> Spent {
        self.before.zip(self.now(), |a, b| a + b)
    }

    /// What was spent since the last call.
    pub fn lap(&mut self) -> Spent {
        let (now, last) = (self.now(), self.lap);
        self.lap = now;
        now.zip(last, |a, b| a - b)
    }

    fn now(&self) -> Spent {
        let cpu = (cpu_seconds() - self.cpu).max(0.0);
        Spent { wall: self.begun.elapsed().as_secs_f64(), cpu, ..self.spent }
    }
}

/// User and system time of this process, finished threads included, in Linux's ticks of 10 ms; 0 elsewhere.
fn cpu_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields = stat.rsplit(')').next().unwrap_or_default().split_whitespace();
    fields.skip(11).take(2).filter_map(|ticks| ticks.parse::<f64>().ok()).sum::<f64>() / 100.0
}

/// A predictor that counts how long its callers wait.
pub struct Timed {
    inner: Arc<dyn Predictor>,
    nanoseconds: AtomicU64,
}

impl Timed {
    /// Counts from zero.
    pub fn new(inner: Arc<dyn Predictor>) -> Self {
        Self { inner, nanoseconds: AtomicU64::new(0) }
    }

    /// Of all callers together.
    pub fn seconds(&self) -> f64 {
        self.nanoseconds.load(Ordering::Relaxed) as f64 / 1e9
    }
}

impl Predictor for Timed {
    fn predict(&self, inputs: &[EncoderInput]) -> Result<Vec<Prediction>, PredictError> {
        let begun = Instant::now();
        let predictions = self.inner.predict(inputs);
        self.nanoseconds.fetch_add(begun.elapsed().as_nanos() as u64, Ordering::Relaxed);
        predictions
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_collection_is_divided_as_its_threads_were() {
        let mut clock = Clock::start(Spent { network: 1.0, wall: 5.0, ..Spent::default() });
        clock.collection(Duration::from_secs(10), ThreadSeconds { inference: 5.0, io: 1.0, all: 20.0 });
        clock.network(Duration::from_secs(2));
        let total = clock.total();
        assert_eq!((total.network, total.inference, total.simulator, total.io), (3.0, 2.5, 7.0, 0.5));
        assert!(total.wall >= 5.0);
        assert_eq!(clock.lap().network, 2.0);
        clock.io(Duration::from_secs(1));
        let lap = clock.lap();
        assert_eq!((lap.network, lap.io), (0.0, 1.0));
    }

    #[test]
    fn shares_are_of_the_wall_and_idleness_of_the_cores() {
        let spent = Spent { network: 6.0, inference: 1.0, simulator: 2.0, io: 0.5, wall: 10.0, cpu: 15.0 };
        let shares = spent.shares(2);
        let expected = [("network", 0.6), ("inference", 0.1), ("simulator", 0.2), ("io", 0.05), ("idle_cores", 0.25)];
        assert_eq!(shares, expected);
        assert_eq!(Spent { cpu: 0.0, ..spent }.shares(2), expected[..4]);
        let line = spent.tell(2);
        assert!(line.contains("took 10 s: network 60.0 %") && line.ends_with("cores idle 25.0 %"), "{line}");
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn work_takes_processor_time() {
        let before = cpu_seconds();
        let begun = Instant::now();
        let mut sum = 0_u64;
        while cpu_seconds() < before + 0.05 {
            sum = std::hint::black_box(sum.wrapping_add(1));
            assert!(begun.elapsed() < Duration::from_secs(60), "the system counts no time");
        }
    }
}
