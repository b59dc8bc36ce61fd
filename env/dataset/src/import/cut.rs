//! The part of a mesh in a box, colours included.

use super::ImportError;
use glam::{Vec2, Vec3};
use nbp_env::scene::{Appearance, Mesh, Paint};
use std::collections::HashMap;

/// A corner on its way through the cuts: where, and what it shows.
#[derive(Clone, Copy)]
struct Corner {
    at: Vec3,
    colour: Vec3,
    uv: Vec2,
}

impl Corner {
    fn lerp(self, other: Self, t: f32) -> Self {
        Self { at: self.at.lerp(other.at, t), colour: self.colour.lerp(other.colour, t), uv: self.uv.lerp(other.uv, t) }
    }
}

/// The part of a mesh in a box. Triangles that cross a side are cut there, so that what is left has its area.
pub(super) fn to_box(mesh: &Mesh, [low, high]: [Vec3; 2]) -> Result<Mesh, ImportError> {
    let bounds = mesh.bounds();
    // The side, as an axis, a sign and a limit, of all sides that the mesh reaches across.
    let below = (0..3).filter(|&axis| bounds[0][axis] < low[axis]).map(|axis| (axis, 1.0, low[axis]));
    let above = (0..3).filter(|&axis| bounds[1][axis] > high[axis]).map(|axis| (axis, -1.0, high[axis]));
    let sides: Vec<(usize, f32, f32)> = below.chain(above).collect();
    if sides.is_empty() {
        return Ok(mesh.clone());
    }
    let mut parts = Parts::default();
    for (number, corners) in mesh.iter_corners().enumerate() {
        let paint = mesh.appearance().map(|appearance| appearance.paints[number]);
        let corner = |n: usize| Corner {
            at: corners[n],
            colour: match paint {
                Some(Paint::Corners(colours)) => Vec3::from(colours[n].map(f32::from)),
                _ => Vec3::ZERO,
            },
            uv: match paint {
                Some(Paint::Image { corners, .. }) => corners[n],
                _ => Vec2::ZERO,
            },
        };
        let triangle = vec![corner(0), corner(1), corner(2)];
        let polygon = sides.iter().fold(triangle, |polygon, &(axis, sign, limit)| cut(&polygon, axis, sign, limit));
        for n in 2..polygon.len() {
            parts.add([polygon[0], polygon[n - 1], polygon[n]], paint);
        }
    }
    let images = mesh.appearance().map(|appearance| appearance.images.clone());
    Ok(match images {
        Some(images) => Mesh::painted(parts.vertices, parts.triangles, Appearance { images, paints: parts.paints })?,
        None => Mesh::new(parts.vertices, parts.triangles)?,
    })
}

/// The part of a convex polygon on one side of a limit.
fn cut(polygon: &[Corner], axis: usize, sign: f32, limit: f32) -> Vec<Corner> {
    let side = |corner: Corner| sign * (corner.at[axis] - limit);
    let mut kept = Vec::with_capacity(polygon.len() + 1);
    for (n, &a) in polygon.iter().enumerate() {
        let b = polygon[(n + 1) % polygon.len()];
        let (from, to) = (side(a), side(b));
        if from >= 0.0 {
            kept.push(a);
        }
        if (from < 0.0) != (to < 0.0) {
            // From the outer end whichever way the edge runs: both its triangles get the same point.
            let mut new = if from < 0.0 { a.lerp(b, from / (from - to)) } else { b.lerp(a, to / (to - from)) };
            new.at[axis] = limit;
            kept.push(new);
        }
    }
    kept
}

#[derive(Default)]
struct Parts {
    vertices: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    paints: Vec<Paint>,
    numbers: HashMap<[u32; 3], u32>,
}

impl Parts {
    fn add(&mut self, corners: [Corner; 3], paint: Option<Paint>) {
        let triangle = corners.map(|corner| {
            let next = self.vertices.len() as u32;
            let number = *self.numbers.entry(corner.at.to_array().map(f32::to_bits)).or_insert(next);
            if number == next {
                self.vertices.push(corner.at);
            }
            number
        });
        self.triangles.push(triangle);
        self.paints.extend(paint.map(|paint| match paint {
            Paint::Corners(_) => Paint::Corners(
                corners.map(|c| c.colour.round().clamp(Vec3::ZERO, Vec3::splat(255.0)).to_array().map(|v| v as u8)),
            ),
            Paint::Image { image, .. } => Paint::Image { image, corners: corners.map(|c| c.uv) },
        }));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wall_is_cut_with_its_colours() {
        let vertices = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]].map(|[x, y]| Vec3::new(x, y, 0.0)).to_vec();
        let grey = |y: f32| [(y * 60.0) as u8; 3];
        let paints = [[0.0, 0.0, 4.0], [0.0, 4.0, 4.0]].map(|heights| Paint::Corners(heights.map(grey))).to_vec();
        let appearance = Appearance { images: Vec::new(), paints };
        let wall = Mesh::painted(vertices, vec![[0, 1, 2], [0, 2, 3]], appearance).unwrap();
        let heights = |low, high| [Vec3::NEG_INFINITY.with_y(low), Vec3::INFINITY.with_y(high)];
        let part = to_box(&wall, heights(1.0, 3.0)).unwrap();
        let area: f32 = part.iter_corners().map(|[a, b, c]| (b - a).cross(c - a).length() / 2.0).sum();
        assert!((area - 8.0).abs() < 1e-5, "{area}");
        assert_eq!(part.bounds(), [Vec3::new(0.0, 1.0, 0.0), Vec3::new(4.0, 3.0, 0.0)]);
        let paints = &part.appearance().unwrap().paints;
        for (corners, paint) in part.iter_corners().zip(paints) {
            let Paint::Corners(colours) = paint else { panic!("{paint:?}") };
            for (corner, colour) in corners.iter().zip(colours) {
                assert!(colour[0].abs_diff(grey(corner.y)[0]) <= 1, "{colour:?} at {corner}");
            }
        }
        assert_eq!(to_box(&wall, heights(-1.0, 4.0)).unwrap(), wall);
        assert!(matches!(to_box(&wall, heights(5.0, 6.0)), Err(ImportError::Mesh(_))));
    }
}
