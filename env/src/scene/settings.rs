//! `settings.json` of an AiMDoom scene: the published schema, read and written.
//!
//! Lengths are in units of the OBJ file. The published files use one unit for 5 m (the released loader multiplies by 10
//! and one of its units is 0.5 m); ours are in metres and say so in `scene.metres_per_unit`, a key that the released
//! code ignores.

use crate::pose::HEADINGS;
use glam::{Vec2, Vec3};
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// Metres in one OBJ unit where the file does not say: the published maps.
pub const PUBLISHED_METRES_PER_UNIT: f32 = 5.0;

/// Distance of neighbouring camera positions, metres.
pub const LATTICE_STEP: f32 = 1.5;

/// Metres that a unit of length can have: from 0.1 mm to 10 km.
pub(super) const UNITS: RangeInclusive<f32> = 1e-4..=1e4;

/// What such a number should be.
pub(super) const WANT_UNIT: &str = "metres in one unit of the OBJ file, from 0.0001 to 10,000";

/// The whole file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// Box and grid of the reconstruction.
    pub scene: SceneSettings,
    /// Lattice of camera poses.
    pub camera: CameraSettings,
}

/// The `scene` object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneSettings {
    /// Cells of the released surface grid along `x`.
    pub grid_l: u32,
    /// … along `y`.
    pub grid_w: u32,
    /// … along `z`.
    pub grid_h: u32,
    /// Points the released grid keeps in a cell.
    pub cell_capacity: u32,
    /// Resolution inside a cell, `null` or a number.
    #[serde(default)]
    pub cell_resolution: Option<f64>,
    /// Lower corner, OBJ units.
    pub x_min: [f32; 3],
    /// Upper corner, OBJ units.
    pub x_max: [f32; 3],
    /// Metres in an OBJ unit; absent in published files.
    #[serde(default = "published_metres_per_unit")]
    pub metres_per_unit: f32,
    /// The mesh is a scan: single sheets, holes, open ends (see [`Interior::Open`](super::Interior)). Absent in published
    /// files, and where it is false.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub open: bool,
}

/// The `camera` object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CameraSettings {
    /// Lower corner of the lattice, OBJ units; the camera plane lies 1.65 m above its `y`.
    pub x_min: [f32; 3],
    /// Upper corner, OBJ units.
    pub x_max: [f32; 3],
    /// Nodes along `x`.
    pub pose_l: i32,
    /// Nodes along `y`; only one height is used.
    pub pose_w: i32,
    /// Nodes along `z`.
    pub pose_h: i32,
    /// Elevations; only the middle one is used.
    pub pose_n_theta: i32,
    /// Azimuths.
    pub pose_n_azim: i32,
    /// `[l, w, h, theta, azimuth]` for each evaluation trajectory.
    pub start_positions: Vec<[i32; 5]>,
    /// Colour contrast in the released renderer.
    #[serde(default = "one")]
    pub contrast_factor: f32,
}

fn published_metres_per_unit() -> f32 {
    PUBLISHED_METRES_PER_UNIT
}

fn one() -> f32 {
    1.0
}

impl Settings {
    /// Settings in metres for a scene in a box: lattice nodes every 1.5 m from `first` (in `x`, `z`, relative to the
    /// box's lower corner), camera 1.65 m above `floor`, no start positions.
    pub fn for_box(bounds: [Vec3; 2], floor: f32, first: Vec2) -> Self {
        let [low, high] = bounds;
        let origin = Vec3::new(low.x + first.x, floor, low.z + first.y);
        let nodes = |from: f32, to: f32| (((to - from) / LATTICE_STEP).floor() as i32).saturating_add(1).max(1);
        let (pose_l, pose_h) = (nodes(origin.x, high.x), nodes(origin.z, high.z));
        let last = origin + LATTICE_STEP * Vec3::new((pose_l - 1) as f32, 0.0, (pose_h - 1) as f32);
        Self {
            scene: SceneSettings {
                grid_l: cells(high.x - low.x),
                grid_w: cells(high.y - low.y),
                grid_h: cells(high.z - low.z),
                cell_capacity: 2000,
                cell_resolution: None,
                x_min: low.to_array(),
                x_max: high.to_array(),
                metres_per_unit: 1.0,
                open: false,
            },
            camera: CameraSettings {
                x_min: origin.to_array(),
                x_max: last.to_array(),
                pose_l,
                pose_w: 1,
                pose_h,
                pose_n_theta: 5,
                pose_n_azim: HEADINGS as i32,
                start_positions: Vec::new(),
                contrast_factor: 1.0,
            },
        }
    }

    /// The same scene in other units. In [`PUBLISHED_METRES_PER_UNIT`] the released code reads it unchanged.
    #[must_use]
    pub fn in_units(mut self, metres_per_unit: f32) -> Self {
        let scale = self.scene.metres_per_unit / metres_per_unit;
        let corners = [&mut self.scene.x_min, &mut self.scene.x_max, &mut self.camera.x_min, &mut self.camera.x_max];
        corners.into_iter().flatten().for_each(|c| *c *= scale);
        self.scene.metres_per_unit = metres_per_unit;
        self
    }
}

/// Cells of the released surface grid over a length: about one for every 10 m.
fn cells(length: f32) -> u32 {
    (length / 10.0).ceil().max(1.0) as u32
}
