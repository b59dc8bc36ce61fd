//! Why maps are refused: what, where, and what to do.

use crate::triangulate::TriangulateError;
use nbp_env::scene::MeshError;

/// Why a map does not become a scene.
#[derive(Debug, thiserror::Error)]
pub enum ConvertError {
    /// The plan has no triangulation.
    #[error("map {map}: {source}")]
    Triangulate {
        /// Map.
        map: String,
        /// Where.
        source: TriangulateError,
    },
    /// No sector has a ceiling above its floor.
    #[error(
        "map {map}: no free space among {linedefs} linedefs and {sectors} sectors: every sector is closed or unbounded"
    )]
    NoSpace {
        /// Map.
        map: String,
        /// Number of linedefs.
        linedefs: usize,
        /// Number of sectors.
        sectors: usize,
    },
    /// Sectors that are not closed, or overlap.
    #[error(
        "map {map}: sectors contradict each other over {area:.1} m², {worst:.1} m² of it around ({x:.0}, {y:.0}) in sector \
         {sector}: close the sector in a map editor, or convert with --force, which follows the longer border"
    )]
    Conflict {
        /// Map.
        map: String,
        /// All of it, m².
        area: f64,
        /// The largest region, m².
        worst: f64,
        /// Map units.
        x: f64,
        /// Map units.
        y: f64,
        /// The sector it was given to, or "none".
        sector: String,
    },
    /// Walls in too many pieces.
    #[error(
        "map {map}: its mesh has more than {most} triangles: too many floors of different heights meet at one corner",
        most = super::solid::MAX_FACES
    )]
    TooManyFaces {
        /// Map.
        map: String,
    },
    /// The mesh is not valid.
    #[error("map {map}: {source}")]
    Mesh {
        /// Map.
        map: String,
        /// What is wrong.
        source: MeshError,
    },
    /// No lattice node in the camera plane.
    #[error(
        "map {map}: the camera plane, 1.65 m above the modal floor ({floor} map units), holds only {nodes} connected \
         positions on the 1.5 m lattice; {need} are needed"
    )]
    NoRoom {
        /// Map.
        map: String,
        /// Modal floor, map units.
        floor: i32,
        /// Positions found.
        nodes: usize,
        /// Positions needed.
        need: usize,
    },
}
