//! Training samples for the two networks: walks through a world, and at every few steps what should have been answered.
//!
//! SCONE learns from the truth: whether points are inside a solid, and how much new surface each candidate shows. MACARONS
//! learns from what the agent itself saw: which proxies it has seen through, and how much its cloud grew where it went.

use super::belief::Belief;
use super::field::Field;
use super::{CandidateInput, NbvConfig, NbvPredictor, OccupancyInput};
use crate::episode::{Action, Episode};
use crate::policy::{headings_near, scone};
use crate::pose::{Direction, LatticePose, Pose};
use crate::predict::PredictError;
use crate::seed::{Rng, SeedTree};
use crate::world::World;
use glam::Vec3;
use rand::RngExt as _;
use rand::seq::IndexedRandom;
use serde::{Deserialize, Serialize};
use std::collections::{HashMap, HashSet, VecDeque};
use std::sync::Arc;

/// Half of SCONE's questions are about points so near to the true surface, metres.
const NEAR_SURFACE: f32 = 0.75;

/// Points drawn for SCONE's questions, of which most are not in view or seen through when a sample is made.
const POOL: usize = 20_000;

/// Newly seen surface is counted in cubes of this side, metres.
const NEW_VOXEL: f32 = 0.5;

/// Whom the networks learn from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Teacher {
    /// The mesh: SCONE.
    Truth,
    /// The agent's own observations: MACARONS.
    Own,
}

/// How samples are collected.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CollectConfig {
    /// Whom the networks learn from.
    pub teacher: Teacher,
    /// Steps of a walk (released code: 100).
    pub steps: usize,
    /// A sample is made at every so many steps, the start included.
    pub every: usize,
    /// Share of random moves in a greedy walk.
    pub epsilon: f32,
    /// Points asked about in a sample (released code: 6000).
    pub queries: usize,
    /// MACARONS: poses reached later whose frames are compared with what was known at the sample, besides the next one.
    pub replays: usize,
}

impl Default for CollectConfig {
    fn default() -> Self {
        Self { teacher: Teacher::Truth, steps: 100, every: 5, epsilon: 0.2, queries: 256, replays: 4 }
    }
}

impl CollectConfig {
    /// The first setting that is out of range: its name, its value and what is accepted.
    pub fn fault(&self) -> Option<(&'static str, String, &'static str)> {
        let counts = [
            ("steps", self.steps, 1..=100_000, "from 1 to 100,000"),
            ("every", self.every, 1..=100_000, "from 1 to 100,000"),
            ("queries", self.queries, 1..=POOL / 2, "from 1 to 10,000"),
            ("replays", self.replays, 1..=100, "from 1 to 100: gains are compared with each other"),
        ];
        let count = counts.into_iter().find(|(_, value, range, _)| !range.contains(value));
        let epsilon = (!(0.0..=1.0).contains(&self.epsilon))
            .then(|| ("epsilon", self.epsilon.to_string(), "a probability, 0 to 1"));
        count.map(|(field, value, _, want)| (field, value.to_string(), want)).or(epsilon)
    }
}

/// What the networks are asked at one pose, and what they should answer.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NbvSample {
    /// One for each cell that is asked about; none where too little is known.
    pub occupancy: Vec<OccupancyInput>,
    /// For each input, for each query, whether it is solid: 0 or 1.
    pub solid: Vec<Vec<f32>>,
    /// At least two cameras, or none where nothing was gained.
    pub candidates: Vec<CandidateInput>,
    /// Gain of each camera, not negative and not all 0. SCONE: share of the true surface that would be new. MACARONS: new
    /// cubes of 0.5 m of the agent's cloud.
    pub gains: Vec<f32>,
}

/// The samples of one walk through a world from a random start.
///
/// SCONE walks on the true gains or, in every second walk on average, at random; MACARONS where `predictor` expects most, or
/// at random without one. Without a predictor, the proxies' probabilities that candidates are shown are what the teacher
/// says. The same world, settings, answers and seed give the same samples.
///
/// # Errors
/// When the network fails.
pub fn collect_samples(
    world: &Arc<World>,
    predictor: Option<&dyn NbvPredictor>,
    config: &NbvConfig,
    collect: &CollectConfig,
    seed: SeedTree,
) -> Result<Vec<NbvSample>, PredictError> {
    match collect.teacher {
        Teacher::Truth => taught_by_truth(world, predictor, config, collect, seed),
        Teacher::Own => taught_by_itself(world, predictor, config, collect, seed),
    }
}

