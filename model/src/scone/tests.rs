use super::*;
use crate::net::gradients::parts::Part;
use crate::net::gradients::{noise, numbers, tensor};
use burn::module::{ModuleVisitor, Param};
use burn::tensor::DType;

fn tiny() -> SconeConfig {
    SconeConfig { width: 16, ..SconeConfig::default() }
}

#[derive(Default)]
struct Count(usize);

impl ModuleVisitor for Count {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        self.0 += param.lazy_shape().num_elements();
    }
}

#[test]
fn parameters_are_as_many_as_the_widths_say() {
    let narrow = SconeConfig { heads: 2, occupancy_layers: 1, visibility_layers: 4, ..tiny() };
    for config in [tiny(), narrow, SconeConfig::default()] {
        let scone = Scone::blank(&config, &Device::flex()).unwrap();
        let count = |visit: &dyn Fn(&mut Count)| {
            let mut count = Count::default();
            visit(&mut count);
            count.0
        };
        let found = [count(&|c| scone.occupancy.visit(c)), count(&|c| scone.visibility.visit(c))];
        assert_eq!(found, config.parameters());
    }
    assert_eq!(SconeConfig::default().parameters(), [2_257_769, 1_392_888]);
}

#[test]
fn impossible_widths_are_refused() {
    let fails = |config: SconeConfig| Scone::new(&config, 1, &Device::flex()).unwrap_err().to_string();
    assert!(fails(SconeConfig { width: 20, ..tiny() }).contains("net.width = 20"));
    assert!(fails(SconeConfig { heads: 0, ..tiny() }).contains("net.heads = 0"));
    assert!(fails(SconeConfig { visibility_layers: 0, ..tiny() }).contains("visibility_layers"));
}

#[test]
fn weights_depend_on_the_seed_alone_and_keep_their_rules() {
    let weights = |seed| {
        let scone = Scone::new(&tiny(), seed, &Device::flex()).unwrap();
        let mut all = Named::default();
        scone.visit(&mut all);
        all.tensors
    };
    assert_eq!(weights(7), weights(7));
    assert_ne!(weights(7), weights(8));
    let deviation = |name: &str| {
        let (_, shape, values) = weights(7).into_iter().find(|(found, ..)| found == name).unwrap();
        let mean_square = values.iter().map(|x| x * x).sum::<f32>() / values.len() as f32;
        (shape, mean_square.sqrt())
    };
    let (shape, value) = deviation("visibility.encoder.layers.1.attention.value.weight");
    assert!(shape == [32, 32] && (value / (2.0f32 / 64.0).sqrt() - 1.0).abs() < 0.05, "xavier: {shape:?} {value}");
    let (shape, wide) = deviation("visibility.encoder.layers.1.wide.weight");
    assert!(shape == [32, 64] && (wide / (2.0f32 / 32.0).sqrt() - 1.0).abs() < 0.05, "kaiming: {shape:?} {wide}");
}

#[derive(Default)]
struct Named {
    path: Vec<String>,
    tensors: Vec<(String, Vec<usize>, Vec<f32>)>,
}

impl ModuleVisitor for Named {
    fn enter_module(&mut self, name: &str, _: &str) {
        self.path.push(name.into());
    }

    fn exit_module(&mut self, _: &str, _: &str) {
        self.path.pop();
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let shape = param.lazy_shape().as_slice().to_vec();
        self.tensors.push((self.path.join("."), shape, param.val().into_data().try_to_vec().unwrap()));
    }
}

fn plain<const D: usize>(name: &str, shape: [usize; D]) -> Tensor<D> {
    tensor(&noise(name, shape.iter().product()), shape, DType::F32).without_autodiff()
}

fn close(a: &[f64], b: &[f64]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() < 2e-5)
}

/// Views of six points and of four, which are filled up by `rows`; `order` is where each of the first view's points lies.
fn views(order: [usize; 6], rows: usize) -> Views {
    let place = |name: &str, width: usize| {
        let all = plain(name, [2, 6, width]);
        let first = order.iter().map(|&n| all.clone().slice([0..1, n..n + 1])).collect();
        let second = all.clone().slice([1..2, 0..4]);
        let fill = |part: Tensor<3>, missing| {
            // What padding holds must not matter.
            let junk = Tensor::full([1, missing, width], 7.5, &Device::flex());
            if missing == 0 { part } else { Tensor::cat(vec![part, junk], 1) }
        };
        Tensor::cat(vec![fill(Tensor::cat(first, 1), rows - 6), fill(second, rows - 4)], 0)
    };
    let padding = Padding::new(&[6, 4], rows, &Device::flex());
    let inside = padding.share_bn1.clone().greater_elem(0.0).float();
    Views {
        point_bn4: place("points", 4),
        harmonics_bnk: place("harmonics", 64),
        basis_bnk: place("basis", 64),
        weight_bn: (place("weights", 1).abs() * inside).squeeze_dim(2),
        padding,
    }
}

