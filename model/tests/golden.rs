//! The network against PyTorch: answers, loss, gradients, running statistics, files both ways, and 20 steps of training.
//!
//! `golden/make.py` made the stored tensors; weights, inputs and labels come from a formula that both sides compute.

#![allow(clippy::unwrap_used)] // a test says what went wrong by failing

use burn::module::ModuleVisitor;
use burn::optim::GradientsParams;
use burn::prelude::*;
use burn::tensor::activation::sigmoid;
use nbp_env::Heading;
use nbp_env::label::ValueLabel;
use nbp_env::predict::EncoderInput;
use nbp_env::window::{Window, WindowSize};
use nbp_model::{AdamW, Batch, CheckpointConfig, Nbp, NetConfig, SampleRef, Tasks, fast, loss, weights};
use safetensors::tensor::{Dtype, SafeTensors, TensorView, serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// Held by whoever computes: [`fast::enable`] is the whole program's switch.
static SWITCH: Mutex<()> = Mutex::new(());

/// Numbers in `[-1, 1)`: 24 bits of SplitMix64 over an FNV-1a hash of the name.
fn noise(name: &str, count: usize) -> Vec<f64> {
    let key =
        name.bytes().fold(0xcbf2_9ce4_8422_2325u64, |key, byte| (key ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3));
    (1..=count as u64)
        .map(|index| {
            let x = key.wrapping_add(index.wrapping_mul(0x9e37_79b9_7f4a_7c15));
            let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            ((x ^ (x >> 31)) >> 40) as f64 / (1u64 << 23) as f64 - 1.0
        })
        .collect()
}

/// The formula's weights for a tensor, at scales that keep signals alive through the depth.
fn formula(name: &str, shape: &[usize]) -> Vec<f32> {
    let scale = |u: f64| match () {
        () if shape.len() == 4 => u * (6.0 / shape[1..].iter().product::<usize>() as f64).sqrt(),
        () if name.ends_with("running_mean") => u * 0.5,
        () if name.ends_with("running_var") => 1.0 + 0.5 * u,
        () if name.ends_with("weight") => 1.0 + 0.3 * u,
        () => u * 0.2,
    };
    noise(name, shape.iter().product()).into_iter().map(|u| scale(u) as f32).collect()
}

type Tensors = BTreeMap<String, (Vec<usize>, Vec<f32>)>;

fn floats(bytes: &[u8]) -> Vec<f32> {
    bytes.as_chunks().0.iter().map(|&word| f32::from_le_bytes(word)).collect()
}

/// The floating-point tensors of a file.
fn read(path: &Path) -> Tensors {
    let bytes = std::fs::read(path).unwrap();
    let file = SafeTensors::deserialize(&bytes).unwrap();
    let float = file.iter().filter(|(_, view)| view.dtype() == Dtype::F32);
    float.map(|(name, view)| (name.to_owned(), (view.shape().to_vec(), floats(view.data())))).collect()
}

fn golden(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(name)
}

fn config(base: usize, pixels: usize) -> CheckpointConfig {
    CheckpointConfig::new(NetConfig { base, ..NetConfig::default() }, WindowSize { pixels, metres: 40.0 })
}

/// A network with the formula's weights, by way of a file in PyTorch's names and layout.
fn network(config: &CheckpointConfig, device: &Device) -> Nbp {
    let dir = tempfile::tempdir().unwrap();
    let fresh = Nbp::new(&config.net, 1, &Device::flex()).unwrap();
    weights::save(dir.path(), &fresh, config).unwrap();
    let path = dir.path().join(weights::WEIGHTS_FILE);
    let filled: Vec<_> = read(&path)
        .into_iter()
        .map(|(name, (shape, _))| {
            let bytes: Vec<u8> = formula(&name, &shape).into_iter().flat_map(f32::to_le_bytes).collect();
            (name, shape, bytes)
        })
        .collect();
    let views =
        filled.iter().map(|(name, shape, bytes)| (name, TensorView::new(Dtype::F32, shape.clone(), bytes).unwrap()));
    std::fs::write(&path, serialize(views, None).unwrap()).unwrap();
    weights::load(dir.path(), device).unwrap().net
}

/// The formula's batch.
fn batch(config: &CheckpointConfig, samples: usize, device: &Device) -> Batch {
    let side = config.window.pixels;
    let (area, cells) = (side * side, side * side / 16);
    let counts: Vec<u16> =
        noise("input", samples * 5 * area).into_iter().map(|u| (u * 12.0 - 4.0).max(0.0) as u16).collect();
    let wall: Vec<u8> = noise("wall", samples * area).into_iter().map(|u| u8::from(u > 0.6)).collect();
    let mask = noise("mask", samples * 8 * cells);
    let gain = noise("gain", samples * 8 * cells);
    let window = Window { size: config.window, centre: [0, 0], height: 1.65 };
    let inputs: Vec<_> = counts
        .chunks_exact(5 * area)
        .map(|counts| EncoderInput { window, channels: 5, counts: counts.to_vec() })
        .collect();
    let labels: Vec<Vec<ValueLabel>> = mask
        .chunks_exact(8 * cells)
        .zip(gain.chunks_exact(8 * cells))
        .map(|(mask, gain)| {
            let label = |cell: usize| ValueLabel {
                heading: Heading::new(cell / cells),
                row: cell % cells / (side / 4),
                col: cell % (side / 4),
                gain: (5.0 + 5.0 * gain[cell]) as f32,
            };
            (0..8 * cells).filter(|&cell| mask[cell] > 0.9).map(label).collect()
        })
        .collect();
    let samples: Vec<_> = (0..samples)
        .map(|i| SampleRef { input: &inputs[i], labels: &labels[i], obstacle: &wall[i * area..(i + 1) * area] })
        .collect();
    Batch::new(&samples, &config.net, device).unwrap()
}

/// Largest difference, and the largest number of `want`.
fn compare(what: &str, got: &[f32], want: &[f32]) -> (f32, f32) {
    assert_eq!(got.len(), want.len(), "{what}");
    let difference = got.iter().zip(want).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    (difference, want.iter().fold(0.0, |max, x| max.max(x.abs())))
}

/// Equal to 1e-4 for numbers around one, and to 1e-4 of the largest for larger ones.
fn assert_close(what: &str, got: Tensor<4>, want: &Tensors) {
    let got: Vec<f32> = got.into_data().iter::<f32>().collect();
    let (difference, largest) = compare(what, &got, &want[what].1);
    assert!(difference <= 1e-4 * largest.max(1.0), "{what}: off by {difference}, largest {largest}");
}

/// Gradients by released name, found by comparing parameters with the formula's (names live inside the model).
struct Gradients<'a> {
    gradients: &'a GradientsParams,
    found: Vec<(Vec<f32>, Vec<f32>)>,
}

