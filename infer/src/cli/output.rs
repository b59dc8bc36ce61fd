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
        let target = target(path)?;
        let Some(name) = path.file_name() else {
            bail!("cannot write to {}: name a file", path.display());
        };
        Self::prepare(parent(&target))?;
        Ok((Self::prepare(parent(path))?, name.to_string_lossy().into_owned()))
    }

    pub(super) fn folder(&self) -> &Path {
        &self.folder
    }

    /// Writes a file under a temporary name and renames it.
    pub(super) fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> Result<()> {
        let path = target(&self.folder.join(name))?;
        if let Some(parent) = path.parent() {
            fs::create_dir_all(parent).with_context(|| format!("cannot make the folder {}", parent.display()))?;
        }
        write_atomic(&path, bytes.as_ref()).with_context(|| format!("cannot write {}", path.display()))
    }
}

fn parent(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// The file that is to be replaced: what a link leads to, so that the link stays, and nothing that is no regular file.
fn target(path: &Path) -> Result<PathBuf> {
    let shown = path.display();
    if path.is_dir() {
        bail!("cannot write to {shown}: it is a folder, name a file");
    }
    let target = match path.is_symlink() {
        true => fs::canonicalize(path).with_context(|| format!("cannot write to {shown}: it is a link to no file"))?,
        false => path.to_owned(),
    };
    if target.exists() && !target.is_file() {
        bail!("cannot write to {shown}: it is no regular file");
    }
    Ok(target)
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::os::unix::{fs::symlink, net::UnixListener};

    #[test]
    fn links_stay_links_and_only_files_are_replaced() {
        let dir = tempfile::tempdir().unwrap();
        let [file, link, nowhere, socket] = ["a/file", "link", "nowhere", "socket"].map(|name| dir.path().join(name));
        fs::create_dir(dir.path().join("a")).unwrap();
        fs::write(&file, "old").unwrap();
        symlink(&file, &link).unwrap();
        symlink("gone", &nowhere).unwrap();
        let _listener = UnixListener::bind(&socket).unwrap();

        let (out, name) = Output::for_file(&link).unwrap();
        out.write(&name, "new").unwrap();
        assert!(link.is_symlink() && fs::read_to_string(&file).unwrap() == "new");
        assert_eq!(out.folder(), dir.path(), "what is written beside it is beside the link");
        for (path, says) in [(&socket, "no regular file"), (&nowhere, "a link to no file")] {
            let error = Output::for_file(path).err().unwrap().to_string();
            let written = out.write(path.file_name().unwrap().to_str().unwrap(), "new").unwrap_err().to_string();
            assert!(error.contains(says) && written.contains(says), "{error}, {written}");
        }
        assert!(nowhere.is_symlink() && socket.exists() && !socket.is_file());
    }
}