#[test]
fn gains_know_no_order_and_no_padding() {
    let net = Scone::new(&tiny(), 5, &Device::flex()).unwrap().visibility;
    let gains = |order, rows| numbers(net.forward(&views(order, rows)));
    let want = gains([0, 1, 2, 3, 4, 5], 6);
    assert!(want.iter().all(|gain| *gain > 0.1) && (want[0] - want[1]).abs() > 1e-3, "{want:?}");
    assert!(close(&gains([4, 2, 0, 5, 1, 3], 6), &want));
    assert!(close(&gains([0, 1, 2, 3, 4, 5], 16), &want));
    assert!(close(&gains([5, 4, 3, 2, 1, 0], 9), &want));
}

/// Two clouds of eight points and of five, three queries; `turn` rotates the order of all sets.
fn asked(net: &SconeOcc, turn: usize, rows: usize) -> Vec<f64> {
    let turned = |all: Tensor<3>, count: usize| {
        let order = (0..count).map(|n| all.clone().narrow(1, (n + turn) % count, 1)).collect();
        Tensor::cat(order, 1)
    };
    let fill = |part: Tensor<3>| {
        let junk = Tensor::full([1, rows - part.dims()[1], 3], -4.0, &Device::flex());
        if junk.dims()[1] == 0 { part } else { Tensor::cat(vec![part, junk], 1) }
    };
    let clouds = [("first", 8), ("second", 5)].map(|(name, count)| fill(turned(plain(name, [1, count, 3]), count)));
    let padding = Padding::new(&[8, 5], rows, &Device::flex());
    let cloud_lg = net.clouds(Tensor::cat(clouds.to_vec(), 0), Some(&padding));
    let queries = Queries {
        cloud_q: Tensor::from_ints([0, 1, 1], &Device::flex()),
        point_q3: plain("queries", [3, 3]),
        offsets_qn3: ["near", "middle", "far"].map(|name| turned(plain(name, [3, 16, 3]), 16)),
        harmonics_qk: plain("views", [3, 64]),
    };
    numbers(net.forward(cloud_lg, queries))
}

#[test]
fn occupancy_knows_no_order_and_no_padding() {
    let net = Scone::new(&tiny(), 5, &Device::flex()).unwrap().occupancy;
    let want = asked(&net, 0, 8);
    assert!(want.iter().any(|p| p.abs() > 1e-3) && want[1] != want[2], "{want:?}");
    assert!(close(&asked(&net, 3, 8), &want));
    assert!(close(&asked(&net, 0, 13), &want));
    assert!(close(&asked(&net, 2, 20), &want));
}

#[test]
fn answers_and_gradients_are_the_same_bits_on_any_number_of_threads() {
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let device = Device::flex().autodiff();
            let config = SconeConfig { width: 32, ..SconeConfig::default() };
            let net = Scone::new(&config, 5, &device).unwrap();
            let cloud = tensor(&noise("cloud", 600), [2, 100, 3], DType::F32);
            let queries = Queries {
                cloud_q: Tensor::from_ints([0, 1].repeat(32).as_slice(), &device),
                point_q3: tensor(&noise("queries", 192), [64, 3], DType::F32),
                offsets_qn3: ["near", "middle", "far"].map(|n| tensor(&noise(n, 3072), [64, 16, 3], DType::F32)),
                harmonics_qk: tensor(&noise("views", 4096), [64, 64], DType::F32),
            };
            let views = Views {
                point_bn4: tensor(&noise("points", 2400), [6, 100, 4], DType::F32),
                harmonics_bnk: tensor(&noise("harmonics", 38_400), [6, 100, 64], DType::F32),
                basis_bnk: tensor(&noise("basis", 38_400), [6, 100, 64], DType::F32),
                weight_bn: tensor(&[0.01; 600], [6, 100], DType::F32),
                padding: Padding::new(&[100, 90, 80, 70, 60, 50], 100, &device),
            };
            let occupied = net.occupancy.forward(net.occupancy.clouds(cloud, None), queries);
            let gains = net.visibility.forward(&views);
            let of_gains = loss::gains(gains, &[1.0, 3.0, 0.5, 2.0, 0.0, 1.0], &[3, 3]).unwrap();
            let total = loss::occupancy(occupied, Tensor::zeros([64], &device)) + of_gains;
            let gradients = burn::optim::GradientsParams::from_grads(total.clone().backward(), &net);
            let mut found = Bits { gradients: &gradients, bits: vec![total.into_scalar::<f32>().to_bits()] };
            net.visit(&mut found);
            found.bits
        })
    };
    let one = run(1);
    assert!(one.len() > 200_000, "{}", one.len());
    for threads in [2, 5] {
        assert!(run(threads) == one, "{threads} threads differ from one");
    }
}

struct Bits<'a> {
    gradients: &'a burn::optim::GradientsParams,
    bits: Vec<u32>,
}

