//! Every compiled back end gives the same answers and makes the same training step as `flex`.

use crate::{AdamW, Batch, DeviceChoice, InputScale, Nbp, NetConfig, SampleRef, Tasks, loss};
use burn::optim::GradientsParams;
use burn::prelude::*;
use nbp_env::label::ValueLabel;
use nbp_env::window::{Window, WindowSize};
use nbp_env::{EncoderInput, Heading};

/// Software Vulkan compiles every kernel on first use: small, or the test takes minutes.
const PIXELS: usize = 32;

struct Outcome {
    value: Vec<f32>,
    obstacle: Vec<f32>,
    loss: f32,
    loss_after_a_step: f32,
    stepped_value: Vec<f32>,
}

fn outcome(choice: DeviceChoice) -> Outcome {
    let device = choice.resolve().unwrap().autodiff();
    let config = NetConfig { base: 2, input_scale: InputScale::Log1p, ..NetConfig::default() };
    let net = Nbp::new(&config, 5, &device).unwrap();
    let window = Window { size: WindowSize { pixels: PIXELS, metres: 40.0 }, centre: [0, 0], height: 1.65 };
    let counts = (0..5 * PIXELS * PIXELS).map(|i| if i * 7919 % 13 == 0 { (i % 40) as u16 } else { 0 }).collect();
    let input = EncoderInput { window, channels: 5, counts };
    let labels: Vec<ValueLabel> =
        (0..6).map(|n| ValueLabel { heading: Heading::new(n), row: n, col: n + 1, gain: n as f32 }).collect();
    let walls: Vec<u8> = (0..PIXELS * PIXELS).map(|i| u8::from(i % 11 == 0)).collect();
    let sample = SampleRef { input: &input, labels: &labels, obstacle: &walls };
    let batch = Batch::new(&[sample, sample], &config, &device).unwrap();
    // A large ε keeps AdamW from magnifying gradients that are nothing but rounding.
    let mut optim = AdamW { eps: 1e-2, ..AdamW::default() }.init();
    let numbers = |tensor: Tensor<4>| tensor.into_data().try_to_vec::<f32>().unwrap();

    let before = net.forward(batch.x_bchw.clone());
    let (value, obstacle) = (numbers(before.value_bkhw.clone()), numbers(before.obstacle_b1hw.clone()));
    let losses = loss(&net, before, &batch.targets, Tasks::Both);
    let first = losses.values().total;
    let gradients = GradientsParams::from_grads(losses.total.backward(), &net);
    let net = optim.step(1e-2, net, gradients);
    let after = net.forward(batch.x_bchw.clone());
    let stepped_value = numbers(after.value_bkhw.clone());
    let loss_after_a_step = loss(&net, after, &batch.targets, Tasks::Both).values().total;
    Outcome { value, obstacle, loss: first, loss_after_a_step, stepped_value }
}

fn assert_close(what: &str, a: &[f32], b: &[f32], tolerance: f32) {
    let scale = b.iter().fold(1.0_f32, |m, v| m.max(v.abs()));
    let worst = a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    println!("{what}: largest difference {worst:e} of {scale}");
    assert!(a.len() == b.len() && worst <= tolerance * scale, "{what}: {worst} of {scale}");
}

fn agrees_with_flex(choice: DeviceChoice) {
    let (here, flex) = (outcome(choice), outcome(DeviceChoice::Flex));
    assert_close("value map", &here.value, &flex.value, 1e-3);
    assert_close("obstacle logits", &here.obstacle, &flex.obstacle, 1e-3);
    assert_close("loss", &[here.loss], &[flex.loss], 1e-4);
    assert_close("loss after a step", &[here.loss_after_a_step], &[flex.loss_after_a_step], 1e-3);
    assert_close("value map after a step", &here.stepped_value, &flex.stepped_value, 1e-2);
    assert!(here.loss_after_a_step < here.loss, "the step went downhill");
}

#[cfg(feature = "wgpu")]
#[test]
fn wgpu_agrees_with_flex() {
    agrees_with_flex(DeviceChoice::Wgpu);
}

#[cfg(feature = "ndarray")]
#[test]
fn ndarray_agrees_with_flex() {
    agrees_with_flex(DeviceChoice::Ndarray);
}

#[test]
fn flex_agrees_with_itself() {
    agrees_with_flex(DeviceChoice::Flex);
}
