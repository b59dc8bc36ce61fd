//! Polygons into triangles: faces of OBJ and PLY files may have any number of corners, and need not be convex.

use earcut::Earcut;
use glam::{DVec3, Vec3};

/// Faces with more corners are refused by readers: random ones of this size take 0.2 s, and time grows faster than size.
pub const MAX_CORNERS: usize = 4096;

/// Share of a polygon's area by which a triangle may lie the wrong way round and still count as flat: rounding.
const FLAT: f64 = 1e-9;

/// Corner numbers of triangles that fill a flat, simple polygon, given in either winding.
///
/// The fan around the first corner where that is right, as for every convex polygon; else ears are clipped in the
/// plane of two axes. A polygon without an area gives no triangle; one that crosses itself gives some.
pub fn triangulate(corners: &[Vec3]) -> Vec<[usize; 3]> {
    let fan = (2..corners.len()).map(|k| [0, k - 1, k]);
    if corners.len() <= 3 {
        return fan.collect();
    }
    let at = |k: usize| corners[k].as_dvec3() - corners[0].as_dvec3();
    let areas: Vec<DVec3> = (2..corners.len()).map(|k| at(k - 1).cross(at(k))).collect();
    let normal: DVec3 = areas.iter().sum();
    let least = -FLAT * normal.length_squared();
    if normal == DVec3::ZERO {
        Vec::new()
    } else if areas.iter().all(|area| area.dot(normal) >= least) {
        fan.collect()
    } else {
        let [u, v] = match normal.abs().max_position() {
            0 => [1, 2],
            1 => [2, 0],
            _ => [0, 1],
        };
        let flat = (0..corners.len()).map(|k| [at(k)[u], at(k)[v]]);
        let mut ears: Vec<usize> = Vec::new();
        Earcut::new().earcut(flat, &[], &mut ears);
        ears.as_chunks().0.to_vec()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn area(corners: &[Vec3], triangles: &[[usize; 3]]) -> f32 {
        let doubled = |t: &[usize; 3]| {
            let [a, b, c] = t.map(|k| corners[k]);
            (b - a).cross(c - a).length()
        };
        triangles.iter().map(doubled).sum::<f32>() / 2.0
    }

    /// An L of 3 square metres on a wall that faces (1, 0, 1), from each corner on.
    #[test]
    fn a_concave_polygon_is_filled_and_not_overdrawn() {
        let l = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]];
        let wall = l.map(|[x, y]| Vec3::new(5.0, 7.0, -2.0) + Vec3::new(x, 0.0, -x) * 0.5_f32.sqrt() + y * Vec3::Y);
        for first in 0..6 {
            let mut corners = wall;
            corners.rotate_left(first);
            for corners in [corners, {
                corners.reverse();
                corners
            }] {
                let triangles = triangulate(&corners);
                assert_eq!(triangles.len(), 4);
                assert!((area(&corners, &triangles) - 3.0).abs() < 1e-5, "{triangles:?}");
            }
        }
    }

    #[test]
    fn convex_polygons_are_fans_and_degenerate_ones_nothing() {
        let square = [Vec3::ZERO, Vec3::X, Vec3::X + Vec3::Z, Vec3::Z];
        assert_eq!(triangulate(&square), [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(triangulate(&square[..3]), [[0, 1, 2]]);
        assert!(triangulate(&square[..2]).is_empty());
        assert!(triangulate(&[Vec3::ONE; 7]).is_empty());
        assert!(triangulate(&[Vec3::ZERO, Vec3::X, 2.0 * Vec3::X, 3.0 * Vec3::X]).is_empty());
    }

    proptest! {
        #[test]
        fn whatever_the_corners_every_index_is_one_of_them(
            corners in prop::collection::vec((-4_i8..4, -4_i8..4, -1_i8..1), 0..40),
        ) {
            let corners: Vec<Vec3> = corners.iter().map(|&(x, y, z)| Vec3::new(x.into(), y.into(), z.into())).collect();
            let triangles = triangulate(&corners);
            prop_assert!(triangles.len() <= corners.len().saturating_sub(2));
            prop_assert!(triangles.iter().flatten().all(|&k| k < corners.len()));
        }

        #[test]
        fn stars_around_a_point_keep_their_area(radii in prop::collection::vec(0.2_f32..3.0, 5..60)) {
            let turn = std::f32::consts::TAU / radii.len() as f32;
            let corners: Vec<Vec3> = (0_u16..).zip(&radii).map(|(k, &r)| {
                let angle = f32::from(k) * turn;
                Vec3::new(r * angle.cos(), 1.0, r * angle.sin())
            }).collect();
            let pairs = radii.iter().zip(radii.iter().cycle().skip(1));
            let expected: f32 = pairs.map(|(a, b)| a * b * turn.sin() / 2.0).sum();
            let found = area(&corners, &triangulate(&corners));
            prop_assert!((found - expected).abs() < 1e-4 * expected, "{} {}", found, expected);
        }
    }
}
