//! The pinhole camera: size, field of view and range, shared by every sensor.
//!
//! Image axes: `col` grows to the right, `row` downwards, pixel `(0, 0)` is the top-left one and its centre lies at
//! `(0.5, 0.5)`; the optical axis meets the image at `(width / 2, height / 2)`. Pixels are square. Depth is measured
//! along the optical axis, in metres, not along the ray.

use crate::pose::Pose;
use glam::Vec3;
use serde::{Deserialize, Serialize};

/// Images beyond this side are refused: a larger number is a typing error, and the rasteriser counts tiles in `u16`.
pub const MAX_SIDE: usize = 8192;

/// Size, field of view and range (paper, section 5.1 and supplement: 456×256 pixels, 90°).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Camera {
    /// Pixels from left to right.
    pub width: usize,
    /// Pixels from top to bottom.
    pub height: usize,
    /// Horizontal field of view, degrees.
    pub hfov_degrees: f32,
    /// Surfaces at this depth or beyond are not seen, metres.
    pub range: f32,
}

impl Default for Camera {
    fn default() -> Self {
        Self { width: 456, height: 256, hfov_degrees: 90.0, range: 35.0 }
    }
}

/// Why a camera is refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CameraError {
    /// No pixels, or too many.
    #[error("camera.width × camera.height is {width} × {height}; both must be 1 to {MAX_SIDE} pixels")]
    Size {
        /// As configured.
        width: usize,
        /// As configured.
        height: usize,
    },
    /// Not an angle that a pinhole camera can have.
    #[error("camera.hfov_degrees is {0}; it must be 1 to 170")]
    FieldOfView(f32),
    /// Not a distance.
    #[error("camera.range is {0} m; it must be a positive, finite number of metres above {near} m", near = Camera::NEAR)]
    Range(f32),
}

impl Camera {
    /// Surfaces nearer than this depth are not seen, metres. Far below any clearance an agent keeps.
    pub const NEAR: f32 = 1e-3;

    /// # Errors
    /// When the sizes, the angle or the range make no camera.
    pub fn validate(&self) -> Result<(), CameraError> {
        let sides = 1..=MAX_SIDE;
        if !sides.contains(&self.width) || !sides.contains(&self.height) {
            return Err(CameraError::Size { width: self.width, height: self.height });
        }
        if !(1.0..=170.0).contains(&self.hfov_degrees) {
            return Err(CameraError::FieldOfView(self.hfov_degrees));
        }
        if !(self.range > Self::NEAR && self.range.is_finite()) {
            return Err(CameraError::Range(self.range));
        }
        Ok(())
    }

    /// Focal length in pixels: how many pixels wide one metre is at one metre.
    pub fn focal(&self) -> f32 {
        let half_angle = f64::from(self.hfov_degrees).to_radians() / 2.0;
        (self.width as f64 / 2.0 / half_angle.tan()) as f32
    }

    /// Offsets of a pixel's centre from the optical axis, in pixels: to the right, and down.
    pub(crate) fn offsets(&self, col: usize, row: usize) -> [f32; 2] {
        [col as f32 + 0.5 - self.width as f32 / 2.0, row as f32 + 0.5 - self.height as f32 / 2.0]
    }

    /// The camera at a pose, ready to turn many pixels into rays and points.
    pub fn at(&self, pose: &Pose) -> PosedCamera {
        PosedCamera {
            position: pose.position,
            forward: pose.forward(),
            right: pose.right(),
            focal: self.focal(),
            camera: *self,
        }
    }

    /// `[col, row, depth]` of a point: continuous image coordinates (pixel `(i, j)` covers `i..i + 1`, `j..j + 1`) and
    /// depth along the optical axis. `None` outside the image or not between near plane and range.
    pub fn project(&self, pose: &Pose, point: Vec3) -> Option<[f32; 3]> {
        self.at(pose).project(point)
    }
}

