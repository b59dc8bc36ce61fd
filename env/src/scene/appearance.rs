//! What a mesh looks like: images, and for each triangle what part of which image it shows.
//!
//! Colours are sRGB bytes, as in PNG files; nothing here is lit or converted. A mesh without an appearance costs nothing.

use super::MeshError;
use glam::Vec2;

/// An sRGB image.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Image {
    /// Pixels from left to right.
    pub width: usize,
    /// Pixels from top to bottom.
    pub height: usize,
    /// Row-major from the top-left pixel, `width × height` of them.
    pub pixels: Vec<[u8; 3]>,
}

/// The colours of one triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Paint {
    /// A colour at each corner, interpolated in between.
    Corners([[u8; 3]; 3]),
    /// A part of an image.
    Image {
        /// Index into [`Appearance::images`].
        image: u32,
        /// Texture coordinates of the corners as in OBJ files: `u` to the right, `v` **upwards**, `(0, 0)` at the image's
        /// lower left and `(1, 1)` at its upper right corner. The image repeats beyond.
        corners: [Vec2; 3],
    },
}

/// The colours of a mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Appearance {
    /// Images that the paints name.
    pub images: Vec<Image>,
    /// One for each triangle, in the mesh's order.
    pub paints: Vec<Paint>,
}

impl Appearance {
    /// Whether there is one valid paint for each of `triangles`.
    pub(super) fn check(&self, triangles: usize) -> Result<(), MeshError> {
        if self.paints.len() != triangles {
            return Err(MeshError::Paints { paints: self.paints.len(), triangles });
        }
        let is_valid = |paint: &Paint| match paint {
            Paint::Corners(_) => true,
            Paint::Image { image, corners } => {
                let image = self.images.get(*image as usize);
                image.is_some_and(|i| !i.pixels.is_empty() && i.pixels.len() == i.width * i.height)
                    && corners.iter().all(|c| c.is_finite())
            }
        };
        match self.paints.iter().position(|paint| !is_valid(paint)) {
            Some(triangle) => {
                Err(MeshError::Paint { triangle, paint: self.paints[triangle], images: self.images.len() })
            }
            None => Ok(()),
        }
    }
}
