//! What the agent makes of its frames: which proxies are solid, and what candidate cameras would be asked about.

use super::cells::Cells;
use super::field::Field;
use super::harmonics::{Harmonics, to_view};
use super::{CandidateInput, HARMONICS, NbvConfig, NbvPredictor, OccupancyInput};
use crate::map::MapView;
use crate::pose::Pose;
use crate::predict::PredictError;
use crate::seed::Rng;
use crate::sensor::Camera;
use glam::Vec3;
use rand::RngExt as _;
use std::collections::{BTreeMap, BTreeSet};

/// Probability of a proxy that nothing was asked about.
const UNKNOWN: f32 = 0.5;

/// The last answer about a proxy, and what it was asked with.
#[derive(Clone, Copy, Debug)]
struct Answer {
    probability: f32,
    views: u128,
    /// Points around its cell; none before it was asked.
    points: u32,
    /// Step at which it was asked, or else first seen.
    step: usize,
}

/// Proxies, cloud and answers of one episode.
#[derive(Clone, Debug)]
pub struct Belief {
    config: NbvConfig,
    camera: Camera,
    bounds: [Vec3; 2],
    proxies: Field,
    /// Cell of each proxy.
    homes: Vec<u32>,
    answers: Vec<Option<Answer>>,
    cells: Cells,
    /// Points around each cell.
    counts: Vec<u32>,
    frames: usize,
}

impl Belief {
    /// Nothing seen yet, in a scene's box.
    pub fn new(bounds: [Vec3; 2], camera: Camera, config: NbvConfig, rng: &mut Rng) -> Self {
        let cells = Cells::new(bounds, config.cell, config.voxel);
        let drawn = Field::uniform(bounds, config.proxies, rng);
        // Cell by cell: neighbours are in or out of a frustum together, which makes looking through them twice as fast.
        let mut points = drawn.points().to_vec();
        points.sort_by_key(|&point| cells.cell_of(point));
        let proxies = Field::new(points, drawn.spacing());
        let homes = proxies.points().iter().map(|&point| cells.cell_of(point) as u32).collect();
        let (answers, counts) = (vec![None; proxies.points().len()], cells.counts());
        Self { config, camera, bounds, proxies, homes, answers, cells, counts, frames: 0 }
    }

    /// The proxies and how they were looked at.
    pub fn proxies(&self) -> &Field {
        &self.proxies
    }

    /// The cloud in cells.
    pub fn cells(&self) -> &Cells {
        &self.cells
    }

    /// Takes in the frames since it was last asked.
    pub fn observe(&mut self, view: &MapView<'_>) {
        let (proxies, carving) = (&mut self.proxies, self.config.carving);
        view.look_again(self.frames, &mut |camera, pose, frame| proxies.observe(camera, pose, frame, carving));
        self.cells.add(view.cloud().of_frames(self.frames));
        self.frames = view.cloud().frames();
        self.counts = self.cells.counts();
    }

    /// Whether the cloud around a place is dense enough to ask about it.
    pub fn is_known(&self, point: Vec3) -> bool {
        self.is_known_cell(self.cells.cell_of(point))
    }

    fn is_known_cell(&self, cell: usize) -> bool {
        self.counts[cell] as usize > self.config.min_points
    }

    /// Probability that a proxy is solid: unknown before it is in view and as long as its turn to be asked has not come, none
    /// once it was seen through or where hardly anything is known of the surface, else as answered.
    pub fn probability(&self, proxy: usize) -> f32 {
        let sight = &self.proxies.sights()[proxy];
        match self.answers[proxy] {
            _ if !sight.is_in_field() => UNKNOWN,
            _ if !sight.is_solid() || !self.is_known_cell(self.homes[proxy] as usize) => 0.0,
            answer => answer.map_or(UNKNOWN, |answer| answer.probability),
        }
    }

