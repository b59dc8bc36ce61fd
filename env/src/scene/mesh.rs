//! A triangle mesh that was checked once and never changes.

use glam::Vec3;

/// Triangles in metres, `y` up, either winding. Every coordinate is finite and every index valid.
#[derive(Clone, Debug, PartialEq)]
pub struct Mesh {
    vertices: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
}

/// Why a mesh is refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MeshError {
    /// No triangle with an area.
    #[error("the mesh has no triangle with an area")]
    Empty,
    /// A coordinate is NaN or infinite.
    #[error("vertex {index} is not finite: {position:?}")]
    NonFinite {
        /// Zero-based.
        index: usize,
        /// As read.
        position: [f32; 3],
    },
    /// A triangle names a vertex that does not exist.
    #[error("triangle {triangle} uses vertex {vertex}, but there are only {count}")]
    Index {
        /// Zero-based.
        triangle: usize,
        /// Zero-based.
        vertex: u32,
        /// Number of vertices.
        count: usize,
    },
}

impl Mesh {
    /// Checks and keeps the triangles that have an area.
    ///
    /// # Errors
    /// On coordinates that are not finite, indices out of range, and when no triangle is left.
    pub fn new(vertices: Vec<Vec3>, mut triangles: Vec<[u32; 3]>) -> Result<Self, MeshError> {
        if let Some(index) = vertices.iter().position(|v| !v.is_finite()) {
            return Err(MeshError::NonFinite { index, position: vertices[index].to_array() });
        }
        for (triangle, corners) in triangles.iter().enumerate() {
            if let Some(&vertex) = corners.iter().find(|&&c| c as usize >= vertices.len()) {
                return Err(MeshError::Index { triangle, vertex, count: vertices.len() });
            }
        }
        triangles.retain(|t| {
            let [a, b, c] = t.map(|i| vertices[i as usize]);
            (b - a).cross(c - a).length_squared() > 0.0
        });
        if triangles.is_empty() {
            return Err(MeshError::Empty);
        }
        Ok(Self { vertices, triangles })
    }

    /// Positions, metres.
    pub fn vertices(&self) -> &[Vec3] {
        &self.vertices
    }

    /// Corner indices.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Corners of one triangle.
    pub fn corners(&self, triangle: usize) -> [Vec3; 3] {
        self.triangles[triangle].map(|i| self.vertices[i as usize])
    }

    /// Corners of all triangles, in order.
    pub fn iter_corners(&self) -> impl Iterator<Item = [Vec3; 3]> + '_ {
        (0..self.triangles.len()).map(|t| self.corners(t))
    }

    /// Smallest and largest coordinates over the vertices in use.
    pub fn bounds(&self) -> [Vec3; 2] {
        self.iter_corners().flatten().fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[lo, hi], v| [lo.min(v), hi.max(v)])
    }
}
