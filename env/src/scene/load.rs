//! Scenes from disk: a folder of the AiMDoom layout, or an OBJ file.

use super::settings::{Settings, UNITS, WANT_UNIT};
use super::{Mesh, Obj, ObjError, Scene, SceneError};
use crate::pose::CAMERA_HEIGHT;
use glam::Vec2;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// Why a scene could not be read.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// The file system says no.
    #[error("cannot read {path}: {source}")]
    Read {
        /// What was to be read.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A folder without a scene.
    #[error("{0} holds no *.obj file: name a scene folder (*.obj + settings.json) or an OBJ file")]
    NoObj(PathBuf),
    /// The OBJ file, or one that it names.
    #[error(transparent)]
    Obj(#[from] ObjError),
    /// Not the published schema.
    #[error("{path} is not a settings file of the AiMDoom schema: {reason}")]
    Settings {
        /// The file.
        path: PathBuf,
        /// The parser's reason.
        reason: String,
    },
    /// Readable, but no scene.
    #[error("{path}: {source}")]
    Scene {
        /// The OBJ file.
        path: PathBuf,
        /// The reason.
        source: SceneError,
    },
}

/// What to read of a scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LoadOptions {
    /// Also the colours: vertex colours, materials and images. Without, they are not even opened.
    pub colour: bool,
}

impl Scene {
    /// Loads the geometry of a scene folder (its first `*.obj` and `settings.json` or `setting.json`) or of a single OBJ
    /// file, with the settings beside it where there are any, else with settings that [`infer_settings`] finds.
    ///
    /// # Errors
    /// Naming the file and the reason.
    pub fn load(path: &Path) -> Result<Self, LoadError> {
        Self::load_with(path, LoadOptions::default())
    }

    /// The same with options.
    ///
    /// # Errors
    /// As [`Scene::load`], and as [`Obj::read`] where colours are asked for.
    pub fn load_with(path: &Path, options: LoadOptions) -> Result<Self, LoadError> {
        let file = if path.is_dir() { first_obj(path)? } else { path.to_path_buf() };
        let mut obj = Obj::read(&file, options.colour)?;
        let folder = file.parent().unwrap_or(Path::new("."));
        let beside = ["settings.json", "setting.json"].map(|name| folder.join(name)).into_iter().find(|p| p.is_file());
        let settings = match &beside {
            None => None,
            Some(path) => {
                let bytes = fs::read(path).map_err(|source| LoadError::Read { path: path.clone(), source })?;
                let parsed = serde_json::from_slice::<Settings>(&bytes);
                Some(parsed.map_err(|e| LoadError::Settings { path: path.clone(), reason: e.to_string() })?)
            }
        };
        let notes = std::mem::take(&mut obj.notes);
        let scale = settings.as_ref().map_or(1.0, |s| s.scene.metres_per_unit);
        if !UNITS.contains(&scale) {
            let reason = format!("scene.metres_per_unit is {scale:e}: {WANT_UNIT}");
            return Err(LoadError::Settings { path: beside.unwrap_or(file), reason });
        }
        let mesh = obj.into_mesh(&file, scale)?;
        let settings = settings.unwrap_or_else(|| infer_settings(&mesh));
        let scene = Self::new(scene_name(path, &file), mesh, &settings);
        let mut scene = scene.map_err(|source| LoadError::Scene { path: file, source })?;
        scene.notes.splice(..0, notes);
        Ok(scene)
    }
}

/// Scene folders below `path`, sorted: `path` itself, or every folder under it that holds an OBJ file. Names that begin
/// with a dot are left out, and a folder that is reached twice through links is searched once.
///
/// # Errors
/// When a folder cannot be listed.
pub fn find_scenes(path: &Path) -> Result<Vec<PathBuf>, LoadError> {
    find_scenes_and(path, |_| false)
}

/// The same, and the files outside of scene folders that `is_other` names.
///
/// # Errors
/// When a folder cannot be listed.
pub fn find_scenes_and(path: &Path, is_other: impl Fn(&Path) -> bool) -> Result<Vec<PathBuf>, LoadError> {
    let mut found = Vec::new();
    search(path, &is_other, &mut BTreeSet::new(), &mut found)?;
    Ok(found)
}

