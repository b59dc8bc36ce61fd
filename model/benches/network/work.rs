//! What is measured: one size of the network and one thing to do with it, ready to be done again and again.
//!
//! Inputs and labels come from formulas in whole numbers, which `peers/measure.py` computes too.

use crate::Failure;
use burn::optim::{GradientsParams, ModuleOptimizer};
use burn::prelude::*;
use nbp_env::Heading;
use nbp_env::label::ValueLabel;
use nbp_env::predict::EncoderInput;
use nbp_env::window::{Window, WindowSize};
use nbp_model::{AdamW, Batch, CheckpointConfig, Nbp, NetConfig, NetPredictor, SampleRef, Tasks, loss, weights};
use std::path::Path;
use std::str::FromStr;

/// Sizes of network and batch.
#[derive(Clone, Copy, PartialEq)]
pub(crate) struct Row {
    /// Of the input, in pixels.
    pub(crate) side: usize,
    /// Channels of the first stage.
    pub(crate) base: usize,
    /// Samples.
    pub(crate) batch: usize,
}

impl FromStr for Row {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Option<Vec<usize>> = text.split('/').map(|number| number.parse().ok()).collect();
        match numbers.as_deref() {
            Some(&[side, base, batch]) if side > 0 && side.is_multiple_of(16) && batch > 0 => {
                Ok(Self { side, base, batch })
            }
            _ => Err(format!("`{text}`: say side/base/batch, the side a multiple of 16, as in 128/16/8")),
        }
    }
}

impl std::fmt::Display for Row {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(&format!("{}/{}/{}", self.side, self.base, self.batch))
    }
}

impl Row {
    pub(crate) fn config(&self) -> CheckpointConfig {
        let window = WindowSize { pixels: self.side, metres: 40.0 };
        CheckpointConfig::new(NetConfig { base: self.base, ..NetConfig::default() }, window)
    }

    /// The same for all rows of one base: first values from the seed 1.
    fn network(&self, device: &Device) -> Result<Nbp, Failure> {
        Ok(Nbp::new(&self.config().net, 1, device)?)
    }

    /// Counts as a map has them: most pixels empty, some with a few points.
    fn counts(&self) -> impl Iterator<Item = u16> {
        let count = |i: usize| ((i * 7919 % 97).saturating_sub(80) * (i * 31 % 11)) as u16;
        (0..self.batch * 5 * self.side * self.side).map(count)
    }

    fn samples(&self, device: &Device) -> Result<Batch, Failure> {
        let Self { side, batch, .. } = *self;
        let config = self.config();
        let window = Window { size: config.window, centre: [0, 0], height: 1.65 };
        let all: Vec<u16> = self.counts().collect();
        let input = |counts: &[u16]| EncoderInput { window, channels: 5, counts: counts.to_vec() };
        let inputs: Vec<_> = all.chunks_exact(5 * side * side).map(input).collect();
        let label = |i: usize| ValueLabel {
            heading: Heading::new(i),
            row: i % (side / 4),
            col: i * 3 % (side / 4),
            gain: i as f32,
        };
        let labels: Vec<_> = (0..20).map(label).collect();
        let obstacle: Vec<_> = (0..batch * side * side).map(|i| u8::from(i % 13 == 0)).collect();
        let walls = obstacle.chunks_exact(side * side);
        let samples: Vec<_> =
            inputs.iter().zip(walls).map(|(input, obstacle)| SampleRef { input, labels: &labels, obstacle }).collect();
        Ok(Batch::new(&samples, &config.net, device)?)
    }

    /// Writes the network as all work on this row begins with it.
    pub(crate) fn export(&self, folder: &Path) -> Result<(), Failure> {
        Ok(weights::save(folder, &self.network(&Device::flex())?, &self.config())?)
    }
}

/// One of three things to do.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Task {
    /// Forward, loss, backward, optimiser.
    Train,
    /// The batch's maps.
    Infer,
    /// One sample's maps: what an agent waits for.
    Decide,
}

impl Task {
    pub(crate) const ALL: [Self; 3] = [Self::Infer, Self::Decide, Self::Train];

    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Train => "train",
            Self::Infer => "infer",
            Self::Decide => "decide",
        }
    }
}

impl FromStr for Task {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::ALL.into_iter().find(|task| task.name() == text).ok_or(format!("`{text}`: say train, infer or decide"))
    }
}

/// A task on a row, ready.
#[allow(clippy::large_enum_variant)] // there is one
pub(crate) enum Work {
    Train { net: Nbp, optim: ModuleOptimizer, batch: Batch },
    Infer { net: NetPredictor, counts: Vec<f32>, shape: [usize; 4] },
}

impl Work {
    pub(crate) fn new(task: Task, row: Row) -> Result<Self, Failure> {
        if task == Task::Train {
            let device = Device::flex().autodiff().gradient_checkpointing();
            let batch = row.samples(&device)?;
            return Ok(Self::Train { net: row.network(&device)?, optim: AdamW::default().init(), batch });
        }
        let row = if task == Task::Decide { Row { batch: 1, ..row } } else { row };
        let net = NetPredictor::new(&row.network(&Device::flex())?, &row.config()).with_chunk(row.batch);
        let shape = [row.batch, 5, row.side, row.side];
        Ok(Self::Infer { net, counts: row.counts().map(f32::from).collect(), shape })
    }

    /// Does it once. Returns a number by which others can see that they did the same: the loss before the step, or the
    /// mean of all value maps plus that of all obstacle maps.
    pub(crate) fn step(&mut self) -> Result<f64, Failure> {
        match self {
            Self::Train { net, optim, batch } => {
                let losses = loss(net, net.forward(batch.x_bchw.clone()), &batch.targets, Tasks::Both);
                let values = losses.values();
                let gradients = GradientsParams::from_grads(losses.total.backward(), net);
                *net = optim.step(AdamW::default().lr, net.clone(), gradients);
                Ok(f64::from(values.total))
            }
            Self::Infer { net, counts, shape } => {
                let maps = net.answer(counts, *shape)?;
                let mean = |map: &[f32]| map.iter().map(|&x| f64::from(x)).sum::<f64>() / map.len() as f64;
                Ok(mean(&maps.value) + mean(&maps.obstacle))
            }
        }
    }
}
