//! Real spherical harmonics below degree 8, orthonormal on the sphere.

use super::config::HARMONICS;
use std::f32::consts::PI;

/// Degrees 0 to 7.
const DEGREES: usize = 8;

/// All harmonics at a unit vector: degree by degree, orders from −l to l, polar axis `z`.
pub fn basis([x, y, z]: [f32; 3]) -> [f32; HARMONICS] {
    let mut all = [0.0; HARMONICS];
    // cos and sin of m·φ times sinᵐθ, which is a polynomial in x and y.
    let (mut cos, mut sin, mut diagonal) = (1.0f32, 0.0f32, (0.25 / PI).sqrt());
    for m in 0..DEGREES {
        if m > 0 {
            (cos, sin) = (x * cos - y * sin, x * sin + y * cos);
            diagonal *= ((2 * m + 1) as f32 / (2 * m) as f32).sqrt();
        }
        let (mut before, mut legendre) = (0.0, diagonal);
        for l in m..DEGREES {
            let centre = l * l + l;
            if m == 0 {
                all[centre] = legendre;
            } else {
                all[centre + m] = std::f32::consts::SQRT_2 * legendre * cos;
                all[centre - m] = std::f32::consts::SQRT_2 * legendre * sin;
            }
            let step = |l: usize| (((4 * l * l) as f32 - 1.0) / ((l * l) as f32 - (m * m) as f32)).sqrt();
            let next = step(l + 1) * (z * legendre - if l > m { before / step(l) } else { 0.0 });
            (before, legendre) = (legendre, next);
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn they_are_orthonormal() {
        // Gauss's rule along z would be exact; the midpoint rule on many points is near enough.
        let (rings, spokes) = (400, 32);
        let mut products = vec![0.0f64; HARMONICS * HARMONICS];
        for ring in 0..rings {
            let z = (2 * ring + 1) as f32 / rings as f32 - 1.0;
            for spoke in 0..spokes {
                let (sin, cos) = (2.0 * PI * spoke as f32 / spokes as f32).sin_cos();
                let across = (1.0 - z * z).sqrt();
                let y = basis([across * cos, across * sin, z]);
                for (a, left) in y.iter().enumerate() {
                    for (b, right) in y.iter().enumerate() {
                        products[a * HARMONICS + b] += f64::from(left * right);
                    }
                }
            }
        }
        let cell = 4.0 * std::f64::consts::PI / f64::from(rings * spokes);
        for (at, product) in products.iter().enumerate() {
            let want = f64::from(u8::from(at / HARMONICS == at % HARMONICS));
            assert!((product * cell - want).abs() < 5e-3, "{} {}: {}", at / HARMONICS, at % HARMONICS, product * cell);
        }
        let first = basis([0.6, 0.0, 0.8]);
        let want = (0.75 / PI).sqrt();
        assert!((first[2] - 0.8 * want).abs() < 1e-6 && (first[3] - 0.6 * want).abs() < 1e-6, "{first:?}");
    }
}