fn taught_by_truth(
    world: &Arc<World>,
    predictor: Option<&dyn NbvPredictor>,
    config: &NbvConfig,
    collect: &CollectConfig,
    seed: SeedTree,
) -> Result<Vec<NbvSample>, PredictError> {
    let mut rng = seed.child("collect", 0).rng();
    let mut episode = Episode::random(Arc::clone(world), collect.steps, seed);
    let (scene, visibility) = (world.scene(), world.visibility());
    let is_solid = |point: Vec3| !scene.graph().interior().contains(scene.rays(), point);
    let mut belief = Belief::new(scene.bounds(), *world.sensor().camera(), *config, &mut rng);
    if predictor.is_none() {
        let solid: Vec<bool> = belief.proxies().points().iter().map(|&point| is_solid(point)).collect();
        belief.answer(|proxy| f32::from(u8::from(solid[proxy])));
    }
    let mut pool = question_pool(world, belief.proxies().spacing(), &mut rng);
    let mut frames = 0;
    let epsilon = if rng.random::<bool>() { 1.0 } else { collect.epsilon };
    let mut samples = Vec::new();
    while !episode.is_over() {
        let (view, step) = (episode.view(), episode.steps());
        let eye = view.camera();
        belief.observe(&view);
        view.look_again(frames, &mut |camera, pose, frame| pool.observe(camera, pose, frame, config.carving));
        frames = view.cloud().frames();
        if let Some(predictor) = predictor {
            belief.ask(predictor, &eye, step, &mut rng)?;
        }
        let here = view.pose();
        let open = scene.graph().neighbours(here.node);
        let candidates: Vec<LatticePose> = open
            .flat_map(|node| headings_near(here.heading).map(move |heading| LatticePose { node, heading }))
            .collect();
        let covered = visibility.covered_by(episode.coverage());
        let share = |&pose: &LatticePose| visibility.gain(pose, &covered) as f32 / world.surface().len() as f32;
        let gains: Vec<f32> = candidates.iter().map(share).collect();
        if step % collect.every == 0 {
            let reach = reach(&belief, step, collect.steps);
            let asked: Vec<u32> = (0..2_u32)
                .flat_map(|half| {
                    let of_half = (half * POOL as u32 / 2)..((half + 1) * POOL as u32 / 2);
                    let is_open = |&point: &u32| {
                        let sight = &pool.sights()[point as usize];
                        sight.is_in_field() && sight.is_solid()
                    };
                    choose(
                        &belief,
                        &pool,
                        of_half.filter(is_open).collect(),
                        collect.queries.div_ceil(2),
                        reach,
                        &mut rng,
                    )
                })
                .collect();
            let questions = belief.questions(&pool, &asked, &eye, &mut rng);
            let label = |&point: &u32| f32::from(u8::from(is_solid(pool.points()[point as usize])));
            let solid = questions.iter().map(|(_, points)| points.iter().map(label).collect()).collect();
            let occupancy = questions.into_iter().map(|(input, _)| input).collect();
            let mut sample = NbvSample { occupancy, solid, ..NbvSample::default() };
            if gains.iter().any(|&gain| gain > 0.0) {
                let cameras: Vec<Pose> = candidates.iter().map(|&pose| scene.lattice().pose(pose)).collect();
                sample.candidates = belief.candidates(&eye, &cameras, &mut rng);
                sample.gains.clone_from(&gains);
            }
            samples.push(sample);
        }
        let greedy = candidates.iter().zip(&gains).reduce(|best, other| if other.1 > best.1 { other } else { best });
        let next = match rng.random::<f32>() < epsilon || gains.iter().all(|&gain| gain == 0.0) {
            true => candidates.choose(&mut rng).copied(),
            false => greedy.map(|(&pose, _)| pose),
        };
        episode.step(towards(here, next));
    }
    Ok(samples)
}

/// Points for SCONE's questions: the first half near the true surface, the second anywhere in the box.
fn question_pool(world: &World, spacing: f32, rng: &mut Rng) -> Field {
    let (scene, surface) = (world.scene(), world.surface().points());
    let near = (0..POOL / 2).map(|_| {
        let cube = Vec3::from_array([(); 3].map(|()| rng.random_range(-1.0..=1.0)));
        surface.choose(rng).copied().unwrap_or_default() + NEAR_SURFACE * cube / cube.length().max(1.0)
    });
    let mut points: Vec<Vec3> = near.collect();
    points.extend(Field::uniform(scene.bounds(), POOL / 2, rng).points());
    Field::new(points, spacing)
}

/// How far from the known surface questions go, metres: from three spacings at the start of a walk to two diagonals of a cell
/// at its end.
fn reach(belief: &Belief, step: usize, steps: usize) -> f32 {
    let [first, last] = [3.0 * belief.proxies().spacing(), 2.0 * belief.cells().diagonal()];
    first + (last - first).max(0.0) * step as f32 / steps as f32
}

