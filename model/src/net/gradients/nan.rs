//! What is no number must reach the answer: a network that diverged has to show, and to leave no trace in memory.

use super::trained;
use crate::NetConfig;
use crate::net::init::Init;
use crate::net::{Conv, Nbp, Norm};
use burn::prelude::*;
use burn::tensor::TensorData;

/// Finite numbers, but for those at some places.
fn broken(shape: [usize; 4], places: &[usize]) -> Vec<f32> {
    let mut numbers: Vec<f32> = (0..shape.iter().product()).map(|i| (i * 7919 % 101) as f32 / 50.0 - 1.0).collect();
    places.iter().for_each(|&at| numbers[at] = f32::NAN);
    numbers
}

fn on(device: &Device, shape: [usize; 4], places: &[usize]) -> Tensor<4> {
    Tensor::from_data(TensorData::new(broken(shape, places), shape), device)
}

fn read<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.without_autodiff().into_data().iter::<f32>().collect()
}

/// Samples, rows and columns of an answer in which some channel is NaN, and whether all channels of those are.
fn lost(numbers: &[f32], [_, channels, height, width]: [usize; 4]) -> Vec<[usize; 3]> {
    let area = height * width;
    let mut places: Vec<_> = (0..numbers.len())
        .filter(|&at| numbers[at].is_nan())
        .map(|at| [at / area / channels, at % area / width, at % width])
        .collect();
    places.sort_unstable();
    places.dedup();
    places
}

#[test]
fn a_convolution_loses_what_sees_it_and_little_else() {
    for (side, channels) in [(2, 3), (5, 4), (8, 16), (16, 9), (33, 5), (34, 24)] {
        let conv = Conv::new(3, channels, channels, &Init::seeded(1, &Device::flex()));
        let shape = [2, channels, side, side];
        let clean = read(conv.forward(on(&Device::flex(), shape, &[])));
        for (row, col) in [(0, 0), (0, side - 1), (side / 2, side / 3), (side - 1, 0), (side - 1, side - 1)] {
            // In the last channel of the second sample.
            let at = (2 * channels - 1) * side * side + row * side + col;
            let y = read(conv.forward(on(&Device::flex(), shape, &[at])));
            let lost = lost(&y, shape);
            let near = |a: usize, b: usize, reach: usize| a.abs_diff(b) <= reach;
            for (y, x) in (0..side).flat_map(|y| (0..side).map(move |x| (y, x))) {
                if near(y, row, 1) && near(x, col, 1) {
                    assert!(lost.contains(&[1, y, x]), "side {side}: NaN at {row}, {col} is not seen at {y}, {x}");
                }
            }
            // A kernel that works on tiles may lose a tile, but no more.
            for [sample, y, x] in lost {
                assert!(
                    sample == 1 && near(y, row, 3) && near(x, col, 3),
                    "side {side}: NaN at {row}, {col} spoils sample {sample} at {y}, {x}"
                );
            }
            assert_eq!(read(conv.forward(on(&Device::flex(), shape, &[]))), clean, "side {side}: NaN stays in memory");
        }
    }
}

#[test]
fn gradients_of_a_convolution_lose_it_too() {
    for side in [2, 5, 8, 16, 33, 34] {
        let (conv, shape) = (Conv::new(3, 6, 10, &Init::seeded(1, &trained())), [1, 6, side, side]);
        let of = |x_places: &[usize], g_places: &[usize]| {
            let x_bchw = on(&trained(), shape, x_places).require_grad();
            let g = on(&trained(), [1, 10, side, side], g_places);
            let grads = (conv.forward(x_bchw.clone()) * g).sum().backward();
            [
                read(x_bchw.grad(&grads).unwrap()),
                read(conv.weight.val().grad(&grads).unwrap()),
                read(conv.bias.val().grad(&grads).unwrap()),
            ]
        };
        let any = |numbers: &[f32]| numbers.iter().any(|x| x.is_nan());
        let clean = of(&[], &[]);
        assert!(!clean.iter().any(|g| any(g)));
        let middle = side / 2 * side + side / 2;
        let [x, weight, bias] = of(&[middle], &[]);
        assert!(any(&weight) && !any(&x) && !any(&bias), "side {side}");
        let [x, weight, bias] = of(&[], &[middle]);
        assert!(any(&x) && any(&weight) && bias[0].is_nan() && !any(&bias[1..]), "side {side}");
        assert_eq!(of(&[], &[]), clean, "side {side}: NaN stays in memory");
    }
}

#[test]
fn norms_keep_it_through_relu() {
    for device in [Device::flex(), trained()] {
        let norm = Norm::new(3, &Init::zeros(&device));
        for shape in [[2, 3, 4, 4], [1, 3, 5, 7]] {
            for normed in [norm.forward(on(&device, shape, &[1])), norm.forward_relu(on(&device, shape, &[1]))] {
                assert!(read(normed)[1].is_nan());
            }
        }
    }
}

#[test]
fn a_network_shows_it_in_both_answers() {
    for (device, side) in [(Device::flex(), 16), (Device::flex(), 64), (trained(), 32)] {
        let config = NetConfig { base: 8, ..NetConfig::default() };
        let net = Nbp::new(&config, 1, &device).unwrap();
        for at in [0, side * side / 2 + 3, 5 * side * side - 1] {
            let output = net.forward(on(&device, [1, 5, side, side], &[at]));
            let (value, obstacle) = (read(output.value_bkhw), read(output.obstacle_b1hw));
            assert!(value.iter().any(|x| x.is_nan()) && obstacle.iter().any(|x| x.is_nan()), "side {side}, at {at}");
        }
        assert!(read(net.forward(on(&Device::flex(), [1, 5, side, side], &[])).value_bkhw).len() == side * side / 2);
    }
}
