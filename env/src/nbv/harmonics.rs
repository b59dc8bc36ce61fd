//! From where a point was looked at: directions in 98 bins, and the real spherical harmonics of the function on them.

use super::HARMONICS;
use crate::pose::shorter_arc;
use glam::Vec3;
use std::f64::consts::{PI, SQRT_2, TAU};

/// Bins from straight below to straight above, of equal angles.
const ELEVATIONS: usize = 7;

/// Bins around the vertical.
const AZIMUTHS: usize = 14;

/// Bins of directions.
pub const VIEW_BINS: usize = ELEVATIONS * AZIMUTHS;

/// Degrees of the harmonics, from 0.
const DEGREES: usize = 8;

/// The bin of a direction, 0 to [`VIEW_BINS`]; any for a vector without a length.
pub fn view_bin(direction: Vec3) -> usize {
    let elevation = f64::from(direction.y).atan2(f64::from(direction.x.hypot(direction.z)));
    let azimuth = f64::from(shorter_arc(direction.x.atan2(direction.z))).rem_euclid(TAU);
    let row = ((elevation / PI + 0.5) * ELEVATIONS as f64) as usize;
    let column = (azimuth / TAU * AZIMUTHS as f64) as usize;
    row.min(ELEVATIONS - 1) * AZIMUTHS + column.min(AZIMUTHS - 1)
}

/// A vector of the world in the view frame of a camera with this azimuth.
pub fn to_view(vector: Vec3, azimuth: f32) -> Vec3 {
    let (sin, cos) = azimuth.sin_cos();
    Vec3::new(vector.x * cos - vector.z * sin, vector.y, vector.x * sin + vector.z * cos)
}

/// The harmonics of each bin in the view frame of one camera.
///
/// They are real and orthonormal on the sphere, degree after degree, order `-l..=l` in degree `l`; the polar axis is `y`, and
/// azimuths count from `z` towards `x`. A bin contributes its harmonics at its middle times its solid angle.
#[derive(Clone, Debug)]
pub struct Harmonics {
    of_bin: Vec<[f32; HARMONICS]>,
}

impl Harmonics {
    /// For a camera that looks along `azimuth`, radians.
    pub fn facing(azimuth: f32) -> Self {
        let bins = (0..VIEW_BINS).map(|bin| {
            let edge = |row: usize| PI * (row as f64 / ELEVATIONS as f64 - 0.5);
            let (low, high) = (edge(bin / AZIMUTHS), edge(bin / AZIMUTHS + 1));
            let around = TAU * ((bin % AZIMUTHS) as f64 + 0.5) / AZIMUTHS as f64 - f64::from(azimuth);
            let solid_angle = TAU / AZIMUTHS as f64 * (high.sin() - low.sin());
            harmonics((0.5 * (low + high)).sin(), around).map(|value| (value * solid_angle) as f32)
        });
        Self { of_bin: bins.collect() }
    }

    /// Of the function that is 1 on some bins, given as bits, and 0 elsewhere.
    pub fn of(&self, mut bins: u128) -> [f32; HARMONICS] {
        let mut sum = [0.0; HARMONICS];
        while bins != 0 {
            let Some(of_bin) = self.of_bin.get(bins.trailing_zeros() as usize) else { break };
            sum.iter_mut().zip(of_bin).for_each(|(sum, value)| *sum += value);
            bins &= bins - 1;
        }
        sum
    }
}

/// All harmonics at a unit vector, in the order and to the axes of [`Harmonics`].
pub fn harmonics_at([x, y, z]: [f32; 3]) -> [f32; HARMONICS] {
    harmonics(f64::from(y), f64::from(x).atan2(f64::from(z))).map(|value| value as f32)
}

