//! Triangles cut along lines of their textures so that neighbours keep sharing whole edges.
//!
//! A cut edge is remembered: whatever else lies along it gets the same corner, so no ray slips through a T-junction.

use glam::Vec3;
use std::collections::HashMap;

/// A corner of a face: vertex, and texture coordinates in tiles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Corner {
    pub(super) vertex: u32,
    pub(super) uv: [f64; 2],
}

/// Tiles by which a corner may lie off a line and still be taken for on it.
pub(super) const SLACK: f64 = 1e-4;

/// Vertices, and the edges cut so far.
#[derive(Debug, Clone, Default)]
pub(super) struct Cutter {
    pub(super) vertices: Vec<Vec3>,
    /// Edge, the smaller index first: the vertex that cuts it, and where from the first end to the second. Each is cut
    /// once; its halves are edges of their own.
    cuts: HashMap<[u32; 2], (u32, f64)>,
}

impl Cutter {
    pub(super) fn new(vertices: Vec<Vec3>) -> Self {
        Self { vertices, cuts: HashMap::new() }
    }

    /// Cuts a convex face at every multiple of `period` tiles along one axis.
    pub(super) fn cut(&mut self, face: Vec<Corner>, axis: usize, period: f64) -> Vec<Vec<Corner>> {
        let lines = |face: &[Corner]| {
            let [low, high] = range(face, axis);
            let first = ((low + SLACK) / period).floor() + 1.0;
            (first * period < high - SLACK).then_some(first * period)
        };
        let (mut done, mut rest) = (Vec::new(), face);
        while let Some(at) = lines(&rest) {
            let [below, above] = self.split(&rest, axis, at);
            done.push(below);
            rest = above;
        }
        done.push(rest);
        done
    }

    /// The parts of a convex face below and above a line that crosses it.
    fn split(&mut self, face: &[Corner], axis: usize, at: f64) -> [Vec<Corner>; 2] {
        let face = self.with_cuts(face);
        let side = |corner: &Corner| {
            let off = corner.uv[axis] - at;
            if off.abs() < SLACK { 0 } else { off.signum() as i32 }
        };
        let mut parts = [Vec::new(), Vec::new()];
        for (n, corner) in face.iter().enumerate() {
            let next = &face[(n + 1) % face.len()];
            let (here, there) = (side(corner), side(next));
            parts[0].extend((here <= 0).then_some(*corner));
            parts[1].extend((here >= 0).then_some(*corner));
            if here * there < 0 {
                let t = (at - corner.uv[axis]) / (next.uv[axis] - corner.uv[axis]);
                let vertex = self.cut_edge(corner.vertex, next.vertex, t);
                let middle = Corner { vertex, uv: lerp(corner.uv, next.uv, t) };
                parts.iter_mut().for_each(|part| part.push(middle));
            }
        }
        parts
    }

    fn cut_edge(&mut self, a: u32, b: u32, t: f64) -> u32 {
        let vertex = self.vertices.len() as u32;
        let [from, to] = [a, b].map(|v| self.vertices[v as usize].as_dvec3());
        self.vertices.push(from.lerp(to, t).as_vec3());
        let (edge, t) = if a < b { ([a, b], t) } else { ([b, a], 1.0 - t) };
        self.cuts.insert(edge, (vertex, t));
        vertex
    }

    /// The face with all corners that cuts put on its edges.
    fn with_cuts(&self, face: &[Corner]) -> Vec<Corner> {
        let mut whole = Vec::with_capacity(face.len());
        for (n, corner) in face.iter().enumerate() {
            whole.push(*corner);
            self.add_between(corner, &face[(n + 1) % face.len()], &mut whole);
        }
        whole
    }

    fn add_between(&self, a: &Corner, b: &Corner, whole: &mut Vec<Corner>) {
        let (mut from, mut ends) = (*a, vec![*b]);
        while let Some(to) = ends.pop() {
            if let Some(middle) = self.middle(&from, &to) {
                ends.extend([to, middle]);
            } else {
                whole.extend((!ends.is_empty()).then_some(to));
                from = to;
            }
        }
    }

    fn middle(&self, a: &Corner, b: &Corner) -> Option<Corner> {
        let &(vertex, t) = self.cuts.get(&[a.vertex.min(b.vertex), a.vertex.max(b.vertex)])?;
        let t = if a.vertex < b.vertex { t } else { 1.0 - t };
        Some(Corner { vertex, uv: lerp(a.uv, b.uv, t) })
    }