/// At most `amount` of the given points of a field at random, around which the cloud is dense, within `reach` of it.
fn choose(belief: &Belief, field: &Field, of: Vec<u32>, amount: usize, reach: f32, rng: &mut Rng) -> Vec<u32> {
    let order = rand::seq::index::sample(rng, of.len(), of.len());
    let is_near = |&point: &u32| {
        let point = field.points()[point as usize];
        belief.is_known(point) && belief.cells().is_within(point, reach)
    };
    let mut chosen: Vec<u32> = order.into_iter().map(|at| of[at]).filter(is_near).take(amount).collect();
    chosen.sort_unstable();
    chosen
}

/// The move to a neighbouring pose, or a turn where there is none.
fn towards(here: LatticePose, next: Option<LatticePose>) -> Action {
    let next = next.unwrap_or(LatticePose { heading: crate::Heading::new(here.heading.index() + 1), ..here });
    Action { direction: Direction::between(here.node, next.node), heading: next.heading }
}

/// A sample of MACARONS that waits for what comes next, with what was believed at it.
struct Pending {
    step: usize,
    eye: Pose,
    belief: Belief,
    sample: NbvSample,
}

fn taught_by_itself(
    world: &Arc<World>,
    predictor: Option<&dyn NbvPredictor>,
    config: &NbvConfig,
    collect: &CollectConfig,
    seed: SeedTree,
) -> Result<Vec<NbvSample>, PredictError> {
    let mut rng = seed.child("collect", 0).rng();
    let mut episode = Episode::random(Arc::clone(world), collect.steps, seed);
    let mut belief = Belief::new(world.scene().bounds(), *world.sensor().camera(), *config, &mut rng);
    let (mut pending, mut samples) = (VecDeque::new(), Vec::new());
    let mut seen = Seen::default();
    seen.add(&episode);
    while !episode.is_over() {
        let (view, step) = (episode.view(), episode.steps());
        let eye = view.camera();
        belief.observe(&view);
        match predictor {
            Some(predictor) => belief.ask(predictor, &eye, step, &mut rng)?,
            None => belief.answer(|_| 1.0),
        }
        if step % collect.every == 0 {
            let seen = (0..belief.proxies().points().len() as u32)
                .filter(|&proxy| belief.proxies().sights()[proxy as usize].is_in_field());
            let reach = reach(&belief, step, collect.steps);
            let asked = choose(&belief, belief.proxies(), seen.collect(), collect.queries, reach, &mut rng);
            let questions = belief.questions(belief.proxies(), &asked, &eye, &mut rng);
            let label = |&proxy: &u32| f32::from(u8::from(belief.proxies().sights()[proxy as usize].is_solid()));
            let solid = questions.iter().map(|(_, proxies)| proxies.iter().map(label).collect()).collect();
            let occupancy = questions.into_iter().map(|(input, _)| input).collect();
            let sample = NbvSample { occupancy, solid, ..NbvSample::default() };
            pending.push_back(Pending { step, eye, belief: belief.clone(), sample });
        }
        let candidates = scone::candidates(&view);
        let next = match predictor.filter(|_| rng.random::<f32>() >= collect.epsilon) {
            Some(predictor) => scone::best(&belief, predictor, &view, &candidates, &mut rng)?,
            None => candidates.choose(&mut rng).copied(),
        };
        episode.step(towards(view.pose(), next));
        seen.add(&episode);
        while let Some(first) =
            pending.pop_front_if(|first: &mut Pending| seen.moves_after(first.step).count() > collect.replays)
        {
            samples.push(first.measured(&episode, &seen, collect, &mut rng));
        }
    }
    samples.extend(pending.into_iter().map(|last| last.measured(&episode, &seen, collect, &mut rng)));
    Ok(samples)
}

/// What an agent has seen of the surface.
#[derive(Default)]
struct Seen {
    /// The cubes of its cloud, and the step at which each was first seen. Only asked, never iterated.
    cubes: HashMap<[i32; 3], usize>,
    /// Number of frames after each step, the start first.
    frames: Vec<usize>,
}

impl Seen {
    /// Takes in the frames of one more step.
    fn add(&mut self, episode: &Episode) {
        let (step, begin) = (self.frames.len(), self.frames.last().copied().unwrap_or(0));
        let end = episode.view().cloud().frames();
        for cube in (begin..end).flat_map(|frame| cubes(episode, frame)) {
            self.cubes.entry(cube).or_insert(step);
        }
        self.frames.push(end);
    }

