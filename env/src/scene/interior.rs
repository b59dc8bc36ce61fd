//! Whether a point lies inside a building: by parity for closed meshes, by what surrounds it for scans.

use super::RayIndex;
use crate::pose::CAMERA_HEIGHT;
use glam::Vec3;
use std::f32::consts::TAU;

/// A floor farther below the camera than this is not a floor to stand on, metres.
const MAX_DROP: f32 = 12.0;

/// The same in a scan: surfaces of the storey below are no floor, metres.
const MAX_SCAN_DROP: f32 = CAMERA_HEIGHT + 1.0;

/// Horizontal rays around a point.
const CIRCLE: usize = 16;

/// How many of them hit something in a room without a ceiling. Beside a long outer wall it is less than half.
const ENCLOSED: usize = 10;

/// The same under a ceiling: glass walls are often missing in scans.
const ENCLOSED_UNDER_CEILING: usize = 6;

/// Surfaces farther away than this enclose nothing, metres.
const VIEW: f32 = 40.0;

/// What the inside of a mesh is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Interior {
    /// Where an odd number of surfaces lies below: in a closed or open-topped building there is one floor, inside a wall or
    /// outside there is none (or a ceiling and its floor).
    #[default]
    Closed,
    /// Where a floor lies at most 2.65 m below and most of the horizontal rays hit something: scans are single sheets
    /// with holes, and counting surfaces says nothing.
    Open,
}

impl Interior {
    /// Whether `position` is inside.
    pub fn contains(self, rays: &RayIndex, position: Vec3) -> bool {
        match self {
            Self::Closed => {
                let below = rays.crossings(position, Vec3::NEG_Y);
                below.len() % 2 == 1 && below[0] <= MAX_DROP
            }
            Self::Open => rays.nearest(position, Vec3::NEG_Y, MAX_SCAN_DROP).is_some() && is_enclosed(rays, position),
        }
    }
}

fn is_enclosed(rays: &RayIndex, position: Vec3) -> bool {
    let is_hit = |direction: Vec3| rays.nearest(position, direction, VIEW).is_some();
    let mut hits = 0;
    for n in 0..CIRCLE {
        let (sin, cos) = (TAU * (n as f32 + 0.25) / CIRCLE as f32).sin_cos();
        hits += usize::from(is_hit(Vec3::new(sin, 0.0, cos)));
        // The rays that are left cannot change the answer.
        if hits == ENCLOSED {
            return true;
        }
        if hits + (CIRCLE - 1 - n) < ENCLOSED_UNDER_CEILING {
            return false;
        }
    }
    hits >= ENCLOSED_UNDER_CEILING && is_hit(Vec3::Y)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Mesh;

    /// A hut of 6 × 6 m without a ceiling, a window in one wall, a sheet for a table, on a lawn of 60 × 60 m.
    fn hut() -> RayIndex {
        let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
        let mut quad = |corners: [[f32; 3]; 4]| {
            let base = vertices.len() as u32;
            vertices.extend(corners.map(Vec3::from));
            triangles.extend([[base, base + 1, base + 2], [base, base + 2, base + 3]]);
        };
        quad([[-30.0, 0.0, -30.0], [30.0, 0.0, -30.0], [30.0, 0.0, 30.0], [-30.0, 0.0, 30.0]]);
        quad([[1.0, 0.8, 1.0], [2.0, 0.8, 1.0], [2.0, 0.8, 2.0], [1.0, 0.8, 2.0]]);
        let mut wall = |a: [f32; 2], b: [f32; 2]| {
            quad([[a[0], 0.0, a[1]], [b[0], 0.0, b[1]], [b[0], 2.6, b[1]], [a[0], 2.6, a[1]]]);
        };
        let walls = [[[0.0, 0.0], [6.0, 0.0]], [[6.0, 0.0], [6.0, 6.0]], [[6.0, 6.0], [0.0, 6.0]]];
        walls.into_iter().for_each(|[a, b]| wall(a, b));
        wall([0.0, 0.0], [0.0, 2.0]);
        wall([0.0, 4.0], [0.0, 6.0]);
        RayIndex::build(&Mesh::new(vertices, triangles).unwrap())
    }

    #[test]
    fn a_scan_is_inside_its_walls_only() {
        let rays = hut();
        let is_free = |x, z| Interior::Open.contains(&rays, Vec3::new(x, 1.65, z));
        for inside in [[0.75, 0.75], [1.5, 1.5], [4.5, 3.0], [1.5, 3.0], [5.25, 5.25]] {
            assert!(is_free(inside[0], inside[1]), "{inside:?}");
        }
        for outside in [[-0.5, 3.0], [7.0, 3.0], [3.0, -2.0], [20.0, 20.0], [40.0, 0.0]] {
            assert!(!is_free(outside[0], outside[1]), "{outside:?}");
        }
        assert!(!Interior::Open.contains(&rays, Vec3::new(4.0, 5.0, 4.0)), "no floor within reach");
        assert!(!Interior::Closed.contains(&rays, Vec3::new(1.5, 1.65, 1.5)), "a sheet makes the count even");
    }
}
