//! Batches of episodes: the number of threads changes no bit, whatever the policy; and a map is what its cloud makes it.

use super::{MANY, for_all};
use glam::Vec3;
use nbp_env::batch::EpisodeBatch;
use nbp_env::map::DensityGrid;
use nbp_env::policy::{Policy, fbe::Fbe, random::Random};
use nbp_env::sensor::Camera;
use nbp_env::{Action, Agent, Episode, LatticePose, MotionConfig, Rng, Scene, SeedTree, SimConfig, World};
use rand::RngExt as _;
use rand::seq::IndexedRandom as _;
use rayon::prelude::*;
use std::sync::Arc;

/// A case of several episodes costs 5 ms: 10,000 take a minute.
const SOME: u64 = 1000;

/// What an episode can tell, in bits.
#[derive(PartialEq, Debug)]
struct Told {
    curve: Vec<u32>,
    cloud: Vec<u32>,
    first: Vec<Option<u32>>,
    history: Vec<LatticePose>,
    track: Vec<[u32; 4]>,
    input: nbp_env::EncoderInput,
}

fn told(episode: &Episode) -> Told {
    Told {
        curve: episode.curve().iter().map(|share| share.to_bits()).collect(),
        cloud: episode.view().cloud().iter().flat_map(|p| p.to_array().map(f32::to_bits)).collect(),
        first: (0..episode.world().surface().len()).map(|n| episode.coverage().first_step(n)).collect(),
        history: episode.view().history().to_vec(),
        track: episode
            .track()
            .iter()
            .map(|p| [p.position.x, p.position.y, p.position.z, p.azimuth].map(f32::to_bits))
            .collect(),
        input: episode.encode(),
    }
}

/// The lattice world and the continuous one.
fn worlds() -> [Arc<World>; 2] {
    [Agent::Lattice {}, Agent::Continuous(MotionConfig::default())].map(|agent| {
        let camera = Camera { width: 60, height: 34, ..Camera::default() };
        let mut config = SimConfig { agent, camera, ..SimConfig::default() };
        config.coverage.points = 500;
        config.encode.window.pixels = 64;
        Arc::new(World::new(Scene::two_rooms(), &config).unwrap())
    })
}

/// What a batch has told after each step, half of its policies walking at random and half to frontiers.
fn run(world: &Arc<World>, (count, horizon, seed): (usize, usize, u64)) -> Vec<Told> {
    let mut batch = EpisodeBatch::new(vec![Arc::clone(world)], count, horizon, seed).unwrap();
    let policy = |n: usize| -> (Box<dyn Policy>, Rng) {
        let rng = SeedTree::new(seed).child("policy", n as u64).rng();
        (if n.is_multiple_of(2) { Box::new(Random) } else { Box::new(Fbe::default()) }, rng)
    };
    let mut policies: Vec<_> = (0..count).map(policy).collect();
    let mut all = Vec::new();
    for _ in 0..horizon + 2 {
        let acting = policies.par_iter_mut().zip(batch.episodes());
        let actions: Vec<Action> =
            acting.map(|((policy, rng), episode)| policy.act(&episode.view(), rng).unwrap()).collect();
        batch.step(&actions).unwrap();
        all.extend(batch.episodes().iter().map(told));
        batch.reset_finished().into_iter().for_each(|n| policies[n].0.begin());
    }
    all
}

#[test]
fn threads_change_no_bit() {
    let worlds = worlds();
    let pools = [1, 3].map(|threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap());
    for_all("threads_change_no_bit", SOME, |rng| {
        let (world, batch) =
            (worlds.choose(rng).unwrap(), (rng.random_range(1..5), rng.random_range(1..6), rng.random()));
        let [one, three] = [0, 1].map(|n| pools[n].install(|| run(world, batch)));
        assert_eq!(one, three);
    });
}

#[test]
fn an_episode_that_was_reset_is_a_new_one_and_its_input_is_its_cloud() {
    let worlds = worlds();
    for_all("an_episode_that_was_reset_is_a_new_one_and_its_input_is_its_cloud", MANY, |rng| {
        let world = worlds.choose(rng).unwrap();
        let [before, seed] = [(); 2].map(|()| SeedTree::new(rng.random()));
        let horizon = rng.random_range(0..6);
        let go = |mut episode: Episode| {
            let mut rng = seed.child("actions", 0).rng();
            while !episode.is_over() {
                episode.step(Random.act(&episode.view(), &mut rng).unwrap());
            }
            episode
        };
        let mut reset = go(Episode::random(Arc::clone(world), horizon, before));
        reset.reset(seed);
        let (reset, new) = (go(reset), go(Episode::random(Arc::clone(world), horizon, seed)));
        assert_eq!(told(&reset), told(&new));

        let encode = world.config().encode;
        let input = new.encode();
        let mut grid = DensityGrid::new(encode.window, encode.layers, world.scene().floor());
        let mut cloud: Vec<Vec3> = new.view().cloud().iter().collect();
        cloud.reverse();
        grid.add(&cloud);
        let mut counts = vec![0; encode.layers.count * encode.window.pixels.pow(2)];
        grid.crop(&input.window, &mut counts);
        for layer in 0..encode.layers.count {
            let size = encode.window.pixels.pow(2);
            assert_eq!(input.channel(layer), &counts[layer * size..][..size]);
        }
    });
}
