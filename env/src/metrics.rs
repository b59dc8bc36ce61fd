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
    /// Two-sided: twice the share of resamples whose mean lies on the other side of 0, or on it; but at least the chance that
    /// as many coins show the same side.
    pub p: f64,
}

/// Paired bootstrap: `differences` has one number for each pair (of scenes, say), and resamples of [`RESAMPLES`] draw as many
/// of them with replacement. `None` for fewer than two pairs, of which nothing can be said.
///
/// With few pairs the interval is too narrow, since resamples know no other values than these; that is why `p` has a lower
/// end, 2 / 2ⁿ for n pairs.
pub fn paired_bootstrap(differences: &[f64], seed: SeedTree) -> Option<Difference> {
    let count = differences.len();
    if count < 2 {
        return None;
    }
    let mut rng = seed.child("bootstrap", 0).rng();
    let mut draw = || (0..count).map(|_| differences[rng.random_range(0..count)]).sum::<f64>() / count as f64;
    let mut means: Vec<f64> = (0..RESAMPLES).map(|_| draw()).collect();
    means.sort_by(f64::total_cmp);
    let share = |is_beyond: fn(f64) -> bool| {
        (1 + means.iter().filter(|&&mean| is_beyond(mean)).count()) as f64 / (RESAMPLES + 1) as f64
    };
    let quantile = |q: f64| means[(q * (RESAMPLES - 1) as f64).round() as usize];
    Some(Difference {
        mean: differences.iter().sum::<f64>() / count as f64,
        interval: [quantile(0.025), quantile(0.975)],
        p: (2.0 * share(|mean| mean <= 0.0).min(share(|mean| mean >= 0.0)))
            .max(0.5_f64.powi(count.min(1000) as i32 - 1))
            .min(1.0),
    })
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
    fn a_bootstrap_tells_differences_from_chance() {
        let of = |differences: &[f64]| paired_bootstrap(differences, SeedTree::new(3));
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
