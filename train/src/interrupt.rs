//! Ctrl-C: the first asks the loop to save and stop, the second ends the process at once.

use std::sync::atomic::{AtomicBool, Ordering};

static ASKED: AtomicBool = AtomicBool::new(false);
static NOTHING_TO_SAVE: AtomicBool = AtomicBool::new(false);

/// Listens for Ctrl-C and termination. A listener that is already there stays.
pub fn listen() {
    let installed = ctrlc::set_handler(|| {
        if ASKED.swap(true, Ordering::SeqCst) || NOTHING_TO_SAVE.load(Ordering::SeqCst) {
            std::process::exit(130);
        }
        eprintln!("\nsaving a checkpoint, then stopping (press Ctrl-C again to stop at once)");
    });
    if let Err(error) = installed {
        tracing::warn!("Ctrl-C will stop at once, without saving: {error}");
    }
}

/// From now on Ctrl-C ends the process at once: all is saved.
pub fn nothing_to_save() {
    NOTHING_TO_SAVE.store(true, Ordering::SeqCst);
}

/// Whether to save and stop.
pub fn asked() -> bool {
    ASKED.load(Ordering::SeqCst)
}
