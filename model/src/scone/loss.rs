//! What both networks are trained with: squared error of occupancy, and the distance of gains that leaves their scale free.

use burn::prelude::*;

/// Mean squared error of occupancy.
///
/// # Shapes
/// `[q]`, `[q]` → `[1]`.
pub fn occupancy(found_q: Tensor<1>, wanted_q: Tensor<1>) -> Tensor<1> {
    (found_q - wanted_q).powi_scalar(2).mean()
}

/// Uncentred L1: `mean |ĝ / mean ĝ − g / mean g|` over the candidates of one decision, then the mean over decisions. Where
/// nothing is to be gained, a decision says nothing and is left out; `None` if all are.
///
/// `decisions` are numbers of candidates, in the order of `found_b` and `wanted`.
///
/// # Shapes
/// `[b]`, b numbers → `[1]`.
pub fn gains(found_b: Tensor<1>, wanted: &[f32], decisions: &[usize]) -> Option<Tensor<1>> {
    let (device, dtype) = (found_b.device(), found_b.dtype());
    let (mut begin, mut terms) = (0, Vec::new());
    for &count in decisions {
        let range = begin..begin + count;
        let labels = &wanted[range.clone()];
        begin += count;
        let mean = labels.iter().sum::<f32>() / count.max(1) as f32;
        if mean <= 0.0 || !mean.is_finite() {
            continue;
        }
        let shares: Vec<f32> = labels.iter().map(|gain| gain / mean).collect();
        let wanted_c = Tensor::<1>::from_data(TensorData::new(shares, [count]), (&device, dtype));
        let found_c = found_b.clone().slice([range]);
        let scale = found_c.clone().mean().clamp_min(SMALLEST);
        terms.push((found_c / scale - wanted_c).abs().mean());
    }
    let count = terms.len();
    (count > 0).then(|| Tensor::cat(terms, 0).sum().mul_scalar(1.0 / count as f64))
}

/// Of a mean gain that others are measured by: a decision in which nothing is found must not divide by zero.
const SMALLEST: f32 = 1e-12;
