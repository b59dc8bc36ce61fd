//! Which way is up and how long a unit is, where nobody says so.

use super::columns::Columns;
use super::scan::Scan;
use super::{Format, ImportError};
use glam::Vec3;
use nbp_env::scene::{Mesh, RayIndex};
use serde::Serialize;

/// The axis of a file that points up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Up {
    /// `+x`.
    X,
    /// `+y`, as in glTF.
    Y,
    /// `+z`, as in Matterport3D and ScanNet.
    Z,
}

impl Up {
    /// `x`, `y` or `z`.
    pub fn name(self) -> &'static str {
        match self {
            Self::X => "x",
            Self::Y => "y",
            Self::Z => "z",
        }
    }

    fn direction(self) -> Vec3 {
        match self {
            Self::X => Vec3::X,
            Self::Y => Vec3::Y,
            Self::Z => Vec3::Z,
        }
    }

    /// The point of a file with this axis, turned so that `y` is up. Rotations only: nothing is mirrored.
    pub(super) fn turn(self, p: Vec3) -> Vec3 {
        match self {
            Self::X => Vec3::new(p.z, p.x, p.y),
            Self::Y => p,
            Self::Z => Vec3::new(p.x, p.z, -p.y),
        }
    }
}

impl std::str::FromStr for Up {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "x" | "X" => Ok(Self::X),
            "y" | "Y" => Ok(Self::Y),
            "z" | "Z" => Ok(Self::Z),
            _ => Err(format!("{text:?} is no axis: x, y or z")),
        }
    }
}

/// A figure and where it comes from.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Assumed<T> {
    /// The figure.
    pub value: T,
    /// Where it comes from.
    pub source: Source,
    /// How sure: the evidence against that for the next best, infinite where it was given.
    #[serde(skip_serializing_if = "is_infinite")]
    pub margin: f32,
}

#[allow(clippy::trivially_copy_pass_by_ref)] // the signature is serde's
fn is_infinite(margin: &f32) -> bool {
    margin.is_infinite()
}

/// Where a figure comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Source {
    /// The user.
    Given,
    /// The file's format.
    Format,
    /// The mesh.
    Guessed,
}

/// Heights are told apart to this share of the mesh's size.
const BINS: f32 = 400.0;

/// The axis along which the mesh has the most area in few flat levels: a floor and a ceiling lie at one height each, walls
/// at many places.
pub(super) fn up(scan: &Scan, format: Format, given: Option<Up>) -> Assumed<Up> {
    if let Some(value) = given {
        return Assumed { value, source: Source::Given, margin: f32::INFINITY };
    }
    if format == Format::Gltf {
        return Assumed { value: Up::Y, source: Source::Format, margin: f32::INFINITY };
    }
    let mut ranked = [Up::Z, Up::Y, Up::X].map(|up| (levels(scan, up.direction()), up));
    ranked.sort_by(|a, b| b.0.total_cmp(&a.0));
    let margin = (ranked[0].0 / ranked[1].0.max(f64::MIN_POSITIVE)) as f32;
    Assumed { value: ranked[0].1, source: Source::Guessed, margin }
}

/// Sum of the squared areas of the levels across an axis.
fn levels(scan: &Scan, axis: Vec3) -> f64 {
    let [low, high] = scan.bounds();
    let bin = (high - low).max_element() / BINS;
    let mut areas = vec![0.0_f64; BINS as usize + 1];
    for triangle in &scan.triangles {
        let [a, b, c] = triangle.map(|corner| scan.vertices[corner as usize] - low);
        let normal = (b - a).cross(c - a);
        if normal.dot(axis).abs() > 0.95 * normal.length()
            && let Some(area) = areas.get_mut(((a + b + c).dot(axis) / 3.0 / bin) as usize)
        {
            *area += f64::from(normal.length());
        }
    }
    areas.into_iter().map(|area| area * area).sum()
}

/// Rooms of these heights are believed, metres.
const BELIEVED: std::ops::RangeInclusive<f32> = 1.8..=15.0;

/// Heights that a guessed unit has to give, metres.
const USUAL: std::ops::RangeInclusive<f32> = 2.0..=5.0;

/// Metres in a unit other than the metre: centimetre, millimetre, inch, foot, the published AiMDoom meshes.
const UNITS: [f32; 5] = [0.01, 0.001, 0.0254, 0.3048, 5.0];

/// Metres in a unit: one, unless both the rooms and the whole mesh are absurd then. Also the height of the rooms in metres:
/// the median over the plan of the largest free height, or that of the whole mesh where there is no ceiling.
pub(super) fn scale(mesh: &Mesh, up: Up, given: Option<f32>) -> Result<(Assumed<f32>, f32), ImportError> {
    let [low, high] = mesh.bounds();
    let whole = high.y - low.y;
    let rooms = Columns::of(&RayIndex::build(mesh), [low, high], 64).room_height().unwrap_or(whole);
    if let Some(value) = given {
        return Ok((Assumed { value, source: Source::Given, margin: f32::INFINITY }, rooms * value));
    }
    let guessed =
        |value: f32, height: f32| Ok((Assumed { value, source: Source::Guessed, margin: 1.0 }, height * value));
    // In a scan without ceilings, only tables and the like have something above them.
    if let Some(height) = [rooms, whole].into_iter().find(|height| BELIEVED.contains(height)) {
        return guessed(1.0, height);
    }
    match UNITS.into_iter().find(|unit| USUAL.contains(&(rooms * unit))) {
        Some(unit) => guessed(unit, rooms),
        None => Err(ImportError::Scale { height: rooms, size: (high - low).to_array(), up: up.name() }),
    }
}
