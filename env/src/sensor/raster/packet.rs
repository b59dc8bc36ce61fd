//! Sixteen triangles at a time from the world to the image.
//!
//! Edges are planes through the eye and two corners, after Olano and Greer, "Triangle Scan Conversion using 2D
//! Homogeneous Coordinates" (1997): inside is where three linear functions of the pixel are not negative, also when a
//! corner lies behind the camera, so nothing is ever clipped. The edge from `b` to `c` is `(c - b) × (c + b)`: exactly
//! the opposite of the edge from `c` to `b`, so no pixel falls between two triangles, and precise far from the camera.

use super::index::{LANES, Packet};
use super::spans::{Edge, Inverse, Triangle};
use super::view::{Extent, RAISE, View};
use super::{high, low};
use crate::sensor::Camera;

/// A camera nearer than this to a triangle's plane sees it edge-on, metres.
const EDGE_ON: f64 = 1e-6;

/// One number for each triangle.
type Lanes = [f32; LANES];

/// Sixteen triangles in the image.
pub(super) struct Projected {
    /// `corner[k] = [right · focal, down · focal, forward]`.
    corner: [[Lanes; 3]; 3],
    /// First and last + 1 column, first and last + 1 row.
    rect: [[i32; LANES]; 4],
    /// Largest and smallest depth.
    depth: [Lanes; 2],
}

impl View {
    /// Corners into camera axes, and the pixels that each triangle may cover.
    #[inline(always)]
    pub(super) fn project(&self, packet: &Packet) -> Projected {
        let mut out = Projected { corner: [[[0.0; LANES]; 3]; 3], rect: [[0; LANES]; 4], depth: [[0.0; LANES]; 2] };
        for i in 0..LANES {
            let (mut x, mut y, mut z) = ([0.0; 3], [0.0; 3], [0.0; 3]);
            for k in 0..3 {
                let dx = packet.corner[k][0][i] - self.position.x;
                let dy = self.position.y - packet.corner[k][1][i];
                let dz = packet.corner[k][2][i] - self.position.z;
                x[k] = (self.sin * dz - self.cos * dx) * self.focal;
                y[k] = dy * self.focal;
                z[k] = self.sin * dx + self.cos * dz;
                out.corner[k][0][i] = x[k];
                out.corner[k][1][i] = y[k];
                out.corner[k][2][i] = z[k];
            }
            let (u, v): ([f32; 3], [f32; 3]) =
                ([x[0] / z[0], x[1] / z[1], x[2] / z[2]], [y[0] / z[0], y[1] / z[1], y[2] / z[2]]);
            let least = |v: [f32; 3]| low(low(v[0], v[1]), v[2]);
            let most = |v: [f32; 3]| high(high(v[0], v[1]), v[2]);
            (out.rect[0][i], out.rect[1][i]) = self.pixels(0, least(u), most(u));
            (out.rect[2][i], out.rect[3][i]) = self.pixels(1, least(v), most(v));
            (out.depth[0][i], out.depth[1][i]) = (least(z), most(z));
        }
        out
    }

