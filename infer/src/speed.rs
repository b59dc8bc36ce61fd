//! How fast the simulator is in given scenes.

use crate::registry::{self, PolicyContext, PolicyKind, RegistryError};
use crate::rollout::{RolloutError, Trial};
use nbp_env::coverage::Coverage;
use nbp_env::map::Kept;
use nbp_env::policy::{PolicyError, decide};
use nbp_env::sensor::Frame;
use nbp_env::{Episode, SeedTree, World};
use serde::Serialize;
use std::hint::black_box;
use std::sync::{Arc, Barrier};
use std::time::Instant;

/// Which episodes are measured.
#[derive(Clone, Copy, Debug)]
pub struct SpeedConfig {
    /// Who walks. One that needs a network cannot.
    pub policy: PolicyKind,
    /// Steps of each episode.
    pub steps: usize,
    /// Root of the random streams.
    pub seed: u64,
    /// Threads; each walks one episode in every scene.
    pub threads: usize,
}

/// What was measured.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Speed {
    /// Steps of all threads together for each second of the clock, the encoder's input after each of them and the policy's
    /// decisions included. Steps of the lattice agent that bumped take no frames and do not count.
    pub steps_per_second: f64,
    /// Milliseconds for a frame, before noise, on one thread: median over the poses at which steps ended.
    pub frame_ms: f64,
    /// Microseconds to count a frame's kept points into the coverage, on one thread: median over the same frames.
    pub coverage_us: f64,
    /// Microseconds for the encoder's input, on one thread: median over the steps.
    pub input_us: f64,
    /// Memory of an episode at its end, without what it shares with others in its scene, in 10⁶ bytes: the largest.
    pub memory_mb: f64,
}

/// A measurement that cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum SpeedError {
    /// Nothing to measure.
    #[error("there is nothing to measure: {0}")]
    Nothing(&'static str),
    /// The policy cannot be built.
    #[error(transparent)]
    Registry(#[from] RegistryError),
    /// An episode cannot begin.
    #[error(transparent)]
    Rollout(#[from] RolloutError),
    /// The policy failed.
    #[error(transparent)]
    Policy(#[from] PolicyError),
    /// A thread ended before its episodes.
    #[error("a thread broke off; what it said is above")]
    Thread,
}

/// Walks through every scene on one thread, part by part, and then on all threads at once.
///
/// # Errors
/// When there is nothing to do, the policy needs a network, or an episode fails.
pub fn measure(worlds: &[Arc<World>], config: SpeedConfig, on_scene: impl Fn(usize)) -> Result<Speed, SpeedError> {
    let checks = [(worlds.is_empty(), "no scenes"), (config.steps == 0, "0 steps"), (config.threads == 0, "0 threads")];
    if let Some((_, what)) = checks.into_iter().find(|(is_bad, _)| *is_bad) {
        return Err(SpeedError::Nothing(what));
    }
    let (mut parts, mut memory) = (Parts::default(), 0);
    for (number, world) in worlds.iter().enumerate() {
        let episode = walk(world, config, 0, |episode| parts.input(episode))?;
        memory = memory.max(episode.memory_bytes());
        parts.frames(&episode);
        on_scene(number + 1);
    }
    Ok(Speed {
        steps_per_second: all_threads(worlds, config)?,
        frame_ms: 1e3 * median(parts.frame),
        coverage_us: 1e6 * median(parts.coverage),
        input_us: 1e6 * median(parts.input),
        memory_mb: memory as f64 / 1e6,
    })
}

/// Seconds of each part, one by one.
#[derive(Default)]
struct Parts {
    frame: Vec<f64>,
    coverage: Vec<f64>,
    input: Vec<f64>,
}

impl Parts {
    fn input(&mut self, episode: &Episode) {
        let clock = Instant::now();
        drop(black_box(episode.encode()));
        self.input.push(clock.elapsed().as_secs_f64());
    }

    /// The frames at the end of each step once more, and their points into a coverage of their own.
    fn frames(&mut self, episode: &Episode) {
        let world = episode.world();
        let (camera, keep) = (world.sensor().camera(), world.config().keep);
        let mut pixels = SeedTree::new(0).child("pixels", 0).rng();
        let (mut frame, mut coverage) = (Frame::default(), Coverage::new(world.surface()));
        for (step, pose) in episode.track().iter().enumerate() {
            let clock = Instant::now();
            world.sensor().capture(world.scene(), pose, &mut frame);
            self.frame.push(clock.elapsed().as_secs_f64());
            let kept = Kept::draw(camera, pose, &frame, keep, &mut pixels);
            let clock = Instant::now();
            coverage.add(world.surface(), &kept.points, step as u32);
            self.coverage.push(clock.elapsed().as_secs_f64());
        }
    }
}

/// Steps for each second of the clock while every thread walks through all scenes, each beginning with another one.
fn all_threads(worlds: &[Arc<World>], config: SpeedConfig) -> Result<f64, SpeedError> {
    let barrier = Barrier::new(config.threads);
    let work = |thread: usize| {
        barrier.wait();
        let begun = Instant::now();
        let mut steps = 0;
        for number in 0..worlds.len() {
            let world = &worlds[(number + thread) % worlds.len()];
            let episode = walk(world, config, thread, |episode| drop(black_box(episode.encode())))?;
            let frameless = if episode.is_continuous() { 0 } else { episode.bumps() };
            steps += episode.steps() - frameless;
        }
        Ok::<_, SpeedError>((steps, begun, Instant::now()))
    };
    let done = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..config.threads).map(|thread| scope.spawn(move || work(thread))).collect();
        threads
            .into_iter()
            .map(|thread| thread.join().unwrap_or(Err(SpeedError::Thread)))
            .collect::<Result<Vec<_>, _>>()
    })?;
    let steps: usize = done.iter().map(|(steps, ..)| steps).sum();
    let begun = done.iter().map(|&(_, begun, _)| begun).min();
    let seconds = begun.zip(done.iter().map(|&(.., end)| end).max()).map(|(begun, end)| end - begun);
    Ok(steps as f64 / seconds.unwrap_or_default().as_secs_f64())
}

