//! Maps to train on: generated from a seed, or read from disk.

use crate::config::SceneSet;
use crate::log::Bars;
use anyhow::{Context as _, Result, anyhow};
use nbp_dataset::generate::{Level, generate};
use nbp_env::config::SimError;
use nbp_env::parallel::try_map;
use nbp_env::scene::LoadOptions;
use nbp_env::{Scene, SimConfig, World};
use nbp_infer::source;
use rayon::prelude::*;
use std::sync::Arc;

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
