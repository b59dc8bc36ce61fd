//! `scone`, `macarons`: the neighbouring pose from which the network expects to see most, chosen anew at every step (Guédon
//! et al., NeurIPS 2022 and CVPR 2023). The two differ in how their networks were trained.

use super::{Policy, PolicyError, action_towards, headings_near, observed_price, turn_on_the_spot};
use crate::episode::Action;
use crate::map::MapView;
use crate::nbv::belief::Belief;
use crate::nbv::{NbvConfig, NbvPredictor};
use crate::pose::{Direction, LatticePose, Pose};
use crate::predict::PredictError;
use crate::seed::Rng;
use crate::sensor::Camera;
use crate::world::World;
use glam::Vec3;
use std::sync::Arc;

/// The policy. It is given the scene's box, in which it draws its proxies.
pub struct Scone {
    predictor: Arc<dyn NbvPredictor>,
    config: NbvConfig,
    bounds: [Vec3; 2],
    camera: Camera,
    belief: Option<Belief>,
}

impl Scone {
    /// A policy for episodes in `world`, of which it takes the box and the camera.
    pub fn new(predictor: Arc<dyn NbvPredictor>, config: NbvConfig, world: &World) -> Self {
        let (bounds, camera) = (world.scene().bounds(), *world.sensor().camera());
        Self { predictor, config, bounds, camera, belief: None }
    }
}

impl Policy for Scone {
    fn name(&self) -> &'static str {
        "scone"
    }

    fn begin(&mut self) {
        self.belief = None;
    }

    fn act(&mut self, view: &MapView<'_>, rng: &mut Rng) -> Result<Action, PolicyError> {
        let new = |rng: &mut Rng| Belief::new(self.bounds, self.camera, self.config, rng);
        let belief = match &mut self.belief {
            Some(belief) => belief,
            none => none.insert(new(rng)),
        };
        belief.observe(view);
        belief.ask(&self.predictor, &view.camera(), view.step(), rng)?;
        Ok(match best(belief, &self.predictor, view, &candidates(view), rng)? {
            Some(pose) => action_towards(view.pose().node, pose),
            None => turn_on_the_spot(view, rng),
        })
    }
}

/// Poses one move away, turned by at most three headings: not known to be blocked and not visited, unless all are visited.
pub(crate) fn candidates(view: &MapView<'_>) -> Vec<LatticePose> {
    let LatticePose { node, heading } = view.pose();
    let open = Direction::ALL.into_iter().map(|direction| node.step(direction));
    let open = open.filter(|&next| observed_price(view, node, next).is_some());
    let poses: Vec<LatticePose> =
        open.flat_map(|node| headings_near(heading).map(move |heading| LatticePose { node, heading })).collect();
    let fresh: Vec<LatticePose> = poses.iter().copied().filter(|&pose| view.visits(pose) == 0).collect();
    if fresh.is_empty() { poses } else { fresh }
}

/// The candidate of the highest gain, of equal ones the first.
pub(crate) fn best(
    belief: &Belief,
    predictor: &dyn NbvPredictor,
    view: &MapView<'_>,
    candidates: &[LatticePose],
    rng: &mut Rng,
) -> Result<Option<LatticePose>, PredictError> {
    if candidates.is_empty() {
        return Ok(None);
    }
    let cameras: Vec<Pose> = candidates.iter().map(|&pose| view.lattice().pose(pose)).collect();
    let inputs = belief.candidates(&view.camera(), &cameras, rng);
    let gains = predictor.gains(&inputs)?;
    if gains.len() != inputs.len() {
        return Err(PredictError::Backend(format!("{} gains for {} candidates", gains.len(), inputs.len())));
    }
    if gains.iter().any(|gain| !gain.is_finite()) {
        return Err(PredictError::NonFinite("gain"));
    }
    let ranked = candidates.iter().zip(&gains).reduce(|best, other| if other.1 > best.1 { other } else { best });
    Ok(ranked.map(|(&pose, _)| pose))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::check_policy;
    use crate::config::SimConfig;
    use crate::episode::Episode;
    use crate::nbv::tests::Mass;
    use crate::nbv::{CandidateInput, OccupancyInput};
    use crate::policy::random::Random;
    use crate::policy::tests::explore;
    use crate::pose::{Heading, Node};
    use crate::scene::Scene;

    fn world() -> Arc<World> {
        let camera = Camera { width: 112, height: 64, ..Camera::default() };
        Arc::new(World::new(Scene::two_rooms(), &SimConfig { camera, ..SimConfig::default() }).unwrap())
    }

    const CONFIG: NbvConfig = NbvConfig { proxies: 3000, ..NbvConfig::DEFAULT };

    #[test]
    fn who_counts_what_may_be_there_beats_chance_and_keeps_the_contract() {
        let world = world();
        let area = |episode: &Episode| episode.curve().iter().sum::<f32>();
        let mut scone = Scone::new(Arc::new(Mass), CONFIG, &world);
        assert_eq!(check_policy(&mut scone, &world), []);
        let (mut counting, mut drawing) = (0.0, 0.0);
        for &start in world.scene().starts() {
            counting += area(&explore(&world, &mut scone, start, 25));
            drawing += area(&explore(&world, &mut Random, start, 25));
        }
        assert!(counting > 1.05 * drawing, "{counting} {drawing}");
    }

    #[test]
    fn walls_and_visited_poses_are_left_out() {
        let world = world();
        let start = LatticePose { node: Node { i: 0, k: 0 }, heading: Heading::new(1) };
        let mut episode = Episode::new(world, start, 9, crate::SeedTree::new(1)).unwrap();
        assert_eq!(candidates(&episode.view()).len(), 2 * 7, "the lattice ends at the start");
        assert!(candidates(&episode.view()).iter().all(|pose| pose.heading != Heading::new(5)));
        episode.step(Action { direction: Some(Direction::PlusX), heading: Heading::new(3) });
        episode.step(Action { direction: Some(Direction::PlusX), heading: Heading::new(3) });
        episode.step(Action { direction: Some(Direction::PlusX), heading: Heading::new(3) });
        episode.step(Action { direction: Some(Direction::PlusX), heading: Heading::new(3) });
        assert_eq!(episode.bumps(), 1, "the wall between the rooms");
        let left = candidates(&episode.view());
        assert_eq!(left.len(), 2 * 7 - 1, "not through the wall, and not back to the pose before");
        assert!(!left.contains(&LatticePose { node: Node { i: 2, k: 0 }, heading: Heading::new(3) }));
    }

    #[test]
    fn answers_that_are_no_numbers_or_too_few_are_refused() {
        struct Broken(f32, usize);

        impl NbvPredictor for Broken {
            fn occupancy(&self, inputs: &[OccupancyInput]) -> Result<Vec<Vec<f32>>, PredictError> {
                Mass.occupancy(inputs)
            }

            fn gains(&self, candidates: &[CandidateInput]) -> Result<Vec<f32>, PredictError> {
                Ok(vec![self.0; candidates.len() - self.1])
            }
        }

        let world = world();
        let episode = Episode::random(Arc::clone(&world), 1, crate::SeedTree::new(1));
        let ask = |predictor| {
            let mut scone = Scone::new(Arc::new(predictor), CONFIG, &world);
            scone.act(&episode.view(), &mut crate::SeedTree::new(1).rng()).unwrap_err().to_string()
        };
        assert!(ask(Broken(f32::NAN, 0)).contains("gain map has a value that is not finite"));
        assert!(ask(Broken(1.0, 1)).contains("gains for"));
    }
}
