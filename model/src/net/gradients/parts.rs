//! Every module in training: gradients against finite differences, of all parameters and inputs.
//!
//! Single precision leaves too little of a difference of two losses, so the slope is measured in double precision, by
//! Burn's operators; its gradients have to agree with the slopes to six digits, and those of the kernels with them as far
//! as single precision reaches.

use super::{noise, numbers, tensor, trained};
use crate::net::init::Init;
use crate::net::{
    Conv, ConvBlock, Encoder, Features, Gate, Nbp, NetOutput, Norm, ObstacleDecoder, Stage, Up, ValueDecoder,
};
use crate::{NetConfig, Targets, Tasks, loss};
use burn::module::{ModuleMapper, ModuleVisitor, Param};
use burn::optim::GradientsParams;
use burn::prelude::*;
use burn::tensor::DType;

/// Gives every tensor of a module its numbers: those of a place of the same name in every precision, moved along a
/// direction.
struct Fill {
    dtype: DType,
    /// Which of several sets of numbers.
    place: usize,
    /// Tensor to move, and how far; `None` moves all.
    only: Option<usize>,
    step: f64,
    at: usize,
    /// Names of the modules we are in.
    path: Vec<String>,
}

impl ModuleMapper for Fill {
    fn enter_module(&mut self, name: &str, _: &str) {
        self.path.push(name.to_owned());
    }

    fn exit_module(&mut self, _: &str, _: &str) {
        self.path.pop();
    }

    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let shape = param.val().dims();
        let fan_in = shape[1..].iter().product::<usize>() as f64;
        let name = self.path.join(".");
        let usual = |u: f64| match () {
            () if D == 4 => u * (3.0 / fan_in).sqrt(),
            () if D == 2 => u * (3.0 / shape[0] as f64).sqrt(),
            () if name.ends_with("running_var") => 1.0 + 0.5 * u,
            () if name.ends_with("norm.weight") || name.contains("norm_") && name.ends_with("weight") => 1.0 + 0.3 * u,
            () => 0.2 * u,
        };
        let start = noise(&format!("{name} {} {}", self.at, self.place), shape.iter().product());
        let moved = self.moved(self.at, start.into_iter().map(|u| f64::from(usual(u) as f32)).collect());
        self.at += 1;
        let value = tensor(&moved, shape, self.dtype);
        // Running statistics are no leaves, and no gradient is asked of them.
        Param::initialized(param.id, if name.contains("running") { value } else { value.require_grad() })
    }
}

impl Fill {
    fn new(dtype: DType, place: usize) -> Self {
        Self { dtype, place, only: None, step: 0.0, at: 0, path: Vec::new() }
    }

    fn moved(&self, at: usize, mut numbers: Vec<f64>) -> Vec<f64> {
        if self.step != 0.0 && self.only.is_none_or(|only| only == at) {
            let direction = direction(at, numbers.len());
            numbers.iter_mut().zip(direction).for_each(|(number, along)| *number += self.step * along);
        }
        numbers
    }
}

fn direction(at: usize, count: usize) -> Vec<f64> {
    noise(&format!("direction {at}"), count)
}

/// Gradients of parameters by their order in the module; `None` where there is none.
struct Found<'a> {
    gradients: &'a GradientsParams,
    found: Vec<(String, Option<Vec<f64>>)>,
    path: Vec<String>,
}

impl ModuleVisitor for Found<'_> {
    fn enter_module(&mut self, name: &str, _: &str) {
        self.path.push(name.to_owned());
    }

    fn exit_module(&mut self, _: &str, _: &str) {
        self.path.pop();
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let gradient = self.gradients.get::<D>(param.id).map(numbers);
        self.found.push((self.path.join("."), gradient));
    }
}

