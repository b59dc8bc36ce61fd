//! Wall textures and flats of WAD files: names on a map become images.
//!
//! A wall texture is composed of patches that TEXTURE1 and TEXTURE2 place and PNAMES names; a flat is 64 × 64 raw texels
//! between F_START and F_END; PLAYPAL colours both. What is broken is told where it is asked for, so that one bad texture
//! spoils no map. Later WADs override earlier ones: an IWAD first, then its PWADs.

mod lists;
mod patch;

use super::Wad;
use crate::doom_map::Name;
use lists::{Entry, Placed};
use nbp_env::scene::Image;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Side of a flat, texels and map units.
pub const FLAT_SIDE: usize = 64;

/// Largest side of a texture or patch, texels.
const MAX_SIDE: u16 = 4096;

/// Largest texture, texels.
const MAX_TEXELS: usize = 1 << 22;

/// Why there is no such image.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum TextureError {
    /// Bytes that cannot be.
    #[error("lump {lump} at byte {offset}: {problem}")]
    Lump {
        /// Name of the lump.
        lump: String,
        /// Offset in its file.
        offset: usize,
        /// In words.
        problem: String,
    },
    /// A name that no WAD has.
    #[error("there is no {kind} {name} in the WAD files given for textures")]
    Unknown {
        /// Wall texture, flat or patch.
        kind: &'static str,
        /// As on the map.
        name: Name,
    },
}

/// The textures of some WAD files; images are made on demand.
#[derive(Debug, Clone)]
pub struct Textures {
    wads: Vec<Arc<Wad>>,
    palette: Vec<[u8; 3]>,
    walls: BTreeMap<Name, Entry>,
    flats: BTreeMap<Name, At>,
    lumps: BTreeMap<Name, At>,
}

/// A lump of one of the files.
#[derive(Debug, Clone, Copy)]
struct At {
    wad: usize,
    lump: usize,
}

impl Wad {
    /// Whether the file brings textures, flats or colours of its own.
    pub fn has_textures(&self) -> bool {
        let own = ["PLAYPAL", "PNAMES", "TEXTURE1", "F_START", "FF_START"];
        self.lumps.iter().any(|lump| own.contains(&lump.name.as_str()))
    }
}

impl Textures {
    /// Reads the lists of textures; `None` without a palette, which every game's own WAD has.
    ///
    /// # Errors
    /// When a palette or a list is cut short.
    pub fn read(wads: &[Arc<Wad>]) -> Result<Option<Self>, TextureError> {
        let mut read = Self {
            wads: wads.to_vec(),
            palette: Vec::new(),
            walls: BTreeMap::new(),
            flats: BTreeMap::new(),
            lumps: BTreeMap::new(),
        };
        for wad in 0..wads.len() {
            read.index(wad);
        }
        let (mut palette, mut walls, mut patches) = (Vec::new(), BTreeMap::new(), Vec::new());
        for wad in 0..wads.len() {
            let lump = |name| read.last_in(wad, name).map(|at| read.bytes(at));
            if let Some(found) = lump("PLAYPAL") {
                let colours = found.take(0, 768, "a palette")?;
                palette = colours.chunks_exact(3).map(|rgb| [rgb[0], rgb[1], rgb[2]]).collect();
            }
            if let Some(names) = lump("PNAMES") {
                patches = lists::patch_names(&names)?;
            }
            for list in ["TEXTURE1", "TEXTURE2"].into_iter().filter_map(lump) {
                walls.extend(lists::textures(&list, &patches)?);
            }
        }
        (read.palette, read.walls) = (palette, walls);
        Ok((!read.palette.is_empty()).then_some(read))
    }

    /// Remembers where the lumps of a file are.
    fn index(&mut self, wad: usize) {
        let mut is_flat = false;
        for (lump, found) in self.wads[wad].lumps.iter().enumerate() {
            let (name, at) = (Name::of(&found.name), At { wad, lump });
            match found.name.as_str() {
                "F_START" | "FF_START" => is_flat = true,
                "F_END" | "FF_END" => is_flat = false,
                _ if is_flat && found.size > 0 => drop(self.flats.insert(name, at)),
                _ => drop(self.lumps.insert(name, at)),
            }
        }
    }

