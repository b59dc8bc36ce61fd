use super::*;

const EPSILON: f32 = 1e-5;

fn wave(count: usize, step: f32, offset: f32) -> Vec<f32> {
    (0..count).map(|at| (at as f32 * step).sin() * 2.0 + (at as f32 * 0.37).cos() + offset).collect()
}

/// The definition in double precision: answer, mean, biased variance.
fn definition(size: Planes, x: &[f32], weight: &[f32], bias: &[f32], relu: bool) -> (Vec<f64>, Vec<f64>, Vec<f64>) {
    let of = |c: usize| (0..x.len()).filter(move |at| at / size.area % size.channels == c);
    let mean: Vec<f64> =
        (0..size.channels).map(|c| of(c).map(|at| f64::from(x[at])).sum::<f64>() / size.count()).collect();
    let square = |c: usize, at: usize| (f64::from(x[at]) - mean[c]).powi(2);
    let var: Vec<f64> = (0..size.channels).map(|c| of(c).map(|at| square(c, at)).sum::<f64>() / size.count()).collect();
    let y = (0..x.len())
        .map(|at| {
            let c = at / size.area % size.channels;
            let hat = (f64::from(x[at]) - mean[c]) / (var[c] + f64::from(EPSILON)).sqrt();
            let y = hat * f64::from(weight[c]) + f64::from(bias[c]);
            if relu { y.max(0.0) } else { y }
        })
        .collect();
    (y, mean, var)
}

fn assert_close(what: &str, got: &[f32], want: &[f64], tolerance: f64) {
    let largest = want.iter().fold(1.0f64, |max, x| max.max(x.abs()));
    for (at, (&got, &want)) in got.iter().zip(want).enumerate() {
        assert!((f64::from(got) - want).abs() <= tolerance * largest, "{what}[{at}]: {got} {want}");
    }
}

#[test]
fn agrees_with_the_definition_and_its_differences() {
    for (size, offset) in [
        (Planes { batch: 2, channels: 3, area: 35 }, 0.2),
        (Planes { batch: 1, channels: 1, area: 4 }, -3.0),
        (Planes { batch: 3, channels: 2, area: 2500 }, 500.0),
    ] {
        let x = wave(size.batch * size.channels * size.area, 0.731, offset);
        let (weight, bias) = (wave(size.channels, 0.5, 1.0), wave(size.channels, 0.9, -0.4));
        let g = wave(x.len(), 1.3, 0.1);
        for relu in [false, true] {
            let (mean, var) = statistics(size, &x);
            let channels = Channels { mean: &mean, var: &var, weight: &weight, bias: &bias, epsilon: EPSILON, relu };
            let (want, want_mean, want_var) = definition(size, &x, &weight, &bias, relu);
            assert_close("mean", &mean, &want_mean, 1e-6);
            assert_close("variance", &var, &want_var, 1e-5);
            assert_close("answer", &forward(size, &x, channels), &want, 1e-4);

            let found = backward(size, &x, channels, &g);
            let loss = |x: &[f32], weight: &[f32], bias: &[f32]| {
                let (y, _, _) = definition(size, x, weight, bias, relu);
                y.iter().zip(&g).map(|(y, &g)| y * f64::from(g)).sum::<f64>()
            };
            // Central differences; exact in the parameters, in which the loss is linear away from the ReLU's kink.
            let slope = |part: usize, at: usize, h: f32| {
                let side = |sign: f32| {
                    let (mut x, mut weight, mut bias) = (x.clone(), weight.clone(), bias.clone());
                    let moved = [&mut x, &mut weight, &mut bias][part].get_mut(at).unwrap();
                    let before = *moved;
                    *moved += sign * h;
                    let step = f64::from(*moved) - f64::from(before);
                    (loss(&x, &weight, &bias), step)
                };
                let ((above, up), (below, down)) = (side(1.0), side(-1.0));
                (above - below) / (up - down)
            };
            for at in 0..size.channels {
                let scale = size.count().sqrt().max(1.0);
                let near = |got: f32, want: f64| (f64::from(got) - want).abs() <= 2e-2 * scale.max(want.abs());
                assert!(
                    near(found.weight[at], slope(1, at, 1e-3)),
                    "weight {} {}",
                    found.weight[at],
                    slope(1, at, 1e-3)
                );
                assert!(near(found.bias[at], slope(2, at, 1e-3)), "bias {} {}", found.bias[at], slope(2, at, 1e-3));
            }
            for at in (0..x.len()).step_by(x.len() / 4) {
                let (got, want) = (f64::from(found.x[at]), slope(0, at, 2e-3));
                assert!((got - want).abs() <= 2e-2 * want.abs().max(0.5), "x[{at}]: {got} {want} relu {relu}");
            }
        }
    }
}

#[test]
fn a_diverged_network_is_not_hidden_by_the_relu() {
    let size = Planes { batch: 1, channels: 1, area: 4 };
    let channels = Channels { mean: &[0.0], var: &[1.0], weight: &[1.0], bias: &[0.0], epsilon: EPSILON, relu: true };
    let y = forward(size, &[f32::NAN, -1.0, 1.0, 2.0], channels);
    assert!(y[0].is_nan() && y[1] == 0.0);
}

#[test]
fn the_number_of_threads_does_not_change_a_bit() {
    let size = Planes { batch: 4, channels: 5, area: 3000 };
    let (x, g) = (wave(60_000, 0.7, 0.3), wave(60_000, 0.2, 0.0));
    let run = |threads: usize| {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
            let (mean, var) = statistics(size, &x);
            let channels = Channels {
                mean: &mean,
                var: &var,
                weight: &[1.0, 2.0, 3.0, 0.5, -1.0],
                bias: &[0.1; 5],
                epsilon: EPSILON,
                relu: true,
            };
            let found = backward(size, &x, channels, &g);
            let all = [forward(size, &x, channels), found.x, found.weight, found.bias].concat();
            all.into_iter().map(f32::to_bits).collect::<Vec<_>>()
        })
    };
    assert_eq!(run(1), run(5));
}