/// All harmonics in a direction, given by the cosine of its angle to the polar axis and its azimuth.
///
/// The recursion over degrees of the normalised Legendre functions: Press et al., Numerical Recipes, section 6.7.
fn harmonics(cosine: f64, azimuth: f64) -> [f64; HARMONICS] {
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    let mut values = [0.0; HARMONICS];
    let mut diagonal = (1.0 / (4.0 * PI)).sqrt();
    for order in 0..DEGREES {
        let m = order as f64;
        if order > 0 {
            diagonal *= sine * ((2.0 * m + 1.0) / (2.0 * m)).sqrt();
        }
        let (sin, cos) = (m * azimuth).sin_cos();
        let (mut before, mut legendre) = (0.0, diagonal);
        for degree in order..DEGREES {
            let l = degree as f64;
            if degree > order {
                let factor = |l: f64| ((4.0 * l * l - 1.0) / (l * l - m * m)).sqrt();
                let previous = if degree > order + 1 { before / factor(l - 1.0) } else { 0.0 };
                (before, legendre) = (legendre, factor(l) * (cosine * legendre - previous));
            }
            let middle = degree * degree + degree;
            match order {
                0 => values[middle] = legendre,
                _ => {
                    values[middle + order] = SQRT_2 * legendre * cos;
                    values[middle - order] = SQRT_2 * legendre * sin;
                }
            }
        }
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::Pose;

    #[test]
    fn harmonics_are_orthonormal() {
        let mut products = vec![[0.0; HARMONICS]; HARMONICS];
        let (rows, columns) = (400, 40);
        for row in 0..rows {
            // Equal steps in the cosine are equal areas; 40 azimuths are exact for orders below 20.
            let cosine = (row as f64 + 0.5) / rows as f64 * 2.0 - 1.0;
            for column in 0..columns {
                let values = harmonics(cosine, TAU * column as f64 / columns as f64);
                for (sums, a) in products.iter_mut().zip(values) {
                    sums.iter_mut().zip(values).for_each(|(sum, b)| *sum += a * b * 4.0 * PI / (rows * columns) as f64);
                }
            }
        }
        for (n, row) in products.iter().enumerate() {
            for (k, &product) in row.iter().enumerate() {
                let expected = f64::from(u8::from(n == k));
                assert!((product - expected).abs() < 1e-3, "{n} {k}: {product}");
            }
        }
        // Degree 1 points along the axes: y, z, x in our order of orders -1, 0, 1 with y as pole and azimuths from z.
        let first = (3.0 / (4.0 * PI)).sqrt();
        let [_, x, y, z, ..] = harmonics(0.6, 0.3);
        for (value, axis) in [(x, 0.8 * 0.3_f64.sin()), (y, 0.6), (z, 0.8 * 0.3_f64.cos())] {
            assert!((value - first * axis).abs() < 1e-12);
        }
    }

    #[test]
    fn bins_cover_the_sphere_and_turn_with_the_camera() {
        let all = Harmonics::facing(0.4).of(u128::MAX >> (128 - VIEW_BINS));
        assert!((all[0] - (4.0 * std::f32::consts::PI).sqrt()).abs() < 1e-5, "the area of the sphere");
        assert!(all[1..4].iter().all(|value| value.abs() < 1e-5));
        // What lies along the optical axis of a camera has its first degree along z in its view frame.
        for azimuth in [0.3_f32, 1.9, 4.4] {
            let pose = Pose { position: Vec3::ZERO, azimuth };
            let forward = to_view(pose.forward(), azimuth);
            assert!(
                forward.abs_diff_eq(Vec3::Z, 1e-6) && to_view(pose.right(), azimuth).abs_diff_eq(Vec3::NEG_X, 1e-6)
            );
            let seen = Harmonics::facing(azimuth).of(1 << view_bin(pose.forward()));
            assert!(seen[3] > 0.05 && seen[1].abs() < 0.25 * seen[3], "{:?}", &seen[..4]);
        }
        let same = Harmonics::facing(1.0).of(0b1011 << 30);
        let turned = Harmonics::facing(1.0 + std::f32::consts::TAU / AZIMUTHS as f32).of(0b10110 << 30);
        assert!(same.iter().zip(turned).all(|(a, b)| (a - b).abs() < 1e-5), "one bin on is one bin back");
    }

    #[test]
    fn a_direction_is_nearest_to_the_middle_of_its_bin_around_the_vertical() {
        for n in 0..1000 {
            let (azimuth, y) = (n as f32 * 0.77, (n as f32 * 0.13).sin());
            let direction = Vec3::new(azimuth.sin(), y, azimuth.cos());
            let bin = view_bin(direction);
            let middle = (bin % AZIMUTHS) as f32 * 0.448_798_95 + 0.224_4;
            assert!(shorter_arc(azimuth - middle).abs() < 0.2245);
            let elevation = y.atan() + std::f32::consts::FRAC_PI_2;
            assert_eq!((elevation / std::f32::consts::PI * 7.0) as usize, bin / AZIMUTHS);
        }
        assert_eq!((view_bin(Vec3::Y) / AZIMUTHS, view_bin(Vec3::NEG_Y) / AZIMUTHS), (6, 0));
        assert!(view_bin(Vec3::ZERO) < VIEW_BINS);
    }
}
