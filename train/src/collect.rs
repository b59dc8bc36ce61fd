//! Gathering trajectories with the current model, and cutting them into samples (paper, section 4.3).

use crate::clock::{ThreadSeconds, Timed};
use crate::config::CollectConfig;
use crate::interrupt;
use crate::memory::PackedSample;
use nbp_env::episode::Episode;
use nbp_env::label::{LabelKind, Sample, Waypoint, look_labels, value_labels};
use nbp_env::policy::nbp::{Nbp, Passability};
use nbp_env::policy::{Plan, PolicyError};
use nbp_env::world::{StartError, World};
use nbp_env::{Heading, LatticePose, Policy, Predictor, SeedTree};
use nbp_infer::rounds;
use rand::RngExt as _;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// What one trajectory gave.
pub struct Trajectory {
    /// Name of its scene.
    pub scene: String,
    /// Samples of all its paths, in order.
    pub samples: Vec<PackedSample>,
    /// Steps taken.
    pub steps: usize,
    /// Covered share at its end.
    pub coverage: f32,
    /// Its last plan, for the log.
    pub plan: Option<Plan>,
    /// Seconds that it took without waiting for predictions, and those of them that went to labelling and packing samples.
    seconds: [f64; 2],
}

/// Why there are no trajectories.
#[derive(Debug, thiserror::Error)]
pub enum CollectError {
    /// The network failed.
    #[error(transparent)]
    Policy(#[from] PolicyError),
    /// Nobody can stand there.
    #[error(transparent)]
    Start(#[from] StartError),
    /// Ctrl-C.
    #[error("interrupted")]
    Interrupted,
}

/// `count` trajectories in each world, in parallel, and what their threads' time went to; the trajectories do not depend on
/// the number of threads.
///
/// # Errors
/// When the predictor fails or the user interrupts.
pub fn trajectories(
    worlds: &[Arc<World>],
    predictor: &Arc<dyn Predictor>,
    config: &CollectConfig,
    count: usize,
    seed: SeedTree,
    on_done: impl Fn(&Trajectory) + Sync,
) -> Result<(Vec<Trajectory>, ThreadSeconds), CollectError> {
    let network = Arc::new(Timed::new(Arc::clone(predictor)));
    let timed: Arc<dyn Predictor> = network.clone();
    let jobs: Vec<(usize, usize)> = (0..worlds.len()).flat_map(|w| (0..count).map(move |n| (w, n))).collect();
    let trajectories = rounds::try_map(&jobs, config.batch, &timed, |&(w, n), predictor| {
        let seed = seed.child("world", w as u64).child("trajectory", n as u64);
        let trajectory = trajectory(&worlds[w], predictor, config, seed)?;
        on_done(&trajectory);
        Ok::<_, CollectError>(trajectory)
    })?;
    let sum = |part: usize| trajectories.iter().map(|t: &Trajectory| t.seconds[part]).sum::<f64>();
    // A call for all has all threads to itself.
    let threads = if config.batch > 1 { rayon::current_num_threads() as f64 } else { 1.0 };
    let inference = threads * network.seconds();
    let threads = ThreadSeconds { inference, io: sum(1), all: inference + sum(0) };
    Ok((trajectories, threads))
}

fn trajectory(
    world: &Arc<World>,
    predictor: Arc<dyn Predictor>,
    config: &CollectConfig,
    seed: SeedTree,
) -> Result<Trajectory, CollectError> {
    let begun = Instant::now();
    let mut packing = Duration::ZERO;
    let mut rng = seed.child("policy", 0).rng();
    // Never empty: a scene without a free pose is none.
    let nodes = world.scene().graph().largest_component();
    let start = LatticePose {
        node: nodes[rng.random_range(0..nodes.len())],
        heading: Heading::new(rng.random_range(0..8_usize)),
    };
    let mut episode = Episode::new(Arc::clone(world), start, config.steps, seed.child("episode", 0))?;
    let waiting = Arc::new(Timed::new(predictor));
    let mut policy = Nbp::new(waiting.clone(), config.policy, Passability::Truth(Arc::clone(world)));
    policy.begin();
    let mut samples = Vec::new();
    let mut path = vec![waypoint(&episode)];
    while !episode.is_over() && episode.curve().last().is_none_or(|&share| share <= config.enough) {
        if interrupt::asked() {
            return Err(CollectError::Interrupted);
        }
        if config.labels == LabelKind::Looks && episode.steps().is_multiple_of(config.every) {
            let begun = Instant::now();
            samples.push(look_around(&episode));
            packing += begun.elapsed();
        }
        let action = policy.act(&episode.view(), &mut rng)?;
        // A plan made just now ends the path before it: the pose between them is its goal and the next one's start.
        if policy.plan().is_some_and(|plan| plan.made_at == episode.steps()) && path.len() > 1 {
            let begun = Instant::now();
            samples.extend(cut(&path, config.labels, world));
            packing += begun.elapsed();
            path.drain(..path.len() - 1);
        }
        episode.step(action);
        if config.labels != LabelKind::Looks {
            path.push(waypoint(&episode));
        }
    }
    let last = Instant::now();
    samples.extend(cut(&path, config.labels, world));
    packing += last.elapsed();
    Ok(Trajectory {
        scene: world.scene().name().into(),
        samples,
        steps: episode.steps(),
        coverage: episode.curve().last().copied().unwrap_or_default(),
        plan: policy.plan().cloned(),
        seconds: [begun.elapsed().as_secs_f64() - waiting.seconds(), packing.as_secs_f64()],
    })
}

fn waypoint(episode: &Episode) -> Waypoint {
    Waypoint {
        pose: episode.pose(),
        input: episode.encode(),
        step: episode.steps(),
        covered: episode.covered().last().copied().unwrap_or_default(),
        covered_before: episode.covered().iter().rev().nth(1).copied().unwrap_or_default(),
    }
}

/// A sample of what looks from everywhere would add.
fn look_around(episode: &Episode) -> PackedSample {
    let (world, view, input) = (episode.world(), episode.view(), episode.encode());
    let covered = world.glimpses().covered_by(episode.coverage());
    PackedSample::new(&Sample {
        step: episode.steps(),
        labels: look_labels(world, &covered, &input.window, |node| view.is_within_sight(node)),
        obstacles: world.obstacles().crop(&input.window),
        input,
    })
}

/// One sample for each pose of a path but its last.
fn cut(path: &[Waypoint], labels: LabelKind, world: &World) -> Vec<PackedSample> {
    let last = path.len().saturating_sub(1);
    path[..last]
        .iter()
        .enumerate()
        .map(|(i, waypoint)| {
            PackedSample::new(&Sample {
                input: waypoint.input.clone(),
                step: waypoint.step,
                labels: value_labels(path, i, labels, world.scene().lattice(), world.surface().len()),
                obstacles: world.obstacles().crop(&waypoint.input.window),
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::memory::Memory;
    use burn::tensor::Device;
    use nbp_env::window::WindowSize;
    use nbp_env::{EncoderInput, ObstacleMap, PredictError, Prediction, Scene, SimConfig, ValueMap};
    use nbp_model::{CheckpointConfig, NetConfig, NetPredictor};

    impl Trajectory {
        fn thought(&self) -> Option<&(EncoderInput, Prediction)> {
            self.plan.as_ref()?.thought.as_ref()
        }
    }

    /// Finds every pose equally good.
    struct Flat;

    impl Predictor for Flat {
        fn predict(&self, inputs: &[EncoderInput]) -> Result<Vec<Prediction>, PredictError> {
            let answer = |input: &EncoderInput| {
                let (pixels, size) = (input.size(), input.size() / 4);
                Prediction {
                    value: ValueMap { size, gain: vec![0.0; 8 * size * size] },
                    obstacle: ObstacleMap { size: pixels, probability: vec![0.0; pixels * pixels] },
                }
            };
            Ok(inputs.iter().map(answer).collect())
        }
    }

    fn collect(threads: usize) -> Vec<Trajectory> {
        collect_with(Arc::new(Flat), threads, 1)
    }

    fn collect_with(predictor: Arc<dyn Predictor>, threads: usize, batch: usize) -> Vec<Trajectory> {
        let mut sim = SimConfig::default();
        sim.encode.window.pixels = 64;
        let world = Arc::new(World::new(Scene::two_rooms(), &sim).unwrap());
        let config = CollectConfig { steps: 30, enough: 1.0, batch, ..CollectConfig::default() };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| trajectories(&[world], &predictor, &config, 3, SeedTree::new(4), |_| ()).unwrap().0)
    }

    #[test]
    fn every_step_but_the_last_becomes_a_sample_whatever_the_thread_count() {
        let (one, two) = (collect(1), collect(2));
        for (a, b) in one.iter().zip(&two) {
            assert_eq!(a.samples, b.samples);
            assert_eq!((a.steps, a.samples.len()), (30, 30));
            assert!(a.samples.iter().enumerate().all(|(t, sample)| sample.step == t));
        }
        assert_ne!(one[0].samples, one[1].samples);
    }

    #[test]
    fn a_network_that_is_asked_for_all_at_once_gives_the_same_samples() {
        let config = NetConfig { base: 2, ..NetConfig::default() };
        let net = nbp_model::Nbp::new(&config, 3, &Device::flex()).unwrap();
        let window = WindowSize { pixels: 64, metres: 40.0 };
        let net: Arc<dyn Predictor> = Arc::new(NetPredictor::new(&net, &CheckpointConfig::new(config, window)));
        let alone = collect_with(Arc::clone(&net), 1, 1);
        for (threads, batch) in [(1, 2), (2, 3), (3, 8)] {
            let together = collect_with(Arc::clone(&net), threads, batch);
            assert!(alone.iter().zip(&together).all(|(a, b)| a.samples == b.samples), "batch {batch}");
            assert!(alone.iter().zip(&together).all(|(a, b)| a.thought() == b.thought()), "batch {batch}");
        }
    }

    #[test]
    fn looks_are_labelled_now_and_then_and_shrink_as_the_house_is_seen() {
        let mut sim = SimConfig::default();
        sim.encode.window.pixels = 64;
        let world = Arc::new(World::new(Scene::two_rooms(), &sim).unwrap());
        let labels = LabelKind::Looks;
        let config = CollectConfig { steps: 30, enough: 1.0, labels, every: 4, ..CollectConfig::default() };
        let of = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let worlds = [Arc::clone(&world)];
            let predictor: Arc<dyn Predictor> = Arc::new(Flat);
            pool.install(|| trajectories(&worlds, &predictor, &config, 2, SeedTree::new(4), |_| ()).unwrap().0)
        };
        let (one, two) = (of(1), of(2));
        let folder = tempfile::tempdir().unwrap();
        let mut memory = Memory::open(&folder.path().join("memory.bin")).unwrap();
        for (a, b) in one.iter().zip(&two) {
            assert_eq!(a.samples, b.samples);
            assert_eq!(a.samples.iter().map(|sample| sample.step).collect::<Vec<_>>(), [0, 4, 8, 12, 16, 20, 24, 28]);
        }
        memory.append(0, &one[0].samples).unwrap();
        let left = |n| memory.get(n).unwrap().labels.iter().map(|label| f64::from(label.gain)).sum::<f64>();
        let left: Vec<f64> = (0..8).map(left).collect();
        // More comes within sight at first.
        assert!(left[1..].is_sorted_by(|a, b| a >= b) && left[7] < 0.5 * left[0], "{left:?}");
        let asked = |n| memory.get(n).unwrap().labels.len();
        assert!(asked(0) < asked(7) && asked(7) <= 8 * world.scene().lattice().len(), "{} {}", asked(0), asked(7));
    }

    #[test]
    fn labels_tell_the_true_gain() {
        let folder = tempfile::tempdir().unwrap();
        let mut memory = Memory::open(&folder.path().join("memory.bin")).unwrap();
        let trajectory = &collect(1)[0];
        memory.append(0, &trajectory.samples).unwrap();
        let samples: Vec<Sample> = (0..memory.len()).map(|n| memory.get(n).unwrap()).collect();
        assert!(samples.iter().all(|s| !s.labels.is_empty() && s.labels.iter().all(|l| l.gain >= 0.0)));
        // Gains of single steps add up to what the trajectory covered after its first frame.
        let single: f32 = samples.iter().map(|s| s.labels[0].gain).sum();
        let start = samples[0].labels[0].gain;
        assert!(single <= 100.0 * trajectory.coverage + 1e-3 && single > start);
        assert!(samples[0].obstacles.contains(&1));
    }
}
