//! What the program says while it works: lines and progress bars on standard error.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use nbp_env::explain::tell;
use std::io::IsTerminal;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

/// How much is said.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Talk {
    Quiet,
    Normal,
    Verbose,
}

impl Talk {
    pub(super) fn new(quiet: bool, verbose: bool) -> Self {
        match (quiet, verbose) {
            (true, _) => Self::Quiet,
            (_, true) => Self::Verbose,
            _ => Self::Normal,
        }
    }

    pub(super) fn say(self, line: impl AsRef<str>) {
        if self >= Self::Normal {
            tell(line.as_ref());
        }
    }

    pub(super) fn detail(self, line: impl AsRef<str>) {
        if self >= Self::Verbose {
            tell(line.as_ref());
        }
    }

    /// A bar over `total` things called `what`.
    pub(super) fn bar(self, total: usize, what: &'static str) -> Bar {
        let is_terminal = std::io::stderr().is_terminal();
        let target = if self >= Self::Normal && is_terminal {
            ProgressDrawTarget::stderr()
        } else {
            ProgressDrawTarget::hidden()
        };
        let bar = ProgressBar::with_draw_target(Some(total as u64), target);
        if let Ok(style) = ProgressStyle::with_template("{msg} {wide_bar} {pos}/{len}  {elapsed} elapsed, {eta} to go")
        {
            bar.set_style(style);
        }
        bar.set_message(what);
        let lines = self >= Self::Normal && !is_terminal;
        Bar { bar, what, lines, tenths: AtomicUsize::new(0), begun: Instant::now() }
    }
}

/// A progress bar on a terminal; elsewhere a line for every tenth.
pub(super) struct Bar {
    bar: ProgressBar,
    what: &'static str,
    lines: bool,
    tenths: AtomicUsize,
    begun: Instant,
}

impl Bar {
    /// `done` of `total` are done.
    pub(super) fn set(&self, done: usize, total: usize) {
        self.bar.set_length(total as u64);
        self.bar.set_position(done as u64);
        let tenths = 10 * done / total.max(1);
        if self.lines && self.tenths.fetch_max(tenths, Ordering::Relaxed) < tenths {
            let elapsed = self.begun.elapsed().as_secs_f64();
            let left = elapsed / done.max(1) as f64 * (total - done.min(total)) as f64;
            tell(format_args!("{} {done}/{total}, {elapsed:.0} s elapsed, about {left:.0} s to go", self.what));
        }
    }

    pub(super) fn finish(self) {
        self.bar.finish_and_clear();
    }
}