impl ModuleVisitor for Gradients<'_> {
    fn visit_float<const D: usize>(&mut self, param: &burn::module::Param<Tensor<D>>) {
        if let Some(gradient) = self.gradients.get::<D>(param.id) {
            let read = |t: Tensor<D>| t.into_data().iter::<f32>().collect::<Vec<_>>();
            self.found.push((read(param.val().without_autodiff()), read(gradient)));
        }
    }
}

fn agrees(base: usize, side: usize, device: &Device) {
    let want = read(&golden(&format!("b{base}.safetensors")));
    let config = config(base, side);

    let x_bchw = batch(&config, 2, device).x_bchw;
    let output = network(&config, device).forward(x_bchw);
    assert_close("eval.value", output.value_bkhw, &want);
    assert_close("eval.obstacle", sigmoid(output.obstacle_b1hw), &want);

    let device = device.clone().autodiff();
    let (net, batch) = (network(&config, &device), batch(&config, 2, &device));
    let output = net.forward(batch.x_bchw.clone());
    assert_close("train.value", output.value_bkhw.clone(), &want);
    assert_close("train.obstacle", sigmoid(output.obstacle_b1hw.clone()), &want);

    let losses = loss(&net, output, &batch.targets, Tasks::Both);
    let values = losses.values();
    let got = [values.total, values.mse, values.bce, values.sigma[0], values.sigma[1]];
    for (got, want) in got.iter().zip(&want["train.loss"].1) {
        assert!((got - want).abs() <= 1e-4 * want.abs(), "{got} {want}");
    }

    let gradients = GradientsParams::from_grads(losses.total.backward(), &net);
    let mut visitor = Gradients { gradients: &gradients, found: Vec::new() };
    net.visit(&mut visitor);
    let expected: Vec<_> = want.iter().filter_map(|(name, v)| Some((name.strip_prefix("grad.")?, v))).collect();
    assert!(expected.len() > 20, "{}", expected.len());
    for (name, (shape, gradient)) in expected {
        let parameter = formula(name, shape);
        let mut same = visitor.found.iter().filter(|(value, _)| *value == parameter);
        let (_, got) = same.next().unwrap_or_else(|| panic!("no parameter is {name}"));
        let (difference, largest) = compare(name, got, gradient);
        // One pixel on the other side of a ReLU's kink moves all gradients before it: PyTorch's own single precision is
        // up to 1.2 % away from its double precision here. The operators themselves are tested to 2e-6 where they live.
        assert!(difference <= 0.02 * largest.max(1e-3), "grad {name}: off by {difference}, largest {largest}");
    }

    let dir = tempfile::tempdir().unwrap();
    weights::save(dir.path(), &net, &config).unwrap();
    let saved = read(&dir.path().join(weights::WEIGHTS_FILE));
    for (name, (_, after)) in want.iter().filter_map(|(name, v)| Some((name.strip_prefix("after.")?, v))) {
        let (difference, largest) = compare(name, &saved[name].1, after);
        assert!(difference <= 1e-4 * largest.max(1.0), "after {name}: off by {difference}, largest {largest}");
    }
}

