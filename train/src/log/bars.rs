//! Progress: a bar with ETA on a terminal, a line now and then elsewhere.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use nbp_env::explain::tell;
use std::io::IsTerminal;
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Off a terminal, a line at most so often.
const LINE_EVERY: Duration = Duration::from_secs(15);

/// How progress is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bars {
    /// Not at all.
    Quiet,
    /// Bars.
    Terminal,
    /// Lines.
    Lines,
}

impl Bars {
    /// What fits standard error.
    pub fn detect(quiet: bool) -> Self {
        match (quiet, std::io::stderr().is_terminal()) {
            (true, _) => Self::Quiet,
            (false, true) => Self::Terminal,
            (false, false) => Self::Lines,
        }
    }

    /// Progress over `total` things.
    pub fn start(self, what: &str, total: usize) -> Progress {
        let bar = ProgressBar::with_draw_target(
            Some(total as u64),
            if self == Self::Terminal { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() },
        );
        let template = "{prefix:>28} [{bar:32}] {pos}/{len}  {elapsed} elapsed, {eta} left  {msg}";
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style.progress_chars("=> "));
        }
        bar.set_prefix(what.to_string());
        Progress {
            bar,
            lines: self == Self::Lines,
            what: what.into(),
            total,
            begun: Instant::now(),
            said: Mutex::new(Instant::now()),
        }
    }
}

/// Progress over one thing.
pub struct Progress {
    bar: ProgressBar,
    lines: bool,
    what: String,
    total: usize,
    begun: Instant,
    said: Mutex<Instant>,
}

impl Progress {
    /// One more is done.
    pub fn advance(&self, message: String) {
        self.bar.inc(1);
        self.bar.set_message(message.clone());
        let done = self.bar.position() as usize;
        let Ok(mut said) = self.said.lock() else { return };
        if self.lines && (said.elapsed() >= LINE_EVERY || done == self.total) {
            *said = Instant::now();
            let elapsed = self.begun.elapsed().as_secs_f64();
            let left = elapsed / done.max(1) as f64 * (self.total.saturating_sub(done)) as f64;
            tell(format_args!(
                "{}: {done}/{}, {elapsed:.0} s elapsed, {left:.0} s left  {message}",
                self.what, self.total
            ));
        }
    }

    /// Starts at `done` instead of zero.
    pub fn skip(&self, done: usize) {
        self.bar.set_position(done as u64);
    }

    /// Leaves the line as it is.
    pub fn finish(&self) {
        self.bar.finish();
    }
}
