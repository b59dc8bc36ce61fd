//! A bench on disk: what is to be computed, the cells that are there, and all of them as one result.
//!
//! `OUT/bench.json` says what belongs to the bench, with a fingerprint for everything that was to be computed.
//! `OUT/cells/SET/SCENE/ROW.json` has the episodes of one row of the table in one scene, from all starts under all seeds:
//! the unit of work, of sharding and of resuming. `OUT/scenes/SET/SCENE.json` has what is known of the scene itself. Each
//! file is written whole or not at all, and none is believed without its fingerprint and its checksum.

use super::FloorPlan;
use crate::registry::PolicyKind;
use crate::rollout::EpisodeRecord;
use crate::seal::{seal, unseal};
use nbp_env::Lattice;
use nbp_model::weights::write_atomic;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::{fs, io};

/// Name of the file that says what belongs to a bench.
pub const MANIFEST: &str = "bench.json";

/// What belongs to a bench: `bench.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// Of the program.
    pub version: String,
    /// Starts of each scene, at most.
    pub starts: usize,
    /// First of the seeds.
    pub seed: u64,
    /// Name of the row that others are compared with.
    pub reference: String,
    /// Whether it is measured what can be seen of each scene at all.
    pub visible: bool,
    /// Whether coverage is counted as the released code does, too.
    pub released: bool,
    /// Rows of the tables, in their order.
    pub rows: Vec<RowInfo>,
    /// Data sets, in their order.
    pub sets: Vec<SetPlan>,
}

/// A row of the tables: a policy with its network and settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RowInfo {
    /// In tables, and in [`EpisodeRecord::policy`].
    pub name: String,
    /// What kind of policy it is.
    pub policy: PolicyKind,
    /// Where its network is from, as given.
    pub checkpoint: Option<String>,
    /// Episodes from each start.
    pub seeds: usize,
    /// All settings, spelt out.
    pub settings: serde_json::Value,
}

impl RowInfo {
    /// Whether it looks at the true map, or at its mesh before a move.
    pub fn knows_map(&self) -> bool {
        self.policy.knows_map() || self.policy == PolicyKind::Nbp && self.settings["policy"]["oracle_edges"] == true
    }
}

/// A data set of a bench.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SetPlan {
    /// In tables and file names.
    pub name: String,
    /// Steps of an episode.
    pub steps: usize,
    /// Published figures by row.
    pub paper: BTreeMap<String, Published>,
    /// Its scenes, in their order.
    pub scenes: Vec<ScenePlan>,
}

/// Published figures of a row on a data set, 0 to 1: means, and standard deviations where they are known.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Published {
    /// Final Cov.
    pub coverage: f64,
    /// AUC.
    pub auc: f64,
    /// Standard deviation of Final Cov.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub coverage_std: Option<f64>,
    /// Standard deviation of AUC.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub auc_std: Option<f64>,
}

impl Published {
    /// The first figure that is no share, by its name.
    pub fn outside(&self) -> Option<(&'static str, f64)> {
        let means = [("coverage", Some(self.coverage)), ("auc", Some(self.auc))];
        let spreads = [("coverage_std", self.coverage_std), ("auc_std", self.auc_std)];
        let mut given = means.into_iter().chain(spreads).filter_map(|(key, value)| Some((key, value?)));
        given.find(|(_, value)| !(0.0..=1.0).contains(value))
    }
}

/// A scene of a bench.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScenePlan {
    /// In tables and file names; no other scene of the set has it.
    pub name: String,
    /// Starts that are used.
    pub starts: usize,
    /// Of [`SceneInfo`].
    pub fingerprint: String,
    /// Of the scene's cells, in the order of the rows.
    pub cells: Vec<String>,
}

/// What is known of a scene besides its episodes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneInfo {
    /// Name.
    pub name: String,
    /// Share of its surface that can be seen from the poses of its lattice, 0 to 1, where it was measured.
    pub visible: Option<f64>,
    /// From above.
    pub plan: FloorPlan,
    /// Where [`EpisodeRecord::poses`] are.
    pub lattice: Lattice,
}