/// A module with its inputs, and how it answers them.
pub(crate) struct Part<M, F> {
    pub(crate) name: &'static str,
    pub(crate) fresh: fn(&Init<'_>) -> M,
    pub(crate) inputs: Vec<[usize; 4]>,
    pub(crate) answer: F,
    /// Which tensors have a gradient.
    pub(crate) learns: fn(&str) -> bool,
    /// Whether to move every tensor alone, too.
    pub(crate) each: bool,
}

impl<M: Module, F: Fn(&M, &[Tensor<4>]) -> Vec<Tensor<4>>> Part<M, F> {
    fn at(&self, mut fill: Fill) -> (M, Vec<Tensor<4>>, Tensor<1>) {
        let dtype = fill.dtype;
        let module = (self.fresh)(&Init::zeros(&trained())).map(&mut fill);
        let inputs: Vec<_> = (self.inputs.iter().enumerate())
            .map(|(n, &shape)| {
                let start = noise(&format!("{} input {n} {}", self.name, fill.place), shape.iter().product());
                tensor(&fill.moved(fill.at + n, start), shape, dtype).require_grad()
            })
            .collect();
        // The loss is a sum of the answers in a fixed proportion.
        let total = (self.answer)(&module, &inputs)
            .into_iter()
            .enumerate()
            .map(|(n, answer)| {
                let shape = answer.dims();
                let count = shape.iter().product::<usize>();
                // No division here: Burn keeps the inverse of a divisor in single precision.
                let scale = 1.0 / (count as f64).sqrt();
                let weights: Vec<f64> =
                    noise(&format!("weights {n}"), count).iter().map(|u| f64::from((scale * u) as f32)).collect();
                (answer * tensor(&weights, shape, dtype)).sum()
            })
            .reduce(|a, b| a + b)
            .unwrap();
        (module, inputs, total)
    }

    /// Name and gradient of each tensor: parameters, then inputs.
    fn gradients(&self, dtype: DType, place: usize) -> Vec<(String, Option<Vec<f64>>)> {
        let (module, inputs, total) = self.at(Fill::new(dtype, place));
        let mut grads = total.backward();
        let of_inputs: Vec<_> =
            inputs.iter().map(|input| Some(numbers(input.grad_remove(&mut grads).unwrap()))).collect();
        let gradients = GradientsParams::from_grads(grads, &module);
        let mut visitor = Found { gradients: &gradients, found: Vec::new(), path: Vec::new() };
        module.visit(&mut visitor);
        let inputs = of_inputs.into_iter().enumerate().map(|(n, gradient)| (format!("input {n}"), gradient));
        visitor.found.into_iter().chain(inputs).collect()
    }

    /// How fast the loss changes when a tensor (or all) moves along its direction, by central differences.
    fn measured(&self, only: Option<usize>, step: f64) -> f64 {
        let loss = |step| {
            let fill = Fill { only, step, ..Fill::new(DType::F64, 0) };
            self.at(fill).2.into_scalar::<f64>()
        };
        (loss(step) - loss(-step)) / (2.0 * step)
    }

    /// Error of `slope`, of `size`. A step that carries some number past the kink of a ReLU measures another slope, so
    /// several are tried: what is wrong agrees with none.
    fn error(&self, what: &str, only: Option<usize>, slope: f64, size: f64) -> f64 {
        let tries = STEPS.map(|step| (slope - self.measured(only, step)).abs() / size);
        let best = tries.into_iter().fold(f64::INFINITY, f64::min);
        assert!(best <= DOUBLE, "{}, {what}: gradient {slope} is off finite differences by {tries:?}", self.name);
        best
    }

    pub(crate) fn check(&self) {
        let exact = self.gradients(DType::F64, 0);
        let along = |at: usize, gradient: &[f64]| -> f64 {
            gradient.iter().zip(direction(at, gradient.len())).map(|(g, d)| g * d).sum()
        };
        let slopes: Vec<_> = exact.iter().enumerate().map(|(at, (_, g))| g.as_ref().map(|g| along(at, g))).collect();
        let size = slopes.iter().flatten().fold(0.0f64, |size, slope| size.max(slope.abs()));
        let mut worst = self.error("all at once", None, slopes.iter().flatten().sum(), size);
        for (at, slope) in slopes.iter().enumerate().filter(|_| self.each) {
            if let Some(slope) = *slope {
                worst = worst.max(self.error(&exact[at].0, Some(at), slope, size));
            }
        }

        // A ReLU so near its kink that rounding decides shows as an error, but not at every place.
        let mut kernels = self.kernels(0);
        for place in 1..PLACES {
            if kernels.0 > SINGLE {
                let again = self.kernels(place);
                kernels = if again.0 < kernels.0 { again } else { kernels };
            }
        }
        let (error, at) = kernels;
        assert!(error <= SINGLE, "{}, {at}: kernels are off by {error:e} of the largest, or more elsewhere", self.name);
        println!("{}: {worst:.1e} from finite differences, kernels {error:.1e}", self.name);
    }

