//! A user's own scan becomes scenes: OBJ, PLY, glTF and GLB files, one scene for each storey.
//!
//! `bytes → parse → Scan → align (up, unit) → Mesh → storeys → cut → place → Imported → write_mesh`. What a file does not
//! say is guessed, and [`Assumptions`] says what.

mod align;
mod columns;
mod cut;
mod error;
mod gltf;
mod obj;
mod place;
mod ply;
mod scan;
mod storeys;
#[cfg(test)]
mod tests;

pub use align::{Assumed, Source, Up};
pub use error::ImportError;
pub use scan::Scan;

use glam::Vec3;
use nbp_env::scene::{Mesh, RayIndex, Settings};
use serde::Serialize;
use std::cell::Cell;
use std::path::Path;
use std::{fmt, fs, io};

/// A larger file is not read, and no more of all files beside it, bytes.
const MAX_BYTES: u64 = 4 << 30;

/// A larger building is not read, metres.
const MAX_EXTENT: f32 = 1000.0;

/// A format of meshes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Format {
    /// Wavefront OBJ, with its MTL file and images where it lies in a folder.
    Obj,
    /// Polygon file format, text or binary.
    Ply,
    /// glTF 2.0: `.gltf`, or `.glb` with everything inside.
    Gltf,
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Obj => "OBJ",
            Self::Ply => "PLY",
            Self::Gltf => "glTF",
        })
    }
}

impl Format {
    /// The format that a file's name says.
    pub fn of(path: &Path) -> Option<Self> {
        match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "obj" => Some(Self::Obj),
            "ply" => Some(Self::Ply),
            "gltf" | "glb" => Some(Self::Gltf),
            _ => None,
        }
    }
}

/// Fetches a file that lies beside the scan, by the name written in it; else says why not.
type Beside<'a> = dyn Fn(&str) -> Result<Vec<u8>, String> + 'a;

/// The mesh in the bytes of a file, in the file's units and axes. Reads no other file, so textures beside it are missing.
///
/// # Errors
/// On bytes that do not follow the format, or hold no triangle with an area.
pub fn parse(bytes: &[u8], format: Format) -> Result<Scan, ImportError> {
    read(bytes, format, None)
}

/// The mesh in a file and the files that it names.
///
/// # Errors
/// As [`parse`], and when a file cannot be read.
pub fn parse_file(path: &Path) -> Result<(Scan, Format), ImportError> {
    let Some(format) = Format::of(path) else {
        return Err(ImportError::Unsupported {
            what: "its name ends in none of .obj, .ply, .gltf and .glb".into(),
            advice: "export the scan as one of these",
        });
    };
    let missing = |e: io::Error| ImportError::Missing { name: path.display().to_string(), reason: e.to_string() };
    let length = fs::metadata(path).map_err(missing)?.len();
    if length > MAX_BYTES {
        return Err(ImportError::TooLarge { what: format!("a file of {length} bytes"), limit: MAX_BYTES });
    }
    let bytes = read_file(path, MAX_BYTES).map_err(missing)?;
    Ok((read(&bytes, format, Some(path))?, format))
}

/// A regular file, because reading a device or a pipe may never end.
fn read_file(path: &Path, most: u64) -> io::Result<Vec<u8>> {
    let file = fs::metadata(path)?;
    if !file.is_file() {
        return Err(io::Error::other("it is no regular file"));
    }
    if file.len() > most {
        return Err(io::Error::other(format!("its {} bytes are more than the {most} that are read", file.len())));
    }
    fs::read(path)
}

fn read(bytes: &[u8], format: Format, path: Option<&Path>) -> Result<Scan, ImportError> {
    let spare = Cell::new(MAX_BYTES);
    let beside = |name: &str| {
        let folder = path.ok_or("it is not looked for")?.parent().unwrap_or(Path::new("."));
        let bytes = read_file(&folder.join(name), spare.get()).map_err(|e| e.to_string())?;
        spare.set(spare.get().saturating_sub(bytes.len() as u64));
        Ok(bytes)
    };
    let mut scan = match format {
        Format::Obj => obj::read(bytes, path)?,
        Format::Ply => ply::read(bytes, &beside)?,
        Format::Gltf => gltf::read(bytes, &beside)?,
    };
    scan.clean()?;
    Ok(scan)
}

/// What the user says about a scan.
#[derive(Debug, Clone, Default)]
pub struct ImportOptions {
    /// The axis that points up; guessed where it is not given.
    pub up: Option<Up>,
    /// Metres in a unit of the file; guessed where it is not given.
    pub scale: Option<f32>,
    /// Only this storey, counted from 0 at the bottom.
    pub storey: Option<usize>,
}

