//! Maps to train on: generated from a seed, or read from disk.

use crate::log::Bars;
use anyhow::{Context as _, Result, anyhow};
use nbp_dataset::generate::{Level, generate};
use nbp_env::config::SimError;
use nbp_env::parallel::try_map;
use nbp_env::scene::LoadOptions;
use nbp_env::{Scene, SimConfig, World};
use nbp_infer::source;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::sync::Arc;

/// Training and held-out maps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ScenesConfig {
    /// Maps to learn from (paper: 70 a level).
    pub train: SceneSet,
    /// Maps that are never learnt from, for the final table (paper: 30 a level).
    pub held_out: SceneSet,
    /// Maps that are never learnt from, walked once after every iteration: the best weights are those that cover most, soonest.
    /// None by default: the best are those with the least loss (released code).
    pub validation: SceneSet,
}

impl Default for ScenesConfig {
    fn default() -> Self {
        Self {
            train: SceneSet::generated(70, 1),
            held_out: SceneSet::generated(30, 1_000_001),
            validation: SceneSet::default(),
        }
    }
}

/// A set of maps: generated, or read from disk.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SceneSet {
    /// Level of generated maps: `simple`, `normal`, `hard`, `insane`; or `mixed`, one of each in turn.
    pub level: String,
    /// Number of generated maps; of `paths`, the first so many (0: all).
    pub count: usize,
    /// Seed of the first generated map; the next ones count up.
    pub seed: u64,
    /// Scene folders, folders of scenes, OBJ or WAD files. Empty: generate.
    pub paths: Vec<PathBuf>,
}

impl SceneSet {
    fn generated(count: usize, seed: u64) -> Self {
        Self { level: "simple".into(), count, seed, paths: Vec::new() }
    }

    /// Whether there are no maps in it.
    pub fn is_empty(&self) -> bool {
        self.count == 0 && self.paths.is_empty()
    }

    /// Levels of generated maps, which take turns.
    ///
    /// # Errors
    /// Naming the levels that there are.
    pub fn levels(&self) -> Result<Vec<Level>, String> {
        if self.level == "mixed" { Ok(Level::ALL.to_vec()) } else { self.level.parse().map(|level| vec![level]) }
    }

    /// Whether both sets generate a map of the same level and seed.
    pub(crate) fn overlaps(&self, other: &Self) -> bool {
        let seeds = |set: &Self| set.seed..set.seed.saturating_add(set.count as u64);
        let (a, b) = (seeds(self), seeds(other));
        let levels = |set: &Self| set.levels().unwrap_or_default();
        let is_shared = levels(self).iter().any(|level| levels(other).contains(level));
        let are_generated = self.paths.is_empty() && other.paths.is_empty() && is_shared;
        are_generated && a.start < b.end && b.start < a.end
    }
}

impl Default for SceneSet {
    fn default() -> Self {
        Self::generated(0, 1)
    }
}

/// Makes the worlds of a set, in its order.
///
/// # Errors
/// When a map cannot be generated or read, or has no free pose.
pub fn load(set: &SceneSet, sim: &SimConfig, what: &str, bars: Bars) -> Result<Vec<Arc<World>>> {
    let scenes = if set.paths.is_empty() { generated(set, what, bars)? } else { read(set)? };
    let worlds: Vec<Result<World, SimError>> = scenes.into_par_iter().map(|scene| World::new(scene, sim)).collect();
    worlds.into_iter().map(|world| Ok(Arc::new(world?))).collect()
}

fn generated(set: &SceneSet, what: &str, bars: Bars) -> Result<Vec<Scene>> {
    let levels = set.levels().map_err(|reason| anyhow!("{what}: {reason}"))?;
    let maps: Vec<(Level, u64)> = levels.into_iter().cycle().zip(set.seed..).take(set.count).collect();
    let bar = bars.start(what, maps.len());
    let scenes = try_map(&maps, |&(level, seed)| -> Result<Scene> {
        let map =
            generate(level, seed).with_context(|| format!("generating the {} map of seed {seed}", level.name()))?;
        bar.advance(map.scene.name.clone());
        // Training sees no colours.
        let scene = nbp_dataset::SceneBundle { mesh: map.scene.mesh.bare(), ..map.scene };
        Ok(nbp_dataset::to_scene(scene)?)
    })?;
    bar.finish();
    Ok(scenes)
}

fn read(set: &SceneSet) -> Result<Vec<Scene>> {
    let paths: Vec<String> = set.paths.iter().map(|path| path.display().to_string()).collect();
    let mut scenes = source::load_all(&paths, LoadOptions::default(), |_| ())?;
    if set.count > 0 {
        scenes.truncate(set.count);
    }
    Ok(scenes)
}