/// A bench with all its episodes.
#[derive(Clone, Debug, PartialEq)]
pub struct BenchResult {
    /// What belongs to it.
    pub about: Manifest,
    /// Its data sets, in their order.
    pub sets: Vec<SetResult>,
}

/// A data set with all its episodes.
#[derive(Clone, Debug, PartialEq)]
pub struct SetResult {
    /// In tables and file names.
    pub name: String,
    /// Steps of an episode.
    pub steps: usize,
    /// Its scenes, in their order.
    pub scenes: Vec<SceneInfo>,
    /// By scene, row, start and seed.
    pub episodes: Vec<EpisodeRecord>,
}

/// A bench that cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// The disk said no.
    #[error("cannot {what} {path}: {source}", path = path.display())]
    Io {
        /// Read or write.
        what: &'static str,
        /// Which file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// No bench there.
    #[error("{folder} holds no bench: there is no {MANIFEST} in it", folder = .0.display())]
    None(PathBuf),
    /// Not the file that was written.
    #[error("{path} cannot be read: {reason}; remove it and run the bench again", path = path.display())]
    Damaged {
        /// Which file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// Some of it is still to be computed.
    #[error(
        "{folder} is not complete: {missing} of {total} files are missing, damaged or of other settings ({some}): run the bench, \
         or its other shards", folder = folder.display()
    )]
    Incomplete {
        /// Which bench.
        folder: PathBuf,
        /// Files that are not there.
        missing: usize,
        /// Files that should be.
        total: usize,
        /// The first few of the missing ones.
        some: String,
    },
}

/// A file of a bench.
#[derive(Clone, Debug, PartialEq)]
pub enum Found<T> {
    /// As it was written.
    Good(T),
    /// Not there.
    Missing,
    /// There, but cut short or changed.
    Damaged,
    /// Of other settings, another scene, network or program.
    Other,
}

impl Manifest {
    /// Of the bench in a folder.
    ///
    /// # Errors
    /// When there is none, or it cannot be read.
    pub fn read(folder: &Path) -> Result<Self, BenchError> {
        let path = folder.join(MANIFEST);
        let damaged = |reason: &str| Err(BenchError::Damaged { path: path.clone(), reason: reason.into() });
        match read_sealed::<Self>(&path, MANIFEST)? {
            Found::Missing => Err(BenchError::None(folder.into())),
            Found::Damaged | Found::Other => damaged("it is not as this program wrote it"),
            Found::Good(manifest) => match manifest.check() {
                Err(reason) => damaged(&reason),
                Ok(()) => Ok(manifest),
            },
        }
    }

    /// Writes `bench.json`.
    ///
    /// # Errors
    /// When the folder cannot be written to.
    pub fn write(&self, folder: &Path) -> Result<(), BenchError> {
        write_sealed(&folder.join(MANIFEST), MANIFEST, serde_json::to_string_pretty(self))
    }

    /// Every file that belongs to it, scene by scene: the scene's own first, its cells after it.
    pub fn files(&self) -> Vec<FileKey> {
        let of_set = |(set, plan): (usize, &SetPlan)| {
            let rows = self.rows.len();
            let of_scene = move |scene| {
                let cells = (0..rows).map(move |row| FileKey { set, scene, row: Some(row) });
                std::iter::once(FileKey { set, scene, row: None }).chain(cells)
            };
            (0..plan.scenes.len()).flat_map(of_scene).collect::<Vec<_>>()
        };
        self.sets.iter().enumerate().flat_map(of_set).collect()
    }

    /// The episodes of a cell, by start and seed.
    pub fn trials(&self, key: FileKey) -> Vec<(usize, u64)> {
        let starts = self.scene(key).map_or(0, |scene| scene.starts);
        let seeds = key.row.and_then(|row| self.rows.get(row)).map_or(0, |row| row.seeds as u64);
        (0..starts).flat_map(|start| (0..seeds).map(move |n| (start, self.seed.wrapping_add(n)))).collect()
    }

