//! A run's folder: made, checked against the run that it was made for, and kept to one process.

use anyhow::{Context as _, Result, bail};
use std::fs::{self, File, TryLockError};
use std::path::Path;

/// Said of a folder that refuses.
pub fn unwritable(folder: &Path) -> String {
    format!("the run's folder {} cannot be written: choose another with --run DIR", folder.display())
}

/// Makes the folder and those in it.
///
/// # Errors
/// When the disk refuses.
pub fn make(folder: &Path) -> Result<()> {
    let made = ["memory", "checkpoints", "eval"].iter().try_for_each(|name| fs::create_dir_all(folder.join(name)));
    made.with_context(|| unwritable(folder))
}

/// Refuses to go on where settings differ from those that the run began with.
///
/// # Errors
/// When there are `differences`, naming them.
pub fn refuse_other_settings(folder: &Path, differences: &[String]) -> Result<()> {
    if !differences.is_empty() {
        bail!(
            "{} was trained with other settings ({}): choose another folder with --run DIR, or delete this one",
            folder.display(),
            differences.join("; ")
        );
    }
    Ok(())
}

/// Keeps a second process out of the run for as long as the file is open.
///
/// # Errors
/// When another process has it, or it cannot be made.
pub fn lock(folder: &Path) -> Result<File> {
    let path = folder.join("lock");
    let file = File::create(&path).with_context(|| format!("creating {}", path.display()))?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => {
            bail!(
                "another process is training in {}: wait for it, or choose another folder with --run DIR",
                folder.display()
            )
        }
        // Some network drives cannot lock; a run there is as safe as its user is careful.
        Err(TryLockError::Error(error)) => {
            tracing::warn!("{} cannot be locked: {error}", path.display());
            Ok(file)
        }
    }
}
