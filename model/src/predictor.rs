//! The network behind the seam: [`NetPredictor`] answers encoder inputs with maps.

use crate::config::CheckpointConfig;
use crate::net::Nbp;
use crate::tensorize;
use crate::weights::{self, WeightsError};
use burn::prelude::*;
use burn::tensor::TensorData;
use burn::tensor::activation::sigmoid;
use nbp_env::predict::{EncoderInput, ObstacleMap, PredictError, Prediction, Predictor, ValueMap};
use nbp_env::window::VALUE_STRIDE;
use std::path::Path;

/// Inputs that go through the network at once unless told otherwise.
const CHUNK: usize = 8;

/// A network that only infers: running statistics, no tape.
///
/// It may be shared by threads: a forward pass reads the weights and changes nothing.
#[derive(Debug)]
pub struct NetPredictor {
    net: Nbp,
    config: CheckpointConfig,
    device: Device,
    chunk: usize,
}

impl NetPredictor {
    /// A copy of `net` as it is now, which may go on training.
    pub fn new(net: &Nbp, config: &CheckpointConfig) -> Self {
        let net = net.valid();
        let device = net.log_vars.val().device();
        Self { net, config: config.clone(), device, chunk: CHUNK }
    }

    /// The checkpoint in a folder.
    ///
    /// # Errors
    /// See [`weights::load`].
    pub fn load(dir: &Path, device: &Device) -> Result<Self, WeightsError> {
        let checkpoint = weights::load(dir, device)?;
        Ok(Self::new(&checkpoint.net, &checkpoint.config))
    }

    /// What the network was trained with.
    pub fn config(&self) -> &CheckpointConfig {
        &self.config
    }

    /// At most `samples` inputs go through the network at once, which bounds its memory.
    #[must_use]
    pub fn with_chunk(mut self, samples: usize) -> Self {
        self.chunk = samples.max(1);
        self
    }

    fn check(&self, input: &EncoderInput) -> Result<(), PredictError> {
        let (side, channels) = (self.config.window.pixels, self.config.net.in_channels);
        let pairs = [
            ("side", input.size(), side),
            ("number of channels", input.channels, channels),
            ("number of counts", input.counts.len(), channels * side * side),
        ];
        match pairs.into_iter().find(|(_, found, wanted)| found != wanted) {
            Some((what, found, wanted)) => Err(PredictError::Shape { what, found, wanted }),
            None => Ok(()),
        }
    }

    fn predict_chunk(&self, inputs: &[EncoderInput]) -> Result<Vec<Prediction>, PredictError> {
        let x_bchw = tensorize::inputs(inputs, &self.config.net, &self.device).map_err(|error| backend(&error))?;
        let maps = self.maps(x_bchw)?;
        let side = self.config.window.pixels;
        let size = side / VALUE_STRIDE;
        let values = maps.value.chunks_exact(self.config.net.headings * size * size);
        let obstacles = maps.obstacle.chunks_exact(side * side);
        Ok(values
            .zip(obstacles)
            .map(|(gain, probability)| Prediction {
                value: ValueMap { size, gain: gain.to_vec() },
                obstacle: ObstacleMap { size: side, probability: probability.to_vec() },
            })
            .collect())
    }

    /// Answers to inputs of any numbers and any side, for comparison with other frameworks. `counts` are what an
    /// [`EncoderInput`] holds, before the network's own scale.
    ///
    /// # Shapes
    /// `[n, in, S, S]`, row-major, S a multiple of 16.
    ///
    /// # Errors
    /// When the shape does not fit the network, or an answer is not finite.
    pub fn answer(&self, counts: &[f32], shape: [usize; 4]) -> Result<Maps, PredictError> {
        let [n, channels, rows, cols] = shape;
        let pairs = [
            ("number of channels", channels, self.config.net.in_channels),
            ("number of columns", cols, rows),
            ("side", rows, rows.next_multiple_of(16).max(16)),
            ("number of numbers", counts.len(), n * channels * rows * cols),
        ];
        if let Some((what, found, wanted)) = pairs.into_iter().find(|(_, found, wanted)| found != wanted) {
            return Err(PredictError::Shape { what, found, wanted });
        }
        let mut all = Maps { value: Vec::new(), obstacle: Vec::new() };
        let sample = channels * rows * cols;
        for chunk in counts.chunks(self.chunk * sample) {
            let numbers: Vec<f32> = chunk.iter().map(|&count| self.config.net.input_scale.scale(count)).collect();
            let data = TensorData::new(numbers, [chunk.len() / sample, channels, rows, cols]);
            let maps = self.maps(Tensor::from_data(data, &self.device))?;
            all.value.extend(maps.value);
            all.obstacle.extend(maps.obstacle);
        }
        Ok(all)
    }

    fn maps(&self, x_bchw: Tensor<4>) -> Result<Maps, PredictError> {
        let output = self.net.forward(x_bchw);
        let read = |tensor: Tensor<4>, name| {
            let numbers: Vec<f32> = tensor.into_data().convert::<f32>().try_to_vec().map_err(|e| backend(&e))?;
            if numbers.iter().all(|number| number.is_finite()) {
                Ok(numbers)
            } else {
                Err(PredictError::NonFinite(name))
            }
        };
        let value = read(output.value_bkhw, "value")?;
        Ok(Maps { value, obstacle: read(sigmoid(output.obstacle_b1hw), "obstacle")? })
    }
}

