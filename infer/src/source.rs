//! Scenes as named on the command line: an OBJ file, a scene folder, a WAD or one of its maps, a folder of any of these.

use nbp_dataset::wad::{Wad, WadError};
use nbp_dataset::{WadSceneError, scene_from_wad};
use nbp_env::Scene;
use nbp_env::scene::load::find_scenes_and;
use nbp_env::scene::{LoadError, LoadOptions};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// Where one scene comes from.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Source {
    /// An OBJ file, or a folder with one and its settings.
    Mesh(PathBuf),
    /// A map of a WAD.
    Map {
        /// The WAD.
        wad: PathBuf,
        /// Name of the map's marker.
        map: String,
    },
}

/// A scene that cannot be had.
#[derive(Debug, thiserror::Error)]
pub enum SourceError {
    /// Nothing there.
    #[error(
        "there is no {0}: name an OBJ file, a scene folder, a WAD, one map as FILE.wad:MAP01, or a folder of these"
    )]
    Missing(PathBuf),
    /// Something else.
    #[error("{0} holds no scene: there is no *.obj and no *.wad file in it or below")]
    Empty(PathBuf),
    /// Neither a mesh nor a WAD.
    #[error("{0} is not a scene: name an OBJ file, a scene folder, a WAD, or one map as FILE.wad:MAP01")]
    Kind(PathBuf),
    /// A mesh or its settings.
    #[error(transparent)]
    Mesh(#[from] LoadError),
    /// A WAD's directory.
    #[error("{path}: {source}")]
    Wad {
        /// The file.
        path: PathBuf,
        /// Why.
        source: WadError,
    },
    /// A WAD's map.
    #[error("{source}{hint}")]
    Map {
        /// Why.
        source: Box<WadSceneError>,
        /// What to do, where something can be done.
        hint: &'static str,
    },
    /// More than one scene where one is needed.
    #[error("{path} holds {count} scenes ({some}): name one")]
    Several {
        /// As given.
        path: PathBuf,
        /// How many.
        count: usize,
        /// The first few.
        some: String,
    },
}

impl Source {
    /// Reads the scene.
    ///
    /// # Errors
    /// Naming the file and the reason.
    pub fn load(&self, options: LoadOptions) -> Result<Scene, SourceError> {
        match self {
            Self::Mesh(path) => Ok(Scene::load_with(path, options)?),
            Self::Map { wad, map } => scene_from_wad(wad, Some(map), options).map_err(|source| {
                let is_unfit = matches!(source, WadSceneError::Convert { .. } | WadSceneError::Scene { .. });
                let hint = if is_unfit { "; to leave this map out, name the others as FILE.wad:MAP01" } else { "" };
                SourceError::Map { source: Box::new(source), hint }
            }),
        }
    }

    /// Name of the map, or of the file or folder without its extension.
    pub fn label(&self) -> String {
        match self {
            Self::Map { map, .. } => map.clone(),
            Self::Mesh(path) => {
                let name = if path.is_dir() { path.file_name() } else { path.file_stem() };
                name.unwrap_or_default().to_string_lossy().into_owned()
            }
        }
    }

    /// Name of the folder that the file or scene folder lies in.
    fn parent(&self) -> Option<String> {
        let (Self::Mesh(path) | Self::Map { wad: path, .. }) = self;
        let parent = path.parent()?.file_name()?;
        Some(parent.to_string_lossy().into_owned())
    }
}

impl std::fmt::Display for Source {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Mesh(path) => write!(f, "{}", path.display()),
            Self::Map { wad, map } => write!(f, "{}:{map}", wad.display()),
        }
    }
}

/// The scenes that an argument names, sorted within folders; their files are not read yet, but for the directories of
/// WADs.
///
/// # Errors
/// When it names none.
pub fn find(argument: &str) -> Result<Vec<Source>, SourceError> {
    let path = Path::new(argument);
    if path.exists() {
        let found = below(path)?;
        let nothing = || if path.is_dir() { SourceError::Empty(path.into()) } else { SourceError::Kind(path.into()) };
        return if found.is_empty() { Err(nothing()) } else { Ok(found) };
    }
    match argument.rsplit_once(':').map(|(file, map)| (Path::new(file), map)) {
        Some((wad, map)) if is(wad, "wad") && !map.is_empty() => match wad.is_file() {
            true => Ok(vec![Source::Map { wad: wad.into(), map: map.to_ascii_uppercase() }]),
            false => Err(SourceError::Missing(wad.into())),
        },
        _ => Err(SourceError::Missing(path.into())),
    }
}

/// The one scene that an argument names.
///
/// # Errors
/// When it names none or several.
pub fn load_one(argument: &str, options: LoadOptions) -> Result<Scene, SourceError> {
    let found = find(argument)?;
    match found.as_slice() {
        [source] => source.load(options),
        all => {
            let some: Vec<String> = all.iter().take(3).map(Source::to_string).collect();
            let some = some.join(", ") + if all.len() > 3 { ", …" } else { "" };
            Err(SourceError::Several { path: argument.into(), count: all.len(), some })
        }
    }
}

