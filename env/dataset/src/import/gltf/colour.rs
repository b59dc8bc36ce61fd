//! Base colours of glTF materials: factors, colours at vertices, textures.
//!
//! Factors and vertex colours are linear, images are sRGB. Where an image cannot be had (Basis and WebP are not read), the
//! factor stands in for it.

use super::accessor::{Buffers, fetch};
use crate::import::scan::Scan;
use crate::import::{Beside, ImportError};
use glam::{Vec2, Vec3};
use gltf::json::Root;
use gltf::json::extensions::texture::TextureTransform;
use gltf::json::mesh::{Primitive, Semantic};
use gltf::json::validation::Checked;
use nbp_env::scene::{Image, Paint};
use std::collections::{BTreeMap, BTreeSet};

/// White is what a mesh without any colour has; it is then left bare.
const WHITE: [u8; 3] = [255; 3];

/// The colours of a primitive.
pub(super) struct PrimitivePaint {
    /// Index into the images and coordinates of the vertices, `v` upwards.
    pub(super) image: Option<u32>,
    pub(super) uv: Option<Vec<Vec2>>,
    /// Of the vertices; empty where all are [`Self::flat`].
    pub(super) colours: Vec<[u8; 3]>,
    pub(super) flat: [u8; 3],
}

/// Images that were used, each with the factor on it.
pub(super) struct Palette<'a> {
    root: &'a Root,
    buffers: &'a Buffers<'a>,
    beside: &'a Beside<'a>,
    images: Vec<Image>,
    /// Of all images.
    pixels: usize,
    /// By image and the bits of the factor; `None` for one that cannot be had.
    known: BTreeMap<(usize, [u32; 3]), Option<u32>>,
    notes: BTreeSet<String>,
}

impl<'a> Palette<'a> {
    pub(super) fn new(root: &'a Root, buffers: &'a Buffers<'a>, beside: &'a Beside<'a>) -> Self {
        let (known, notes) = (BTreeMap::new(), BTreeSet::new());
        Self { root, buffers, beside, images: Vec::new(), pixels: 0, known, notes }
    }

    /// The colours of a primitive with `count` vertices.
    pub(super) fn paint(&mut self, primitive: &Primitive, count: usize) -> Result<PrimitivePaint, ImportError> {
        let root = self.root;
        let material = primitive.material.and_then(|number| root.materials.get(number.value()));
        let [r, g, b, _] = material.map_or([1.0; 4], |m| m.pbr_metallic_roughness.base_color_factor.0);
        let factor = Vec3::new(r, g, b);
        let mut paint = PrimitivePaint { image: None, uv: None, colours: Vec::new(), flat: srgb(factor) };
        if let Some(texture) = material.and_then(|m| m.pbr_metallic_roughness.base_color_texture.as_ref()) {
            let transform = texture.extensions.as_ref().and_then(|e| e.texture_transform.as_ref());
            let set = transform.and_then(|t| t.tex_coord).unwrap_or(texture.tex_coord);
            let coordinates = primitive.attributes.get(&Checked::Valid(Semantic::TexCoords(set)));
            if let (Some(image), Some(coordinates)) = (self.image(texture.index.value(), factor), coordinates) {
                let uv = self.buffers.floats::<2>(coordinates.value())?;
                if uv.len() >= count && uv.iter().flatten().all(|c| c.is_finite()) {
                    paint.image = Some(image);
                    paint.uv = Some(uv.into_iter().map(|uv| place(uv.into(), transform)).collect());
                }
            }
        }
        let colours = primitive.attributes.get(&Checked::Valid(Semantic::Colors(0)));
        if let (None, Some(colours)) = (paint.image, colours) {
            let colours = colours.value();
            let linear: Vec<Vec3> = match self.buffers.components(colours) {
                Some(4) => self.buffers.floats::<4>(colours)?.iter().map(|c| Vec3::new(c[0], c[1], c[2])).collect(),
                _ => self.buffers.floats::<3>(colours)?.into_iter().map(Vec3::from).collect(),
            };
            paint.colours = linear.into_iter().map(|c| srgb(c * factor)).collect();
        }
        Ok(paint)
    }

