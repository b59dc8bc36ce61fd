//! What a training step is made of: each operator of the network alone, at every size that occurs, forwards and backwards.
//!
//! The operators are the network's own bricks on numbers of the same shape, so this needs no knowledge of what is below
//! them. Alone they find their memory in other states than in a step: the sum is printed beside the step's own time, and
//! what is left is everything that has no line (sums of gradients where a tensor is used twice, gate, loss, allocation).

use crate::clock::Time;
use crate::work::{Row, Task, Work};
use crate::{Failure, sgemm_peak};
use burn::module::{Param, RunningState};
use burn::optim::GradientsParams;
use burn::prelude::*;
use burn::tensor::Distribution;
use nbp_model::net::{Conv, Norm};
use nbp_model::{AdamW, Tasks, fast, loss};

/// Calls of which the quickest counts: an operator is short, and whatever comes between makes it longer.
const REPEATS: usize = 7;

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Kind {
    Conv3,
    Doubled,
    Conv1,
    NormRelu,
    Norm,
    Pool,
    Scale,
    Cat,
}

impl Kind {
    fn is_convolution(self) -> bool {
        matches!(self, Self::Conv3 | Self::Doubled | Self::Conv1)
    }

    fn name(self) -> &'static str {
        match self {
            Self::Conv3 => "3×3 convolution",
            Self::Doubled => "doubling and 3×3 convolution",
            Self::Conv1 => "1×1 convolution",
            Self::NormRelu => "batch norm and ReLU",
            Self::Norm => "batch norm",
            Self::Pool => "maximum pool",
            Self::Scale => "attention times skip",
            Self::Cat => "concatenation",
        }
    }
}

/// An operator at a place in the network.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Place {
    kind: Kind,
    /// Of the answer.
    side: usize,
    cin: usize,
    cout: usize,
    /// Whether it sees the network's input, of which no gradient is needed.
    first: bool,
}

/// All operators of the network, in its order.
fn places(row: Row) -> Vec<Place> {
    use Kind::{Cat, Conv1, Conv3, Doubled, Norm, NormRelu, Pool, Scale};
    let mut all = Vec::new();
    let mut add = |kind, side, cin, cout| all.push(Place { kind, side, cin, cout, first: all.is_empty() });
    let mut unit = |kind, norm, side, cin, cout| {
        add(kind, side, cin, cout);
        if let Some(norm) = norm {
            add(norm, side, cout, cout);
        }
    };
    let at = |level: usize| (row.side >> (level - 1), row.base << (level - 1));
    for level in 1..=5 {
        let (side, c) = at(level);
        let cin = if level == 1 { row.config().net.in_channels } else { c / 2 };
        if level > 1 {
            unit(Pool, None, side, cin, cin);
        }
        unit(Conv3, Some(NormRelu), side, cin, c);
        unit(Conv3, Some(NormRelu), side, c, c);
    }
    // The value decoder ends at a quarter of the side, the obstacle decoder at the whole.
    for (last, answers) in [(3, row.config().net.headings), (1, 1)] {
        for level in (last..=4).rev() {
            let (side, c) = at(level);
            unit(Doubled, Some(NormRelu), side, 2 * c, c);
            unit(Conv1, Some(Norm), side, c, c / 2);
            unit(Conv1, Some(Norm), side, c, c / 2);
            unit(Conv1, Some(Norm), side, c / 2, 1);
            unit(Scale, None, side, c, c);
            unit(Cat, None, side, c, 2 * c);
            unit(Conv3, Some(NormRelu), side, 2 * c, c);
            unit(Conv3, Some(NormRelu), side, c, c);
        }
        let (side, c) = at(last);
        unit(Conv1, None, side, c, answers);
    }
    all
}

impl Place {
    /// Operations of a convolution as it is defined, in one direction; how few it is really done with is another matter.
    fn operations(&self, batch: usize) -> f64 {
        let taps = match self.kind {
            Kind::Conv3 | Kind::Doubled => 9,
            Kind::Conv1 => 1,
            _ => 0,
        };
        2.0 * (taps * self.cin * self.cout * self.side * self.side * batch) as f64
    }

    /// Seconds forwards, for the parameters' gradient and for the input's; those without parameters have their
    /// whole way back in the last.
    fn seconds(&self, batch: usize) -> Result<[f64; 3], Failure> {
        let device = Device::flex().autodiff();
        let uniform = |shape: [usize; 4]| Tensor::<4>::random(shape, Distribution::Uniform(-1.0, 1.0), &device);
        let vector = |value: f64| Tensor::<1>::full([self.cout], value, &device);
        let kernel = if self.kind == Kind::Conv1 { 1 } else { 3 };
        let weight = uniform([self.cout, self.cin, kernel, kernel]);
        let conv = Conv { weight: Param::from_tensor(weight), bias: Param::from_tensor(vector(0.1)) };
        let norm = Norm {
            weight: Param::from_tensor(vector(1.0)),
            bias: Param::from_tensor(vector(0.1)),
            running_mean: RunningState::new(vector(0.0)),
            running_var: RunningState::new(vector(1.0)),
        };
        let side = match self.kind {
            Kind::Doubled => self.side / 2,
            Kind::Pool => self.side * 2,
            _ => self.side,
        };
        let x = uniform([batch, self.cin, side, side]);
        let factor = uniform([batch, 1, side, side]).require_grad();
        let forward = |x: Tensor<4>| match self.kind {
            Kind::Conv3 | Kind::Conv1 => Some(conv.forward(x)),
            Kind::Doubled => Some(conv.forward_doubled(x)),
            Kind::NormRelu => Some(norm.forward_relu(x)),
            Kind::Norm => Some(norm.forward(x)),
            Kind::Pool => fast::pool(&x),
            Kind::Scale => fast::scale(&x, &factor),
            Kind::Cat => Some(Tensor::cat(vec![x.clone(), x], 1)),
        };
        // Forwards and backwards.
        let both = |x: &Tensor<4>| -> Result<[f64; 2], Failure> {
            let mut least = [f64::INFINITY; 2];
            for _ in 0..REPEATS {
                let (ahead, y) = Time::of(|| forward(x.clone()));
                let y = y.ok_or("an operator does not take its tensor")?;
                let (back, _) = Time::of(|| y.backward());
                least = [least[0].min(ahead.wall), least[1].min(back.wall)];
            }
            Ok(least)
        };
        let has_parameters = !matches!(self.kind, Kind::Pool | Kind::Scale | Kind::Cat);
        let [ahead, parameters] = if has_parameters { both(&x)? } else { [0.0; 2] };
        if self.first {
            return Ok([ahead, parameters, 0.0]);
        }
        let [ahead, back] = both(&x.require_grad())?;
        // Batch norm has no cheaper way back to its parameters alone.
        Ok(if self.kind.is_convolution() {
            [ahead, parameters, (back - parameters).max(0.0)]
        } else {
            [ahead, 0.0, back]
        })
    }
}

