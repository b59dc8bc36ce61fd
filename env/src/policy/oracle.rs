//! Predictors that know a part of the answer: `oracle-obstacles` the obstacle map (paper, section 5.3, Table 4), `oracle-looks`
//! what looks would add. What a policy lacks with them is not the fault of that part.

use super::nbp::Nbp;
use super::{Plan, Policy, PolicyError};
use crate::coverage::Coverage;
use crate::episode::Action;
use crate::label::look_labels;
use crate::map::MapView;
use crate::pose::HEADINGS;
use crate::predict::{EncoderInput, ObstacleMap, PredictError, Prediction, Predictor, ValueMap};
use crate::seed::Rng;
use crate::visibility::PointSet;
use crate::window::VALUE_STRIDE;
use crate::world::World;
use glam::Vec3;
use std::sync::{Arc, Mutex, PoisonError};

/// Wraps a predictor and replaces its obstacle maps by the ground truth of one world.
pub struct OracleObstacles<P> {
    inner: P,
    world: Arc<World>,
}

impl<P> OracleObstacles<P> {
    /// Answers for inputs of `world`.
    pub fn new(inner: P, world: Arc<World>) -> Self {
        Self { inner, world }
    }
}

impl<P: Predictor> Predictor for OracleObstacles<P> {
    fn predict(&self, inputs: &[EncoderInput]) -> Result<Vec<Prediction>, PredictError> {
        let predictions = self.inner.predict(inputs)?.into_iter().zip(inputs);
        Ok(predictions
            .map(|(prediction, input)| {
                let truth = self.world.obstacles().crop(&input.window);
                let probability = truth.into_iter().map(f32::from).collect();
                Prediction { obstacle: ObstacleMap { size: input.size(), probability }, ..prediction }
            })
            .collect())
    }
}

/// What an episode has really covered, from the frames that a policy is shown.
pub(super) struct Hindsight {
    coverage: Coverage,
    frames: usize,
}

impl Hindsight {
    pub(super) fn new(world: &World) -> Self {
        Self { coverage: Coverage::new(world.surface()), frames: 0 }
    }

    /// Takes in the frames since the last time, and returns all that is covered.
    pub(super) fn look_back(&mut self, world: &World, view: &MapView<'_>) -> PointSet {
        let fresh: Vec<Vec3> = view.cloud().of_frames(self.frames).collect();
        self.coverage.add(world.surface(), &fresh, 0);
        self.frames = view.cloud().frames();
        world.glimpses().covered_by(&self.coverage)
    }
}

/// Replaces value maps by what looks would truly add, [`look_labels`], to what it was last told is covered.
struct OracleValues {
    inner: Arc<dyn Predictor>,
    world: Arc<World>,
    covered: Mutex<PointSet>,
}

impl Predictor for OracleValues {
    fn predict(&self, inputs: &[EncoderInput]) -> Result<Vec<Prediction>, PredictError> {
        let covered = self.covered.lock().unwrap_or_else(PoisonError::into_inner);
        let truth = |input: &EncoderInput| {
            let size = input.size() / VALUE_STRIDE;
            let mut gain = vec![0.0; HEADINGS * size * size];
            for label in look_labels(&self.world, &covered, &input.window, |_| true) {
                gain[(label.heading.index() * size + label.row) * size + label.col] = label.gain;
            }
            ValueMap { size, gain }
        };
        let predictions = self.inner.predict(inputs)?.into_iter().zip(inputs);
        Ok(predictions.map(|(prediction, input)| Prediction { value: truth(input), ..prediction }).collect())
    }
}

/// `oracle-looks`: [`Nbp`] with [`Goals::Surroundings`](super::nbp::Goals) on the true gains of looks.
pub struct OracleLooks {
    nbp: Nbp,
    values: Arc<OracleValues>,
    hindsight: Hindsight,
}

impl OracleLooks {
    /// In `world`, with the obstacle maps of `inner`; `nbp` makes the policy that asks a predictor.
    pub fn new(inner: Arc<dyn Predictor>, world: Arc<World>, nbp: impl FnOnce(Arc<dyn Predictor>) -> Nbp) -> Self {
        let (hindsight, covered) = (Hindsight::new(&world), Mutex::new(world.glimpses().nothing()));
        let values = Arc::new(OracleValues { inner, world, covered });
        Self { nbp: nbp(values.clone()), values, hindsight }
    }
}

impl Policy for OracleLooks {
    fn name(&self) -> &'static str {
        "oracle-looks"
    }

    fn begin(&mut self) {
        self.nbp.begin();
        self.hindsight = Hindsight::new(&self.values.world);
    }

    fn act(&mut self, view: &MapView<'_>, rng: &mut Rng) -> Result<Action, PolicyError> {
        let covered = self.hindsight.look_back(&self.values.world, view);
        *self.values.covered.lock().unwrap_or_else(PoisonError::into_inner) = covered;
        self.nbp.act(view, rng)
    }

    fn plan(&self) -> Option<&Plan> {
        self.nbp.plan()
    }
}