    fn image(&mut self, texture: usize, factor: Vec3) -> Option<u32> {
        let factor = factor.clamp(Vec3::ZERO, Vec3::ONE);
        let source = self.source(texture);
        let source = source.map_err(|reason| self.tell(&format!("texture {texture}"), reason)).ok()?;
        let key = (source, factor.to_array().map(f32::to_bits));
        if let Some(&known) = self.known.get(&key) {
            return known;
        }
        let found = match self.decode(source) {
            Ok(mut image) => {
                if factor != Vec3::ONE {
                    tint(&mut image, factor);
                }
                self.images.push(image);
                Some(self.images.len() as u32 - 1)
            }
            Err(reason) => {
                self.tell(&format!("image {source}"), &reason);
                None
            }
        };
        self.known.insert(key, found);
        found
    }

    fn tell(&mut self, what: &str, reason: &str) {
        self.notes.insert(format!("{what}: {reason}; its base colour stands in for it"));
    }

    /// The number of a texture's image.
    fn source(&self, texture: usize) -> Result<usize, &'static str> {
        let texture = self.root.textures.get(texture).ok_or("there is none of this number")?;
        // The crate's word for "no source".
        if texture.source.value() == u32::MAX as usize {
            return Err("its image is in an extension that is not read (Basis, WebP)");
        }
        Ok(texture.source.value())
    }

    fn decode(&mut self, source: usize) -> Result<Image, String> {
        let image = self.root.images.get(source).ok_or("it does not exist")?;
        let bytes = match (&image.uri, image.buffer_view) {
            (Some(uri), _) => fetch(uri, self.beside).map_err(|e| e.to_string())?,
            (None, Some(view)) => self.buffers.view(view.value()).map_err(|e| e.to_string())?.0.to_vec(),
            (None, None) => return Err("it has no data".into()),
        };
        Image::decode_counted(&bytes, &mut self.pixels).map_err(|e| e.to_string())
    }

    /// Hands over the images and what was said; a mesh that is white all over has no colours.
    pub(super) fn finish(self, scan: &mut Scan) {
        scan.notes.extend(self.notes);
        scan.images = self.images;
        if scan.paints.iter().all(|paint| *paint == Paint::Corners([WHITE; 3])) {
            scan.paints.clear();
        }
    }
}

/// glTF counts `v` downwards from the top.
fn place(uv: Vec2, transform: Option<&TextureTransform>) -> Vec2 {
    let uv = transform.map_or(uv, |t| {
        let scaled = uv * Vec2::from(t.scale.0);
        let (sin, cos) = t.rotation.0.sin_cos();
        Vec2::new(cos * scaled.x + sin * scaled.y, cos * scaled.y - sin * scaled.x) + Vec2::from(t.offset.0)
    });
    Vec2::new(uv.x, 1.0 - uv.y)
}

fn tint(image: &mut Image, factor: Vec3) {
    let table: [[u8; 256]; 3] = factor
        .to_array()
        .map(|factor| std::array::from_fn(|value| srgb(Vec3::splat(linear(value as f32 / 255.0) * factor))[0]));
    for pixel in &mut image.pixels {
        *pixel = [0, 1, 2].map(|channel| table[channel][usize::from(pixel[channel])]);
    }
}

fn srgb(linear: Vec3) -> [u8; 3] {
    linear.to_array().map(|c| {
        let c = c.clamp(0.0, 1.0);
        let encoded = if c <= 0.003_130_8 { 12.92 * c } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 };
        (encoded * 255.0).round() as u8
    })
}

fn linear(encoded: f32) -> f32 {
    if encoded <= 0.040_45 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}
