use super::*;
use crate::fast::up;

/// Numbers in `[-1, 1)` without a pattern.
fn noise(count: usize, seed: u32) -> Vec<f32> {
    let mut state = seed.wrapping_mul(0x9e37_79b9) | 1;
    (0..count)
        .map(|_| {
            state ^= state << 13;
            state ^= state >> 17;
            state ^= state << 5;
            state as f32 / (1u32 << 31) as f32 - 1.0
        })
        .collect()
}

/// The sum that defines a convolution and its gradients, in double precision: calls `term(y index, x index, weight index)`.
fn each_term(size: Geometry, mut term: impl FnMut(usize, usize, usize)) {
    let Geometry { batch, cin, cout, height, width, kernel } = size;
    let half = kernel / 2;
    for (b, o, i) in (0..batch).flat_map(|b| (0..cout).flat_map(move |o| (0..cin).map(move |i| (b, o, i)))) {
        for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
            for (ky, kx) in (0..kernel).flat_map(|ky| (0..kernel).map(move |kx| (ky, kx))) {
                let (from_y, from_x) = (y + ky, x + kx);
                if from_y >= half && from_x >= half && from_y - half < height && from_x - half < width {
                    let at_x = ((b * cin + i) * height + from_y - half) * width + from_x - half;
                    let at_y = ((b * cout + o) * height + y) * width + x;
                    term(at_y, at_x, ((o * cin + i) * kernel + ky) * kernel + kx);
                }
            }
        }
    }
}

fn assert_close(what: &str, got: &[f32], want: &[f64]) {
    assert_eq!(got.len(), want.len(), "{what}");
    let largest = want.iter().fold(0.0f64, |max, x| max.max(x.abs()));
    for (at, (&got, &want)) in got.iter().zip(want).enumerate() {
        assert!((f64::from(got) - want).abs() <= 2e-6 * largest, "{what}[{at}]: {got} {want}, largest {largest}");
    }
}

#[test]
fn both_directions_agree_with_the_definition() {
    let sizes = [
        (2, 3, 5, 6, 7, 3),
        (1, 5, 8, 16, 16, 3),
        (3, 8, 16, 9, 33, 3),
        (2, 16, 8, 2, 2, 3),
        (1, 4, 1, 1, 1, 3),
        (2, 6, 9, 40, 50, 3),
        (9, 3, 20, 4, 6, 3),
        (1, 70, 130, 6, 4, 3),
        (2, 9, 12, 64, 64, 3),
        (1, 5, 3, 2, 130, 3),
        (2, 7, 5, 3, 5, 1),
        (1, 8, 1, 16, 16, 1),
        (2, 1, 4, 4, 4, 1),
        (2, 32, 16, 40, 40, 1),
    ];
    for (batch, cin, cout, height, width, kernel) in sizes {
        let size = Geometry { batch, cin, cout, height, width, kernel };
        let x = noise(batch * cin * height * width, 1);
        let weight = noise(cout * cin * kernel * kernel, 2);
        let bias = noise(cout, 3);
        let g = noise(batch * cout * height * width, 4);

        let area = height * width;
        let mut y: Vec<f64> = (0..g.len()).map(|at| f64::from(bias[at / area % cout])).collect();
        let (mut dx, mut dw) = (vec![0.0; x.len()], vec![0.0; weight.len()]);
        each_term(size, |at_y, at_x, at_w| {
            let (x, w, g) = (f64::from(x[at_x]), f64::from(weight[at_w]), f64::from(g[at_y]));
            y[at_y] += x * w;
            dx[at_x] += g * w;
            dw[at_w] += g * x;
        });
        let mut db = vec![0.0; cout];
        g.iter().enumerate().for_each(|(at, &g)| db[at / area % cout] += f64::from(g));

        for on in Machine::all() {
            assert_close(
                "y",
                &forward(on, size, &x, Kernels { weight: &weight, bias: &bias, scale: None, relu: false }),
                &y,
            );
            let found = backward(on, size, &x, &weight, &g, true);
            assert_close("x gradient", &found.x.unwrap(), &dx);
            assert_close("weight gradient", &found.weight, &dw);
            assert_close("bias gradient", &found.bias, &db);
            assert!(backward(on, size, &x, &weight, &g, false).x.is_none());
        }
    }
}

#[test]
fn the_number_of_threads_does_not_change_a_bit() {
    // Many tiles, many channels, and sides that only the direct kernels take.
    for (batch, cin, cout, height, width) in [(3, 6, 20, 24, 40), (2, 130, 140, 8, 8), (2, 6, 20, 9, 11)] {
        let size = Geometry { batch, cin, cout, height, width, kernel: 3 };
        let (x, g) = (noise(batch * cin * size.area(), 1), noise(4 * batch * cout * size.area(), 2));
        let (weight, bias) = (noise(cout * cin * 9, 3), noise(cout, 4));
        let kernels = Kernels { weight: &weight, bias: &bias, scale: None, relu: false };
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let small = &g[..batch * cout * size.area()];
                let same = backward(Machine::new(), size, &x, &weight, small, true);
                let doubled = up::backward(Machine::new(), size, &x, &weight, &g, true);
                let answers =
                    [forward(Machine::new(), size, &x, kernels), up::forward(Machine::new(), size, &x, kernels)];
                let gradients = [same, doubled].map(|found| [found.x.unwrap(), found.weight, found.bias].concat());
                [answers.concat(), gradients.concat()].concat()
            })
        };
        let bits = |numbers: Vec<f32>| numbers.into_iter().map(f32::to_bits).collect::<Vec<_>>();
        let one = bits(run(1));
        for threads in [2, 3, 7] {
            assert!(bits(run(threads)) == one, "{size:?} on {threads} threads");
        }
    }
}
