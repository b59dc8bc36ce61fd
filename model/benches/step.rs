//! Seconds for one training step and one inference, with Burn's own operators and with those of `fast`.
//!
//! `cargo bench --profile dev -p model` takes the sizes of the quickstart, with `-- 256/64/1 fast` side/base/batch and one set of
//! operators (the bench
//! profile would compile Burn a second time, to the same code). Wall-clock medians are what a user waits for; CPU seconds
//! say more on a busy machine.

#![allow(clippy::unwrap_used)] // a benchmark may stop at the first failure

use burn::optim::GradientsParams;
use burn::prelude::*;
use nbp_env::Heading;
use nbp_env::label::ValueLabel;
use nbp_env::predict::EncoderInput;
use nbp_env::window::{Window, WindowSize};
use nbp_model::{AdamW, Batch, Nbp, NetConfig, SampleRef, fast, loss, tensorize};
use std::time::Instant;

struct Data {
    inputs: Vec<EncoderInput>,
    labels: Vec<ValueLabel>,
    obstacle: Vec<u8>,
}

impl Data {
    fn new(side: usize, batch: usize) -> Self {
        let window = Window { size: WindowSize { pixels: side, metres: 40.0 }, centre: [0, 0], height: 1.65 };
        let count = |i: usize| ((i * 7919 % 97).saturating_sub(80) * (i * 31 % 11)) as u16;
        let input = |b: usize| EncoderInput {
            window,
            channels: 5,
            counts: (0..5 * side * side).map(|i| count(i + b)).collect(),
        };
        let label = |i: usize| ValueLabel {
            heading: Heading::new(i),
            row: i % (side / 4),
            col: i * 3 % (side / 4),
            gain: i as f32,
        };
        Self {
            inputs: (0..batch).map(input).collect(),
            labels: (0..20).map(label).collect(),
            obstacle: (0..side * side).map(|i| u8::from(i % 13 == 0)).collect(),
        }
    }

    fn batch(&self, config: &NetConfig, device: &Device) -> Batch {
        let sample = |input| SampleRef { input, labels: &self.labels, obstacle: &self.obstacle };
        Batch::new(&self.inputs.iter().map(sample).collect::<Vec<_>>(), config, device).unwrap()
    }
}

/// Median seconds of `runs` calls on the clock, and mean CPU seconds, after one call to warm up.
fn measure(runs: usize, mut call: impl FnMut()) -> String {
    call();
    let cpu = cpu_seconds();
    let mut seconds: Vec<f64> = (0..runs)
        .map(|_| {
            let start = Instant::now();
            call();
            start.elapsed().as_secs_f64()
        })
        .collect();
    seconds.sort_by(f64::total_cmp);
    format!("{:.3} ({:.2})", seconds[runs / 2], (cpu_seconds() - cpu) / runs as f64)
}

/// User and system time of this process, in Linux's ticks of 10 ms; 0 elsewhere.
fn cpu_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields = stat.rsplit(')').next().unwrap_or_default().split_whitespace();
    fields.skip(11).take(2).filter_map(|ticks| ticks.parse::<f64>().ok()).sum::<f64>() / 100.0
}

fn train(config: &NetConfig, data: &Data) -> String {
    let device = Device::flex().autodiff();
    let mut net = Some(Nbp::new(config, 1, &device).unwrap());
    let (settings, batch) = (AdamW::default(), data.batch(config, &device));
    let mut optim = settings.init();
    measure(7, || {
        let current = net.take().unwrap();
        let losses = loss(&current, current.forward(batch.x_bchw.clone()), &batch.targets);
        assert!(losses.values().is_finite());
        let gradients = GradientsParams::from_grads(losses.total.backward(), &current);
        net = Some(optim.step(settings.lr, current, gradients));
    })
}

fn infer(config: &NetConfig, inputs: &[EncoderInput]) -> String {
    let device = Device::flex();
    let net = Nbp::new(config, 1, &device).unwrap();
    let x_bchw = tensorize::inputs(inputs, config, &device).unwrap();
    measure(9, || {
        let output = net.forward(x_bchw.clone());
        let _ = (output.value_bkhw.into_data(), output.obstacle_b1hw.into_data());
    })
}

fn main() {
    let mut sizes: Vec<[usize; 3]> = std::env::args()
        .filter_map(|arg| arg.split('/').map(|n| n.parse().ok()).collect::<Option<Vec<_>>>()?.try_into().ok())
        .collect();
    let named = |name: &str| std::env::args().any(|arg| arg == name);
    let wanted = |name: &str| named(name) || !(named("burn") || named("fast"));
    if sizes.is_empty() {
        sizes = vec![[128, 8, 8], [128, 16, 8]];
    }
    println!("seconds on the clock (on the CPU), {} threads", rayon::current_num_threads());
    println!("{:<17}{:<11}{:<16}{:<16}one inference", "side/base/batch", "operators", "training step", "inference");
    for [side, base, batch] in sizes {
        let config = NetConfig { base, ..NetConfig::default() };
        let data = Data::new(side, batch);
        for (name, on) in [("burn", false), ("fast", true)].into_iter().filter(|(name, _)| wanted(name)) {
            fast::enable(on);
            let (step, many, one) =
                (train(&config, &data), infer(&config, &data.inputs), infer(&config, &data.inputs[..1]));
            println!("{:<17}{name:<11}{step:<16}{many:<16}{one}", format!("{side}/{base}/{batch}"));
        }
    }
}