    /// Where a triangle of the packet may be seen; no pixels if it cannot.
    #[inline(always)]
    pub(super) fn extent(&self, projected: &Projected, lane: usize) -> Extent {
        let [nearest, farthest] = [projected.depth[0][lane], projected.depth[1][lane]];
        if nearest >= Camera::NEAR {
            let [x0, x1, y0, y1] = projected.rect.map(|side| side[lane]);
            return Extent { x0, x1, y0, y1, nearest: RAISE / nearest };
        }
        if farthest < Camera::NEAR {
            return Extent::default();
        }
        // The part beyond the near plane: corners there, and where edges pierce it.
        let [mut u, mut v] = [[f32::INFINITY, f32::NEG_INFINITY]; 2];
        let corner = |k: usize| projected.corner[k % 3].map(|axis| axis[lane]);
        let mut grow = |[x, y, z]: [f32; 3]| {
            u = [low(u[0], x / z), high(u[1], x / z)];
            v = [low(v[0], y / z), high(v[1], y / z)];
        };
        for k in 0..3 {
            let (a, b) = (corner(k), corner(k + 1));
            if a[2] >= Camera::NEAR {
                grow(a);
            }
            if (a[2] < Camera::NEAR) != (b[2] < Camera::NEAR) {
                let t = (Camera::NEAR - a[2]) / (b[2] - a[2]);
                grow([a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), Camera::NEAR]);
            }
        }
        let ((x0, x1), (y0, y1)) = (self.pixels(0, u[0] - 1.0, u[1] + 1.0), self.pixels(1, v[0] - 1.0, v[1] + 1.0));
        Extent { x0, x1, y0, y1, nearest: f32::INFINITY }
    }

    /// Edges and 1/depth of all triangles.
    #[inline(always)]
    pub(super) fn planes(&self, packet: &Packet, projected: &Projected) -> Planes {
        let zero = [0.0; LANES];
        let mut out = Planes { edges: [[zero; 5]; 3], inverse: [zero; 3] };
        let mut scale = zero;
        let [px, py, pz] = [f64::from(self.position.x), f64::from(self.position.y), f64::from(self.position.z)];
        for (i, scale) in scale.iter_mut().enumerate() {
            let (nx, ny, nz) = (packet.normal[0][i], packet.normal[1][i], packet.normal[2][i]);
            // Distance of the eye from the plane, in f64: it may be a small difference of large numbers.
            let side = packet.offset[i] - (f64::from(nx) * px + f64::from(ny) * py + f64::from(nz) * pz);
            *scale = if side.abs() < EDGE_ON { 0.0 } else { (1.0 / side) as f32 };
        }
        for (i, &scale) in scale.iter().enumerate() {
            let (nx, ny, nz) = (packet.normal[0][i], packet.normal[1][i], packet.normal[2][i]);
            out.inverse[0][i] = (self.sin * nz - self.cos * nx) * scale / self.focal;
            out.inverse[1][i] = -ny * scale / self.focal;
            out.inverse[2][i] = (self.sin * nx + self.cos * nz) * scale;
        }
        for k in 0..3 {
            let (from, to) = (&projected.corner[k], &projected.corner[(k + 1) % 3]);
            for i in 0..LANES {
                // Of a triangle in front of the eye and one behind it, all edge functions have opposite signs.
                let turn = if scale[i] > 0.0 { -1.0 } else { 1.0 };
                let (dx, dy, dz) =
                    ((to[0][i] - from[0][i]) * turn, (to[1][i] - from[1][i]) * turn, (to[2][i] - from[2][i]) * turn);
                let (sx, sy, sz) = (to[0][i] + from[0][i], to[1][i] + from[1][i], to[2][i] + from[2][i]);
                let edge = Edge::new(dy * sz - dz * sy, dz * sx - dx * sz, dx * sy - dy * sx);
                out.edges[k][0][i] = edge.b;
                out.edges[k][1][i] = edge.c;
                out.edges[k][2][i] = edge.k;
                out.edges[k][3][i] = edge.from_left;
                out.edges[k][4][i] = edge.from_right;
            }
        }
        out
    }
}

/// Edges and 1/depth of sixteen triangles.
pub(super) struct Planes {
    /// `edges[k] = [b, c, k, from_left, from_right]`.
    edges: [[Lanes; 5]; 3],
    /// `[x, y, at]`; all 0 for a triangle that is seen edge-on.
    inverse: [Lanes; 3],
}

impl Planes {
    /// One of the triangles; `None` if it is seen edge-on.
    #[inline(always)]
    pub(super) fn triangle(&self, lane: usize, extent: Extent) -> Option<Triangle> {
        let edge = |[b, c, k, left, right]: &[Lanes; 5]| Edge {
            b: b[lane],
            c: c[lane],
            k: k[lane],
            from_left: left[lane],
            from_right: right[lane],
        };
        let [x, y, at] = &self.inverse;
        let inverse = Inverse { x: x[lane], y: y[lane], at: at[lane] };
        let edges = [edge(&self.edges[0]), edge(&self.edges[1]), edge(&self.edges[2])];
        let seen = inverse.x != 0.0 || inverse.y != 0.0 || inverse.at != 0.0;
        seen.then_some(Triangle { edges, inverse, extent, near: extent.nearest == f32::INFINITY })
    }
}
