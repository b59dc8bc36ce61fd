//! OBJ files, through the reader of `env`.

use super::scan::Scan;
use super::{Format, ImportError};
use nbp_env::scene::{Obj, ObjError};
use std::path::Path;

/// Reads the bytes of a file. Materials and images are looked for beside `path`; without one, a file that names any has no
/// colours.
pub(super) fn read(bytes: &[u8], path: Option<&Path>) -> Result<Scan, ImportError> {
    let here = path.unwrap_or(Path::new("it"));
    let names_materials = || bytes.windows(7).any(|word| word == b"mtllib ");
    let mut notes = Vec::new();
    let obj = match Obj::parse(here, bytes, path.is_some() || !names_materials()) {
        // A scan without its images is still a scan.
        Err(error @ (ObjError::NoImage { .. } | ObjError::Image { .. })) => {
            notes.push(format!("{error}; the scene has no colours"));
            Obj::parse(here, bytes, false)
        }
        other => other,
    };
    let obj = obj.map_err(|error| match error {
        ObjError::Line { path, line, reason } if path == here => {
            ImportError::syntax(Format::Obj, format!("line {line}"), reason)
        }
        other => ImportError::syntax(Format::Obj, "its materials", other),
    })?;
    notes.extend(obj.notes);
    let appearance = obj.appearance.unwrap_or_default();
    Ok(Scan {
        vertices: obj.vertices,
        triangles: obj.triangles,
        paints: appearance.paints,
        images: appearance.images,
        notes,
    })
}
