//! PNAMES, TEXTURE1 and TEXTURE2: which patches make up which texture.

use super::{Lump, MAX_SIDE, MAX_TEXELS, TextureError};
use crate::doom_map::Name;

/// One wall texture.
#[derive(Debug, Clone)]
pub(super) struct Texture {
    /// Width and height, texels.
    pub(super) size: [u16; 2],
    /// In drawing order.
    pub(super) patches: Vec<Placed>,
}

/// A texture, or what is wrong with it.
pub(super) type Entry = Result<Texture, TextureError>;

/// A patch on a texture.
#[derive(Debug, Clone)]
pub(super) struct Placed {
    pub(super) patch: Name,
    /// Column and row of its upper left corner.
    pub(super) at: [i16; 2],
}

/// Names of patches by number.
pub(super) fn patch_names(lump: &Lump<'_>) -> Result<Vec<Name>, TextureError> {
    let count = lump.u32(0, "the number of names")? as usize;
    let names = lump.take(4, count.saturating_mul(8), "the list of names")?;
    Ok(names.chunks_exact(8).map(Name::from_record).collect())
}

/// The entries of a TEXTURE1 or TEXTURE2 lump with their names; an entry may be broken by itself.
pub(super) fn textures(lump: &Lump<'_>, patches: &[Name]) -> Result<Vec<(Name, Entry)>, TextureError> {
    let count = lump.u32(0, "the number of textures")? as usize;
    let offsets = lump.take(4, count.saturating_mul(4), "the list of offsets")?;
    let starts = offsets.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize);
    // An entry outside of the lump has not even a name.
    let named = starts.filter_map(|at| Some((at, Name::from_record(lump.take(at, 8, "a name").ok()?))));
    Ok(named.map(|(at, name)| (name, texture(lump, at, patches))).collect())
}

fn texture(lump: &Lump<'_>, at: usize, patches: &[Name]) -> Result<Texture, TextureError> {
    let size = [lump.u16(at + 12, "a width")?, lump.u16(at + 14, "a height")?];
    if size.iter().any(|side| !(1..=MAX_SIDE).contains(side))
        || usize::from(size[0]) * usize::from(size[1]) > MAX_TEXELS
    {
        return Err(
            lump.fail(at, format!("a texture of {} x {} texels; both must be 1 to {MAX_SIDE}", size[0], size[1]))
        );
    }
    let count = usize::from(lump.u16(at + 20, "the number of patches")?);
    let placed =
        lump.take(at + 22, 10 * count, "the list of patches")?.chunks_exact(10).enumerate().map(|(n, bytes)| {
            let word = |at: usize| u16::from_le_bytes([bytes[at], bytes[at + 1]]);
            let patch = patches.get(usize::from(word(4))).copied().ok_or_else(|| {
                let known = patches.len();
                lump.fail(at + 22 + 10 * n, format!("it names patch {}, but PNAMES has {known}", word(4)))
            })?;
            Ok(Placed { patch, at: [word(0) as i16, word(2) as i16] })
        });
    Ok(Texture { size, patches: placed.collect::<Result<_, _>>()? })
}