#[test]
fn agrees_with_pytorch_in_both_sets_of_operators() {
    let _switch = SWITCH.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    for on in [false, true] {
        fast::enable(on);
        agrees(4, 64, &Device::flex());
        agrees(16, 32, &Device::flex());
    }
}

/// Losses of 20 steps of AdamW on the formula's batch, each before its step.
fn curve() -> Vec<f32> {
    let (config, device, settings) = (config(4, 48), Device::flex().autodiff(), AdamW::default());
    let (mut net, batch) = (network(&config, &device), batch(&config, 3, &device));
    let mut optim = settings.init();
    (0..20)
        .map(|_| {
            let losses = loss(&net, net.forward(batch.x_bchw.clone()), &batch.targets, Tasks::Both);
            let total = losses.values().total;
            let gradients = GradientsParams::from_grads(losses.total.backward(), &net);
            net = optim.step(settings.lr, net.clone(), gradients);
            total
        })
        .collect()
}

#[test]
fn twenty_steps_are_pytorchs_and_the_same_bits_every_time() {
    let _switch = SWITCH.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    fast::enable(true);
    let run = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(curve);
    let got = run(1);
    for threads in [1, 2, 2, 5] {
        let bits = |curve: &[f32]| curve.iter().map(|loss| loss.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&run(threads)), bits(&got), "{threads} threads: {got:?}");
    }

    let stored: BTreeMap<String, Vec<f64>> =
        serde_json::from_slice(&std::fs::read(golden("curve_b4.json")).unwrap()).unwrap();
    let (exact, single) = (&stored["float64"], &stored["float32"]);
    assert_eq!([got.len(), exact.len(), single.len()], [20; 3]);
    // Training is chaotic: each step magnifies the rounding of the one before, by ReLUs that fall to their other side. Its own
    // single precision takes PyTorch from 1e-7 at first to 4e-3 in step 17, about four times as far with every early step.
    for (step, ((&got, &exact), &single)) in got.iter().zip(exact).zip(single).enumerate() {
        let allowed = (4e-6 * 4f64.powi(step as i32)).min(0.02);
        let off = |loss: f64| (loss - exact).abs() / exact;
        println!(
            "step {step}: {got}, off by {:.1e}, PyTorch's single precision by {:.1e}",
            off(f64::from(got)),
            off(single)
        );
        assert!(off(f64::from(got)) <= allowed, "step {step}: {got} is not {exact} within {allowed:e}");
        assert!(off(single) <= allowed, "step {step}: the tolerance is too small for PyTorch itself");
    }
    assert!(exact[19] < 0.4 * exact[0]);
}

#[test]
fn a_file_of_the_released_kind_is_imported() {
    let window = WindowSize::default();
    let checkpoint = weights::import_pth(&golden("released_b2.pth"), window, &Device::flex()).unwrap();
    assert_eq!(checkpoint.config, CheckpointConfig::new(NetConfig { base: 2, ..NetConfig::default() }, window));
    // Left there for `golden/make.py --check target/tmp/imported`, which loads it into PyTorch.
    let dir = Path::new(env!("CARGO_TARGET_TMPDIR")).join("imported");
    weights::save(&dir, &checkpoint.net, &checkpoint.config).unwrap();
    let tensors = read(&dir.join(weights::WEIGHTS_FILE));
    for (name, (shape, values)) in &tensors {
        assert_eq!(*values, formula(name, shape), "{name}");
    }
    assert_eq!(tensors["Conv1.conv.0.weight"].0, [2, 5, 3, 3]);
}
