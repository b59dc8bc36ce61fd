//! Arrays in, tensors out: the only place where samples become tensors.

use crate::config::NetConfig;
use crate::loss::Targets;
use burn::prelude::*;
use burn::tensor::TensorData;
use nbp_env::label::ValueLabel;
use nbp_env::predict::EncoderInput;
use nbp_env::window::VALUE_STRIDE;

/// One training sample, borrowed.
#[derive(Clone, Copy, Debug)]
pub struct SampleRef<'a> {
    /// What the network sees.
    pub input: &'a EncoderInput,
    /// What is known of the value map; two labels of one cell count once, with their mean.
    pub labels: &'a [ValueLabel],
    /// `S · S`, row-major, 0 for free and anything else for an obstacle.
    pub obstacle: &'a [u8],
}

/// Samples that do not fit each other or the network.
#[derive(Debug, thiserror::Error)]
pub enum TensorizeError {
    /// Nothing to do.
    #[error("the batch is empty: give at least one sample")]
    Empty,
    /// A dimension is off.
    #[error("sample {sample}: {what} is {found}, but {wanted} is needed")]
    Shape {
        /// Position in the batch.
        sample: usize,
        /// Which dimension.
        what: &'static str,
        /// As given.
        found: usize,
        /// As the network, or the first sample, has it.
        wanted: usize,
    },
    /// The side of the window does not halve four times.
    #[error("sample {sample}: a window of {pixels} pixels does not halve four times: use a multiple of 16")]
    Side {
        /// Position in the batch.
        sample: usize,
        /// As given.
        pixels: usize,
    },
    /// A label lies outside the value map or is not a number.
    #[error("sample {sample}: {label:?} is not in a value map of {headings} × {size} × {size} or is not finite")]
    Label {
        /// Position in the batch.
        sample: usize,
        /// The label.
        label: ValueLabel,
        /// Channels of the map.
        headings: usize,
        /// Side of the map.
        size: usize,
    },
}

/// Samples as the training step wants them.
#[derive(Clone, Debug)]
pub struct Batch {
    /// `[b, in, S, S]`.
    pub x_bchw: Tensor<4>,
    /// What the answer should be.
    pub targets: Targets,
}