/// A camera at a pose: [`Camera::at`].
#[derive(Clone, Copy, Debug)]
pub struct PosedCamera {
    position: Vec3,
    forward: Vec3,
    right: Vec3,
    focal: f32,
    camera: Camera,
}

impl PosedCamera {
    /// As [`Camera::project`].
    pub fn project(&self, point: Vec3) -> Option<[f32; 3]> {
        let (offset, camera) = (point - self.position, &self.camera);
        let depth = offset.dot(self.forward);
        if !(depth >= Camera::NEAR && depth < camera.range) {
            return None;
        }
        let scale = self.focal / depth;
        let col = camera.width as f32 / 2.0 + offset.dot(self.right) * scale;
        let row = camera.height as f32 / 2.0 - offset.y * scale;
        let inside = (0.0..camera.width as f32).contains(&col) && (0.0..camera.height as f32).contains(&row);
        inside.then_some([col, row, depth])
    }

    /// Direction through the centre of a pixel, in the world. Its length along the optical axis is 1, so `position +
    /// depth · ray` is the surface that the pixel shows.
    pub fn ray(&self, col: usize, row: usize) -> Vec3 {
        let [right, down] = self.camera.offsets(col, row);
        self.forward + (self.right * right - Vec3::Y * down) / self.focal
    }

    /// The surface point, in the world, that a pixel shows at a depth along the optical axis.
    pub fn unproject(&self, col: usize, row: usize, depth: f32) -> Vec3 {
        self.position + depth * self.ray(col, row)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn projection_undoes_unprojection() {
        let cameras = [Camera::default(), Camera { width: 61, height: 40, hfov_degrees: 60.0, range: 20.0 }];
        for camera in cameras {
            camera.validate().unwrap();
            for (k, depth) in [(0.0, 0.01), (0.7, 1.0), (3.0, 5.5), (-2.0, 19.0)] {
                let pose = Pose { position: Vec3::new(3.0, 1.65, -8.0), azimuth: k };
                for (col, row) in [(0, 0), (camera.width - 1, camera.height - 1), (camera.width / 3, 7), (5, 39)] {
                    let point = camera.at(&pose).unproject(col, row, depth);
                    let [x, y, z] = camera.project(&pose, point).unwrap();
                    let slack = 2e-3_f32.max(1e-5 / depth * camera.focal());
                    assert!((x - col as f32 - 0.5).abs() < slack && (y - row as f32 - 0.5).abs() < slack, "{x} {y}");
                    assert!((z - depth).abs() < 1e-5 * depth.max(1.0));
                }
            }
        }
    }

    #[test]
    fn the_picture_is_upright_and_not_mirrored() {
        let camera = Camera::default();
        assert_eq!(camera.focal(), 228.0);
        let pose = Pose { position: Vec3::ZERO, azimuth: 0.0 };
        // Looking along +z with y up, +x is on the left (see `pose`).
        let [col, row, _] = camera.project(&pose, Vec3::new(1.0, 0.5, 4.0)).unwrap();
        assert!(col < 228.0 && row < 128.0, "{col} {row}");
        assert_eq!(camera.project(&pose, Vec3::new(0.0, 0.0, -4.0)), None);
        assert_eq!(camera.project(&pose, Vec3::new(0.0, 0.0, 35.5)), None);
    }

    #[test]
    fn nonsense_is_refused_by_name() {
        let good = Camera::default();
        assert_eq!(good.validate(), Ok(()));
        let bad = Camera { width: 0, ..good }.validate().unwrap_err();
        assert!(bad.to_string().contains("camera.width"), "{bad}");
        assert!(matches!(Camera { hfov_degrees: 180.0, ..good }.validate(), Err(CameraError::FieldOfView(_))));
        assert!(matches!(Camera { range: f32::NAN, ..good }.validate(), Err(CameraError::Range(_))));
        assert!(serde_json::from_str::<Camera>(r#"{"widht": 3}"#).is_err());
        assert_eq!(serde_json::from_str::<Camera>("{}").unwrap(), good);
    }
}
