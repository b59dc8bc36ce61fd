//! From rows and scenes to what is to be computed, and what of it is there already.

use super::limits::check_names;
use super::store::{BenchError, FileKey, Found, Manifest, Published, RowInfo, ScenePlan, SetPlan};
use crate::checkpoint::{Settings, difference, plain};
use crate::journal::{BEHAVIOUR, of_scene};
use crate::registry::PolicyKind;
use crate::seal::hash;
use nbp_env::encode::EncodeConfig;
use nbp_env::{Scene, SimConfig};
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A row of the tables, settings resolved.
#[derive(Clone, Debug)]
pub struct Row {
    /// In tables.
    pub name: String,
    /// Kind of policy.
    pub kind: PolicyKind,
    /// Episodes from each start.
    pub seeds: usize,
    /// All settings.
    pub settings: Settings,
    /// Where its network is from, as given.
    pub checkpoint: Option<PathBuf>,
    /// Its network in each data set, in their order.
    pub networks: Vec<Weights>,
}

/// A network of a row.
#[derive(Clone, Debug)]
pub struct Weights {
    /// Where it is from; nowhere for policies that ask none.
    pub checkpoint: Option<PathBuf>,
    /// Where its obstacle map is from, if from another network.
    pub obstacle_checkpoint: Option<PathBuf>,
    hash: u64,
}

impl Weights {
    /// Of where they are from and their bytes, which are none for policies that ask no network.
    pub fn new((checkpoint, obstacle_checkpoint): (Option<PathBuf>, Option<PathBuf>), bytes: &[u8]) -> Self {
        Self { checkpoint, obstacle_checkpoint, hash: hash(bytes) }
    }
}

/// A data set, scenes read.
#[derive(Debug)]
pub struct DataSet {
    /// In tables.
    pub name: String,
    /// Steps of an episode.
    pub steps: usize,
    /// Published figures.
    pub paper: BTreeMap<String, Published>,
    /// Its scenes.
    pub scenes: Vec<Scene>,
}

/// What holds for a whole bench.
#[derive(Clone, Debug)]
pub struct Terms {
    /// Starts of each scene, at most.
    pub starts: usize,
    /// First of the seeds.
    pub seed: u64,
    /// Row that others are compared with.
    pub reference: String,
    /// Whether to measure what can be seen.
    pub visible: bool,
    /// Whether to count as the released code does, besides.
    pub released: bool,
}

/// Rows that cannot be compared, or nothing to compare them on.
#[derive(Debug, thiserror::Error)]
pub enum PlanError {
    /// Not the same task.
    #[error(
        "rows {first} and {second} are not compared on equal terms: {key} is {first_value} and {second_value}; set it for all \
         of them under [sim] of the bench's configuration"
    )]
    Unequal {
        /// A row.
        first: String,
        /// Another row.
        second: String,
        /// Setting of the simulator.
        key: String,
        /// That of the first.
        first_value: String,
        /// That of the second.
        second_value: String,
    },
    /// Names are how episodes are told apart, and name files.
    #[error("data set {set}: {reason}")]
    Names {
        /// Data set.
        set: String,
        /// What is wrong with one.
        reason: String,
    },
    /// Nowhere to start from.
    #[error("data set {set}: scene {scene} has no start poses")]
    NoStarts {
        /// Data set.
        set: String,
        /// Scene.
        scene: String,
    },
    /// Nothing at all.
    #[error("data set {0} has no scenes")]
    NoScenes(String),
    /// A setting that JSON cannot hold.
    #[error("a setting has no JSON form: {0}")]
    Json(#[from] serde_json::Error),
}

/// The simulator of a row without what its network alone looks at.
fn terms_of(sim: &SimConfig) -> SimConfig {
    SimConfig { encode: EncodeConfig::default(), ..sim.clone() }
}

/// Whether all rows face the same task; what their networks see of the agent's map may differ.
///
/// # Errors
/// Naming two rows and the setting that differs.
pub fn check_equal_terms(rows: &[Row]) -> Result<(), PlanError> {
    let Some(first) = rows.first() else { return Ok(()) };
    let ours = plain(&terms_of(&first.settings.sim))?;
    for row in rows {
        if let Some((key, ours, theirs)) = difference("sim", &ours, &plain(&terms_of(&row.settings.sim))?) {
            return Err(PlanError::Unequal {
                first: first.name.clone(),
                second: row.name.clone(),
                key,
                first_value: ours.to_string(),
                second_value: theirs.to_string(),
            });
        }
    }
    Ok(())
}

