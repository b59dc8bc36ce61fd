//! The networks behind the seam: [`SconePredictor`] answers what [`NbvPredictor`] is asked.

use super::{Scone, batch};
use crate::weights::WeightsError;
use crate::weights::scone::{self as weights, SconeDescription};
use burn::prelude::*;
use nbp_env::PredictError;
use nbp_env::nbv::{CandidateInput, NbvPredictor, OccupancyInput};
use std::path::Path;

/// Queries that go through the network at once.
const QUERIES: usize = 512;
/// Numbers of an attention matrix that are in memory at once.
const SCORES: usize = 1 << 24;

/// Networks that only infer. They may be shared by threads.
#[derive(Debug)]
pub struct SconePredictor {
    net: Scone,
    config: SconeDescription,
    device: Device,
}

impl SconePredictor {
    /// A copy of `net` as it is now, which may go on training.
    pub fn new(net: &Scone, config: &SconeDescription, device: &Device) -> Self {
        Self { net: net.valid(), config: config.clone(), device: device.clone().without_autodiff() }
    }

    /// The checkpoint in a folder.
    ///
    /// # Errors
    /// See [`weights::load`].
    pub fn load(dir: &Path, device: &Device) -> Result<Self, WeightsError> {
        let checkpoint = weights::load(dir, device)?;
        Ok(Self::new(&checkpoint.net, &checkpoint.config, device))
    }

    /// What the networks were trained with.
    pub fn config(&self) -> &SconeDescription {
        &self.config
    }

    /// How many sets of `rows` points may attend to themselves at once.
    fn at_once(&self, rows: usize) -> usize {
        (SCORES / (self.config.net.heads * rows * rows).max(1)).max(1)
    }
}

impl NbvPredictor for SconePredictor {
    /// Probabilities, cut to 0 to 1: the last layer is a GELU, which is not bounded above and dips below zero.
    fn occupancy(&self, inputs: &[OccupancyInput]) -> Result<Vec<Vec<f32>>, PredictError> {
        in_pool(|| self.occupied(inputs))
    }

    fn gains(&self, candidates: &[CandidateInput]) -> Result<Vec<f32>, PredictError> {
        in_pool(|| self.gained(candidates))
    }
}

/// Computes on a thread of the pool: for each operator of its own, one from elsewhere would wait for a thread there to wake.
fn in_pool<R: Send>(work: impl FnOnce() -> R + Send) -> R {
    rayon::scope(|_| work())
}

impl SconePredictor {
    fn occupied(&self, inputs: &[OccupancyInput]) -> Result<Vec<Vec<f32>>, PredictError> {
        inputs.iter().try_for_each(batch::check_occupancy)?;
        let asking: Vec<usize> = (0..inputs.len()).filter(|&n| !inputs[n].queries.is_empty()).collect();
        let mut answers: Vec<Vec<f32>> = inputs.iter().map(|input| Vec::with_capacity(input.queries.len())).collect();
        let rows = asking.iter().map(|&n| inputs[n].cloud.len()).max().unwrap_or(0);
        for asking in asking.chunks(self.at_once(rows)) {
            let clouds: Vec<&[[f32; 3]]> = asking.iter().map(|&n| &inputs[n].cloud[..]).collect();
            let (cloud_ln3, padding) = batch::clouds(&clouds, &self.device);
            let cloud_lg = self.net.occupancy.clouds(cloud_ln3, padding.as_ref());
            let all = asking
                .iter()
                .enumerate()
                .flat_map(|(row, &n)| (0..inputs[n].queries.len()).map(move |query| (row, n, query)));
            let all: Vec<(usize, usize, usize)> = all.collect();
            for part in all.chunks(QUERIES) {
                let queries = batch::queries(inputs, part, &self.device);
                let found = read(self.net.occupancy.forward(cloud_lg.clone(), queries), "occupancy")?;
                part.iter().zip(found).for_each(|(&(_, n, _), p)| answers[n].push(p.clamp(0.0, 1.0)));
            }
        }
        Ok(answers)
    }

    fn gained(&self, candidates: &[CandidateInput]) -> Result<Vec<f32>, PredictError> {
        candidates.iter().try_for_each(batch::check_candidate)?;
        let mut gains = vec![0.0; candidates.len()];
        // Those of a size go together, so that little is padding.
        let mut order: Vec<usize> = (0..candidates.len()).filter(|&n| !candidates[n].points.is_empty()).collect();
        order.sort_by_key(|&n| candidates[n].points.len());
        let rows = order.last().map_or(0, |&n| candidates[n].points.len());
        for part in order.chunks(self.at_once(rows)) {
            let chosen: Vec<&CandidateInput> = part.iter().map(|&n| &candidates[n]).collect();
            let found = read(self.net.visibility.forward(&batch::views(&chosen, &self.device)), "gain")?;
            part.iter().zip(found).for_each(|(&n, gain)| gains[n] = gain);
        }
        Ok(gains)
    }
}