/// The network's answer to a batch as plain numbers, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct Maps {
    /// `[n, k, S/4, S/4]`, percent points of coverage.
    pub value: Vec<f32>,
    /// `[n, 1, S, S]`, probabilities.
    pub obstacle: Vec<f32>,
}

fn backend(error: &dyn std::fmt::Display) -> PredictError {
    PredictError::Backend(error.to_string())
}

impl Predictor for NetPredictor {
    fn predict(&self, inputs: &[EncoderInput]) -> Result<Vec<Prediction>, PredictError> {
        inputs.iter().try_for_each(|input| self.check(input))?;
        let mut predictions = Vec::with_capacity(inputs.len());
        for chunk in inputs.chunks(self.chunk) {
            predictions.extend(self.predict_chunk(chunk)?);
        }
        Ok(predictions)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::NetConfig;
    use crate::tensorize::tests::input;
    use nbp_env::window::WindowSize;

    fn predictor() -> NetPredictor {
        let config = NetConfig { base: 4, ..NetConfig::default() };
        let net = Nbp::new(&config, 3, &Device::flex()).unwrap();
        NetPredictor::new(&net, &CheckpointConfig::new(config, WindowSize { pixels: 32, metres: 40.0 }))
    }

    #[test]
    fn can_be_shared_by_threads() {
        fn shared<T: Send + Sync>() {}
        shared::<NetPredictor>();
    }

    #[test]
    fn answers_have_their_shapes_and_do_not_depend_on_the_chunks() {
        let inputs: Vec<_> = (0..5).map(|seed| input(32, 5, seed)).collect();
        let together = predictor().predict(&inputs).unwrap();
        let apart = predictor().with_chunk(2).predict(&inputs).unwrap();
        assert_eq!(together.len(), 5);
        for (a, b) in together.iter().zip(&apart) {
            assert!(a.value.is_consistent(32) && a.obstacle.probability.len() == 32 * 32);
            assert!(a.obstacle.probability.iter().all(|p| (0.0..=1.0).contains(p)));
            for (x, y) in a.value.gain.iter().zip(&b.value.gain) {
                assert!((x - y).abs() < 1e-4, "{x} {y}");
            }
        }
        assert_ne!(together[0].value, together[1].value);
        assert!(predictor().predict(&[]).unwrap().is_empty());
    }

    #[test]
    fn plain_numbers_get_the_same_answer() {
        let inputs: Vec<_> = (0..3).map(|seed| input(32, 5, seed)).collect();
        let counts: Vec<f32> =
            inputs.iter().flat_map(|input| input.counts.iter().map(|&count| f32::from(count))).collect();
        let maps = predictor().with_chunk(2).answer(&counts, [3, 5, 32, 32]).unwrap();
        let predictions = predictor().with_chunk(2).predict(&inputs).unwrap();
        assert_eq!(maps.value, predictions.iter().flat_map(|p| p.value.gain.clone()).collect::<Vec<_>>());
        assert_eq!(maps.obstacle, predictions.iter().flat_map(|p| p.obstacle.probability.clone()).collect::<Vec<_>>());
        let fails = |shape| predictor().answer(&counts, shape).unwrap_err().to_string();
        assert!(fails([3, 4, 40, 32]).contains("channels is 4"));
        assert!(fails([3, 5, 24, 24]).contains("side is 24"));
        assert!(fails([3, 5, 32, 16]).contains("columns is 16"));
        assert!(fails([4, 5, 32, 32]).contains("numbers"));
    }

    #[test]
    fn threads_get_the_same_answer() {
        let (shared, one) = (predictor(), [input(32, 5, 9)]);
        let first = shared.predict(&one).unwrap();
        std::thread::scope(|scope| {
            let threads: Vec<_> = (0..3).map(|_| scope.spawn(|| shared.predict(&one).unwrap())).collect();
            for thread in threads {
                assert_eq!(thread.join().unwrap(), first);
            }
        });
    }

    #[test]
    fn misfits_and_damaged_weights_are_errors() {
        let error = predictor().predict(&[input(16, 5, 1)]).unwrap_err();
        assert!(matches!(error, PredictError::Shape { what: "side", found: 16, wanted: 32 }), "{error}");
        let error = predictor().predict(&[input(32, 4, 1)]).unwrap_err();
        assert!(matches!(error, PredictError::Shape { found: 4, wanted: 5, .. }), "{error}");

        let mut broken = predictor();
        broken.net = broken.net.map(&mut Poison);
        assert!(matches!(broken.predict(&[input(32, 5, 1)]), Err(PredictError::NonFinite("value"))));
    }

    struct Poison;

    impl burn::module::ModuleMapper for Poison {
        fn map_float<const D: usize>(&mut self, p: burn::module::Param<Tensor<D>>) -> burn::module::Param<Tensor<D>> {
            p.map(|t| t.mul_scalar(f32::NAN))
        }
    }
}
