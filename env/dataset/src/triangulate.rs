//! Constrained Delaunay triangulation of line segments that may cross, touch and overlap.
//!
//! The only file that knows `spade`; the converter and the generator share it. Segments
//! are made planar first: spade's own splitting of crossing constraints panics on maps with many crossings.

use crate::arrange::{Arrangement, arrange};
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
    /// Corners, map units, sorted.
    pub points: Vec<[f64; 2]>,
    /// Counter-clockwise corner indices.
    pub triangles: Vec<[u32; 3]>,
    /// The triangle across each edge; `None` outside of the hull.
    pub neighbours: Vec<[Option<u32>; 3]>,
    /// Number of each edge's group of segments; group 0 is empty.
    groups_of: Vec<[u32; 3]>,
    groups: Vec<Vec<u32>>,
}

impl Triangulation {
    /// Triangulates segments between points in map units. Crossings are rounded to a grid with `subunits` lines in a map
    /// unit; segments of no length are left out.
    ///
    /// # Errors
    /// Where a coordinate is too large or lines cross in a way that does not settle on the grid.
    pub fn build(segments: &[[[i32; 2]; 2]], subunits: u16) -> Result<Self, TriangulateError> {
        let scale = f64::from(subunits.max(1));
        let fixed = |segment: &[[i32; 2]; 2]| segment.map(|p| p.map(|c| i64::from(c) * i64::from(subunits.max(1))));
        let fixed: Vec<_> = segments.iter().map(fixed).collect();
        let fail = |[x, y]: [i64; 2], reason: String| {
            Err(TriangulateError { x: x as f64 / scale, y: y as f64 / scale, reason })
        };
        let arranged = match arrange(&fixed) {
            Ok(arranged) => arranged,
            Err((at, reason)) => return fail(at, reason.into()),
        };
        let place = |p: &[i64; 2]| Point2::new(p[0] as f64 / scale, p[1] as f64 / scale);
        let corners: Vec<Point2<f64>> = arranged.points.iter().map(place).collect();
        let pairs = arranged.pieces.keys().map(|pair| pair.map(|p| p as usize)).collect();
        let mut conflict = None;
        let built = ConstrainedDelaunayTriangulation::<Point2<f64>>::try_bulk_load_cdt(corners, pairs, |pair| {
            conflict = conflict.or(arranged.points.get(pair[0]).copied());
        });
        match (built, conflict) {
            (Ok(cdt), None) => Ok(Self::read(&cdt, arranged)),
            (Ok(_), Some(at)) => fail(at, "two lines cross".into()),
            (Err(error), _) => fail([0; 2], error.to_string()),
        }
    }

    fn read(cdt: &ConstrainedDelaunayTriangulation<Point2<f64>>, arranged: Arrangement) -> Self {
        let points = cdt.vertices().map(|v| [v.position().x, v.position().y]).collect();
        // Face 0 is the outside; numbers are made dense again in the order of the faces.
        let mut number = vec![None; cdt.num_all_faces()];
        cdt.inner_faces().enumerate().for_each(|(n, face)| number[face.index()] = Some(n as u32));
        let mut built = Self { points, groups: vec![Vec::new()], ..Self::default() };
        let mut group_of: BTreeMap<[u32; 2], u32> = BTreeMap::new();
        for (pair, sources) in arranged.pieces {
            group_of.insert(pair, built.groups.len() as u32);
            built.groups.push(sources);
        }
        for face in cdt.inner_faces() {
            let edges = face.adjacent_edges();
            built.triangles.push(edges.map(|edge| edge.from().index() as u32));
            built.neighbours.push(edges.map(|edge| number[edge.rev().face().index()]));
            built.groups_of.push(edges.map(|edge| {
                let [a, b] = [edge.from(), edge.to()].map(|v| v.index() as u32);
                group_of.get(&[a.min(b), a.max(b)]).copied().unwrap_or(0)
            }));
        }
        built
    }

    /// The segments, by number, that an edge of a triangle is part of.
    pub fn segments_on(&self, triangle: usize, edge: usize) -> &[u32] {
        &self.groups[self.groups_of[triangle][edge] as usize]
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn crossing_segments_are_split() {
        let plan = Triangulation::build(&[[[0, 0], [10, 10]], [[0, 10], [10, 0]]], 1).unwrap();
        assert_eq!(plan.points.len(), 5);
        assert_eq!(plan.triangles.len(), 4);
        let area: f64 = (0..4).map(|t| plan.area(t)).sum();
        assert!((area - 100.0).abs() < 1e-9);
        let (_, regions) = plan.flood(|_| true, |t, e, _| plan.segments_on(t, e).is_empty());
        assert_eq!(regions, 4);
    }

    #[test]
    fn degenerate_plans_are_empty() {
        assert!(Triangulation::build(&[], 1).unwrap().triangles.is_empty());
        assert!(Triangulation::build(&[[[5, 5], [5, 5]]], 1).unwrap().triangles.is_empty());
        assert!(Triangulation::build(&[[[0, 0], [5, 5]], [[3, 3], [9, 9]]], 1).unwrap().triangles.is_empty());
        assert!(Triangulation::build(&[[[0, 0], [i32::MAX, 5]]], 256).is_err());
    }
}
