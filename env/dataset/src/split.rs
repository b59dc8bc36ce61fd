//! Scenes parted into those to train on and those to test on, in the published layout.

use nbp_env::SeedTree;
use rand::seq::SliceRandom as _;
use std::path::{Path, PathBuf};
use std::{fs, io};

/// Share of a set's scenes that is trained on (paper: 70 of 100).
const TRAIN_TENTHS: usize = 7;

/// A part of a set.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Part {
    /// To train on.
    Train,
    /// To test on.
    Test,
}

impl Part {
    /// Name of the folder that we write.
    pub fn folder(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::Test => "test",
        }
    }

    /// The part whose folder has a name: `train`, `Training dataset` and `training_dataset` are all in use.
    fn named(name: &str) -> Option<Self> {
        match name.to_ascii_lowercase().as_str() {
            "train" | "training dataset" | "training_dataset" => Some(Self::Train),
            "test" | "test dataset" | "test_dataset" => Some(Self::Test),
            _ => None,
        }
    }
}

/// The part that a scene lies in, by the nearest folder above it that is called like one.
pub fn part_of(scene: &Path) -> Option<Part> {
    scene.ancestors().skip(1).filter_map(|folder| folder.file_name()?.to_str()).find_map(Part::named)
}

/// Number of scenes to train on among `count`: 70 %, rounded up, and one less where nothing else is left to test on.
pub fn train_count(count: usize) -> usize {
    count.saturating_mul(TRAIN_TENTHS).div_ceil(10).min(count.saturating_sub(1)).max(count.min(1))
}

/// Why a set cannot be split.
#[derive(Debug, thiserror::Error)]
pub enum SplitError {
    /// Nothing to split.
    #[error("{0} holds {1} scene folders: splitting needs two or more right below it")]
    Few(PathBuf, usize),
    /// Another split, or one that was interrupted. To go on with fewer names would draw other parts.
    #[error(
        "{0} holds scenes already: nothing was changed; move them back to the set and split it anew, or choose another --out"
    )]
    Begun(PathBuf),
    /// The target is there.
    #[error("{0} exists already: nothing was changed; choose another --out, or remove it")]
    Exists(PathBuf),
    /// The file system refused.
    #[error("cannot {verb} {path}: {source}{hint}")]
    Io {
        /// What was tried.
        verb: &'static str,
        /// On what.
        path: PathBuf,
        /// The system's word.
        source: io::Error,
        /// What to do.
        hint: &'static str,
    },
}

/// Where one scene goes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Placement {
    /// The scene's folder.
    pub from: PathBuf,
    /// Where it will be.
    pub to: PathBuf,
    /// Its part.
    pub part: Part,
}

/// Draws 70 % of the scenes right below `dir` to train on, the others to test on. Sorted by part and name; the same names
/// and seed give the same parts.
///
/// # Errors
/// When a part holds scenes already, there are fewer than two to split, or a target exists.
pub fn plan(dir: &Path, out: &Path, seed: u64) -> Result<Vec<Placement>, SplitError> {
    let begun = |part: &PathBuf| fs::read_dir(part).is_ok_and(|all| all.flatten().any(|entry| is_scene(&entry.path())));
    if let Some(part) = [Part::Train, Part::Test].map(|part| out.join(part.folder())).into_iter().find(begun) {
        return Err(SplitError::Begun(part));
    }
    let fail = |source| SplitError::Io { verb: "list", path: dir.into(), source, hint: "" };
    let entries: Vec<PathBuf> = fs::read_dir(dir)
        .map_err(fail)?
        .map(|entry| entry.map(|e| e.path()))
        .collect::<io::Result<_>>()
        .map_err(fail)?;
    let mut scenes: Vec<PathBuf> = entries.into_iter().filter(|path| is_scene(path)).collect();
    if scenes.len() < 2 {
        return Err(SplitError::Few(dir.into(), scenes.len()));
    }
    scenes.sort();
    let mut order: Vec<usize> = (0..scenes.len()).collect();
    order.shuffle(&mut SeedTree::new(seed).child("split", 0).rng());
    let train = train_count(scenes.len());
    let mut placements: Vec<Placement> = order
        .into_iter()
        .enumerate()
        .map(|(rank, number)| {
            let part = if rank < train { Part::Train } else { Part::Test };
            let from = scenes[number].clone();
            let to = out.join(part.folder()).join(from.file_name().unwrap_or_default());
            Placement { from, to, part }
        })
        .collect();
    placements.sort_by(|a, b| (a.part, &a.to).cmp(&(b.part, &b.to)));
    match placements.iter().find(|placement| placement.to.exists()) {
        Some(taken) => Err(SplitError::Exists(taken.to.clone())),
        None => Ok(placements),
    }
}

