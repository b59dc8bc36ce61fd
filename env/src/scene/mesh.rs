//! A triangle mesh that was checked once and never changes.

use super::appearance::{Appearance, Paint};
use glam::Vec3;
use std::sync::Arc;

/// Triangles in metres, `y` up, either winding. Every coordinate is finite and every index valid.
#[derive(Clone, Debug, PartialEq)]
pub struct Mesh {
    vertices: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    appearance: Option<Arc<Appearance>>,
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
    /// There must be one paint for each triangle.
    #[error("{paints} paints for {triangles} triangles")]
    Paints {
        /// Paints given.
        paints: usize,
        /// Triangles given.
        triangles: usize,
    },
    /// A paint names an image that does not exist, or texture coordinates that are not finite.
    #[error("the paint of triangle {triangle} is {paint:?}: it needs finite coordinates and one of {images} images")]
    Paint {
        /// Zero-based.
        triangle: usize,
        /// As given.
        paint: Paint,
        /// Number of images.
        images: usize,
    },
}

impl Mesh {
    /// Checks and keeps the triangles that have an area.
    ///
    /// # Errors
    /// On coordinates that are not finite, indices out of range, and when no triangle is left.
    pub fn new(vertices: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Result<Self, MeshError> {
        Self::build(vertices, triangles, None)
    }

    /// The same with colours: one paint for each triangle.
    ///
    /// # Errors
    /// As [`Mesh::new`], and on paints that do not fit.
    pub fn painted(vertices: Vec<Vec3>, triangles: Vec<[u32; 3]>, appearance: Appearance) -> Result<Self, MeshError> {
        Self::build(vertices, triangles, Some(appearance))
    }

    fn build(
        vertices: Vec<Vec3>,
        mut triangles: Vec<[u32; 3]>,
        mut appearance: Option<Appearance>,
    ) -> Result<Self, MeshError> {
        if let Some(index) = vertices.iter().position(|v| !v.is_finite()) {
            return Err(MeshError::NonFinite { index, position: vertices[index].to_array() });
        }
        for (triangle, corners) in triangles.iter().enumerate() {
            if let Some(&vertex) = corners.iter().find(|&&c| c as usize >= vertices.len()) {
                return Err(MeshError::Index { triangle, vertex, count: vertices.len() });
            }
        }
        let has_area = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|i| vertices[i as usize]);
            (b - a).cross(c - a).length_squared() > 0.0
        };
        if let Some(appearance) = &mut appearance {
            appearance.check(triangles.len())?;
            let mut kept = triangles.iter().map(has_area);
            appearance.paints.retain(|_| kept.next().unwrap_or(false));
        }
        triangles.retain(has_area);
        if triangles.is_empty() {
            return Err(MeshError::Empty);
        }
        Ok(Self { vertices, triangles, appearance: appearance.map(Arc::new) })
    }

    /// Positions, metres.
    pub fn vertices(&self) -> &[Vec3] {
        &self.vertices
    }

    /// Corner indices.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// The same geometry without its colours.
    #[must_use]
    pub fn bare(self) -> Self {
        Self { appearance: None, ..self }
    }

    /// Colours, one paint for each triangle; `None` for a mesh of bare geometry.
    pub fn appearance(&self) -> Option<&Appearance> {
        self.appearance.as_deref()
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

#[cfg(test)]
mod tests {
    use super::super::appearance::Image;
    use super::*;
    use glam::Vec2;

    #[test]
    fn paints_follow_the_triangles_that_are_kept() {
        let vertices = vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z];
        let triangles = vec![[0, 0, 1], [0, 1, 2], [1, 2, 3]];
        let paint = |grey: u8| Paint::Corners([[grey; 3]; 3]);
        let appearance = Appearance { images: Vec::new(), paints: vec![paint(0), paint(1), paint(2)] };
        let mesh = Mesh::painted(vertices.clone(), triangles.clone(), appearance.clone()).unwrap();
        assert_eq!(mesh.appearance().unwrap().paints, [paint(1), paint(2)]);
        assert!(matches!(
            Mesh::painted(vertices.clone(), triangles[1..].to_vec(), appearance.clone()),
            Err(MeshError::Paints { paints: 3, triangles: 2 })
        ));
        let corners = [Vec2::ZERO; 3];
        let image = Image { width: 1, height: 1, pixels: vec![[9; 3]] };
        for (image_number, valid) in [(0, true), (1, false)] {
            let mut appearance = appearance.clone();
            appearance.images = vec![image.clone()];
            appearance.paints[2] = Paint::Image { image: image_number, corners };
            let painted = Mesh::painted(vertices.clone(), triangles.clone(), appearance);
            assert_eq!(painted.is_ok(), valid);
        }
    }
}
