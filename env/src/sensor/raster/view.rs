//! The camera of one frame, and which boxes it may see.

use super::index::{WIDE, Wide};
use super::{high, low};
use crate::pose::Pose;
use crate::sensor::Camera;
use glam::Vec3;

/// Pixels by which projected bounds are widened: far above what projection in `f32` errs, far below what costs time.
pub(super) const SLACK: f32 = 1.0 / 64.0;

/// Factor by which bounds on 1/depth are raised, for the same reason.
pub(super) const RAISE: f32 = 1.0 + 1e-5;

/// A camera at a pose.
///
/// Camera axes are right, down and forward. Of the rotation only azimuth remains, so a point costs four products.
pub(super) struct View {
    pub(super) position: Vec3,
    pub(super) sin: f32,
    pub(super) cos: f32,
    pub(super) focal: f32,
    /// Half the image, pixels.
    pub(super) centre: [f32; 2],
    /// The image, pixels.
    pub(super) size: [f32; 2],
    /// 1/range: what a pixel holds before anything is drawn.
    pub(super) far: f32,
}

/// Where a box may be seen: pixels `x0..x1`, `y0..y1`, and its largest 1/depth.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Extent {
    pub(super) x0: i32,
    pub(super) x1: i32,
    pub(super) y0: i32,
    pub(super) y1: i32,
    pub(super) nearest: f32,
}

impl View {
    pub(super) fn new(camera: &Camera, pose: &Pose) -> Self {
        let forward = pose.forward();
        let size = [camera.width as f32, camera.height as f32];
        Self {
            position: pose.position,
            sin: forward.x,
            cos: forward.z,
            focal: camera.focal(),
            centre: size.map(|side| side / 2.0),
            size,
            far: 1.0 / camera.range,
        }
    }

    /// The pixels whose centres lie between two image coordinates (from the image's centre), as `first, last + 1`.
    #[inline(always)]
    pub(super) fn pixels(&self, axis: usize, from: f32, to: f32) -> (i32, i32) {
        // Half a pixel each way is the same as rounding down after adding a half; ties fall within the slack.
        let bound = |x: f32| nearest_whole(low(high(x + self.centre[axis], 0.0), self.size[axis])).0;
        (bound(from - SLACK), bound(to + SLACK))
    }

    /// Projects the eight boxes of a node. A box that cannot be seen gets no pixels.
    #[inline(always)]
    pub(super) fn extents(&self, node: &Wide) -> [Extent; WIDE] {
        let (mut rect, mut near) = ([[0; WIDE]; 4], [0.0; WIDE]);
        let [cx, cy] = self.centre;
        for i in 0..WIDE {
            let (dx0, dx1) = (node.low[0][i] - self.position.x, node.high[0][i] - self.position.x);
            let (dz0, dz1) = (node.low[2][i] - self.position.z, node.high[2][i] - self.position.z);
            // Down is -y.
            let y0 = (self.position.y - node.high[1][i]) * self.focal;
            let y1 = (self.position.y - node.low[1][i]) * self.focal;
            let (rx0, rx1, rz0, rz1) = (-self.cos * dx0, -self.cos * dx1, self.sin * dz0, self.sin * dz1);
            let (fx0, fx1, fz0, fz1) = (self.sin * dx0, self.sin * dx1, self.cos * dz0, self.cos * dz1);
            let x = [
                (rx0 + rz0) * self.focal,
                (rx0 + rz1) * self.focal,
                (rx1 + rz0) * self.focal,
                (rx1 + rz1) * self.focal,
            ];
            let z = [fx0 + fz0, fx0 + fz1, fx1 + fz0, fx1 + fz1];
            let fold = |v: [f32; 4], f: fn(f32, f32) -> f32| f(f(v[0], v[1]), f(v[2], v[3]));
            let (z0, z1) = (fold(z, low), fold(z, high));
            // Boxes at or behind the near plane have no bounded projection; side planes through the eye still cull them.
            let behind = z0 < Camera::NEAR;
            let inverse = z.map(|z| 1.0 / z);
            let u = [x[0] * inverse[0], x[1] * inverse[1], x[2] * inverse[2], x[3] * inverse[3]];
            let (i0, i1) = (1.0 / z1, 1.0 / z0);
            let (left, right) = self.pixels(0, fold(u, low), fold(u, high));
            let (top, bottom) = self.pixels(1, low(y0 * i0, y0 * i1), high(y1 * i0, y1 * i1));
            let from_left = [x[0] + cx * z[0], x[1] + cx * z[1], x[2] + cx * z[2], x[3] + cx * z[3]];
            let from_right = [cx * z[0] - x[0], cx * z[1] - x[1], cx * z[2] - x[2], cx * z[3] - x[3]];
            let sideways = low(fold(from_left, high), fold(from_right, high));
            let upright = low(y1 + cy * z1, cy * z1 - y0);
            // A box beyond the range fails `z0 * far < 1`.
            let seen =
                (z1 >= Camera::NEAR) & (sideways >= -SLACK * z1) & (upright >= -SLACK * z1) & (z0 * self.far < 1.0);
            rect[0][i] = if behind { 0 } else { left };
            rect[1][i] = if !seen {
                0
            } else if behind {
                self.size[0] as i32
            } else {
                right
            };
            rect[2][i] = if behind { 0 } else { top };
            rect[3][i] = if behind { self.size[1] as i32 } else { bottom };
            near[i] = if behind { f32::INFINITY } else { i1 * RAISE };
        }
        let mut extent = [Extent::default(); WIDE];
        for i in 0..WIDE {
            extent[i] = Extent { x0: rect[0][i], x1: rect[1][i], y0: rect[2][i], y1: rect[3][i], nearest: near[i] };
        }
        extent
    }
}

/// The whole number nearest to a number from 0 to 2²², ties to even, as integer and float.
///
/// Adding 2²³ leaves no bits for a fraction. Unlike `as i32`, which must handle numbers out of range, this compiles to
/// two vector instructions.
#[inline(always)]
pub(in crate::sensor) fn nearest_whole(x: f32) -> (i32, f32) {
    const SHIFT: f32 = (1 << 23) as f32;
    let shifted = x + SHIFT;
    (shifted.to_bits().wrapping_sub(SHIFT.to_bits()) as i32, shifted - SHIFT)
}