    /// Where a file lies, from the bench's folder.
    pub fn path(&self, key: FileKey) -> PathBuf {
        let set = self.sets.get(key.set).map_or("", |set| &set.name);
        let scene = self.scene(key).map_or("", |scene| &scene.name);
        match key.row.and_then(|row| self.rows.get(row)) {
            None => PathBuf::from(format!("scenes/{}/{}.json", file_name(set), file_name(scene))),
            Some(row) => {
                PathBuf::from(format!("cells/{}/{}/{}.json", file_name(set), file_name(scene), file_name(&row.name)))
            }
        }
    }

    fn scene(&self, key: FileKey) -> Option<&ScenePlan> {
        self.sets.get(key.set)?.scenes.get(key.scene)
    }

    fn fingerprint(&self, key: FileKey) -> &str {
        let scene = self.scene(key);
        let found = scene.and_then(|scene| match key.row {
            None => Some(&scene.fingerprint),
            Some(row) => scene.cells.get(row),
        });
        found.map_or("", String::as_str)
    }

    /// The episodes of a cell.
    ///
    /// # Errors
    /// When the file is there and cannot be read.
    pub fn read_cell(&self, folder: &Path, key: FileKey) -> Result<Found<Vec<EpisodeRecord>>, BenchError> {
        let found = read_sealed::<Vec<EpisodeRecord>>(&folder.join(self.path(key)), self.fingerprint(key))?;
        Ok(match found {
            Found::Good(records) if !self.is_whole(key, &records) => Found::Damaged,
            found => found,
        })
    }

    fn is_whole(&self, key: FileKey, records: &[EpisodeRecord]) -> bool {
        let trials = records.iter().map(|record| (record.start, record.seed));
        let steps = self.sets.get(key.set).map_or(0, |set| set.steps);
        let [scene, row] =
            [self.scene(key).map(|scene| &scene.name), key.row.and_then(|row| Some(&self.rows.get(row)?.name))];
        trials.eq(self.trials(key))
            && records.iter().all(|r| r.steps == steps && Some(&r.scene) == scene && Some(&r.policy) == row)
    }

    /// Writes the episodes of a cell.
    ///
    /// # Errors
    /// When the folder cannot be written to.
    pub fn write_cell(&self, folder: &Path, key: FileKey, records: &[EpisodeRecord]) -> Result<(), BenchError> {
        write_sealed(&folder.join(self.path(key)), self.fingerprint(key), serde_json::to_string(records))
    }

    /// What is known of a scene.
    ///
    /// # Errors
    /// When the file is there and cannot be read.
    pub fn read_scene(&self, folder: &Path, key: FileKey) -> Result<Found<SceneInfo>, BenchError> {
        read_sealed(&folder.join(self.path(key)), self.fingerprint(key))
    }

    /// Writes what is known of a scene.
    ///
    /// # Errors
    /// When the folder cannot be written to.
    pub fn write_scene(&self, folder: &Path, key: FileKey, info: &SceneInfo) -> Result<(), BenchError> {
        write_sealed(&folder.join(self.path(key)), self.fingerprint(key), serde_json::to_string(info))
    }
}

/// A file of a bench, by numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct FileKey {
    /// Data set.
    pub set: usize,
    /// Scene of the set.
    pub scene: usize,
    /// Row of the cell; none for the scene itself.
    pub row: Option<usize>,
}