/// What was assumed about a scan.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Assumptions {
    /// Of the file.
    pub format: Format,
    /// The axis that points up.
    pub up: Assumed<Up>,
    /// Metres in a unit of the file.
    pub scale: Assumed<f32>,
    /// Median height of the rooms at this scale, metres.
    pub room_height: f32,
    /// Heights of the floors above the lowest point of the mesh, metres.
    pub floors: Vec<f32>,
    /// What was left out or replaced.
    pub notes: Vec<String>,
}

/// What became of one storey.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StoreyReport {
    /// Counted from 0 at the bottom.
    pub storey: usize,
    /// Of how many.
    pub storeys: usize,
    /// Floor with room to stand, at the storey's height, square metres.
    pub floor_area: f32,
    /// Metres added to a point of the file, after its turn to `y` up and its scaling, to get to the scene.
    pub offset: [f32; 3],
    /// Faces of the mesh.
    pub triangles: usize,
    /// Connected camera positions.
    pub nodes: usize,
    /// Free camera positions, connected or not.
    pub free: usize,
    /// Whether the mesh has holes, so that inside is where walls stand around.
    pub open: bool,
    /// Whether it has colours.
    pub coloured: bool,
}

/// A scene that was made from a scan.
#[derive(Debug, Clone)]
pub struct Imported {
    /// Of the scene.
    pub name: String,
    /// Metres, `y` up, floor at `y = 0`, the middle of the scan's plan at `x = z = 0`.
    pub mesh: Mesh,
    /// In metres, with start positions.
    pub settings: Settings,
    /// What became of the storey.
    pub report: StoreyReport,
}

/// Makes scenes of a scan: one called `name`, or `name_floor0`, `name_floor1` and so on from below.
///
/// # Errors
/// When no floor is found, a storey has no room for the camera, or the unit cannot be guessed.
pub fn import(
    mut scan: Scan,
    format: Format,
    name: &str,
    options: &ImportOptions,
) -> Result<(Vec<Imported>, Assumptions), ImportError> {
    let up = align::up(&scan, format, options.up);
    scan.vertices.iter_mut().for_each(|v| *v = up.value.turn(*v));
    let (notes, appearance) = (std::mem::take(&mut scan.notes), scan.take_appearance());
    let build = |vertices, triangles| match appearance.clone() {
        Some(appearance) => Mesh::painted(vertices, triangles, appearance),
        None => Mesh::new(vertices, triangles),
    };
    let Scan { vertices, triangles, .. } = scan;
    let unscaled = Mesh::new(vertices.clone(), triangles.clone())?;
    let (scale, room_height) = align::scale(&unscaled, up.value, options.scale)?;
    drop(unscaled);
    let mesh = build(vertices.into_iter().map(|v| v * scale.value).collect(), triangles)?;
    let bounds = mesh.bounds();
    let size = bounds[1] - bounds[0];
    if size.max_element() > MAX_EXTENT || size.is_nan() {
        return Err(ImportError::Extent { size: size.to_array(), scale: scale.value, limit: MAX_EXTENT });
    }
    let found = storeys::find(&RayIndex::build(&mesh), bounds, up.value, scale.value)?;
    let floors: Vec<f32> = found.iter().map(|storey| storey.floor - bounds[0].y).collect();
    if let Some(storey) = options.storey.filter(|&storey| storey >= found.len()) {
        let heights = floors.iter().map(|height| format!("{height:.2} m")).collect::<Vec<_>>().join(", ");
        return Err(ImportError::Storey { storey, count: found.len(), heights });
    }
    let middle = (bounds[0] + bounds[1]) / 2.0;
    let mut scenes = Vec::new();
    for (number, storey) in found.iter().enumerate() {
        if options.storey.is_some_and(|only| only != number) {
            continue;
        }
        let name = if found.len() == 1 { name.into() } else { format!("{name}_floor{number}") };
        let offset = -Vec3::new(middle.x, storey.floor, middle.z);
        let mesh = moved(&cut::to_box(&mesh, storey.bounds)?, offset)?;
        let placed = place::place(&mesh, &name, number)?;
        let report = StoreyReport {
            storey: number,
            storeys: found.len(),
            floor_area: storey.area,
            offset: offset.to_array(),
            triangles: mesh.triangles().len(),
            nodes: placed.nodes,
            free: placed.free,
            open: placed.settings.scene.open,
            coloured: mesh.appearance().is_some(),
        };
        scenes.push(Imported { name, mesh, settings: placed.settings, report });
    }
    Ok((scenes, Assumptions { format, up, scale, room_height, floors, notes }))
}

fn moved(mesh: &Mesh, offset: Vec3) -> Result<Mesh, ImportError> {
    let vertices = mesh.vertices().iter().map(|&v| v + offset).collect();
    Ok(match mesh.appearance() {
        Some(appearance) => Mesh::painted(vertices, mesh.triangles().to_vec(), appearance.clone())?,
        None => Mesh::new(vertices, mesh.triangles().to_vec())?,
    })
}