/// What settings say beyond the usual ones, which may have more keys; `None` for nothing. A table that says of which kind it is
/// counts as a whole.
fn beyond(usual: &Value, settings: &Value) -> Option<Value> {
    let is_whole = |table: &serde_json::Map<String, Value>| table.contains_key("kind") || table.contains_key("rule");
    match (usual, settings) {
        (Value::Object(usual), Value::Object(settings)) if !is_whole(settings) => {
            let part = |(key, value): (&String, &Value)| {
                let said = usual.get(key).map_or_else(|| Some(value.clone()), |usual| beyond(usual, value));
                said.map(|said| (key.clone(), said))
            };
            let parts: serde_json::Map<String, Value> = settings.iter().filter_map(part).collect();
            (!parts.is_empty()).then(|| parts.into())
        }
        _ => (usual != settings).then(|| settings.clone()),
    }
}

impl Manifest {
    /// What a bench has to compute, everything that each part depends on in its fingerprint.
    ///
    /// # Errors
    /// When rows are not comparable, or there is nothing to compare them on.
    pub fn new(terms: &Terms, rows: &[Row], sets: &[DataSet]) -> Result<Self, PlanError> {
        check_equal_terms(rows)?;
        let version = format!("{}.{BEHAVIOUR}", env!("CARGO_PKG_VERSION"));
        let print = |text: String| format!("{:016x}", hash(text.as_bytes()));
        let infos = rows.iter().map(|row| {
            Ok(RowInfo {
                name: row.name.clone(),
                policy: row.kind,
                checkpoint: row.checkpoint.as_ref().map(|path| path.display().to_string()),
                seeds: row.seeds,
                settings: plain(&row.settings)?,
            })
        });
        let infos: Vec<RowInfo> = infos.collect::<Result<_, PlanError>>()?;
        // A setting that is new, and at its default changes nothing, leaves what was computed before it in force.
        let usual = plain(&Settings::default())?;
        let unusual: Vec<Value> = infos.iter().map(|info| beyond(&usual, &info.settings).unwrap_or_default()).collect();
        let sim = rows.first().map(|row| plain(&terms_of(&row.settings.sim))).transpose()?;
        let sim = sim.and_then(|sim| beyond(&usual["sim"], &sim)).unwrap_or_default();
        let Terms { starts, seed, visible, released, .. } = *terms;
        let scene_plan = |number: usize, set: &DataSet, scene: &Scene| {
            let of_scene = of_scene(scene);
            let starts = scene.starts().len().min(starts);
            let cell = |((info, row), settings): ((&RowInfo, &Row), &Value)| {
                let RowInfo { name, policy, seeds, .. } = info;
                let weights = row.networks[number].hash;
                let trial = format!("{starts} {} {seed} {seeds} {released}", set.steps);
                print(format!("{version} {of_scene:016x} {trial} {name} {policy} {weights:016x} {settings}"))
            };
            ScenePlan {
                name: scene.name().to_owned(),
                starts,
                fingerprint: print(format!("{version} {of_scene:016x} {sim} {visible}")),
                cells: infos.iter().zip(rows).zip(&unusual).map(cell).collect(),
            }
        };
        let set_plan = |(number, set): (usize, &DataSet)| {
            check_scenes(set)?;
            let scenes = set.scenes.iter().map(|scene| scene_plan(number, set, scene)).collect();
            Ok(SetPlan { name: set.name.clone(), steps: set.steps, paper: set.paper.clone(), scenes })
        };
        let sets = sets.iter().enumerate().map(set_plan).collect::<Result<Vec<_>, PlanError>>()?;
        let reference = terms.reference.clone();
        Ok(Self { version, starts, seed, reference, visible, released, rows: infos, sets })
    }

    /// Whether another one is of the same bench: where a network is from does not matter, its bytes do.
    pub fn is_of(&self, other: &Self) -> bool {
        let nameless = |manifest: &Self| {
            let mut manifest = manifest.clone();
            manifest.rows.iter_mut().for_each(|row| row.checkpoint = None);
            manifest
        };
        nameless(self) == nameless(other)
    }

