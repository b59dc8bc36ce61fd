//! Scenes from disk: a folder of the AiMDoom layout, or an OBJ file.

use super::settings::Settings;
use super::{Mesh, MeshError, Scene, SceneError};
use crate::pose::CAMERA_HEIGHT;
use glam::{Vec2, Vec3};
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
    /// Not an OBJ file.
    #[error("{path} is not a readable OBJ file: {reason}")]
    Obj {
        /// The file.
        path: PathBuf,
        /// The parser's reason.
        reason: String,
    },
    /// A mesh that cannot be used.
    #[error("{path}: {source}")]
    Mesh {
        /// The file.
        path: PathBuf,
        /// The reason.
        source: MeshError,
    },
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

impl Scene {
    /// Loads a scene folder (its first `*.obj` and `settings.json` or `setting.json`) or a single OBJ file, with the
    /// settings beside it where there are any, else with settings that [`infer_settings`] finds.
    ///
    /// # Errors
    /// Naming the file and the reason.
    pub fn load(path: &Path) -> Result<Self, LoadError> {
        let obj = if path.is_dir() { first_obj(path)? } else { path.to_path_buf() };
        let read = |path: &Path| fs::read(path).map_err(|source| LoadError::Read { path: path.to_path_buf(), source });
        let (vertices, triangles) = parse_obj(&obj, &read(&obj)?)?;
        let folder = obj.parent().unwrap_or(Path::new("."));
        let beside = ["settings.json", "setting.json"].map(|name| folder.join(name)).into_iter().find(|p| p.is_file());
        let settings = match &beside {
            None => None,
            Some(path) => {
                let parsed = serde_json::from_slice::<Settings>(&read(path)?);
                Some(parsed.map_err(|e| LoadError::Settings { path: path.clone(), reason: e.to_string() })?)
            }
        };
        let scale = settings.as_ref().map_or(1.0, |s| s.scene.metres_per_unit);
        let vertices = vertices.into_iter().map(|v| v * scale).collect();
        let mesh = Mesh::new(vertices, triangles).map_err(|source| LoadError::Mesh { path: obj.clone(), source })?;
        let settings = settings.unwrap_or_else(|| infer_settings(&mesh));
        Self::new(scene_name(path, &obj), mesh, &settings).map_err(|source| LoadError::Scene { path: obj, source })
    }
}

/// Scene folders below `path`, sorted: `path` itself, or every folder under it that holds an OBJ file.
///
/// # Errors
/// When a folder cannot be listed.
pub fn find_scenes(path: &Path) -> Result<Vec<PathBuf>, LoadError> {
    if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("obj")) || first_obj(path).is_ok() {
        return Ok(vec![path.to_path_buf()]);
    }
    let mut found = Vec::new();
    for entry in list(path)?.into_iter().filter(|entry| entry.is_dir()) {
        found.extend(find_scenes(&entry)?);
    }
    Ok(found)
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

fn parse_obj(path: &Path, bytes: &[u8]) -> Result<(Vec<Vec3>, Vec<[u32; 3]>), LoadError> {
    let refuse = |reason: String| LoadError::Obj { path: path.to_path_buf(), reason };
    // tobj reads `nan` and `inf` as numbers and does not say where; the line is what a user needs.
    for (number, line) in bytes.split(|&b| b == b'\n').enumerate().filter(|(_, line)| line.starts_with(b"v ")) {
        let text = String::from_utf8_lossy(line);
        let finite = text.split_whitespace().skip(1).take(3).all(|w| w.parse::<f32>().is_ok_and(f32::is_finite));
        if !finite || text.split_whitespace().count() < 4 {
            return Err(refuse(format!(
                "line {}: a vertex needs three finite numbers, found {:?}",
                number + 1,
                text.trim()
            )));
        }
    }
    let options = tobj::LoadOptions { triangulate: true, ..Default::default() };
    let without_materials = |_: &Path| Ok((Vec::new(), Default::default()));
    let (models, _) =
        tobj::load_obj_buf(&mut &*bytes, &options, without_materials).map_err(|e| refuse(e.to_string()))?;
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for model in models {
        let base = vertices.len() as u32;
        vertices.extend(model.mesh.positions.chunks_exact(3).map(|p| Vec3::new(p[0], p[1], p[2])));
        triangles.extend(model.mesh.indices.chunks_exact(3).map(|t| [t[0] + base, t[1] + base, t[2] + base]));
    }
    Ok((vertices, triangles))
}

fn list(folder: &Path) -> Result<Vec<PathBuf>, LoadError> {
    let entries = fs::read_dir(folder).and_then(|entries| entries.map(|e| e.map(|e| e.path())).collect());
    let mut paths: Vec<PathBuf> = entries.map_err(|source| LoadError::Read { path: folder.to_path_buf(), source })?;
    paths.sort();
    Ok(paths)
}

fn first_obj(folder: &Path) -> Result<PathBuf, LoadError> {
    let is_obj = |path: &PathBuf| path.extension().is_some_and(|e| e.eq_ignore_ascii_case("obj"));
    list(folder)?.into_iter().find(is_obj).ok_or_else(|| LoadError::NoObj(folder.to_path_buf()))
}

fn scene_name(path: &Path, obj: &Path) -> String {
    let named = if path.is_dir() { path.file_name() } else { obj.file_stem() };
    named.or(obj.file_stem()).map_or_else(|| "scene".into(), |name| name.to_string_lossy().into_owned())
}

#[cfg(test)]
mod tests {
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
        assert!(message("v 0 0 0\nf 1 2 9\n").contains("room.obj"));
        let folder = tempfile::tempdir().unwrap();
        assert!(Scene::load(folder.path()).unwrap_err().to_string().contains("no *.obj"));
        assert!(Scene::load(Path::new("/nowhere/at.obj")).unwrap_err().to_string().contains("cannot read"));
    }
}
