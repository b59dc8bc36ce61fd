//! Final Coverage and AUC (paper, section 5.1), their mean and spread over episodes, and whether a difference is more than
//! chance.

use crate::seed::SeedTree;
use rand::RngExt as _;
use serde::{Deserialize, Serialize};

/// Coverage at the end of a curve; 0 for an empty one.
pub fn final_coverage(curve: &[f32]) -> f64 {
    curve.last().map_or(0.0, |&c| f64::from(c))
}

/// Area under a coverage curve over its steps, trapezoidal, divided by the number of steps: 0 to 1.
pub fn auc(curve: &[f32]) -> f64 {
    match curve.len() {
        0 => 0.0,
        1 => f64::from(curve[0]),
        n => curve.windows(2).map(|w| f64::from(w[0] + w[1]) / 2.0).sum::<f64>() / (n - 1) as f64,
    }
}

/// Mean and sample standard deviation; the deviation of fewer than two values is 0.
pub fn mean_std(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    if values.is_empty() {
        return (0.0, 0.0);
    }
    let mean = values.iter().sum::<f64>() / n;
    let squares: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
    (mean, if values.len() < 2 { 0.0 } else { (squares / (n - 1.0)).sqrt() })
}

/// Resamples of a bootstrap.
pub const RESAMPLES: usize = 10_000;

/// A mean difference, and what chance may have to do with it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Difference {
    /// Mean of the differences.
    pub mean: f64,
    /// Interval in which 95 % of the means of resamples lie.
    pub interval: [f64; 2],
    /// Share of the ways to choose the signs of the differences that give a mean as far from 0, two-sided.
    pub p: f64,
}

/// Up to so many pairs, `p` counts all choices of signs; beyond, [`RESAMPLES`] at random.
const ALL_SIGNS: usize = 13;

/// What `differences`, one number for each pair (of scenes, say), tell of chance; `None` for fewer than two, of which nothing
/// can be said.
///
/// The interval is a paired bootstrap's: resamples draw as many differences with replacement. With few pairs it is too
/// narrow, since resamples know no other values than these: of 6 normal differences it holds the true mean in 85 % of cases.
/// So `p` is not read off it, but off the signs (Fisher's randomisation test), exact however few the pairs: at best 2 / 2ⁿ.
pub fn paired_difference(differences: &[f64], seed: SeedTree) -> Option<Difference> {
    let count = differences.len();
    if count < 2 {
        return None;
    }
    let mean = |sum: f64| sum / count as f64;
    let mut rng = seed.child("bootstrap", 0).rng();
    let mut draw = || mean((0..count).map(|_| differences[rng.random_range(0..count)]).sum::<f64>());
    let mut means: Vec<f64> = (0..RESAMPLES).map(|_| draw()).collect();
    means.sort_by(f64::total_cmp);
    let quantile = |q: f64| means[(q * (RESAMPLES - 1) as f64).round() as usize];
    let found = differences.iter().sum::<f64>();
    // Sums in another order round otherwise.
    let is_as_far = |sum: f64| sum.abs() >= found.abs() * (1.0 - 1e-9);
    let signed = |is_minus: &mut dyn FnMut(usize) -> bool| {
        let terms =
            differences.iter().enumerate().map(|(n, &difference)| if is_minus(n) { -difference } else { difference });
        is_as_far(terms.sum())
    };
    let p = if count <= ALL_SIGNS {
        let all = 1_u32 << count;
        (0..all).filter(|signs| signed(&mut |n| signs >> n & 1 == 1)).count() as f64 / f64::from(all)
    } else {
        let mut rng = seed.child("signs", 0).rng();
        let far = (0..RESAMPLES).filter(|_| signed(&mut |_| rng.random())).count();
        (1 + far) as f64 / (RESAMPLES + 1) as f64
    };
    Some(Difference { mean: mean(found), interval: [quantile(0.025), quantile(0.975)], p })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_straight_line_has_half_its_height_as_area() {
        let curve: Vec<f32> = (0..=100).map(|t| t as f32 / 100.0).collect();
        assert!((auc(&curve) - 0.5).abs() < 1e-6);
        assert_eq!(final_coverage(&curve), 1.0);
        assert_eq!(auc(&[0.25]), 0.25);
    }

    #[test]
    fn spread_is_that_of_a_sample() {
        let (mean, std) = mean_std(&[1.0, 2.0, 3.0]);
        assert!((mean - 2.0).abs() < 1e-12 && (std - 1.0).abs() < 1e-12);
        assert_eq!(mean_std(&[5.0]), (5.0, 0.0));
    }

    #[test]
    fn differences_are_told_from_chance() {
        let of = |differences: &[f64]| paired_difference(differences, SeedTree::new(3));
        let clear_ones = [0.1, 0.12, 0.08, 0.11, 0.09];
        let clear = of(&clear_ones).unwrap();
        assert!((clear.mean - 0.1).abs() < 1e-12 && clear.p == 1.0 / 16.0, "{clear:?}");
        assert!(clear.interval[0] >= 0.08 && clear.interval[1] <= 0.12 && clear.interval[0] < clear.interval[1]);
        let nothing = of(&[0.1, -0.1, 0.2, -0.2]).unwrap();
        assert!(nothing.p > 0.5 && nothing.interval[0] < 0.0 && nothing.interval[1] > 0.0, "{nothing:?}");
        assert_eq!(of(&[0.0; 4]).unwrap(), Difference { mean: 0.0, interval: [0.0; 2], p: 1.0 });
        assert_eq!(of(&[0.1, 0.3, -0.1]), of(&[0.1, 0.3, -0.1]));
        assert_eq!((of(&[0.1]), of(&[])), (None, None));
        // The spread of the mean of numbers with a deviation of 1, which is known.
        let spread: Vec<f64> = (1..400).map(|n| (f64::from(n) / 400.0 - 0.5) * 12_f64.sqrt()).collect();
        assert!(of(&[&clear_ones[..], &clear_ones].concat()).unwrap().p < 0.01);
        let width = of(&spread).map(|d| d.interval[1] - d.interval[0]).unwrap();
        assert!((width - 2.0 * 1.96 / 20.0).abs() < 0.01, "{width}");
    }
}