    /// Steps after `step` that did not end in a bump, which takes no frame.
    fn moves_after(&self, step: usize) -> impl Iterator<Item = usize> + '_ {
        (step + 1..self.frames.len()).filter(|&later| self.frames[later] > self.frames[later - 1])
    }
}

/// The cubes that a frame shows.
fn cubes(episode: &Episode, frame: usize) -> HashSet<[i32; 3]> {
    let points = episode.view().cloud().of_frame(frame).map(|point| (point / NEW_VOXEL).floor().as_ivec3().to_array());
    points.collect()
}

impl Pending {
    /// Adds the candidates: the poses reached after the sample, with what their frames showed that was not known at it.
    fn measured(self, episode: &Episode, seen: &Seen, collect: &CollectConfig, rng: &mut Rng) -> NbvSample {
        let Self { step, eye, belief, mut sample } = self;
        let (mut cameras, mut gains) = (Vec::new(), Vec::new());
        for later in seen.moves_after(step).take(1 + collect.replays) {
            let cubes = cubes(episode, seen.frames[later] - 1);
            let is_new = |cube: &&[i32; 3]| seen.cubes.get(*cube).is_some_and(|&first| first > step);
            gains.push(cubes.iter().filter(is_new).count() as f32);
            cameras.push(episode.world().scene().lattice().pose(episode.view().history()[later]));
        }
        if gains.len() > 1 && gains.iter().any(|&gain| gain > 0.0) {
            sample.candidates = belief.candidates(&eye, &cameras, rng);
            sample.gains = gains;
        }
        sample
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::Mass;
    use super::*;
    use crate::config::SimConfig;
    use crate::scene::Scene;
    use crate::sensor::Camera;

    fn world() -> Arc<World> {
        let camera = Camera { width: 112, height: 64, ..Camera::default() };
        Arc::new(World::new(Scene::two_rooms(), &SimConfig { camera, ..SimConfig::default() }).unwrap())
    }

    const SMALL: NbvConfig =
        NbvConfig { proxies: 2000, cloud_points: 128, queries: 32, draws: 16, ..NbvConfig::DEFAULT };

    #[test]
    fn both_teachers_give_samples_with_both_answers_and_repeat_them() {
        let world = world();
        for teacher in [Teacher::Truth, Teacher::Own] {
            let collect = CollectConfig { teacher, steps: 30, queries: 64, ..CollectConfig::default() };
            for predictor in [None, Some(&Mass as &dyn NbvPredictor)] {
                let go = || collect_samples(&world, predictor, &SMALL, &collect, SeedTree::new(4)).unwrap();
                let samples = go();
                assert_eq!(samples.len(), 6);
                let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
                assert!(samples == one_thread.install(go));
                let (mut solid, mut count, mut compared) = (0.0, 0, 0);
                for sample in &samples {
                    assert_eq!(sample.candidates.len(), sample.gains.len());
                    compared += usize::from(sample.gains.len() > 1);
                    assert!(sample.gains.is_empty() || sample.gains.iter().sum::<f32>() > 0.0);
                    for (input, solids) in sample.occupancy.iter().zip(&sample.solid) {
                        assert_eq!((input.cloud.len(), input.queries.len()), (128, solids.len()));
                        assert_eq!((input.offsets.len(), input.harmonics.len()), (solids.len(), solids.len()));
                        let all = input.cloud.iter().chain(&input.queries).flatten();
                        assert!(all.chain(input.offsets.iter().flatten().flatten().flatten()).all(|v| v.abs() <= 1.0));
                        solid += solids.iter().sum::<f32>();
                        count += solids.len();
                    }
                    for candidate in &sample.candidates {
                        assert!(candidate.weights.iter().sum::<f32>() <= 1.0001 && candidate.mass >= 0.0);
                        assert!(candidate.points.iter().all(|p| p[..3].iter().all(|v| v.abs() <= 0.51)));
                    }
                }
                assert!(compared >= 3 && count > 100, "{compared} {count}");
                assert!(solid > 0.05 * count as f32 && solid < 0.95 * count as f32, "{solid} of {count}");
            }
        }
    }

    #[test]
    fn settings_out_of_range_are_named() {
        assert_eq!(CollectConfig::default().fault(), None);
        assert_eq!(CollectConfig { replays: 0, ..CollectConfig::default() }.fault().unwrap().0, "replays");
        assert_eq!(CollectConfig { epsilon: 1.5, ..CollectConfig::default() }.fault().unwrap().0, "epsilon");
        let read = serde_json::from_str::<CollectConfig>(r#"{"teacher": "own", "steps": 50}"#).unwrap();
        assert_eq!((read.teacher, read.steps), (Teacher::Own, 50));
    }
}