fn search(
    path: &Path,
    is_other: &dyn Fn(&Path) -> bool,
    visited: &mut BTreeSet<PathBuf>,
    found: &mut Vec<PathBuf>,
) -> Result<(), LoadError> {
    if path.is_file() && (is_obj(path) || is_other(path)) {
        found.push(path.into());
        return Ok(());
    }
    let entries = list(path)?;
    if !visited.insert(path.canonicalize().unwrap_or_else(|_| path.into())) {
        return Ok(());
    }
    let (meshes, others): (Vec<&PathBuf>, Vec<&PathBuf>) =
        entries.iter().partition(|entry| is_obj(entry) && entry.is_file());
    let before = found.len();
    let mut folders = others.iter().filter(|entry| entry.is_dir());
    folders.try_for_each(|entry| search(entry, is_other, visited, found))?;
    // A folder with a mesh is one scene, whatever else lies in it; but a stray mesh must not hide the scenes below.
    match (meshes.is_empty(), found.len() > before) {
        (false, false) => found.push(path.into()),
        (false, true) => found.extend(meshes.into_iter().cloned()),
        (true, _) => found.extend(others.into_iter().filter(|entry| is_other(entry) && entry.is_file()).cloned()),
    }
    found[before..].sort();
    Ok(())
}

/// Settings for a mesh in metres that comes without any: the floor is the height with the most horizontal area, the
/// lattice covers the box of the mesh.
pub fn infer_settings(mesh: &Mesh) -> Settings {
    let [low, high] = mesh.bounds();
    let bin = |y: f32| ((y - low.y) / FLOOR_BIN) as usize;
    let mut area = vec![0.0_f32; bin(high.y).min(1 << 20) + 1];
    for [a, b, c] in mesh.iter_corners() {
        let normal = (b - a).cross(c - a);
        let (bottom, top) = (a.y.min(b.y).min(c.y), a.y.max(b.y).max(c.y));
        if normal.y.abs() > 0.95 * normal.length()
            && top + CAMERA_HEIGHT < high.y
            && let Some(sum) = area.get_mut(bin(bottom))
        {
            *sum += normal.length();
        }
    }
    // The first of equals: the lowest floor.
    let floor = (0..area.len()).fold(0, |best, at| if area[at] > area[best] { at } else { best });
    Settings::for_box([low, high], low.y + floor as f32 * FLOOR_BIN, Vec2::splat(0.75))
}

/// Resolution of the floor's height, metres.
const FLOOR_BIN: f32 = 0.05;

/// What a folder holds, sorted, without names that begin with a dot: caches, and what macOS writes beside each file.
fn list(folder: &Path) -> Result<Vec<PathBuf>, LoadError> {
    let entries = fs::read_dir(folder).and_then(|entries| entries.map(|e| e.map(|e| e.path())).collect());
    let mut paths: Vec<PathBuf> = entries.map_err(|source| LoadError::Read { path: folder.to_path_buf(), source })?;
    paths.retain(|path| path.file_name().is_some_and(|name| !name.as_encoded_bytes().starts_with(b".")));
    paths.sort();
    Ok(paths)
}

fn is_obj(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("obj"))
}

fn first_obj(folder: &Path) -> Result<PathBuf, LoadError> {
    let mut meshes: Vec<PathBuf> = list(folder)?.into_iter().filter(|path| is_obj(path) && path.is_file()).collect();
    // Of several the one that is called like the folder, else the first.
    let named = meshes.iter().position(|path| path.file_stem() == folder.file_name()).unwrap_or(0);
    match meshes.is_empty() {
        true => Err(LoadError::NoObj(folder.to_path_buf())),
        false => Ok(meshes.swap_remove(named)),
    }
}

fn scene_name(path: &Path, obj: &Path) -> String {
    let named = if path.is_dir() { path.file_name() } else { obj.file_stem() };
    named.or(obj.file_stem()).map_or_else(|| "scene".into(), |name| name.to_string_lossy().into_owned())
}

#[cfg(test)]
mod tests {
    use super::super::Paint;
    use super::*;

    const ROOM: &str = "v 0 0 0\nv 6 0 0\nv 6 0 6\nv 0 0 6\nv 0 3 0\nv 6 3 0\nv 6 3 6\nv 0 3 6\n\
        f 1 2 3 4\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";