impl Batch {
    /// Puts samples on a device.
    ///
    /// # Errors
    /// When samples do not fit each other or the network.
    pub fn new(samples: &[SampleRef<'_>], config: &NetConfig, device: &Device) -> Result<Self, TensorizeError> {
        let borrowed: Vec<&EncoderInput> = samples.iter().map(|sample| sample.input).collect();
        let x_bchw = to_tensor(&borrowed, config, device)?;
        let [b, _, side, _] = x_bchw.dims();
        let (area, size) = (side * side, side / VALUE_STRIDE);

        let mut obstacle = Vec::with_capacity(b * area);
        let mut sum = vec![0.0f32; b * config.headings * size * size];
        let mut count = vec![0u32; sum.len()];
        for (index, sample) in samples.iter().enumerate() {
            same(index, "the number of obstacle pixels", sample.obstacle.len(), area)?;
            obstacle.extend(sample.obstacle.iter().map(|&pixel| f32::from(u8::from(pixel != 0))));
            for &label in sample.labels {
                let ValueLabel { heading, row, col, gain } = label;
                let heading = heading.index();
                if heading >= config.headings || row >= size || col >= size || !gain.is_finite() {
                    return Err(TensorizeError::Label { sample: index, label, headings: config.headings, size });
                }
                let cell = ((index * config.headings + heading) * size + row) * size + col;
                sum[cell] += gain;
                count[cell] += 1;
            }
        }
        let value = sum.iter().zip(&count).map(|(&sum, &count)| sum / count.max(1) as f32).collect();
        let mask = count.iter().map(|&count| f32::from(u8::from(count > 0))).collect();
        let cells = |numbers: Vec<f32>| data(numbers, [b, config.headings, size, size], device);
        Ok(Self {
            x_bchw,
            targets: Targets {
                value_bkhw: cells(value),
                mask_bkhw: cells(mask),
                labelled: count.iter().filter(|&&count| count > 0).count(),
                obstacle_b1hw: data(obstacle, [b, 1, side, side], device),
            },
        })
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.x_bchw.dims()[0]
    }

    /// Never: an empty batch is refused.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Inputs as one tensor.
///
/// # Shapes
/// → `[b, in, S, S]`.
///
/// # Errors
/// When inputs do not fit each other or the network.
pub fn inputs(inputs: &[EncoderInput], config: &NetConfig, device: &Device) -> Result<Tensor<4>, TensorizeError> {
    to_tensor(&inputs.iter().collect::<Vec<_>>(), config, device)
}

fn to_tensor(inputs: &[&EncoderInput], config: &NetConfig, device: &Device) -> Result<Tensor<4>, TensorizeError> {
    let side = inputs.first().ok_or(TensorizeError::Empty)?.size();
    let mut numbers = Vec::with_capacity(inputs.len() * config.in_channels * side * side);
    for (index, input) in inputs.iter().enumerate() {
        if input.size() == 0 || !input.size().is_multiple_of(16) {
            return Err(TensorizeError::Side { sample: index, pixels: input.size() });
        }
        same(index, "the side of the window", input.size(), side)?;
        same(index, "the number of channels", input.channels, config.in_channels)?;
        same(index, "the number of counts", input.counts.len(), config.in_channels * side * side)?;
        numbers.extend(input.counts.iter().map(|&count| config.input_scale.apply(count)));
    }
    Ok(data(numbers, [inputs.len(), config.in_channels, side, side], device))
}

fn same(sample: usize, what: &'static str, found: usize, wanted: usize) -> Result<(), TensorizeError> {
    if found == wanted { Ok(()) } else { Err(TensorizeError::Shape { sample, what, found, wanted }) }
}

fn data(numbers: Vec<f32>, shape: [usize; 4], device: &Device) -> Tensor<4> {
    Tensor::from_data(TensorData::new(numbers, shape), device)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::config::InputScale;
    use nbp_env::Heading;
    use nbp_env::window::{Window, WindowSize};

    /// An input of pseudo-random small counts.
    pub(crate) fn input(pixels: usize, channels: usize, seed: u32) -> EncoderInput {
        let mut state = seed.wrapping_mul(0x9e37_79b9) | 1;
        let counts = (0..channels * pixels * pixels)
            .map(|_| {
                state ^= state << 13;
                state ^= state >> 17;
                state ^= state << 5;
                (state % 7) as u16 * u16::from(state & 0x300 == 0)
            })
            .collect();
        let size = WindowSize { pixels, metres: 40.0 };
        EncoderInput { window: Window { size, centre: [0, 0], height: 1.65 }, channels, counts }
    }

    fn small() -> NetConfig {
        NetConfig { base: 2, ..NetConfig::default() }
    }

    fn read(tensor: Tensor<4>) -> Vec<f32> {
        tensor.into_data().try_to_vec().unwrap()
    }

    #[test]
    fn labels_land_on_their_cells_and_doubles_count_once() {
        let (a, b) = (input(32, 5, 1), input(32, 5, 2));
        let label = |heading, row, col, gain| ValueLabel { heading: Heading::new(heading), row, col, gain };
        let labels = [label(7, 2, 3, 4.0), label(7, 2, 3, 2.0), label(0, 0, 0, 0.0)];
        let mut obstacle = vec![0; 32 * 32];
        obstacle[33] = 255;
        let samples = [
            SampleRef { input: &a, labels: &[], obstacle: &obstacle },
            SampleRef { input: &b, labels: &labels, obstacle: &obstacle },
        ];
        let batch = Batch::new(&samples, &small(), &Device::flex()).unwrap();
        assert_eq!((batch.len(), batch.targets.labelled), (2, 2));
        assert_eq!(batch.x_bchw.dims(), [2, 5, 32, 32]);
        let (value, mask) = (read(batch.targets.value_bkhw), read(batch.targets.mask_bkhw));
        let cell = ((8 + 7) * 8 + 2) * 8 + 3;
        assert_eq!((value[cell], mask[cell]), (3.0, 1.0));
        assert_eq!((mask.iter().sum::<f32>(), value.iter().sum::<f32>()), (2.0, 3.0));
        let obstacle = read(batch.targets.obstacle_b1hw);
        assert_eq!((obstacle[33], obstacle[1024 + 33], obstacle.iter().sum::<f32>()), (1.0, 1.0, 2.0));
        assert_eq!(read(batch.x_bchw)[5 * 1024 + 7], f32::from(b.counts[7]));
    }

    #[test]
    fn log_scale_is_applied() {
        let mut one = input(16, 5, 1);
        one.counts[0] = 1;
        let config = NetConfig { input_scale: InputScale::Log1p, ..small() };
        let x = read(inputs(&[one], &config, &Device::flex()).unwrap());
        assert!((x[0] - 2.0f32.ln()).abs() < 1e-7);
    }

    #[test]
    fn misfits_are_named() {
        let device = Device::flex();
        let says = |error: TensorizeError, what: &str| assert!(error.to_string().contains(what), "{error}");
        says(inputs(&[], &small(), &device).unwrap_err(), "empty");
        says(inputs(&[input(24, 5, 1)], &small(), &device).unwrap_err(), "multiple of 16");
        says(inputs(&[input(32, 4, 1)], &small(), &device).unwrap_err(), "number of channels is 4, but 5");
        says(inputs(&[input(32, 5, 1), input(16, 5, 1)], &small(), &device).unwrap_err(), "sample 1: the side");
        let (x, free) = (input(16, 5, 1), vec![0; 256]);
        let off = [ValueLabel { heading: Heading::new(0), row: 4, col: 0, gain: 1.0 }];
        let bad = [SampleRef { input: &x, labels: &off, obstacle: &free }];
        says(Batch::new(&bad, &small(), &device).unwrap_err(), "value map of 8 × 4 × 4");
        let bad = [SampleRef { input: &x, labels: &[], obstacle: &free[1..] }];
        says(Batch::new(&bad, &small(), &device).unwrap_err(), "obstacle pixels is 255, but 256");
    }
}