    /// Triangles of a convex face; call it when all faces are cut.
    pub(super) fn triangulate(&mut self, face: &[Corner], triangles: &mut Vec<[Corner; 3]>) {
        let face = self.with_cuts(face);
        if let [a, b, c] = face[..] {
            triangles.push([a, b, c]);
            return;
        }
        let count = face.len();
        let fan = |apex: usize| (1..count - 1).map(move |n| [apex, (apex + n) % count, (apex + n + 1) % count]);
        let height = |triangle: [usize; 3]| {
            let [a, b, c] = triangle.map(|n| self.vertices[face[n].vertex as usize]);
            let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
            (b - a).cross(c - a).length() / longest.max(f32::MIN_POSITIVE)
        };
        let worst = |apex: usize| fan(apex).map(height).fold(f32::INFINITY, f32::min);
        let best = (0..count).map(|apex| (worst(apex), apex)).max_by(|a, b| a.0.total_cmp(&b.0));
        match best {
            Some((height, apex)) if height > FLAT => triangles.extend(fan(apex).map(|t| t.map(|n| face[n]))),
            // Corners along two edges: no fan from a corner does without flat triangles.
            _ => {
                let mean = |of: &dyn Fn(&Corner) -> f64| face.iter().map(of).sum::<f64>() / count as f64;
                let place = |axis: usize| mean(&|c| f64::from(self.vertices[c.vertex as usize][axis])) as f32;
                let position = Vec3::new(place(0), place(1), place(2));
                let middle =
                    Corner { vertex: self.vertices.len() as u32, uv: [mean(&|c| c.uv[0]), mean(&|c| c.uv[1])] };
                self.vertices.push(position);
                triangles.extend((0..count).map(|n| [middle, face[n], face[(n + 1) % count]]));
            }
        }
    }
}

/// Height of a triangle, metres, that counts as none.
const FLAT: f32 = 1e-4;

/// Smallest and largest coordinate of a face along an axis.
pub(super) fn range(face: &[Corner], axis: usize) -> [f64; 2] {
    face.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], c| [low.min(c.uv[axis]), high.max(c.uv[axis])])
}

fn lerp(a: [f64; 2], b: [f64; 2], t: f64) -> [f64; 2] {
    [0, 1].map(|axis| a[axis] + t * (b[axis] - a[axis]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    /// A box whose six sides are two triangles each, textured at different scales.
    #[test]
    fn a_cut_box_stays_closed() {
        let corner = |n: u32| Vec3::new((n & 1) as f32 * 3.0, (n >> 1 & 1) as f32 * 2.0, (n >> 2) as f32 * 5.0);
        let mut cutter = Cutter::new((0..8).map(corner).collect());
        let sides = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        let mut faces = Vec::new();
        for (number, [a, b, c, d]) in sides.into_iter().enumerate() {
            let scale = 0.7 + 0.37 * number as f64;
            for triangle in [[a, b, c], [a, c, d]] {
                let uv = |n: u32| {
                    let p = corner(n).as_dvec3();
                    [scale * (p.x + 0.3 * p.z), scale * (p.y - 0.4 * p.z)]
                };
                let face = triangle.map(|vertex| Corner { vertex, uv: uv(vertex) }).to_vec();
                for strip in cutter.cut(face, 0, 1.0) {
                    faces.extend(cutter.cut(strip, 1, 1.0));
                }
            }
        }
        let mut triangles = Vec::new();
        faces.iter().for_each(|face| cutter.triangulate(face, &mut triangles));
        assert!(triangles.len() > 100);
        let mut edges: BTreeMap<[u32; 2], i32> = BTreeMap::new();
        let mut area = 0.0;
        for t in &triangles {
            for (a, b) in [(0, 1), (1, 2), (2, 0)].map(|(a, b)| (t[a].vertex, t[b].vertex)) {
                *edges.entry([a.min(b), a.max(b)]).or_default() += if a < b { 1 } else { -1 };
            }
            let [a, b, c] = t.map(|c| cutter.vertices[c.vertex as usize]);
            area += (b - a).cross(c - a).length() / 2.0;
            for axis in 0..2 {
                let [low, high] = range(t, axis);
                let cell = ((low + high) / 2.0).floor();
                assert!(low > cell - 1e-3 && high < cell + 1.0 + 1e-3, "{low} to {high}");
            }
        }
        assert!(edges.values().all(|&balance| balance == 0), "every edge is run both ways equally often");
        assert!((area - 2.0 * (6.0 + 10.0 + 15.0)).abs() < 1e-3, "{area}");
    }
}