    /// Asks about the proxies that may have changed: their cloud grew, or they were looked at from elsewhere. The nearest
    /// and longest unasked ones first, as many as the settings allow.
    ///
    /// # Errors
    /// When the network fails or does not answer every question with a number.
    pub fn ask(
        &mut self,
        predictor: &dyn NbvPredictor,
        eye: &Pose,
        step: usize,
        rng: &mut Rng,
    ) -> Result<(), PredictError> {
        let mut open: Vec<(f32, u32)> = Vec::new();
        for (proxy, (&point, sight)) in self.proxies.points().iter().zip(self.proxies.sights()).enumerate() {
            let cell = self.homes[proxy] as usize;
            if !sight.is_in_field() || !sight.is_solid() || !self.is_known_cell(cell) {
                continue;
            }
            let first = Answer { probability: UNKNOWN, views: 0, points: 0, step };
            let last = self.answers[proxy].get_or_insert(first);
            if last.points != self.counts[cell] || last.views != sight.views {
                open.push((point.distance(eye.position) / (step - last.step + 1) as f32, proxy as u32));
            }
        }
        open.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        // The cloud around a cell costs the network as much as a dozen questions about it.
        let mut cells = BTreeSet::new();
        let is_affordable = |&proxy: &u32| {
            let cell = self.homes[proxy as usize];
            cells.contains(&cell) || cells.len() < self.config.cells && cells.insert(cell)
        };
        let proxies = open.into_iter().map(|(_, proxy)| proxy);
        let asked: Vec<u32> = proxies.filter(is_affordable).take(self.config.queries).collect();
        let (inputs, places): (Vec<_>, Vec<_>) = self.questions(&self.proxies, &asked, eye, rng).into_iter().unzip();
        let answers = predictor.occupancy(&inputs)?;
        if answers.len() != inputs.len() || answers.iter().zip(&places).any(|(a, p)| a.len() != p.len()) {
            return Err(PredictError::Backend("not every proxy was answered".into()));
        }
        for (&proxy, &probability) in places.iter().flatten().zip(answers.iter().flatten()) {
            if !probability.is_finite() {
                return Err(PredictError::NonFinite("occupancy"));
            }
            let proxy = proxy as usize;
            let (views, points) = (self.proxies.sights()[proxy].views, self.counts[self.homes[proxy] as usize]);
            self.answers[proxy] = Some(Answer { probability: probability.clamp(0.0, 1.0), views, points, step });
        }
        Ok(())
    }

    /// Answers every proxy by other means than a network.
    pub fn answer(&mut self, probability: impl Fn(usize) -> f32) {
        for (proxy, answer) in self.answers.iter_mut().enumerate() {
            *answer = Some(Answer { probability: probability(proxy), views: 0, points: 0, step: 0 });
        }
    }

    /// The network's input for some points of a field, cell by cell, and which points each input asks about. Around every
    /// point the cloud must be dense enough, see [`Belief::is_known`].
    pub fn questions(
        &self,
        field: &Field,
        asked: &[u32],
        eye: &Pose,
        rng: &mut Rng,
    ) -> Vec<(OccupancyInput, Vec<u32>)> {
        let mut by_cell: BTreeMap<usize, Vec<u32>> = BTreeMap::new();
        for &point in asked {
            by_cell.entry(self.cells.cell_of(field.points()[point as usize])).or_default().push(point);
        }
        let harmonics = Harmonics::facing(eye.azimuth);
        let scale = 1.0 / (3.0 * self.cells.diagonal());
        let questions = by_cell.into_iter().map(|(cell, points)| {
            let middle = self.cells.middle(cell);
            let place = |point: Vec3| scale * to_view(point - middle, eye.azimuth);
            let cloud = self.cells.draw(cell, self.config.cloud_points, place, rng);
            let places: Vec<Vec3> = points.iter().map(|&point| place(field.points()[point as usize])).collect();
            let input = OccupancyInput {
                cloud: cloud.points(self.config.cloud_points),
                offsets: places.iter().map(|&query| cloud.offsets(query)).collect(),
                queries: places.iter().map(Vec3::to_array).collect(),
                harmonics: points.iter().map(|&point| harmonics.of(field.sights()[point as usize].views)).collect(),
            };
            (input, points)
        });
        questions.collect()
    }