impl BenchResult {
    /// Reads a bench that is complete.
    ///
    /// # Errors
    /// When there is none, or something is missing, damaged or of other settings: the first few files are named.
    pub fn load(folder: &Path) -> Result<Self, BenchError> {
        let about = Manifest::read(folder)?;
        let files = about.files();
        let set = |plan: &SetPlan| SetResult {
            name: plan.name.clone(),
            steps: plan.steps,
            scenes: Vec::new(),
            episodes: Vec::new(),
        };
        let mut sets: Vec<SetResult> = about.sets.iter().map(set).collect();
        let mut missing = Vec::new();
        for &key in &files {
            let is_good = match (key.row, &mut sets[key.set]) {
                (None, set) => match about.read_scene(folder, key)? {
                    Found::Good(info) => {
                        set.scenes.push(info);
                        true
                    }
                    _ => false,
                },
                (Some(_), set) => match about.read_cell(folder, key)? {
                    Found::Good(episodes) => {
                        set.episodes.extend(episodes);
                        true
                    }
                    _ => false,
                },
            };
            if !is_good {
                missing.push(about.path(key));
            }
        }
        if missing.is_empty() { Ok(Self { about, sets }) } else { Err(incomplete(folder, &missing, files.len())) }
    }
}

/// A bench of which `missing` is not there.
pub fn incomplete(folder: &Path, missing: &[PathBuf], total: usize) -> BenchError {
    let names: Vec<String> = missing.iter().take(3).map(|path| path.display().to_string()).collect();
    let some = names.join(", ") + if missing.len() > 3 { ", …" } else { "" };
    BenchError::Incomplete { folder: folder.into(), missing: missing.len(), total, some }
}

/// A name as part of a path: what could lead elsewhere is written as `%` and two hexadecimal digits for each byte.
pub fn file_name(name: &str) -> String {
    let is_plain =
        |at: usize, byte: u8| byte.is_ascii_alphanumeric() || b"-_+ ".contains(&byte) || byte == b'.' && at > 0;
    let one = |(at, byte): (usize, u8)| match is_plain(at, byte) {
        true => char::from(byte).to_string(),
        false => format!("%{byte:02x}"),
    };
    name.bytes().enumerate().map(one).collect()
}

fn write_sealed(path: &Path, fingerprint: &str, content: serde_json::Result<String>) -> Result<(), BenchError> {
    let write = || {
        let text = seal(fingerprint, &content?) + "\n";
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder)?;
        }
        write_atomic(path, text.as_bytes())
    };
    write().map_err(|source| BenchError::Io { what: "write", path: path.into(), source })
}

