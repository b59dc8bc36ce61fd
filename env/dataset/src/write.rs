//! Scene folders in the published layout: `<scene>/<scene>.obj`, `.mtl`, `settings.json`.
//!
//! Lengths are metres and `y` is up; `scene.metres_per_unit` is 1. A folder appears complete or not at all: it is written
//! under a temporary name and renamed.

use crate::convert::SceneBundle;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::{fs, io};

/// Why a scene cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// The scene is there already.
    #[error("{0} exists already: choose another --out, or replace it with --replace")]
    Exists(PathBuf),
    /// A name that is no folder name.
    #[error("scene name {0:?} cannot be a folder: use letters, digits, '-', '_' and '.'")]
    Name(String),
    /// The file system refused.
    #[error("cannot write {path}: {source}; choose a folder that can be written, on a disk with space left")]
    Io {
        /// File or folder.
        path: PathBuf,
        /// The system's word.
        source: io::Error,
    },
    /// Settings that are not JSON.
    #[error("the settings of {scene} have no JSON form: {source}")]
    Json {
        /// Scene.
        scene: String,
        /// The serializer's word.
        source: serde_json::Error,
    },
}

/// Writes a scene as a folder of its name in `parent`, which is made if need be, and returns the folder.
///
/// # Errors
/// When the folder exists and `replace` is false, or the file system refuses.
pub fn write_scene(scene: &SceneBundle, parent: &Path, replace: bool) -> Result<PathBuf, WriteError> {
    let name = &scene.name;
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
    if name.is_empty() || name.starts_with('.') || !name.chars().all(is_plain) {
        return Err(WriteError::Name(name.clone()));
    }
    let folder = parent.join(name);
    if folder.exists() && !replace {
        return Err(WriteError::Exists(folder));
    }
    let fail = |path: &Path| {
        let path = path.to_path_buf();
        move |source| WriteError::Io { path, source }
    };
    let partial = parent.join(format!(".{name}.partial-{}", std::process::id()));
    if partial.exists() {
        fs::remove_dir_all(&partial).map_err(fail(&partial))?;
    }
    fs::create_dir_all(&partial).map_err(fail(&folder))?;
    let written = write_files(scene, &partial).and_then(|()| {
        if folder.exists() {
            fs::remove_dir_all(&folder).map_err(fail(&folder))?;
        }
        fs::rename(&partial, &folder).map_err(fail(&folder))
    });
    if let Err(error) = written {
        // Best effort: the first error is the one to tell.
        drop(fs::remove_dir_all(&partial));
        return Err(error);
    }
    Ok(folder)
}

fn write_files(scene: &SceneBundle, folder: &Path) -> Result<(), WriteError> {
    let name = &scene.name;
    let settings = serde_json::to_string_pretty(&scene.settings)
        .map_err(|source| WriteError::Json { scene: name.clone(), source })?;
    // The OBJ comes last: what an interrupted run leaves behind is not taken for a scene.
    for (file, text) in [("settings.json".into(), settings), (format!("{name}.mtl"), MTL.into())] {
        write_file(&folder.join(file), &text)?;
    }
    let (partial, path) = (folder.join("mesh.partial"), folder.join(format!("{name}.obj")));
    write_file(&partial, &obj(scene))?;
    fs::rename(&partial, &path).map_err(|source| WriteError::Io { path, source })
}

fn write_file(path: &Path, text: &str) -> Result<(), WriteError> {
    let write = || {
        let mut file = fs::File::create(path)?;
        file.write_all(text.as_bytes())?;
        file.sync_all()
    };
    write().map_err(|source| WriteError::Io { path: path.into(), source })
}

/// One flat grey.
const MTL: &str = "newmtl flat\nKa 0 0 0\nKd 0.7 0.7 0.7\nKs 0 0 0\nillum 1\n";

/// The mesh as OBJ text: shortest decimals that read back as the same `f32`, so the same scene has the same bytes.
pub fn obj(scene: &SceneBundle) -> String {
    let mesh = &scene.mesh;
    let mut text = String::with_capacity(40 * mesh.vertices().len() + 24 * mesh.triangles().len());
    text.push_str("# metres, y up, normals towards the free space\n");
    // Writing to a string cannot fail.
    let _ = writeln!(text, "mtllib {}.mtl\no {}\nusemtl flat", scene.name, scene.name);
    for v in mesh.vertices() {
        // Adding zero turns -0 into 0.
        let _ = writeln!(text, "v {} {} {}", v.x + 0.0, v.y + 0.0, v.z + 0.0);
    }
    for t in mesh.triangles() {
        let [a, b, c] = t.map(|i| i + 1);
        let _ = writeln!(text, "f {a} {b} {c}");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generate::{Level, generate};
    use nbp_env::Scene;

    #[test]
    fn a_written_scene_loads_as_it_was() {
        let scene = generate(Level::Simple, 5).unwrap().scene;
        let parent = tempfile::tempdir().unwrap();
        let folder = write_scene(&scene, parent.path(), false).unwrap();
        let loaded = Scene::load(&folder).unwrap();
        assert_eq!(loaded.name(), scene.name);
        assert_eq!(loaded.mesh().triangles().len(), scene.mesh.triangles().len());
        assert_eq!(loaded.mesh().bounds(), scene.mesh.bounds());
        assert_eq!(*loaded.lattice(), scene.lattice());
        assert_eq!(loaded.starts().len(), 5);
        assert!(matches!(write_scene(&scene, parent.path(), false), Err(WriteError::Exists(_))));
        write_scene(&scene, parent.path(), true).unwrap();
        assert_eq!(fs::read_dir(parent.path()).unwrap().count(), 1, "no temporary folder is left");
    }

    #[test]
    fn refusals_name_the_path() {
        let mut scene = generate(Level::Simple, 5).unwrap().scene;
        let parent = tempfile::tempdir().unwrap();
        let file = parent.path().join("file");
        fs::write(&file, "").unwrap();
        let error = write_scene(&scene, &file, false).unwrap_err().to_string();
        assert!(error.contains("file") && error.contains("cannot write"), "{error}");
        scene.name = "../up".into();
        assert!(matches!(write_scene(&scene, parent.path(), false), Err(WriteError::Name(_))));
    }
}
