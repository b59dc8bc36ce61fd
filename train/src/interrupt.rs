//! Ctrl-C: the first asks the loop to save and stop, the second ends the process at once.

use std::sync::atomic::{AtomicBool, Ordering};

static ASKED: AtomicBool = AtomicBool::new(false);

/// Listens for Ctrl-C and termination. A listener that is already there stays.
pub fn listen() {
    let installed = ctrlc::set_handler(|| {
        if ASKED.swap(true, Ordering::SeqCst) {
            std::process::exit(130);
        }
        eprintln!("\nsaving a checkpoint, then stopping (press Ctrl-C again to stop at once)");
    });
    if let Err(error) = installed {
        tracing::warn!("Ctrl-C will stop at once, without saving: {error}");
    }
}

/// Whether to save and stop.
pub fn asked() -> bool {
    ASKED.load(Ordering::SeqCst)
}