impl ModuleVisitor for Bits<'_> {
    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        let gradient = self.gradients.get::<D>(param.id).unwrap();
        self.bits.extend(gradient.into_data().iter::<f32>().map(f32::to_bits));
    }
}

/// Few layers: what is differentiated does not depend on their number.
fn shallow() -> SconeConfig {
    SconeConfig { occupancy_layers: 1, visibility_layers: 2, ..tiny() }
}

/// Padding of sets of powers of two, whose inverse single precision holds.
fn padding(counts: &[usize], rows: usize, dtype: DType) -> Padding {
    let Padding { bias_bn1, share_bn1 } = Padding::new(counts, rows, &Device::flex().autodiff());
    let exact = |part: Tensor<3>| {
        let shape = part.dims();
        tensor(&numbers(part), shape, dtype)
    };
    Padding { bias_bn1: exact(bias_bn1), share_bn1: exact(share_bn1) }
}

#[test]
fn occupancy_has_its_gradients() {
    let answer = |net: &SconeOcc, x: &[Tensor<4>]| {
        let padding = padding(&[8, 4], 8, x[0].dtype());
        let cloud_lg = net.clouds(x[0].clone().squeeze_dim(0), Some(&padding));
        let queries = Queries {
            cloud_q: Tensor::from_ints([1, 0], &x[0].device()),
            point_q3: x[1].clone().reshape([2, 3]),
            offsets_qn3: [0, 1, 2].map(|scale| x[2].clone().narrow(0, scale, 1).squeeze_dim(0)),
            harmonics_qk: x[3].clone().reshape([2, 64]),
        };
        vec![net.forward(cloud_lg, queries).reshape([1, 1, 1, 2])]
    };
    let inputs = vec![[1, 2, 8, 3], [1, 1, 2, 3], [3, 2, 16, 3], [1, 1, 2, 64]];
    let fresh = |init: &Init<'_>| SconeOcc::new(&shallow(), init);
    Part { name: "occupancy", fresh, inputs, answer, learns: |_| true, each: true }.check();
}

#[test]
fn visibility_and_its_loss_have_their_gradients() {
    let gains = |net: &SconeVis, x: &[Tensor<4>]| {
        let views = Views {
            point_bn4: x[0].clone().squeeze_dim(0),
            harmonics_bnk: x[1].clone().squeeze_dim(0),
            basis_bnk: x[2].clone().squeeze_dim(0),
            weight_bn: x[3].clone().reshape([4, 8]) + 1.5,
            padding: padding(&[8, 4, 8, 2], 8, x[0].dtype()),
        };
        net.forward(&views)
    };
    let inputs = vec![[1, 4, 8, 4], [1, 4, 8, 64], [1, 4, 8, 64], [1, 1, 4, 8]];
    let fresh = |init: &Init<'_>| SconeVis::new(&shallow(), init);
    let answer = |net: &SconeVis, x: &[Tensor<4>]| vec![gains(net, x).reshape([1, 1, 1, 4])];
    Part { name: "visibility", fresh, inputs: inputs.clone(), answer, learns: |_| true, each: true }.check();
    let answer = |net: &SconeVis, x: &[Tensor<4>]| {
        // Two decisions of two candidates; a third has nothing to gain.
        let all = Tensor::cat(vec![gains(net, x), gains(net, x).narrow(0, 0, 2)], 0);
        let loss = loss::gains(all, &[3.0, 1.0, 0.5, 1.5, 0.0, 0.0], &[2, 2, 2]).unwrap();
        vec![loss.reshape([1, 1, 1, 1])]
    };
    Part { name: "loss of gains", fresh, inputs, answer, learns: |_| true, each: true }.check();
}

#[test]
fn the_loss_of_gains_is_the_formula_and_leaves_out_what_says_nothing() {
    let loss = |found: &[f32], wanted: &[f32], decisions: &[usize]| {
        let found = Tensor::<1>::from_floats(found, &Device::flex());
        loss::gains(found, wanted, decisions).map(|loss| loss.into_scalar::<f32>())
    };
    let alone = loss(&[1.0, 3.0], &[4.0, 4.0], &[2]).unwrap();
    assert!((alone - 0.5).abs() < 1e-6, "{alone}");
    let scaled = loss(&[10.0, 30.0], &[0.4, 0.4], &[2]).unwrap();
    assert!((scaled - alone).abs() < 1e-6, "the scale is free");
    let two = loss(&[1.0, 3.0, 1.0, 1.0, 2.0], &[4.0, 4.0, 0.0, 0.0, 5.0], &[2, 2, 1]).unwrap();
    assert!((two - 0.25).abs() < 1e-6, "{two}");
    assert_eq!(loss(&[1.0, 2.0], &[0.0, 0.0], &[2]), None);
    assert!(loss(&[0.0, 0.0], &[1.0, 2.0], &[2]).unwrap().is_finite());
}
