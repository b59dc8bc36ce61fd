//! Convolutions and their three gradients against sums in double precision, at the sizes on which kernels branch.

use super::{noise, numbers, tensor};
use crate::net::Conv;
use burn::module::Param;
use burn::prelude::*;
use burn::tensor::DType;

/// What of a case is convolved.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Single,
    Three,
    Doubled,
}

#[derive(Clone, Copy, Debug)]
struct Case {
    kind: Kind,
    batch: usize,
    cin: usize,
    cout: usize,
    /// Of the input.
    height: usize,
    width: usize,
}

impl Case {
    fn kernel(&self) -> usize {
        if self.kind == Kind::Single { 1 } else { 3 }
    }

    /// How many times as large the answer is.
    fn times(&self) -> usize {
        if self.kind == Kind::Doubled { 2 } else { 1 }
    }

    fn large(&self) -> (usize, usize) {
        (self.times() * self.height, self.times() * self.width)
    }

    /// Calls `row(output plane, input plane, weight, y, to, from)` for every run of pixels in a row that share a weight:
    /// pixels `to` of row `y` of the answer see row `from.0` of the (doubled) input from column `from.1` on.
    fn each_run(&self, mut run: impl FnMut(usize, usize, usize, usize, std::ops::Range<usize>, (usize, usize))) {
        let (kernel, half, (height, width)) = (self.kernel(), self.kernel() / 2, self.large());
        for (b, o, i) in cube(self.batch, self.cout, self.cin) {
            for (ky, kx, y) in cube(kernel, kernel, height) {
                if (half..height + half).contains(&(y + ky)) {
                    let columns = half.saturating_sub(kx)..width.min(width + half - kx);
                    let from = (y + ky - half, columns.start + kx - half);
                    let weight = ((o * self.cin + i) * kernel + ky) * kernel + kx;
                    run(b * self.cout + o, b * self.cin + i, weight, y, columns, from);
                }
            }
        }
    }
}

fn cube(a: usize, b: usize, c: usize) -> impl Iterator<Item = (usize, usize, usize)> {
    (0..a * b * c).map(move |at| (at / c / b, at / c % b, at % c))
}

/// Answer and gradients in the order input, weight, bias.
struct Truth {
    y: Vec<f64>,
    gradients: [Vec<f64>; 3],
}

fn truth(case: &Case, [x, weight, bias, g]: [&[f64]; 4]) -> Truth {
    let (times, (height, width)) = (case.times(), case.large());
    let area = height * width;
    // The larger image, and its gradient, which is summed over squares in the end.
    let small = |at: usize| {
        let (plane, y, x) = (at / area, at % area / width, at % width);
        (plane * case.height + y / times) * case.width + x / times
    };
    let image: Vec<f64> = (0..x.len() * times * times).map(|at| x[small(at)]).collect();
    let mut y: Vec<f64> = (0..g.len()).map(|at| bias[at / area % case.cout]).collect();
    let (mut dimage, mut dweight, mut dbias) = (vec![0.0; image.len()], vec![0.0; weight.len()], vec![0.0; bias.len()]);
    case.each_run(|out_plane, in_plane, at_weight, row, columns, from| {
        let to = out_plane * area + row * width + columns.start..out_plane * area + row * width + columns.end;
        let from = in_plane * area + from.0 * width + from.1;
        let from = from..from + to.len();
        for ((y, g), (x, dx)) in
            y[to.clone()].iter_mut().zip(&g[to]).zip(image[from.clone()].iter().zip(&mut dimage[from]))
        {
            *y += weight[at_weight] * x;
            *dx += weight[at_weight] * g;
            dweight[at_weight] += g * x;
        }
    });
    g.iter().enumerate().for_each(|(at, g)| dbias[at / area % case.cout] += g);
    let mut dx = vec![0.0; x.len()];
    dimage.iter().enumerate().for_each(|(at, g)| dx[small(at)] += g);
    Truth { y, gradients: [dx, dweight, dbias] }
}

/// Allowed errors in units of rounding: ε times the root of the number of terms, for as many roundings in either direction,
/// times the size of the sum. Direct kernels stay below 3; transformed ones add and subtract their inputs first, which
/// costs another bit or two.
const UNITS: f64 = 6.0;

/// Fails with everything that says which kernel is at fault: the case, what of it, where the worst number is.
fn assert_close(case: &Case, what: &str, got: Tensor<4>, want: &[f64], terms: usize) -> f64 {
    // Terms are products of numbers in [-1, 1): their deviation is a third.
    let root = (terms as f64).sqrt();
    let unit = f64::from(f32::EPSILON) * root * (root / 3.0).max(1.0);
    let shape = got.dims();
    let got = numbers(got);
    assert_eq!(got.len(), want.len(), "{what} of {case:?}");
    // A NaN is infinitely wrong.
    let error =
        |(got, want): (&f64, &f64)| ((got - want).abs() / unit).max(if got.is_nan() { f64::INFINITY } else { 0.0 });
    let errors: Vec<f64> = got.iter().zip(want).map(error).collect();
    let wrong = errors.iter().filter(|&&error| error > UNITS).count();
    let (at, worst) =
        errors.into_iter().enumerate().fold((0, 0.0), |worst, new| if new.1 > worst.1 { new } else { worst });
    let place: Vec<usize> = (0..4).map(|axis| at / shape[axis + 1..].iter().product::<usize>() % shape[axis]).collect();
    assert!(
        wrong == 0,
        "{what} of {case:?}: {wrong} of {} numbers are wrong, worst at {place:?} of {shape:?}: {} instead of {}, \
         {worst:.1} units of rounding ({UNITS} allowed)",
        got.len(),
        got[at],
        want[at],
    );
    worst
}