fn read_sealed<T: DeserializeOwned>(path: &Path, fingerprint: &str) -> Result<Found<T>, BenchError> {
    let bytes = match fs::read(path) {
        Ok(bytes) => bytes,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Found::Missing),
        Err(source) => return Err(BenchError::Io { what: "read", path: path.into(), source }),
    };
    let text = std::str::from_utf8(&bytes).ok().and_then(|text| text.strip_suffix('\n'));
    Ok(match text.and_then(unseal) {
        None => Found::Damaged,
        Some((found, _)) if found != fingerprint => Found::Other,
        Some((_, content)) => serde_json::from_str(content).map_or(Found::Damaged, Found::Good),
    })
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::export;
    use nbp_env::Scene;

    /// One set of one scene with two rows, the second with two seeds.
    pub(crate) fn manifest() -> Manifest {
        let row = |policy: PolicyKind, seeds| RowInfo {
            name: policy.name().to_owned(),
            policy,
            checkpoint: None,
            seeds,
            settings: serde_json::json!({"sim": {"keep": 0.05}}),
        };
        let scene = ScenePlan {
            name: "two_rooms".into(),
            starts: 2,
            fingerprint: "s".into(),
            cells: vec!["a".into(), "b".into()],
        };
        Manifest {
            version: "1".into(),
            starts: 2,
            seed: 7,
            reference: "fbe".into(),
            visible: true,
            released: false,
            rows: vec![row(PolicyKind::Fbe, 1), row(PolicyKind::Random, 2)],
            sets: vec![SetPlan { name: "simple".into(), steps: 2, paper: BTreeMap::new(), scenes: vec![scene] }],
        }
    }

    pub(crate) fn record(policy: &str, start: usize, seed: u64) -> EpisodeRecord {
        EpisodeRecord { scene: "two_rooms".into(), policy: policy.into(), start, seed, ..export::tests::record() }
    }

    /// Writes a complete bench.
    pub(crate) fn write(folder: &Path) -> BenchResult {
        let about = manifest();
        about.write(folder).unwrap();
        let scene = Scene::two_rooms();
        let plan = FloorPlan::of(&scene);
        let info = SceneInfo { name: "two_rooms".into(), visible: Some(0.75), plan, lattice: *scene.lattice() };
        let mut episodes = Vec::new();
        for key in about.files() {
            match key.row {
                None => about.write_scene(folder, key, &info).unwrap(),
                Some(row) => {
                    let name = &about.rows[row].name;
                    let records: Vec<_> =
                        about.trials(key).into_iter().map(|(start, seed)| record(name, start, seed)).collect();
                    about.write_cell(folder, key, &records).unwrap();
                    episodes.extend(records);
                }
            }
        }
        let set = SetResult { name: "simple".into(), steps: 2, scenes: vec![info], episodes };
        BenchResult { about, sets: vec![set] }
    }

    #[test]
    fn what_was_written_comes_back() {
        let dir = tempfile::tempdir().unwrap();
        let written = write(dir.path());
        assert_eq!(written.sets[0].episodes.len(), 6);
        assert_eq!(BenchResult::load(dir.path()).unwrap(), written);
        assert!(dir.path().join("cells/simple/two_rooms/random.json").is_file());
        let whole: serde_json::Value =
            serde_json::from_slice(&fs::read(dir.path().join("cells/simple/two_rooms/fbe.json")).unwrap()).unwrap();
        assert_eq!(whole["content"][0]["policy"], "fbe", "other programs read it as JSON");
    }

    #[test]
    fn what_is_not_whole_is_refused_by_name() {
        let dir = tempfile::tempdir().unwrap();
        let message = || BenchResult::load(dir.path()).unwrap_err().to_string();
        assert!(message().contains("holds no bench"), "{}", message());
        let about = write(dir.path()).about;
        let key = FileKey { set: 0, scene: 0, row: Some(1) };
        let cell = dir.path().join(about.path(key));
        let bytes = fs::read(&cell).unwrap();
        let found = |bytes: &[u8]| {
            fs::write(&cell, bytes).unwrap();
            let found = about.read_cell(dir.path(), key).unwrap();
            assert!(message().contains("1 of 3 files") && message().contains("random.json"), "{}", message());
            found
        };
        assert_eq!(found(&bytes[..bytes.len() / 2]), Found::Damaged);
        let text = String::from_utf8(bytes).unwrap();
        assert_eq!(found(text.replacen("0.25", "0.35", 1).as_bytes()), Found::Damaged);
        assert_eq!(found(text.replace("\"b\"", "\"c\"").as_bytes()), Found::Other);
        // A cell that lacks an episode is none, though nothing is wrong with its bytes.
        about.write_cell(dir.path(), key, &[record("random", 0, 7)]).unwrap();
        assert_eq!(about.read_cell(dir.path(), key).unwrap(), Found::Damaged);
        fs::remove_file(&cell).unwrap();
        assert_eq!(about.read_cell(dir.path(), key).unwrap(), Found::Missing);
        fs::write(dir.path().join(MANIFEST), "{").unwrap();
        assert!(message().contains("bench.json cannot be read"), "{}", message());
        about.write(dir.path()).unwrap();
        let text = fs::read_to_string(dir.path().join(MANIFEST)).unwrap();
        fs::write(dir.path().join(MANIFEST), text.replacen("\"seed\": 7", "\"seed\": 8", 1)).unwrap();
        assert!(message().contains("not as this program wrote it"), "{}", message());
    }

    #[test]
    fn names_stay_in_their_folder() {
        assert_eq!(file_name("fbe-tsp 2.5"), "fbe-tsp 2.5");
        assert_eq!([file_name("../a"), file_name("a/b\\é")], ["%2e.%2fa", "a%2fb%5c%c3%a9"]);
    }
}