fn read(tensor: Tensor<1>, name: &'static str) -> Result<Vec<f32>, PredictError> {
    let numbers: Result<Vec<f32>, _> = tensor.into_data().convert::<f32>().try_to_vec();
    let numbers = numbers.map_err(|error| PredictError::Backend(error.to_string()))?;
    match numbers.iter().all(|number| number.is_finite()) {
        true => Ok(numbers),
        false => Err(PredictError::NonFinite(name)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::net::gradients::noise;
    use crate::scone::SconeConfig;
    use crate::weights::scone::Baseline;
    use nbp_env::nbv::{HARMONICS, NEIGHBOURS};

    fn predictor() -> SconePredictor {
        let net = SconeConfig { width: 16, ..SconeConfig::default() };
        let scone = Scone::new(&net, 5, &Device::flex().autodiff()).unwrap();
        SconePredictor::new(&scone, &SconeDescription::new(Baseline::Scone, net), &Device::flex().autodiff())
    }

    /// Numbers in rows of `N`, the same for a name.
    fn rows<const N: usize>(name: &str, count: usize) -> Vec<[f32; N]> {
        let numbers: Vec<f32> = noise(name, count * N).into_iter().map(|x| x as f32).collect();
        numbers.as_chunks().0.to_vec()
    }

    fn asked(name: &str, points: usize, queries: usize) -> OccupancyInput {
        let offsets: Vec<[f32; 3]> = rows(&format!("{name} offsets"), queries * 3 * NEIGHBOURS);
        OccupancyInput {
            cloud: rows(&format!("{name} cloud"), points),
            queries: rows(&format!("{name} queries"), queries),
            offsets: offsets.as_chunks().0.as_chunks().0.to_vec(),
            harmonics: rows::<HARMONICS>(&format!("{name} harmonics"), queries),
        }
    }

    fn candidate(name: &str, points: usize) -> CandidateInput {
        let unit = |v: [f32; 3]| v.map(|x| x / v.iter().map(|x| x * x).sum::<f32>().sqrt());
        CandidateInput {
            points: rows(&format!("{name} points"), points),
            harmonics: rows(&format!("{name} harmonics"), points),
            directions: rows(&format!("{name} directions"), points).into_iter().map(unit).collect(),
            weights: vec![1.0 / points.max(1) as f32; points],
            mass: 20.0,
        }
    }

    #[test]
    fn can_be_shared_by_threads() {
        fn shared<T: Send + Sync>() {}
        shared::<SconePredictor>();
    }

    #[test]
    fn answers_do_not_depend_on_what_else_is_asked() {
        let predictor = predictor();
        let inputs = [asked("a", 40, 3), asked("b", 7, 0), asked("c", 64, 600), OccupancyInput::default()];
        let together = predictor.occupancy(&inputs).unwrap();
        assert_eq!(together.iter().map(Vec::len).collect::<Vec<_>>(), [3, 0, 600, 0]);
        assert!(together.iter().flatten().all(|p| (0.0..=1.0).contains(p)));
        assert!(together.iter().flatten().any(|&p| p > 0.0));
        for (input, together) in inputs.iter().zip(&together) {
            let alone = predictor.occupancy(std::slice::from_ref(input)).unwrap();
            assert!(alone[0].iter().zip(together).all(|(a, b)| (a - b).abs() < 1e-5));
        }

        let candidates = [candidate("a", 20), candidate("b", 0), candidate("c", 3), candidate("d", 50)];
        let together = predictor.gains(&candidates).unwrap();
        assert!(together[1] == 0.0 && together[0] > 0.1 && together[0] != together[2], "{together:?}");
        for (candidate, together) in candidates.iter().zip(&together) {
            let alone = predictor.gains(std::slice::from_ref(candidate)).unwrap()[0];
            assert!((alone - together).abs() < 1e-4, "{alone} {together}");
        }
        assert!(predictor.occupancy(&[]).unwrap().is_empty() && predictor.gains(&[]).unwrap().is_empty());
    }

    #[test]
    fn threads_get_the_same_answer() {
        let (shared, inputs) = (predictor(), [candidate("a", 20), candidate("c", 3)]);
        let first = shared.gains(&inputs).unwrap();
        std::thread::scope(|scope| {
            let threads: Vec<_> = (0..3).map(|_| scope.spawn(|| shared.gains(&inputs).unwrap())).collect();
            threads.into_iter().for_each(|thread| assert_eq!(thread.join().unwrap(), first));
        });
    }

    #[test]
    fn misfits_and_numbers_that_are_none_are_errors() {
        let predictor = predictor();
        let mut input = asked("a", 20, 3);
        input.harmonics.pop();
        let error = predictor.occupancy(&[input]).unwrap_err().to_string();
        assert!(error.contains("3 queries have 3 neighbourhoods and 2 sets of harmonics"), "{error}");
        let error = predictor.occupancy(&[OccupancyInput { cloud: vec![], ..asked("a", 9, 3) }]).unwrap_err();
        assert!(error.to_string().contains("without points"), "{error}");
        let mut input = candidate("a", 4);
        input.weights.push(1.0);
        let error = predictor.gains(&[input]).unwrap_err().to_string();
        assert!(error.contains("4 points have 4 sets of harmonics, 4 directions and 5 weights"), "{error}");
        let mut input = candidate("a", 4);
        input.mass = f32::NAN;
        assert!(matches!(predictor.gains(&[input]), Err(PredictError::NonFinite("gain"))));
    }
}
