//! The work: episodes of open cells on as many threads as there are, each cell written as its last episode ends.
//!
//! Threads take episode after episode, not cell after cell: all of them work on the same few cells, so that little is lost
//! when the program is stopped, and the last cell does not leave them idle. Worlds are built before, so that a scene that cannot
//! be used is told before anything changes on disk; a scene's world is gone after its last episode.

use super::FloorPlan;
use super::plan::Row;
use super::store::{BenchError, FileKey, Manifest, SceneInfo};
use crate::registry::{self, Network, PolicyContext, RegistryError};
use crate::rollout::{EpisodeRecord, RolloutError, Trial, go_on};
use nbp_env::config::SimError;
use nbp_env::{Scene, SimConfig, World, parallel};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// Work that broke off.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// A file.
    #[error(transparent)]
    Bench(#[from] BenchError),
    /// A scene and the settings.
    #[error(transparent)]
    World(#[from] SimError),
    /// A policy cannot be built.
    #[error("row {row}: {source}")]
    Registry {
        /// Row.
        row: String,
        /// Why.
        source: RegistryError,
    },
    /// An episode failed.
    #[error("row {row}: {source}")]
    Rollout {
        /// Row.
        row: String,
        /// Why.
        source: Box<RolloutError>,
    },
    /// A scene that was not handed over.
    #[error("scene {0} was not read")]
    NoScene(String),
}

/// Coverage is counted as the released code does in every so many steps: in each it would cost more than to simulate them.
const RELEASED_EVERY: usize = 5;

/// How cells are computed, besides what the manifest says.
#[derive(Clone, Copy, Debug)]
pub struct Measures {
    /// What can be seen of each scene at all.
    pub visible: bool,
    /// Coverage as the released code counts it.
    pub released: bool,
}

/// A row at work.
pub struct Runner {
    /// What is built from the settings and the network, for each data set in turn.
    pub contexts: Vec<PolicyContext>,
    /// The simulator.
    pub sim: SimConfig,
}

impl Runner {
    /// Of a row and its network in each data set, where there is something to do.
    pub fn new(row: &Row, networks: Vec<Option<Network>>) -> Self {
        let context = |network| {
            let context = PolicyContext::new(&row.settings);
            match network {
                Some(network) => context.with(row.kind, network, row.settings.nbv),
                None => context,
            }
        };
        Self { contexts: networks.into_iter().map(context).collect(), sim: row.settings.sim.clone() }
    }
}

/// Data set and scene, by numbers.
pub type Place = (usize, usize);

/// Scenes ready for episodes.
///
/// # Errors
/// When a scene and the settings do not go together.
pub fn worlds(scenes: BTreeMap<Place, Scene>, sim: &SimConfig) -> Result<BTreeMap<Place, Arc<World>>, SimError> {
    scenes.into_par_iter().map(|(place, scene)| Ok((place, Arc::new(World::new(scene, sim)?)))).collect()
}

/// What is left to do in a scene.
struct Site {
    worlds: Vec<Arc<World>>,
    jobs: usize,
}

/// A cell under way.
struct Cell {
    key: FileKey,
    records: Mutex<Vec<Option<EpisodeRecord>>>,
    left: AtomicUsize,
}

enum Job<'a> {
    Look(FileKey),
    Walk { cell: &'a Cell, number: usize, start: usize, seed: u64 },
}

struct Work<'a> {
    folder: &'a Path,
    manifest: &'a Manifest,
    runners: &'a [Runner],
    measures: Measures,
    sites: BTreeMap<Place, Mutex<Site>>,
}

/// Computes the files of `open`. `worlds` has the scenes that they are of, `runners` the rows, in their order. `on_steps` is called
/// with the number of steps of each episode that ends.
///
/// # Errors
/// When a cell cannot be written or an episode fails; episodes that are under way finish, cells that are done stay.
pub fn run(
    folder: &Path,
    manifest: &Manifest,
    worlds: BTreeMap<Place, Arc<World>>,
    runners: &[Runner],
    measures: Measures,
    open: &[FileKey],
    on_steps: impl Fn(usize) + Sync,
) -> Result<(), RunError> {
    let cell = |&key: &FileKey| {
        let count = manifest.trials(key).len();
        Cell { key, records: Mutex::new(vec![None; count]), left: AtomicUsize::new(count) }
    };
    let cells: Vec<Cell> = open.iter().map(cell).collect();
    let mut jobs = Vec::new();
    for cell in &cells {
        match cell.key.row {
            None => jobs.push(Job::Look(cell.key)),
            Some(_) => {
                let trials = manifest.trials(cell.key).into_iter().enumerate();
                jobs.extend(trials.map(|(number, (start, seed))| Job::Walk { cell, number, start, seed }));
            }
        }
    }
    let site = |(place, world)| (place, Mutex::new(Site { worlds: vec![world], jobs: 0 }));
    let mut sites: BTreeMap<_, Mutex<Site>> = worlds.into_iter().map(site).collect();
    for job in &jobs {
        if let Some(site) = sites.get_mut(&job.place()) {
            site.get_mut().unwrap_or_else(PoisonError::into_inner).jobs += 1;
        }
    }
    let work = Work { folder, manifest, runners, measures, sites };
    parallel::try_map(&jobs, |job| {
        work.perform(job)?;
        work.leave(job.place());
        on_steps(manifest.steps_of(job.key()));
        Ok::<_, RunError>(())
    })?;
    Ok(())
}