    /// The largest error of the kernels' gradients, of the largest number, and in which tensor it is.
    fn kernels(&self, place: usize) -> (f64, String) {
        let (exact, kernels) = (self.gradients(DType::F64, place), self.gradients(DType::F32, place));
        let largest = |g: &[f64]| g.iter().fold(0.0f64, |largest, x| largest.max(x.abs()));
        let of_all = exact.iter().filter_map(|(_, g)| g.as_deref()).map(largest).fold(0.0, f64::max);
        let mut worst = (0.0, String::new());
        for ((name, want), (_, got)) in exact.iter().zip(&kernels) {
            let is_there = [want.is_some(), got.is_some()];
            assert_eq!(is_there, [(self.learns)(name); 2], "{}, {name}: gradient in double and single", self.name);
            let (Some(want), Some(got)) = (want, got) else { continue };
            // A bias before a norm has no gradient but rounding, so a part of the largest of all is allowed everywhere.
            let size = largest(want).max(0.1 * of_all);
            let difference = |(want, got): (&f64, &f64)| if got.is_nan() { f64::INFINITY } else { (want - got).abs() };
            let error = want.iter().zip(got).map(difference).fold(0.0, f64::max) / size;
            if error > worst.0 {
                worst = (error, name.clone());
            }
        }
        worst
    }
}

/// Of the finite differences, from the one with the least rounding to the one with the fewest kinks.
const STEPS: [f64; 4] = [1e-5, 1e-6, 1e-7, 1e-8];
/// What gradients and finite differences may differ, of the largest slope of the module.
const DOUBLE: f64 = 1e-6;
/// What single precision may be off, of the largest number.
const SINGLE: f64 = 3e-5;
/// Sets of numbers to try.
const PLACES: usize = 4;

fn part<M: Module, F: Fn(&M, &[Tensor<4>]) -> Vec<Tensor<4>>>(
    name: &'static str,
    fresh: fn(&Init<'_>) -> M,
    inputs: &[[usize; 4]],
    answer: F,
) {
    let learns = |name: &str| !name.contains("running");
    Part { name, fresh, inputs: inputs.to_vec(), answer, learns, each: true }.check();
}

#[test]
fn layers() {
    part("conv 3x3", |init| Conv::new(3, 5, 6, init), &[[2, 5, 7, 9]], |m, x| vec![m.forward(x[0].clone())]);
    part("conv 1x1", |init| Conv::new(1, 5, 6, init), &[[2, 5, 7, 9]], |m, x| vec![m.forward(x[0].clone())]);
    part(
        "conv doubled",
        |init| Conv::new(3, 5, 6, init),
        &[[2, 5, 4, 6]],
        |m, x| vec![m.forward_doubled(x[0].clone())],
    );
    part("norm", |init| Norm::new(5, init), &[[3, 5, 6, 7]], |m, x| vec![m.forward(x[0].clone())]);
    part("norm and ReLU", |init| Norm::new(5, init), &[[3, 5, 6, 7]], |m, x| vec![m.forward_relu(x[0].clone())]);
}

#[test]
fn bricks() {
    let (g, x) = ([2, 6, 6, 8], [2, 6, 6, 8]);
    part("gate", |init| Gate::new(6, init), &[g, x], |m, x| vec![m.forward(x[0].clone(), x[1].clone())]);
    part("block", |init| ConvBlock::new(3, 4, init), &[[3, 3, 6, 10]], |m, x| vec![m.forward(x[0].clone())]);
    part("up", |init| Up::new(4, 3, init), &[[2, 4, 5, 3]], |m, x| vec![m.forward(x[0].clone())]);
    let (d, skip) = ([2, 8, 4, 6], [2, 4, 8, 12]);
    part("stage", |init| Stage::new(4, init), &[d, skip], |m, x| vec![m.forward(x[0].clone(), x[1].clone())]);
}

const BASE: usize = 2;

/// Shapes of the features of inputs of 48 pixels.
fn features() -> [[usize; 4]; 5] {
    std::array::from_fn(|level| [2, BASE << level, 48 >> level, 48 >> level])
}

fn as_features(x: &[Tensor<4>]) -> Features {
    let [x1, x2, x3, x4, x5] = std::array::from_fn(|level| x[level].clone());
    Features { x1, x2, x3, x4, x5 }
}

#[test]
fn encoder() {
    part(
        "encoder",
        |init| Encoder::new(5, BASE, init),
        &[[2, 5, 48, 48]],
        |m, x| {
            let Features { x1, x2, x3, x4, x5 } = m.forward(x[0].clone());
            vec![x1, x2, x3, x4, x5]
        },
    );
}

#[test]
fn decoders() {
    // A decoder reads no further than its last stage: what it does not see can have no gradient.
    let value = |m: &ValueDecoder, x: &[Tensor<4>]| {
        let unseen = x[0].clone().zeros_like();
        let [x1, x2] = [unseen.clone(), unseen];
        let [x3, x4, x5] = std::array::from_fn(|level| x[level].clone());
        vec![m.forward(&Features { x1, x2, x3, x4, x5 })]
    };
    part("value decoder", |init| ValueDecoder::new(BASE, 8, init), &features()[2..], value);
    let obstacle = |m: &ObstacleDecoder, x: &[Tensor<4>]| vec![m.forward(&as_features(x))];
    part("obstacle decoder", |init| ObstacleDecoder::new(BASE, init), &features(), obstacle);
}

/// A whole network, blank.
fn net(init: &Init<'_>) -> Nbp {
    Nbp::build(&NetConfig { base: BASE, ..NetConfig::default() }, init).unwrap()
}

/// Targets for answers to two inputs of `side` pixels.
fn targets(side: usize, dtype: DType) -> Targets {
    let (cells, pixels) = ([2, 8, side / 4, side / 4], [2, 1, side, side]);
    // Every eighth: a power of two can be divided by without rounding, which Burn does in single precision.
    let mask: Vec<f64> = (0..cells.iter().product()).map(|i: usize| f64::from(u8::from(i.is_multiple_of(8)))).collect();
    let wall = noise("wall", pixels.iter().product()).into_iter().map(|u| f64::from(u8::from(u > 0.5)));
    let gain = noise("gain", mask.len());
    Targets {
        value_bkhw: tensor(&gain, cells, dtype),
        labelled: mask.iter().filter(|&&m| m > 0.0).count(),
        mask_bkhw: tensor(&mask, cells, dtype),
        obstacle_b1hw: tensor(&wall.collect::<Vec<_>>(), pixels, dtype),
    }
}

fn total(net: &Nbp, output: NetOutput, side: usize) -> Vec<Tensor<4>> {
    let targets = targets(side, output.value_bkhw.dtype());
    vec![loss(net, output, &targets, Tasks::Both).total.reshape([1, 1, 1, 1])]
}

#[test]
fn the_loss() {
    let answer =
        |m: &Nbp, x: &[Tensor<4>]| total(m, NetOutput { value_bkhw: x[0].clone(), obstacle_b1hw: x[1].clone() }, 16);
    let inputs = vec![[2, 8, 4, 4], [2, 1, 16, 16]];
    let learns = |name: &str| name == "log_vars" || name.starts_with("input");
    Part { name: "loss", fresh: net, inputs, answer, learns, each: true }.check();
}

#[test]
fn the_whole_network_and_its_loss() {
    let answer = |m: &Nbp, x: &[Tensor<4>]| total(m, m.forward(x[0].clone()), 48);
    let learns = |name: &str| !name.contains("running");
    // Its parts were moved one by one.
    Part { name: "network", fresh: net, inputs: vec![[2, 5, 48, 48]], answer, learns, each: false }.check();
}

#[test]
fn inference() {
    for (base, batch, side) in [(2, 3, 48), (4, 1, 16), (6, 2, 80), (8, 1, 128), (16, 1, 64)] {
        let answer = |dtype| {
            let blank = Nbp::build(&NetConfig { base, ..NetConfig::default() }, &Init::zeros(&trained())).unwrap();
            let net = blank.map(&mut Fill::new(dtype, 0)).valid();
            let x_bchw = tensor(&noise("x", batch * 5 * side * side), [batch, 5, side, side], dtype);
            let NetOutput { value_bkhw, obstacle_b1hw } = net.forward(x_bchw.without_autodiff());
            [numbers(value_bkhw), numbers(obstacle_b1hw)]
        };
        for (got, want) in answer(DType::F32).into_iter().zip(answer(DType::F64)) {
            let largest = want.iter().fold(0.0f64, |largest, x| largest.max(x.abs()));
            let difference = |(got, want): (&f64, &f64)| if got.is_nan() { f64::INFINITY } else { (got - want).abs() };
            let error = got.iter().zip(&want).map(difference).fold(0.0, f64::max) / largest;
            println!("inference at base {base}, batch {batch}, side {side}: {error:.1e}");
            assert!(error <= 1e-5, "base {base}, batch {batch}, side {side}: off by {error:e} of the largest");
        }
    }
}