    fn write(text: &str) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("room.obj");
        fs::write(&path, text).unwrap();
        (folder, path)
    }

    #[test]
    fn an_obj_alone_gets_a_floor_and_a_lattice() {
        let (folder, path) = write(ROOM);
        let scene = Scene::load(&path).unwrap();
        assert_eq!(scene.name(), "room");
        assert_eq!(scene.mesh().triangles().len(), 12);
        assert_eq!(scene.graph().largest_component().len(), 16);
        assert!((scene.lattice().origin.y - CAMERA_HEIGHT).abs() < 0.06);
        assert_eq!(find_scenes(folder.path()).unwrap().len(), 1);
    }

    #[test]
    fn published_settings_scale_the_mesh() {
        let (folder, path) = write(&ROOM.replace('6', "1.2").replace('3', "0.6").replace("f 1 2 0.6 4", "f 1 2 3 4"));
        let _ = path;
        fs::write(folder.path().join("room.obj"), "v 0 0 0\nv 1.2 0 0\nv 1.2 0 1.2\nv 0 0 1.2\nf 1 2 3 4\n").unwrap();
        let settings = r#"{"scene":{"grid_l":1,"grid_w":1,"grid_h":1,"cell_capacity":2000,"cell_resolution":null,
            "x_min":[0,0,0],"x_max":[1.2,0.6,1.2]},"camera":{"x_min":[0.15,0,0.15],"x_max":[1,0,1],"pose_l":4,"pose_w":1,
            "pose_h":4,"pose_n_theta":5,"pose_n_azim":8,"start_positions":[[1,0,2,2,5]],"contrast_factor":1.5}}"#;
        fs::write(folder.path().join("setting.json"), settings).unwrap();
        let scene = Scene::load(folder.path()).unwrap();
        assert_eq!(scene.mesh().bounds()[1].x, 6.0);
        assert!((scene.lattice().origin.x - 0.75).abs() < 1e-6);
        assert_eq!(scene.starts()[0].heading.index(), 5);
    }

    #[test]
    fn bad_files_say_what_and_where() {
        let message = |text: &str| Scene::load(&write(text).1).unwrap_err().to_string();
        assert!(message(&ROOM.replace("v 6 3 6", "v 6 nan 6")).contains("line 7"), "{}", message("v nan 0 0"));
        assert!(message("v 0 0\n").contains("line 1"));
        assert!(message("hello").contains("no triangle"), "{}", message("hello"));
        assert!(message("v 0 0 0\nf 1 2 9\n").contains("room.obj, line 2"));
        let folder = tempfile::tempdir().unwrap();
        assert!(Scene::load(folder.path()).unwrap_err().to_string().contains("no *.obj"));
        assert!(Scene::load(Path::new("/nowhere/at.obj")).unwrap_err().to_string().contains("cannot read"));
    }

    #[test]
    fn colours_are_loaded_when_asked_for() {
        let painted =
            |line: &str| if line.starts_with('v') { format!("{line} 0 0.2 1\n") } else { format!("{line}\n") };
        let (_folder, path) = write(&ROOM.lines().map(painted).collect::<String>());
        let scene = Scene::load_with(&path, LoadOptions { colour: true }).unwrap();
        let paints = &scene.mesh().appearance().unwrap().paints;
        assert_eq!((paints.len(), paints[0]), (12, Paint::Corners([[0, 51, 255]; 3])));
        assert_eq!(Scene::load(&path).unwrap().mesh(), Scene::load(&write(ROOM).1).unwrap().mesh());
    }

    #[test]
    fn published_folders_are_found_whatever_their_spelling() {
        let root = tempfile::tempdir().unwrap();
        let scenes = ["Test dataset/3", "train/0", "training_dataset/10/deep"];
        for place in scenes.iter().copied().chain([".cache/0", "empty"]) {
            fs::create_dir_all(root.path().join(place)).unwrap();
        }
        for place in scenes.iter().copied().chain([".cache/0"]) {
            fs::write(root.path().join(place).join("._a.obj"), "resource fork").unwrap();
            fs::write(root.path().join(place).join("a.obj"), ROOM).unwrap();
            fs::write(root.path().join(place).join("b.obj"), "v").unwrap();
        }
        #[cfg(unix)]
        std::os::unix::fs::symlink(root.path(), root.path().join("train/back")).unwrap();
        let found = find_scenes(root.path()).unwrap();
        assert_eq!(found, scenes.map(|place| root.path().join(place)));
        assert!(found.iter().all(|path| Scene::load(path).is_ok()));
        fs::write(root.path().join("stray.obj"), ROOM).unwrap();
        assert_eq!(find_scenes(root.path()).unwrap().len(), 4, "a stray mesh hides nothing");
        fs::write(root.path().join("train/0/0.obj"), ROOM.replace('3', "4")).unwrap();
        let named = Scene::load(&root.path().join("train/0")).unwrap();
        assert_eq!(named.mesh().bounds()[1].y, 4.0, "called like its folder");
    }
}