    fn last_in(&self, wad: usize, name: &str) -> Option<At> {
        self.wads[wad].lumps.iter().rposition(|lump| lump.name == name).map(|lump| At { wad, lump })
    }

    fn bytes(&self, At { wad, lump }: At) -> Lump<'_> {
        let wad = &self.wads[wad];
        let lump = &wad.lumps[lump];
        let bytes = wad.bytes.get(lump.offset..lump.offset + lump.size).unwrap_or_default();
        Lump { name: &lump.name, offset: lump.offset, bytes }
    }

    /// A wall texture.
    ///
    /// # Errors
    /// When there is none of the name, or its list entry or a patch of it is broken.
    pub fn wall(&self, name: Name) -> Result<Image, TextureError> {
        let unknown = || Err(TextureError::Unknown { kind: "wall texture", name });
        let texture = self.walls.get(&name).map_or_else(unknown, Clone::clone)?;
        let [width, height] = texture.size.map(usize::from);
        let mut image = Image { width, height, pixels: vec![self.colour(0); width * height] };
        let mut budget = 4 * MAX_TEXELS;
        for Placed { patch, at } in texture.patches {
            let Some(&lump) = self.lumps.get(&patch) else {
                return Err(TextureError::Unknown { kind: "patch", name: patch });
            };
            patch::draw(&self.bytes(lump), &mut budget, |column, row, index| {
                let [x, y] = [(column, at[0], width), (row, at[1], height)].map(|(texel, origin, side)| {
                    usize::try_from(texel as i64 + i64::from(origin)).ok().filter(|&texel| texel < side)
                });
                if let (Some(x), Some(y)) = (x, y) {
                    image.pixels[y * width + x] = self.colour(index);
                }
            })?;
        }
        Ok(image)
    }

    /// A flat, for floors and ceilings.
    ///
    /// # Errors
    /// When there is none of the name, or it is too short.
    pub fn flat(&self, name: Name) -> Result<Image, TextureError> {
        let Some(&at) = self.flats.get(&name) else { return Err(TextureError::Unknown { kind: "flat", name }) };
        let lump = self.bytes(at);
        let texels = lump.take(0, FLAT_SIDE * FLAT_SIDE, "a flat")?;
        let pixels = texels.iter().map(|&index| self.colour(index)).collect();
        Ok(Image { width: FLAT_SIDE, height: FLAT_SIDE, pixels })
    }

    fn colour(&self, index: u8) -> [u8; 3] {
        self.palette.get(usize::from(index)).copied().unwrap_or_default()
    }
}

/// A lump's bytes, read with errors that say where.
struct Lump<'a> {
    name: &'a str,
    /// In the file.
    offset: usize,
    bytes: &'a [u8],
}

impl Lump<'_> {
    fn fail(&self, at: usize, problem: String) -> TextureError {
        TextureError::Lump { lump: self.name.into(), offset: self.offset + at, problem }
    }

    fn take(&self, at: usize, count: usize, what: &str) -> Result<&[u8], TextureError> {
        let found = at.checked_add(count).and_then(|end| self.bytes.get(at..end));
        found.ok_or_else(|| {
            let size = self.bytes.len();
            self.fail(at, format!("{what} needs {count} bytes at byte {at} of the lump, which has {size}"))
        })
    }

    fn u16(&self, at: usize, what: &str) -> Result<u16, TextureError> {
        self.take(at, 2, what).map(|b| u16::from_le_bytes([b[0], b[1]]))
    }

    fn u32(&self, at: usize, what: &str) -> Result<u32, TextureError> {
        self.take(at, 4, what).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]))
    }
}

#[cfg(test)]
mod tests;