/// Largest error of answer, input gradient, weight gradient and bias gradient, in units of rounding.
fn check(case: &Case) -> [f64; 4] {
    let Case { kind, batch, cin, cout, height, width } = *case;
    let (kernel, large) = (case.kernel(), case.large());
    let (shape, answer) = ([batch, cin, height, width], [batch, cout, large.0, large.1]);
    let all = |shape: [usize; 4]| shape.iter().product::<usize>();
    let (x, weight) = (noise("x", all(shape)), noise("weight", cout * cin * kernel * kernel));
    let (bias, g) = (noise("bias", cout), noise("g", all(answer)));
    let want = truth(case, [&x, &weight, &bias, &g]);

    let leaf = |numbers: &[f64], shape| tensor(numbers, shape, DType::F32).require_grad();
    let x_bchw = leaf(&x, shape);
    let conv = Conv {
        weight: Param::from_tensor(leaf(&weight, [cout, cin, kernel, kernel])),
        bias: Param::from_tensor(tensor(&bias, [cout], DType::F32)),
    };
    let forward = |x_bchw| if kind == Kind::Doubled { conv.forward_doubled(x_bchw) } else { conv.forward(x_bchw) };
    let y_bchw = forward(x_bchw.clone());
    let terms = cin * kernel * kernel + 1;
    let y = assert_close(case, "the answer", y_bchw.clone(), &want.y, terms);

    let grads = (y_bchw * tensor(&g, answer, DType::F32)).sum().backward();
    let found = [
        x_bchw.grad(&grads).unwrap(),
        conv.weight.val().grad(&grads).unwrap(),
        conv.bias.val().grad(&grads).unwrap().reshape([1, 1, 1, cout]),
    ];
    let pixels = batch * large.0 * large.1;
    let terms = [cout * kernel * kernel * case.times() * case.times(), pixels, 3 * pixels];
    let names = ["the input's gradient", "the weight's gradient", "the bias' gradient"];
    let mut errors = [y, 0.0, 0.0, 0.0];
    for (n, found) in found.into_iter().enumerate() {
        errors[n + 1] = assert_close(case, names[n], found, &want.gradients[n], terms[n]);
    }
    errors
}

fn check_all(kind: Kind, cases: impl IntoIterator<Item = [usize; 5]>) {
    let mut worst = [0.0f64; 4];
    for [batch, cin, cout, height, width] in cases {
        let errors = check(&Case { kind, batch, cin, cout, height, width });
        worst = std::array::from_fn(|n| worst[n].max(errors[n]));
    }
    println!("{kind:?}: worst of answer and gradients in units of rounding: {worst:.2?}");
}

/// Batch, channels in and out, height, width: every width that vectors do not divide, channels that blocks do not divide.
fn shapes() -> Vec<[usize; 5]> {
    let mut shapes = vec![
        [1, 1, 1, 1, 1],
        [3, 4, 9, 1, 1],
        [1, 5, 3, 1, 7],
        [2, 3, 8, 9, 1],
        [1, 7, 2, 2, 3],
        [3, 9, 7, 3, 4],
        [2, 8, 16, 4, 3],
        [1, 16, 8, 4, 4],
        [3, 17, 15, 5, 6],
        [1, 13, 24, 6, 10],
        [3, 6, 11, 10, 6],
        [1, 12, 20, 16, 15],
        [2, 20, 12, 15, 16],
        [1, 10, 9, 33, 33],
        [3, 3, 5, 17, 33],
        [1, 24, 16, 33, 64],
        [2, 5, 10, 64, 65],
        [1, 6, 7, 127, 128],
        // Many tiles and few channels, few tiles and many channels.
        [1, 5, 3, 128, 128],
        [3, 2, 1, 128, 128],
        [1, 8, 8, 128, 128],
        [1, 128, 128, 8, 8],
        [1, 256, 256, 8, 8],
        [3, 64, 129, 4, 4],
        [2, 130, 65, 2, 2],
    ];
    for side in (2..=34).step_by(2) {
        shapes.push([3, 3, 5, side, side]);
        shapes.push([1, 16, 24, side, side]);
        shapes.push([2, 9, 8, side, 36 - side]);
        shapes.push([1, 32, 40, side, side + 2]);
    }
    shapes
}

#[test]
fn three_by_three() {
    check_all(Kind::Three, shapes());
}

#[test]
fn single_pixels() {
    check_all(Kind::Single, shapes());
}

#[test]
fn doubled() {
    check_all(Kind::Doubled, shapes().into_iter().filter(|shape| shape[3] * shape[4] <= 64 * 64));
}

#[test]
fn the_truth_is_a_convolution() {
    // One channel of 2×2 with a kernel that looks to the right and one row down.
    let case = Case { kind: Kind::Three, batch: 1, cin: 1, cout: 1, height: 2, width: 2 };
    let mut weight = [0.0; 9];
    (weight[5], weight[7]) = (10.0, 100.0);
    let found = truth(&case, [&[1.0, 2.0, 3.0, 4.0], &weight, &[0.5], &[1.0, 0.0, 0.0, 2.0]]);
    assert_eq!(found.y, [320.5, 400.5, 40.5, 0.5]);
    assert_eq!(found.gradients[0], [0.0, 10.0, 100.0, 0.0]);
    assert_eq!(found.gradients[1], [2.0, 4.0, 0.0, 6.0, 9.0, 2.0, 0.0, 3.0, 4.0]);
    assert_eq!(found.gradients[2], [3.0]);
    let case = Case { kind: Kind::Doubled, height: 1, width: 1, ..case };
    let found = truth(&case, [&[3.0], &weight, &[0.0], &[1.0; 4]]);
    assert_eq!(found.y, [330.0, 300.0, 30.0, 0.0]);
    assert_eq!(found.gradients[0], [220.0]);
}