    /// What the network is asked about each candidate camera, seen from `eye`.
    pub fn candidates(&self, eye: &Pose, cameras: &[Pose], rng: &mut Rng) -> Vec<CandidateInput> {
        let all = (0..self.homes.len()).map(|proxy| (proxy, self.probability(proxy)));
        let likely: Vec<(usize, f32)> =
            all.filter(|&(_, probability)| probability > self.config.min_probability).collect();
        let harmonics = Harmonics::facing(eye.azimuth);
        cameras.iter().map(|camera| self.candidate(eye, camera, &likely, &harmonics, rng)).collect()
    }

    fn candidate(
        &self,
        eye: &Pose,
        camera: &Pose,
        likely: &[(usize, f32)],
        harmonics: &Harmonics,
        rng: &mut Rng,
    ) -> CandidateInput {
        let (points, eye_there) = (self.proxies.points(), self.camera.at(camera));
        let is_in_view = |&&(proxy, _): &&(usize, f32)| eye_there.project(points[proxy]).is_some();
        let worth =
            |proxy: usize| (self.config.full_distance / camera.position.distance(points[proxy])).min(1.0).powi(2);
        let mut mass = 0.0;
        let inside = likely.iter().filter(is_in_view).map(|&(proxy, probability)| {
            mass += probability;
            (proxy, probability, mass)
        });
        let inside: Vec<(usize, f32, f32)> = inside.collect();
        let Some(last) = inside.len().checked_sub(1) else { return CandidateInput::default() };
        let mut shares: BTreeMap<usize, u32> = BTreeMap::new();
        for _ in 0..self.config.draws {
            let at = mass * rng.random::<f32>();
            *shares.entry(inside.partition_point(|&(.., sum)| sum <= at).min(last)).or_default() += 1;
        }
        let drawn: Vec<(usize, f32, u32)> =
            shares.into_iter().map(|(at, share)| (inside[at].0, inside[at].1, share)).collect();
        let seen = drawn.iter().map(|&(proxy, ..)| to_view(points[proxy] - eye.position, eye.azimuth));
        let seen: Vec<Vec3> = seen.collect();
        let [low, high] = seen.iter().fold([seen[0]; 2], |[low, high], &point| [low.min(point), high.max(point)]);
        let scale = 1.0 / (self.bounds[1] - self.bounds[0]).length();
        let mut input = CandidateInput { mass, ..CandidateInput::default() };
        for (point, (proxy, probability, share)) in seen.into_iter().zip(drawn) {
            let [x, y, z] = (scale * (point - 0.5 * (low + high))).to_array();
            let away = camera.position - points[proxy];
            let sight = &self.proxies.sights()[proxy];
            let of_views = || harmonics.of(sight.views);
            input.points.push([x, y, z, probability]);
            input.harmonics.push(if sight.is_in_field() { of_views() } else { [0.0; HARMONICS] });
            input.directions.push(to_view(away.normalize_or_zero(), eye.azimuth).to_array());
            input.weights.push(share as f32 / self.config.draws as f32 * worth(proxy));
        }
        input
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::Mass;
    use super::*;
    use crate::config::SimConfig;
    use crate::episode::{Action, Episode};
    use crate::pose::{Direction, Heading, LatticePose, Node};
    use crate::scene::Scene;
    use crate::seed::SeedTree;
    use crate::world::World;
    use std::sync::{Arc, Mutex};

    /// Counts cells and questions, and says that everything is solid.
    #[derive(Default)]
    struct Counting(Mutex<Vec<(usize, usize)>>);

    impl NbvPredictor for Counting {
        fn occupancy(&self, inputs: &[OccupancyInput]) -> Result<Vec<Vec<f32>>, PredictError> {
            let answers: Vec<Vec<f32>> = inputs.iter().map(|input| vec![1.5; input.queries.len()]).collect();
            self.0.lock().unwrap().push((inputs.len(), answers.iter().map(Vec::len).sum()));
            Ok(answers)
        }

        fn gains(&self, candidates: &[CandidateInput]) -> Result<Vec<f32>, PredictError> {
            Mass.gains(candidates)
        }
    }

    fn episode() -> Episode {
        let world = Arc::new(World::new(Scene::two_rooms(), &SimConfig::default()).unwrap());
        let start = LatticePose { node: Node { i: 1, k: 2 }, heading: Heading::new(2) };
        Episode::new(world, start, 9, SeedTree::new(1)).unwrap()
    }

    fn belief(episode: &Episode, config: NbvConfig) -> Belief {
        let scene = episode.world().scene();
        let mut belief = Belief::new(scene.bounds(), SimConfig::default().camera, config, &mut SeedTree::new(2).rng());
        belief.observe(&episode.view());
        belief
    }

    #[test]
    fn only_what_may_have_changed_is_asked_again_and_no_more_than_allowed() {
        let mut episode = episode();
        let config = NbvConfig { proxies: 2000, cells: 1, queries: 40, ..NbvConfig::DEFAULT };
        let (network, mut rng) = (Counting::default(), SeedTree::new(3).rng());
        let mut belief = belief(&episode, config);
        let eye = episode.view().camera();
        for step in 0..60 {
            belief.ask(&network, &eye, step, &mut rng).unwrap();
        }
        let counts = std::mem::take(&mut *network.0.lock().unwrap());
        assert_eq!((counts[0].0, counts[59]), (1, (0, 0)));
        assert!(counts.iter().all(|&(cells, asked)| cells <= 1 && asked <= 40) && counts.len() == 60);
        let open = |belief: &Belief| {
            let sights = belief.proxies.sights().iter().zip(belief.proxies.points());
            sights.filter(|(sight, point)| sight.is_in_field() && sight.is_solid() && belief.is_known(**point)).count()
        };
        assert_eq!(counts.iter().map(|&(_, asked)| asked).sum::<usize>(), open(&belief), "each once");
        let of = |belief: &Belief, wanted: f32| (0..2000).filter(|&proxy| belief.probability(proxy) == wanted).count();
        assert_eq!(of(&belief, 1.0), open(&belief), "answers are probabilities");
        assert_eq!(of(&belief, 0.5), belief.proxies.sights().iter().filter(|sight| !sight.is_in_field()).count());
        episode.step(Action { direction: Some(Direction::PlusX), heading: Heading::new(2) });
        belief.observe(&episode.view());
        belief.ask(&network, &episode.view().camera(), 60, &mut rng).unwrap();
        assert!(matches!(network.0.lock().unwrap()[..], [(1, 1..=40)]), "the cloud has grown");
    }

    #[test]
    fn the_expected_gain_of_the_drawn_proxies_is_the_sum_over_the_frustum() {
        let episode = episode();
        let config = NbvConfig { proxies: 3000, full_distance: 3.0, ..NbvConfig::DEFAULT };
        let belief = belief(&episode, config);
        let eye = episode.view().camera();
        let there = Pose { azimuth: eye.azimuth + 0.5, ..eye };
        let points = belief.proxies.points().iter().enumerate();
        let inside = points.filter(|(_, point)| belief.camera.project(&there, **point).is_some());
        let worth = |distance: f32| (3.0 / distance).min(1.0).powi(2);
        let exact: f32 =
            inside.map(|(proxy, point)| belief.probability(proxy) * worth(point.distance(there.position))).sum();
        let mut rng = SeedTree::new(3).rng();
        let inputs: Vec<CandidateInput> = (0..400).flat_map(|_| belief.candidates(&eye, &[there], &mut rng)).collect();
        let drawn = Mass.gains(&inputs).unwrap().iter().sum::<f32>() / 400.0;
        assert!((drawn / exact - 1.0).abs() < 0.02, "{drawn} {exact}");
        for input in inputs {
            assert!(input.points.len() <= 64 && input.points.len() == input.weights.len());
            assert!(input.directions.iter().all(|&d| (Vec3::from(d).length() - 1.0).abs() < 1e-5));
        }
    }
}
