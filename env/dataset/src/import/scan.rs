//! What a file holds, before anything is assumed about it.

use super::ImportError;
use glam::{Vec2, Vec3};
use nbp_env::scene::polygon::{MAX_CORNERS, triangulate};
use nbp_env::scene::{Appearance, Image, Paint};
use std::collections::HashMap;

/// A larger mesh is not read: its scene would need over 8 GB.
pub(super) const MAX_TRIANGLES: u64 = 40_000_000;

/// A triangle mesh in the units and axes of its file.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Scan {
    /// Positions.
    pub vertices: Vec<Vec3>,
    /// Corner indices, all valid.
    pub triangles: Vec<[u32; 3]>,
    /// One for each triangle, or none at all.
    pub paints: Vec<Paint>,
    /// Images that the paints name.
    pub images: Vec<Image>,
    /// What was left out or replaced, for people.
    pub notes: Vec<String>,
}

/// The colours of a face.
pub(super) enum FacePaint<'a> {
    /// None.
    Bare,
    /// One for each corner.
    Colours(&'a [[u8; 3]]),
    /// An image and one texture coordinate for each corner.
    Image(u32, &'a [Vec2]),
}

impl Scan {
    /// Adds a polygon, convex or not, given by indices of vertices.
    pub(super) fn add_face(&mut self, face: usize, corners: &[u32], paint: &FacePaint<'_>) -> Result<(), ImportError> {
        let count = self.vertices.len();
        if let Some(&vertex) = corners.iter().find(|&&corner| corner as usize >= count) {
            return Err(ImportError::Index { face, vertex, count });
        }
        if corners.len() > MAX_CORNERS {
            let what = format!("face {face} with {} corners", corners.len());
            return Err(ImportError::TooLarge { what, limit: MAX_CORNERS as u64 });
        }
        let mut add = |triangle: [usize; 3]| {
            self.triangles.push(triangle.map(|at| corners[at]));
            match *paint {
                FacePaint::Bare => {}
                FacePaint::Colours(colours) => self.paints.push(Paint::Corners(triangle.map(|at| colours[at]))),
                FacePaint::Image(image, uv) => {
                    self.paints.push(Paint::Image { image, corners: triangle.map(|at| uv[at]) });
                }
            }
        };
        if corners.len() == 3 {
            add([0, 1, 2]);
        } else {
            let positions: Vec<Vec3> = corners.iter().map(|&corner| self.vertices[corner as usize]).collect();
            triangulate(&positions).into_iter().for_each(add);
        }
        self.check_size()
    }

    fn check_size(&self) -> Result<(), ImportError> {
        match self.triangles.len() as u64 {
            0..=MAX_TRIANGLES => Ok(()),
            count => Err(ImportError::TooLarge { what: format!("a mesh of {count} triangles"), limit: MAX_TRIANGLES }),
        }
    }

    /// The colours in the form that a mesh takes.
    pub(super) fn take_appearance(&mut self) -> Option<Appearance> {
        let (images, paints) = (std::mem::take(&mut self.images), std::mem::take(&mut self.paints));
        (!paints.is_empty()).then_some(Appearance { images, paints })
    }

    /// Refuses coordinates that are not finite, joins vertices at the same place and drops triangles without an area.
    pub(super) fn clean(&mut self) -> Result<(), ImportError> {
        self.check_size()?;
        if let Some(vertex) = self.vertices.iter().position(|v| !v.is_finite()) {
            return Err(ImportError::NotFinite { vertex, position: self.vertices[vertex].to_array() });
        }
        let before = self.vertices.len();
        self.weld();
        let welded = before - self.vertices.len();
        if welded > 0 {
            self.notes.push(format!("{welded} of {before} vertices repeat others and were joined"));
        }
        let has_area = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|i| self.vertices[i as usize]);
            (b - a).cross(c - a).length_squared() > 0.0
        };
        let kept: Vec<bool> = self.triangles.iter().map(has_area).collect();
        let dropped = kept.iter().filter(|&&keep| !keep).count();
        if dropped == kept.len() {
            return Err(ImportError::Empty { vertices: before });
        }
        if dropped > 0 {
            let first = kept.iter().position(|&keep| !keep).unwrap_or(0);
            self.notes.push(format!("{dropped} triangles without an area were left out, the first is number {first}"));
            retain(&mut self.triangles, &kept);
            retain(&mut self.paints, &kept);
        }
        Ok(())
    }

    fn weld(&mut self) {
        let mut numbers: HashMap<[u32; 3], u32> = HashMap::with_capacity(self.vertices.len());
        let mut kept = Vec::with_capacity(self.vertices.len());
        let new: Vec<u32> = (self.vertices.iter())
            .map(|&vertex| {
                // Adding zero turns -0 into 0.
                let key = (vertex + 0.0).to_array().map(f32::to_bits);
                *numbers.entry(key).or_insert_with(|| {
                    kept.push(vertex + 0.0);
                    kept.len() as u32 - 1
                })
            })
            .collect();
        self.vertices = kept;
        self.triangles.iter_mut().flatten().for_each(|corner| *corner = new[*corner as usize]);
    }

    /// Smallest and largest coordinates.
    pub(super) fn bounds(&self) -> [Vec3; 2] {
        let corners = self.triangles.iter().flatten().map(|&corner| self.vertices[corner as usize]);
        corners.fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)])
    }
}

fn retain<T>(items: &mut Vec<T>, kept: &[bool]) {
    let mut kept = kept.iter();
    items.retain(|_| *kept.next().unwrap_or(&false));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faces_and_meshes_have_a_limit() {
        let mut scan = Scan { vertices: vec![Vec3::ZERO, Vec3::X, Vec3::Y], ..Scan::default() };
        let corners: Vec<u32> = (0..3).cycle().take(MAX_CORNERS + 1).collect();
        let refused = scan.add_face(7, &corners, &FacePaint::Bare).unwrap_err().to_string();
        assert!(refused.contains("face 7 with 4097 corners"), "{refused}");
        scan.triangles = vec![[0; 3]; MAX_TRIANGLES as usize + 1];
        assert!(matches!(scan.clean(), Err(ImportError::TooLarge { limit: MAX_TRIANGLES, .. })));
    }
}
