//! Final Coverage and AUC (paper, section 5.1), and their mean and spread over episodes.

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
}