/// Prints a table in Markdown.
pub(crate) fn print(row: Row) -> Result<(), Failure> {
    let (early, parts) = (sgemm_peak(), phases(row)?);
    let peak = early.max(sgemm_peak());
    let (step, update) = (parts.iter().map(|part| part.wall).sum::<f64>(), parts[2].wall);
    let [ahead, back, optimiser] = parts.map(|part| format!("{:.0} ({:.0})", 1e3 * part.wall, 1e3 * part.cpu));
    println!("Training step of {row}: {:.0} ms on {} threads.", 1e3 * step, rayon::current_num_threads());
    println!("On the clock (of the processor), ms: forward and loss {ahead}, backward {back}, optimiser {optimiser}.");
    println!("Matrix product of 1024³: {peak:.0} GFLOP/s. Cells are ms (GFLOP/s).\n");
    println!("| operator | side | number | forward | weights' gradient | input's gradient | ms | of step | of peak |");
    println!("|---|---|---|---|---|---|---|---|---|");
    let mut all = places(row);
    all.sort_by_key(|place| (place.kind, std::cmp::Reverse(place.side), place.cin, place.cout));
    let mut sum = 0.0;
    // Convolutions by resolution; the others are a few passes over memory.
    let key = |place: &Place| (place.kind, if place.kind.is_convolution() { place.side } else { 0 });
    for group in all.chunk_by(|a, b| key(a) == key(b)) {
        let (mut seconds, mut operations) = ([0.0; 3], [0.0; 3]);
        let mut known: Option<(Place, [f64; 3])> = None;
        for &place in group {
            let times = match known {
                Some((same, times)) if same == place => times,
                _ => place.seconds(row.batch)?,
            };
            known = Some((place, times));
            for (direction, time) in times.into_iter().enumerate() {
                seconds[direction] += time;
                operations[direction] += if time > 0.0 { place.operations(row.batch) } else { 0.0 };
            }
        }
        let rate = |operations: f64, seconds: f64| operations / seconds / 1e9;
        let [cell_a, cell_b, cell_c] = std::array::from_fn(|i| match (seconds[i], operations[i]) {
            (0.0, _) => String::new(),
            (time, 0.0) => format!("{:.1}", 1e3 * time),
            (time, count) => format!("{:.1} ({:.0})", 1e3 * time, rate(count, time)),
        });
        let (total, count): (f64, f64) = (seconds.iter().sum(), operations.iter().sum());
        let of_peak = if count > 0.0 { format!("{:.0} %", 100.0 * rate(count, total) / peak) } else { String::new() };
        let (kind, side) = key(&group[0]);
        let side = if side > 0 { side.to_string() } else { "all".into() };
        print!("| {} | {side} | {} | {cell_a} | {cell_b} | {cell_c} ", kind.name(), group.len());
        println!("| {:.1} | {:.1} % | {of_peak} |", 1e3 * total, 100.0 * total / step);
        sum += total;
    }
    let rest =
        |name: &str, time: f64| println!("| {name} | | | | | | {:.1} | {:.1} % | |", 1e3 * time, 100.0 * time / step);
    rest("optimiser", update);
    rest("rest", step - sum - update);
    Ok(())
}

/// Parts of the quickest step: forward with loss, backward, optimiser.
fn phases(row: Row) -> Result<[Time; 3], Failure> {
    let mut steps = Vec::new();
    let mut work = Work::new(Task::Train, row)?;
    for _ in 0..REPEATS {
        let Work::Train { net, optim, batch } = &mut work else { return Err("this is no training".into()) };
        let (ahead, losses) = Time::of(|| {
            let losses = loss(net, net.forward(batch.x_bchw.clone()), &batch.targets, Tasks::Both);
            losses.values();
            losses
        });
        let (back, gradients) = Time::of(|| GradientsParams::from_grads(losses.total.backward(), net));
        let (update, next) = Time::of(|| optim.step(AdamW::default().lr, net.clone(), gradients));
        *net = next;
        steps.push([ahead, back, update]);
    }
    let whole = |step: &[Time; 3]| step.iter().map(|part| part.wall).sum::<f64>();
    steps.into_iter().min_by(|a, b| whole(a).total_cmp(&whole(b))).ok_or("no step was made".into())
}