    /// What another bench, in the same folder before, had and this one would lose: its tables would be smaller.
    pub fn lacks(&self, old: &Self) -> Option<String> {
        let fewer = |what: &str, new: usize, old: usize| (new < old).then(|| format!("{old} {what}, not {new}"));
        let rows = old.rows.iter().find_map(|row| match self.rows.iter().find(|new| new.name == row.name) {
            None => Some(format!("row {}", row.name)),
            Some(new) => fewer(&format!("seeds of row {}", row.name), new.seeds, row.seeds),
        });
        let sets = || {
            old.sets.iter().find_map(|set| {
                let Some(new) = self.sets.iter().find(|new| new.name == set.name) else {
                    return Some(format!("data set {}", set.name));
                };
                let lost = set.scenes.iter().find(|scene| !new.scenes.iter().any(|new| new.name == scene.name));
                let lost = lost.map(|scene| format!("scene {} of data set {}", scene.name, set.name));
                let figures = set.paper.keys().find(|row| !new.paper.contains_key(*row));
                let figures = figures.map(|row| format!("published figures of {row} on data set {}", set.name));
                let steps = || fewer(&format!("steps on data set {}", set.name), new.steps, set.steps);
                lost.or(figures).or_else(steps)
            })
        };
        let columns = [
            (old.visible && !self.visible, "coverage as a share of what is visible"),
            (old.released && !self.released, "coverage as the released code counts it"),
        ];
        let column = || columns.iter().find(|(is_lost, _)| *is_lost).map(|(_, what)| (*what).to_owned());
        rows.or_else(sets).or_else(|| fewer("starts", self.starts, old.starts)).or_else(column)
    }

    /// The files that shard `shard` of `shards` (from 0) has to see to. Neighbours in both scenes and rows go to different
    /// shards, so that each gets its share of large scenes and of slow rows.
    pub fn shard(&self, shard: usize, shards: usize) -> Vec<FileKey> {
        let mut scenes = Vec::new();
        let mut number = |key: &FileKey| {
            if scenes.last() != Some(&(key.set, key.scene)) {
                scenes.push((key.set, key.scene));
            }
            scenes.len() + key.row.map_or(0, |row| row + 1)
        };
        self.files().into_iter().filter(|key| number(key) % shards.max(1) == shard).collect()
    }
}

fn check_scenes(set: &DataSet) -> Result<(), PlanError> {
    if set.scenes.is_empty() {
        return Err(PlanError::NoScenes(set.name.clone()));
    }
    if let Some(scene) = set.scenes.iter().find(|scene| scene.starts().is_empty()) {
        return Err(PlanError::NoStarts { set: set.name.clone(), scene: scene.name().to_owned() });
    }
    check_names("scenes", set.scenes.iter().map(Scene::name))
        .map_err(|reason| PlanError::Names { set: set.name.clone(), reason })
}

/// What is there of some files.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Survey {
    /// Still to be computed.
    pub open: Vec<FileKey>,
    /// Among them, files of other settings.
    pub other: Vec<PathBuf>,
    /// Among them, files that are damaged.
    pub damaged: Vec<PathBuf>,
}

/// Looks at files of a bench in a folder.
///
/// # Errors
/// When one is there and cannot be read.
pub fn survey(folder: &Path, manifest: &Manifest, files: &[FileKey]) -> Result<Survey, BenchError> {
    let mut survey = Survey::default();
    for &key in files {
        let found = match key.row {
            None => kind_of(manifest.read_scene(folder, key)?),
            Some(_) => kind_of(manifest.read_cell(folder, key)?),
        };
        match found {
            Found::Good(()) => continue,
            Found::Missing => (),
            Found::Other => survey.other.push(manifest.path(key)),
            Found::Damaged => survey.damaged.push(manifest.path(key)),
        }
        survey.open.push(key);
    }
    Ok(survey)
}

fn kind_of<T>(found: Found<T>) -> Found<()> {
    match found {
        Found::Good(_) => Found::Good(()),
        Found::Missing => Found::Missing,
        Found::Damaged => Found::Damaged,
        Found::Other => Found::Other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn what_is_usual_is_not_said() {
        let usual = json!({"sim": {"keep": 0.05, "agent": {"kind": "lattice"}}, "policy": {"new": 1.0, "within": null, "most": 3}});
        let said = |settings: Value| beyond(&usual, &settings);
        assert_eq!(said(usual.clone()), None);
        assert_eq!(said(json!({"sim": {"keep": 0.05}, "policy": {}})), None, "older settings had fewer keys");
        assert_eq!(
            said(json!({"policy": {"within": 2.0, "most": null}})),
            Some(json!({"policy": {"within": 2.0, "most": null}}))
        );
        let robot = json!({"kind": "continuous", "step": 0.1});
        assert_eq!(said(json!({"sim": {"keep": 0.05, "agent": robot}})), Some(json!({"sim": {"agent": robot}})));
    }
}
