//! Doom maps as scenes: read from WAD files or generated, converted to closed meshes, written and measured.
//!
//! Data flows one way: `wad | generate → DoomMap → convert → SceneBundle → write`, and `stats`, `check` and `preview` look
//! at what was written.

pub mod doom_map;
pub mod wad;

mod arrange;
pub mod triangulate;

pub mod convert;

pub mod generate;

pub mod import;

pub mod check;
pub mod draw;
pub mod navigation;
pub mod picture;
pub mod preview;
pub mod split;
pub mod stats;

mod atlas;
pub mod write;

pub use convert::{ConvertError, ConvertOptions, ConvertReport, SceneBundle, convert};
pub use doom_map::DoomMap;
pub use generate::{GenerateError, Generated, Level, generate};
pub use wad::Textures;
pub use write::{WriteError, write_mesh, write_scene, write_scene_with};

use nbp_env::scene::{LoadOptions, SceneError};
use nbp_env::{Scene, SeedTree};
use std::path::Path;
use std::sync::Arc;

/// Why a WAD's map is no scene.
#[derive(Debug, thiserror::Error)]
pub enum WadSceneError {
    /// The WAD cannot be read.
    #[error("{path}: {source}")]
    Wad {
        /// The file.
        path: std::path::PathBuf,
        /// Why.
        source: wad::WadError,
    },
    /// Several maps and none named.
    #[error("{path} holds {count} maps ({maps}): name one")]
    Which {
        /// The file.
        path: std::path::PathBuf,
        /// Number of maps.
        count: usize,
        /// Their names.
        maps: String,
    },
    /// The converter refuses it.
    #[error("{path}: {source}")]
    Convert {
        /// The file.
        path: std::path::PathBuf,
        /// Why.
        source: ConvertError,
    },
    /// The mesh makes no scene.
    #[error("{path}: {source}")]
    Scene {
        /// The file.
        path: std::path::PathBuf,
        /// Why.
        source: SceneError,
    },
}

/// The scene of a map in a WAD, in memory; `map` may be left out where the WAD holds one. Without `options.colour` its
/// textures are not composed.
///
/// # Errors
/// Naming the file and what is wrong with it.
pub fn scene_from_wad(path: &Path, map: Option<&str>, options: LoadOptions) -> Result<Scene, WadSceneError> {
    let path = path.to_path_buf();
    let wad = wad::Wad::open(&path).map_err(|source| WadSceneError::Wad { path: path.clone(), source })?;
    let wad = Arc::new(wad);
    let available = wad.maps();
    let map = match (map, available.as_slice()) {
        (Some(map), _) => map,
        (None, [only]) => only,
        (None, all) => {
            let (count, maps) = (all.len(), all.join(", "));
            return Err(WadSceneError::Which { path, count, maps });
        }
    };
    // Broken textures are no reason to refuse the map: tiles stand in.
    let read_textures = || wad::Textures::read(std::slice::from_ref(&wad)).unwrap_or_default();
    let textures = options.colour.then(read_textures).flatten();
    let mut read = wad.map(map).map_err(|source| WadSceneError::Wad { path: path.clone(), source })?;
    read.name = scene_name(&path, map, available.len());
    let mut bundle = convert(&read, ConvertOptions { textures: textures.as_ref(), ..ConvertOptions::default() })
        .map_err(|source| WadSceneError::Convert { path: path.clone(), source })?;
    if !options.colour {
        bundle.mesh = bundle.mesh.bare();
    }
    to_scene(bundle).map_err(|source| WadSceneError::Scene { path, source })
}

/// Name of a map's scene: the file's, with the map's where the WAD holds several. What cannot be in a folder name becomes
/// `-`.
pub fn scene_name(path: &Path, map: &str, maps: usize) -> String {
    let stem = path.file_stem().map_or_else(|| "map".into(), |stem| stem.to_string_lossy().into_owned());
    let name = if maps == 1 { stem } else { format!("{stem}_{}", map.to_ascii_uppercase()) };
    let plain = name.trim_start_matches('.').chars();
    plain.map(|c| if c.is_ascii_alphanumeric() || "-_.".contains(c) { c } else { '-' }).collect()
}

/// The scene of a bundle, in memory.
///
/// # Errors
/// When the mesh has no free lattice pose.
pub fn to_scene(bundle: SceneBundle) -> Result<Scene, SceneError> {
    Scene::new(bundle.name, bundle.mesh, &bundle.settings)
}

/// Seed of one map in a set: sets of different seeds share no map, and a map does not depend on the size of its set.
pub fn batch_seed(seed: u64, number: u64) -> u64 {
    SeedTree::new(seed).child("map", number).key()
}
