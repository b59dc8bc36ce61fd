//! What an episode says that it holds is what the allocator has given it.

#![allow(clippy::unwrap_used)] // helpers of tests are tests

use nbp_env::{Action, Episode, Heading, LatticePose, Node, Scene, SeedTree, SimConfig, World};
use peak_alloc::PeakAlloc;
use std::sync::Arc;

#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

/// An episode that has looked around from one place.
fn looked_around(world: &Arc<World>, steps: usize) -> Episode {
    let start = LatticePose { node: Node { i: 1, k: 2 }, heading: Heading::new(0) };
    let mut episode = Episode::new(Arc::clone(world), start, steps, SeedTree::new(1)).unwrap();
    for heading in (1..=steps).map(Heading::new) {
        episode.step(Action { direction: None, heading });
    }
    episode
}

#[test]
fn an_episode_tells_its_memory() {
    let world = Arc::new(World::new(Scene::two_rooms(), &SimConfig::default()).unwrap());
    // The rasteriser's memory belongs to the thread, not to the episode.
    drop(looked_around(&world, 1));
    for steps in [1, 8, 100] {
        let before = MEMORY.current_usage();
        let episode = looked_around(&world, steps);
        let given = (MEMORY.current_usage() - before + size_of::<Episode>()) as f64;
        let told = episode.memory_bytes() as f64;
        assert!((0.95..=1.0).contains(&(told / given)), "{told} told, {given} given after {steps} steps");
    }
}
