//! Constrained Delaunay triangulation of line segments that may cross, touch and overlap.
//!
//! The only file that knows `spade`; the converter and the generator share it (aimdoom.md, section 2, step 3).

use spade::handles::FixedVertexHandle;
use spade::{ConstrainedDelaunayTriangulation, Point2, Triangulation as _};
use std::collections::BTreeMap;

/// Why a set of segments has no triangulation.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("the plan cannot be triangulated near ({x}, {y}): {reason}")]
pub struct TriangulateError {
    /// Map units.
    pub x: f64,
    /// Map units.
    pub y: f64,
    /// In words.
    pub reason: String,
}

/// Triangles of the convex hull of the segments; edges are numbered 0: `a→b`, 1: `b→c`, 2: `c→a`.
#[derive(Debug, Clone, Default)]
pub struct Triangulation {
    /// Corners, map units. The first ones are the distinct end points; crossings follow.
    pub points: Vec<[f64; 2]>,
    /// Counter-clockwise corner indices.
    pub triangles: Vec<[u32; 3]>,
    /// The triangle across each edge; `None` outside of the hull.
    pub neighbours: Vec<[Option<u32>; 3]>,
    /// Whether each edge lies on a segment.
    pub is_constraint: Vec<[bool; 3]>,
}

impl Triangulation {
    /// Triangulates `segments` between `points` (pairs of indices); segments of no length are left out.
    ///
    /// # Errors
    /// On coordinates that are not finite.
    pub fn build(points: &[[f64; 2]], segments: &[[u32; 2]]) -> Result<Self, TriangulateError> {
        let mut cdt = ConstrainedDelaunayTriangulation::<Point2<f64>>::new();
        let mut handles = Vec::with_capacity(points.len());
        for &[x, y] in points {
            // -0.0 and 0.0 are one place, and spade refuses tiny values.
            let [x, y] = [x, y].map(|v| if v.abs() < 1e-9 { 0.0 } else { v });
            let refused = |error: spade::InsertionError| TriangulateError { x, y, reason: error.to_string() };
            handles.push(cdt.insert(Point2::new(x, y)).map_err(refused)?);
        }
        for &[a, b] in segments {
            let (Some(&from), Some(&to)) = (handles.get(a as usize), handles.get(b as usize)) else { continue };
            if from != to {
                add_segment(&mut cdt, from, to);
            }
        }
        Ok(Self::read(&cdt))
    }

    fn read(cdt: &ConstrainedDelaunayTriangulation<Point2<f64>>) -> Self {
        let points = cdt.vertices().map(|v| [v.position().x, v.position().y]).collect();
        // Face 0 is the outside; numbers are made dense again in the order of the faces.
        let number: BTreeMap<usize, u32> =
            cdt.inner_faces().enumerate().map(|(n, face)| (face.index(), n as u32)).collect();
        let mut built = Self { points, ..Self::default() };
        for face in cdt.inner_faces() {
            let edges = face.adjacent_edges();
            built.triangles.push(edges.map(|edge| edge.from().index() as u32));
            built.neighbours.push(edges.map(|edge| number.get(&edge.rev().face().index()).copied()));
            built.is_constraint.push(edges.map(|edge| edge.is_constraint_edge()));
        }
        built
    }

    /// End points of one edge of a triangle.
    pub fn edge(&self, triangle: usize, edge: usize) -> [u32; 2] {
        let corners = self.triangles[triangle];
        [corners[edge % 3], corners[(edge + 1) % 3]]
    }

    /// Length of one edge of a triangle.
    pub fn edge_length(&self, triangle: usize, edge: usize) -> f64 {
        let [a, b] = self.edge(triangle, edge).map(|v| self.points[v as usize]);
        (b[0] - a[0]).hypot(b[1] - a[1])
    }

    /// Area of a triangle, square map units.
    pub fn area(&self, triangle: usize) -> f64 {
        let [a, b, c] = self.triangles[triangle].map(|v| self.points[v as usize]);
        0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
    }

    /// Mean of the corners.
    pub fn centroid(&self, triangle: usize) -> [f64; 2] {
        let [a, b, c] = self.triangles[triangle].map(|v| self.points[v as usize]);
        [(a[0] + b[0] + c[0]) / 3.0, (a[1] + b[1] + c[1]) / 3.0]
    }

    /// Groups triangles into components: neighbours are joined where `joined(triangle, edge, neighbour)` holds. Triangles
    /// that are not `wanted` stay `None`. Numbers follow the order of the triangles.
    pub fn flood(
        &self,
        wanted: impl Fn(usize) -> bool,
        joined: impl Fn(usize, usize, usize) -> bool,
    ) -> (Vec<Option<u32>>, u32) {
        let mut label = vec![None; self.triangles.len()];
        let mut count = 0;
        for start in 0..self.triangles.len() {
            if label[start].is_some() || !wanted(start) {
                continue;
            }
            label[start] = Some(count);
            let mut stack = vec![start];
            while let Some(triangle) = stack.pop() {
                for edge in 0..3 {
                    let Some(next) = self.neighbours[triangle][edge].map(|n| n as usize) else { continue };
                    if label[next].is_none() && wanted(next) && joined(triangle, edge, next) {
                        label[next] = Some(count);
                        stack.push(next);
                    }
                }
            }
            count += 1;
        }
        (label, count)
    }
}

fn add_segment(
    cdt: &mut ConstrainedDelaunayTriangulation<Point2<f64>>,
    from: FixedVertexHandle,
    to: FixedVertexHandle,
) {
    cdt.add_constraint_and_split(from, to, |crossing| crossing);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn crossing_segments_are_split() {
        let points = [[0.0, 0.0], [10.0, 10.0], [0.0, 10.0], [10.0, 0.0]];
        let plan = Triangulation::build(&points, &[[0, 1], [2, 3]]).unwrap();
        assert_eq!(plan.points.len(), 5);
        assert_eq!(plan.triangles.len(), 4);
        let area: f64 = (0..4).map(|t| plan.area(t)).sum();
        assert!((area - 100.0).abs() < 1e-9);
        let (_, regions) = plan.flood(|_| true, |t, e, _| !plan.is_constraint[t][e]);
        assert_eq!(regions, 4);
    }

    #[test]
    fn duplicates_and_overlaps_are_fine() {
        let points = [[0.0, 0.0], [4.0, 0.0], [2.0, 0.0], [8.0, 0.0], [0.0, 0.0], [3.0, 5.0]];
        let segments = [[0, 1], [2, 3], [4, 5], [0, 4], [0, 1], [5, 3]];
        let plan = Triangulation::build(&points, &segments).unwrap();
        assert_eq!(plan.points.len(), 5);
        assert!(Triangulation::build(&[[f64::NAN, 0.0]], &[]).is_err());
        assert!(Triangulation::build(&[], &[]).unwrap().triangles.is_empty());
    }
}