impl Job<'_> {
    fn key(&self) -> FileKey {
        match self {
            Self::Look(key) => *key,
            Self::Walk { cell, .. } => cell.key,
        }
    }

    fn place(&self) -> Place {
        (self.key().set, self.key().scene)
    }
}

impl Manifest {
    /// Steps of each episode of a cell; a look at a scene has none.
    pub fn steps_of(&self, key: FileKey) -> usize {
        key.row.and_then(|_| self.sets.get(key.set)).map_or(0, |set| set.steps)
    }
}

impl Work<'_> {
    fn perform(&self, job: &Job<'_>) -> Result<(), RunError> {
        match *job {
            Job::Look(key) => Ok(self.manifest.write_scene(self.folder, key, &self.look(key)?)?),
            Job::Walk { cell, number, start, seed } => {
                let trial = Trial { start, seed, steps: self.manifest.steps_of(cell.key) };
                let record = self.walk(cell.key, trial)?;
                let mut records = cell.records.lock().unwrap_or_else(PoisonError::into_inner);
                records[number] = Some(record);
                if cell.left.fetch_sub(1, Ordering::Relaxed) == 1 {
                    let records: Vec<EpisodeRecord> = records.drain(..).flatten().collect();
                    self.manifest.write_cell(self.folder, cell.key, &records)?;
                }
                Ok(())
            }
        }
    }

    fn look(&self, key: FileKey) -> Result<SceneInfo, RunError> {
        let world = self.world(key, 0)?;
        let visible = || world.visibility().visible().len() as f64 / world.surface().len() as f64;
        let scene = world.scene();
        Ok(SceneInfo {
            name: scene.name().to_owned(),
            visible: self.measures.visible.then(visible),
            plan: FloorPlan::of(scene),
            lattice: *scene.lattice(),
        })
    }

    fn walk(&self, key: FileKey, trial: Trial) -> Result<EpisodeRecord, RunError> {
        let number = key.row.unwrap_or_default();
        let (row, runner) = (&self.manifest.rows[number], &self.runners[number]);
        let world = self.world(key, number)?;
        let of_row = |source| RunError::Rollout { row: row.name.clone(), source: Box::new(source) };
        let mut policy = registry::build(row.policy, &runner.contexts[key.set], &world)
            .map_err(|source| RunError::Registry { row: row.name.clone(), source })?;
        let mut episode = trial.episode(&world).map_err(of_row)?;
        if self.measures.released {
            episode.count_as_released(RELEASED_EVERY);
        }
        let record = go_on(episode, policy.as_mut(), trial, |_, _| Ok(())).map_err(of_row)?.record;
        Ok(EpisodeRecord { policy: row.name.clone(), ..record })
    }

    /// The scene as a row's network sees it; other views of it are built by whoever needs them first.
    fn world(&self, key: FileKey, row: usize) -> Result<Arc<World>, RunError> {
        let name = || self.manifest.sets[key.set].scenes[key.scene].name.clone();
        let site = self.sites.get(&(key.set, key.scene)).ok_or_else(|| RunError::NoScene(name()))?;
        let mut site = site.lock().unwrap_or_else(PoisonError::into_inner);
        let encode = self.runners[row].sim.encode;
        if let Some(world) = site.worlds.iter().find(|world| world.config().encode == encode) {
            return Ok(Arc::clone(world));
        }
        let first = site.worlds.first().ok_or_else(|| RunError::NoScene(name()))?;
        let world = Arc::new(first.with_encode(encode)?);
        site.worlds.push(Arc::clone(&world));
        Ok(world)
    }

    /// One job less in a scene; after its last, it is gone.
    fn leave(&self, place: Place) {
        if let Some(site) = self.sites.get(&place) {
            let mut site = site.lock().unwrap_or_else(PoisonError::into_inner);
            site.jobs -= 1;
            if site.jobs == 0 {
                site.worlds.clear();
            }
        }
    }
}