/// One episode from a start of its own. `on_step` is called once for each step, in the continuous world after all of the
/// motions that a decision makes. Nothing is recorded, as [`run_episode`](crate::rollout::run_episode) does, for that takes
/// time.
fn walk(
    world: &Arc<World>,
    config: SpeedConfig,
    number: usize,
    mut on_step: impl FnMut(&Episode),
) -> Result<Episode, SpeedError> {
    let mut policy = registry::build(config.policy, &PolicyContext::default(), world)?;
    let start = number % world.scene().starts().len().max(1);
    let trial = Trial { start, seed: config.seed.wrapping_add(number as u64), steps: config.steps };
    let seeds = trial.seeds(world.scene().name());
    let mut rng = seeds.child("policy", 0).rng();
    let episode = Episode::new(Arc::clone(world), trial.pose(world)?, trial.steps, seeds);
    let mut episode = episode.map_err(RolloutError::from)?;
    policy.begin();
    while !episode.is_over() {
        let before = episode.steps();
        let decision = decide(policy.as_mut(), &episode, &mut rng)?;
        episode.follow(decision);
        (before..episode.steps()).for_each(|_| on_step(&episode));
    }
    Ok(episode)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nbp_env::{Agent, MotionConfig, Scene, SimConfig};

    #[test]
    fn every_step_of_either_world_has_its_input() {
        let motions = Agent::Continuous(MotionConfig::default());
        for agent in [Agent::Lattice {}, motions] {
            let config = SimConfig { agent, ..SimConfig::default() };
            let world = Arc::new(World::new(Scene::two_rooms(), &config).unwrap());
            let mut parts = Parts::default();
            let config = SpeedConfig { policy: PolicyKind::Fbe, steps: 30, seed: 1, threads: 1 };
            let episode = walk(&world, config, 0, |episode| parts.input(episode)).unwrap();
            parts.frames(&episode);
            assert_eq!((parts.input.len(), parts.frame.len(), parts.coverage.len()), (30, 31, 31));
        }
    }

    #[test]
    fn every_part_takes_time_and_nothing_to_do_is_refused() {
        let world = Arc::new(World::new(Scene::two_rooms(), &SimConfig::default()).unwrap());
        let config = SpeedConfig { policy: PolicyKind::Fbe, steps: 5, seed: 1, threads: 3 };
        let speed = measure(&[Arc::clone(&world), world.clone()], config, |_| ()).unwrap();
        let parts = [speed.steps_per_second, speed.frame_ms, speed.coverage_us, speed.input_us, speed.memory_mb];
        assert!(parts.iter().all(|part| part.is_finite() && *part > 0.0), "{speed:?}");
        let one = [world];
        for (worlds, config, says) in [
            (&[][..], config, "no scenes"),
            (&one, SpeedConfig { threads: 0, ..config }, "0 threads"),
            (&one, SpeedConfig { steps: 0, ..config }, "0 steps"),
            (&one, SpeedConfig { policy: PolicyKind::Nbp, ..config }, "needs a network"),
        ] {
            let error = measure(worlds, config, |_| ()).unwrap_err().to_string();
            assert!(error.contains(says), "{error}");
        }
    }
}
