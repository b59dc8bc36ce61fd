//! The folder that results go to: tried before the work, each file written whole or not at all.

use anyhow::{Context, Result, bail};
use nbp_model::weights::{create_temporary, write_atomic};
use std::fs;
use std::path::{Path, PathBuf};

/// A folder that could be written to when the program began.
pub(super) struct Output {
    folder: PathBuf,
}

impl Output {
    /// Makes the folder if need be and writes a file into it, to fail now rather than after the work.
    pub(super) fn prepare(folder: &Path) -> Result<Self> {
        if folder.exists() && !folder.is_dir() {
            bail!("cannot write to {}: it is a file, not a folder", folder.display());
        }
        fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
        create_temporary(&folder.join("probe"))
            .and_then(|(probe, _)| fs::remove_file(probe))
            .with_context(|| format!("cannot write to the folder {}", folder.display()))?;
        Ok(Self { folder: folder.to_owned() })
    }

    /// The same for one file, whose folder is tried. Returns the folder and the file's name.
    pub(super) fn for_file(path: &Path) -> Result<(Self, String)> {
        let Some(name) = path.file_name().filter(|_| !path.is_dir()) else {
            bail!("cannot write to {}: it is a folder, name a file", path.display());
        };
        let folder = path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
        Ok((Self::prepare(folder)?, name.to_string_lossy().into_owned()))
    }

    pub(super) fn folder(&self) -> &Path {
        &self.folder
    }

    /// Writes a file under a temporary name and renames it.
    pub(super) fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> Result<()> {
        let path = self.folder.join(name);
        if let Some(parent) = path.parent() {
            fs::create_dir_all(parent).with_context(|| format!("cannot make the folder {}", parent.display()))?;
        }
        write_atomic(&path, bytes.as_ref()).with_context(|| format!("cannot write {}", path.display()))
    }
}