fn is_scene(path: &Path) -> bool {
    let is_hidden = path.file_name().is_none_or(|name| name.to_string_lossy().starts_with('.'));
    let is_obj = |path: PathBuf| path.is_file() && path.extension().is_some_and(|e| e.eq_ignore_ascii_case("obj"));
    !is_hidden && fs::read_dir(path).is_ok_and(|entries| entries.flatten().any(|entry| is_obj(entry.path())))
}

/// Moves the scenes, or copies them. A folder appears whole or not at all.
///
/// # Errors
/// Naming the folder at which the file system refused; those before it are done.
pub fn carry_out(placements: &[Placement], copy: bool) -> Result<(), SplitError> {
    for Placement { from, to, .. } in placements {
        let parent = to.parent().unwrap_or(Path::new("."));
        let fail = |verb, path: &Path, hint| {
            let path = path.to_path_buf();
            move |source| SplitError::Io { verb, path, source, hint }
        };
        fs::create_dir_all(parent).map_err(fail("make", parent, ""))?;
        if copy {
            let name = to.file_name().unwrap_or_default().to_string_lossy();
            let partial = parent.join(format!(".{name}.partial-{}", std::process::id()));
            let copied = copy_folder(from, &partial).and_then(|()| fs::rename(&partial, to));
            copied.inspect_err(|_| drop(fs::remove_dir_all(&partial))).map_err(fail("copy", from, ""))?;
        } else {
            fs::rename(from, to).map_err(fail("move", from, "; to another disk, use --copy"))?;
        }
    }
    Ok(())
}

fn copy_folder(from: &Path, to: &Path) -> io::Result<()> {
    fs::create_dir_all(to)?;
    for entry in fs::read_dir(from)? {
        let entry = entry?;
        let target = to.join(entry.file_name());
        if entry.path().is_dir() {
            copy_folder(&entry.path(), &target)?;
        } else {
            fs::copy(entry.path(), target)?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scenes(count: usize) -> tempfile::TempDir {
        let dir = tempfile::tempdir().unwrap();
        for n in 0..count {
            let folder = dir.path().join(format!("scene_{n:02}"));
            fs::create_dir(&folder).unwrap();
            fs::write(folder.join("mesh.obj"), format!("# {n}")).unwrap();
        }
        fs::create_dir(dir.path().join("empty")).unwrap();
        dir
    }

    #[test]
    fn seventy_percent_are_trained_on_and_something_is_left() {
        assert_eq!([0, 1, 2, 3, 5, 10, 100].map(train_count), [0, 1, 1, 2, 4, 7, 70]);
    }

    #[test]
    fn a_split_follows_its_seed_and_overwrites_nothing() {
        let dir = scenes(10);
        let drawn = |seed| plan(dir.path(), dir.path(), seed).unwrap();
        assert_eq!(drawn(1), drawn(1));
        assert_ne!(drawn(1), drawn(2));
        let copy = tempfile::tempdir().unwrap();
        let copied = plan(dir.path(), copy.path(), 1).unwrap();
        carry_out(&copied, true).unwrap();
        assert!(dir.path().join("scene_00").is_dir(), "copies leave the originals");
        let all = drawn(1);
        carry_out(&all[8..], false).unwrap();
        assert!(matches!(plan(dir.path(), dir.path(), 1), Err(SplitError::Begun(part)) if part.ends_with("test")));
        carry_out(&all[..8], false).unwrap();
        let count = |root: &Path, part: &str| fs::read_dir(root.join(part)).unwrap().count();
        for root in [dir.path(), copy.path()] {
            assert_eq!((count(root, "train"), count(root, "test")), (7, 3));
        }
        let one = copied[0].to.join("mesh.obj");
        assert_eq!(fs::read(&one).unwrap(), fs::read(dir.path().join(one.strip_prefix(copy.path()).unwrap())).unwrap());
        let new = copy.path().join("new");
        assert!(matches!(plan(dir.path(), &new, 1), Err(SplitError::Few(_, 0))));
        let name = copied[0].to.file_name().unwrap();
        ["train", "test"].iter().for_each(|part| fs::create_dir_all(new.join(part).join(name)).unwrap());
        assert!(matches!(plan(&dir.path().join("train"), &new, 3), Err(SplitError::Exists(_))));
    }

    #[test]
    fn parts_have_the_names_in_use() {
        for (path, part) in [
            ("a/Training dataset/s", Some(Part::Train)),
            ("a/test_dataset/s", Some(Part::Test)),
            ("train/a/test/s", Some(Part::Test)),
            ("a/s/train", None),
        ] {
            assert_eq!(part_of(Path::new(path)), part, "{path}");
        }
    }
}
