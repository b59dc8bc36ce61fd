//! Why scans are refused: what, where, and what to do.

use super::Format;
use nbp_env::scene::MeshError;

/// Why a file gives no scene.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// The bytes do not follow the format.
    #[error("not readable as {format}: {place}: {reason}")]
    Syntax {
        /// As which it was read.
        format: Format,
        /// Where in the file.
        place: String,
        /// What is wrong there.
        reason: String,
    },
    /// Part of a format that is not read.
    #[error("{what}: {advice}")]
    Unsupported {
        /// What the file asks for.
        what: String,
        /// What to do.
        advice: &'static str,
    },
    /// A file that the scan names is missing.
    #[error("the file {name:?} that it names cannot be read: {reason}")]
    Missing {
        /// As named.
        name: String,
        /// The system's word.
        reason: String,
    },
    /// More than fits.
    #[error("{what} is more than the {limit} that are read: simplify the mesh or cut it into parts")]
    TooLarge {
        /// What there is too much of.
        what: String,
        /// The limit.
        limit: u64,
    },
    /// A face names a vertex that does not exist.
    #[error(
        "face {face} names vertex {vertex}, but there are {count}, counted from 0: the file is cut short or damaged"
    )]
    Index {
        /// Zero-based.
        face: usize,
        /// Zero-based.
        vertex: u32,
        /// Number of vertices.
        count: usize,
    },
    /// A coordinate is NaN or infinite.
    #[error("vertex {vertex} (counted from 0) is at {position:?}: remove it, or the faces that use it, and save again")]
    NotFinite {
        /// Zero-based.
        vertex: usize,
        /// As read.
        position: [f32; 3],
    },
    /// No triangle with an area.
    #[error("it holds {vertices} vertices and no face with an area: a mesh is needed, not a cloud of points")]
    Empty {
        /// Number of vertices.
        vertices: usize,
    },
    /// The rooms have no plausible height in any usual unit.
    #[error(
        "its rooms are {height} units high, and its box is {size:?}: give the metres in a unit with --scale, and --up if {up} \
         is not the axis that points up"
    )]
    Scale {
        /// Median height, units of the file.
        height: f32,
        /// Size of the bounding box, units of the file.
        size: [f32; 3],
        /// The axis taken as up.
        up: &'static str,
    },
    /// Larger than any building.
    #[error(
        "it is {size:?} m large if a unit is {scale} m, and {limit} m are read: give the metres in a unit with --scale, or cut \
         the mesh into parts"
    )]
    Extent {
        /// Of the bounding box, metres, `y` up.
        size: [f32; 3],
        /// Metres in a unit.
        scale: f32,
        /// Metres.
        limit: f32,
    },
    /// Nothing to stand on.
    #[error(
        "it has no floor of {need} m² with 1.8 m of free height that walls stand around (best {best:.1} m² at {height:.2} \
         m); {up} was taken as up and {scale} m as the unit: check --up and --scale, and that the mesh shows a room from inside"
    )]
    NoFloor {
        /// Area asked for, m².
        need: f32,
        /// Largest found, m².
        best: f32,
        /// Its height, metres.
        height: f32,
        /// The axis taken as up.
        up: &'static str,
        /// Metres in a unit.
        scale: f32,
    },
    /// Hardly a lattice position.
    #[error(
        "storey {storey} has only {nodes} connected positions on the 1.5 m lattice, {need} are needed: leave it out with \
         --storey, or check --scale"
    )]
    NoRoom {
        /// Counted from 0.
        storey: usize,
        /// Found.
        nodes: usize,
        /// Needed.
        need: usize,
    },
    /// No such storey.
    #[error("there is no storey {storey}: it has {count}, counted from 0 ({heights})")]
    Storey {
        /// Asked for.
        storey: usize,
        /// Found.
        count: usize,
        /// Their floors, metres.
        heights: String,
    },
    /// What is left is no mesh.
    #[error("{0}")]
    Mesh(#[from] MeshError),
}

impl ImportError {
    /// A [`Self::Syntax`].
    pub(super) fn syntax(format: Format, place: impl Into<String>, reason: impl ToString) -> Self {
        Self::Syntax { format, place: place.into(), reason: reason.to_string() }
    }
}