/// All scenes that arguments name, in order, each once. Scenes that share a name get that of their folder in front.
///
/// # Errors
/// When an argument names none, or a scene cannot be read.
pub fn load_all(
    arguments: &[String],
    options: LoadOptions,
    on_scene: impl Fn(usize) + Sync,
) -> Result<Vec<Scene>, SourceError> {
    load_found(&find_all(arguments)?, options, on_scene)
}

/// All scenes that arguments name, in order, each once; see [`find`].
///
/// # Errors
/// When an argument names none.
pub fn find_all(arguments: &[String]) -> Result<Vec<Source>, SourceError> {
    let mut sources = Vec::new();
    let mut known = BTreeSet::new();
    for argument in arguments {
        sources.extend(find(argument)?.into_iter().filter(|source| known.insert(source.clone())));
    }
    Ok(sources)
}

/// Reads scenes. Those that share a name get that of their folder in front.
///
/// # Errors
/// When a scene cannot be read.
pub fn load_found(
    sources: &[Source],
    options: LoadOptions,
    on_scene: impl Fn(usize) + Sync,
) -> Result<Vec<Scene>, SourceError> {
    let total = sources.len();
    let load = |source: &Source| {
        let scene = source.load(options);
        on_scene(total);
        scene
    };
    let scenes = sources.par_iter().map(load).collect::<Vec<_>>().into_iter().collect::<Result<Vec<Scene>, _>>()?;
    let mut uses: BTreeMap<String, usize> = BTreeMap::new();
    scenes.iter().for_each(|scene| *uses.entry(scene.name().to_owned()).or_default() += 1);
    let named = |(scene, source): (Scene, &Source)| match source.parent() {
        Some(parent) if uses.get(scene.name()).is_some_and(|&count| count > 1) => {
            let name = format!("{parent}-{}", scene.name());
            scene.with_name(name)
        }
        _ => scene,
    };
    Ok(scenes.into_iter().zip(sources).map(named).collect())
}

fn is(path: &Path, extension: &str) -> bool {
    path.extension().and_then(OsStr::to_str).is_some_and(|found| found.eq_ignore_ascii_case(extension))
}

fn below(path: &Path) -> Result<Vec<Source>, SourceError> {
    if path.is_file() && !is(path, "obj") && !is(path, "wad") {
        return Ok(Vec::new());
    }
    let mut sources = Vec::new();
    for path in find_scenes_and(path, |file| is(file, "wad"))? {
        if is(&path, "wad") && path.is_file() {
            let wad = Wad::open(&path).map_err(|source| SourceError::Wad { path: path.clone(), source })?;
            sources.extend(wad.maps().into_iter().map(|map| Source::Map { wad: path.clone(), map: map.to_owned() }));
        } else {
            sources.push(Source::Mesh(path));
        }
    }
    Ok(sources)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    const ROOM: &str = "v 0 0 0\nv 6 0 0\nv 6 0 6\nv 0 0 6\nv 0 3 0\nv 6 3 0\nv 6 3 6\nv 0 3 6\n\
        f 1 2 3 4\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";

    fn argument(path: &Path) -> String {
        path.to_str().unwrap().to_owned()
    }

    #[test]
    fn folders_of_folders_are_searched_and_twins_are_told_apart() {
        let dir = tempfile::tempdir().unwrap();
        for place in ["easy/0", "hard/0", "hard/1"] {
            fs::create_dir_all(dir.path().join(place)).unwrap();
            fs::write(dir.path().join(place).join("mesh.obj"), ROOM).unwrap();
        }
        fs::write(dir.path().join("notes.txt"), "").unwrap();
        let twice = [argument(dir.path()), argument(&dir.path().join("hard"))];
        let scenes = load_all(&twice, LoadOptions::default(), |total| assert_eq!(total, 3)).unwrap();
        assert_eq!(scenes.iter().map(Scene::name).collect::<Vec<_>>(), ["easy-0", "hard-0", "1"]);
        let error = load_one(&twice[1], LoadOptions::default()).unwrap_err().to_string();
        assert!(error.contains("2 scenes"), "{error}");
        assert_eq!(
            load_one(&argument(&dir.path().join("hard/1/mesh.obj")), LoadOptions::default()).unwrap().name(),
            "mesh"
        );
    }

    #[test]
    fn what_holds_no_scene_says_so() {
        let dir = tempfile::tempdir().unwrap();
        let message = |argument: &str| find(argument).unwrap_err().to_string();
        assert!(message(&argument(dir.path())).contains("holds no scene"));
        assert!(message("/nowhere/at/all").contains("there is no /nowhere"));
        assert!(message("/nowhere/doom.wad:MAP01").contains("there is no /nowhere/doom.wad"));
        let text = dir.path().join("a.txt");
        fs::write(&text, "").unwrap();
        assert!(message(&argument(&text)).contains("is not a scene"));
        let wad = dir.path().join("a.wad");
        fs::write(&wad, "IWAD").unwrap();
        assert!(message(&argument(&wad)).contains("a.wad"), "{}", message(&argument(&wad)));
        assert!(message(&format!("{}:MAP01", argument(&text))).contains("there is no"));
        let named = find(&format!("{}:map01", argument(&wad))).unwrap();
        assert_eq!(named, [Source::Map { wad, map: "MAP01".into() }]);
    }
}
