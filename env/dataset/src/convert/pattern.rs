//! Drawn tiles that stand in for textures where no WAD gives them: a name always gets the same hue and pattern.

use crate::doom_map::Name;
use nbp_env::scene::Image;

/// Texels along a side of a tile, which are map units.
const SIDE: usize = 64;
pub(super) const TEXELS: usize = SIDE * SIDE;
const HUES: u32 = 24;
const SATURATION: f32 = 0.4;

/// Brightness of joints, and of bricks, boards or panels. Few, so that all tiles of a map share a palette.
const SHADES: [f32; 4] = [0.38, 0.6, 0.68, 0.76];

/// The tile of a wall texture, or of a flat.
pub(super) fn tile(name: Name, is_flat: bool) -> Image {
    let hash = hash(name, is_flat);
    let hue = (hash >> 8) % HUES;
    // Width and height of a stone, and by how much each row is moved.
    let (width, height, shift) = match (is_flat, hash % 3) {
        (false, 0) => (32, 16, 16),
        (false, 1) => (64, 64, 0),
        (false, _) => (16, 64, 0),
        (true, 0) => (32, 32, 0),
        (true, 1) => (64, 16, 32),
        (true, _) => (16, 16, 8),
    };
    let texel = |at: usize| {
        let row = at / SIDE;
        let column = (at % SIDE + row / height * shift) % SIDE;
        let is_joint = row.is_multiple_of(height) || column.is_multiple_of(width);
        let stone = mix(hash ^ (row / height * SIDE + column / width) as u32);
        colour(hue, SHADES[if is_joint { 0 } else { 1 + stone as usize % 3 }])
    };
    Image { width: SIDE, height: SIDE, pixels: (0..TEXELS).map(texel).collect() }
}

/// Of a name, the same on every machine.
pub(super) fn hash(name: Name, is_flat: bool) -> u32 {
    name.bytes().iter().fold(0x811c_9dc5 ^ u32::from(is_flat), |hash, &b| mix(hash ^ u32::from(b)))
}

/// Scatters the bits of a number.
fn mix(n: u32) -> u32 {
    let n = (n ^ (n >> 16)).wrapping_mul(0x7feb_352d);
    let n = (n ^ (n >> 15)).wrapping_mul(0x846c_a68b);
    n ^ (n >> 16)
}

fn colour(hue: u32, value: f32) -> [u8; 3] {
    let sector = hue as f32 * 6.0 / HUES as f32;
    [5.0, 3.0, 1.0].map(|n| {
        let k = (n + sector) % 6.0;
        let level = value * (1.0 - SATURATION * k.min(4.0 - k).clamp(0.0, 1.0));
        (255.0 * level).round() as u8
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn names_differ_and_share_a_palette() {
        let names: Vec<Name> = (0..40).map(|n| Name::of(&format!("WALL{n}"))).collect();
        let tiles: Vec<Image> = names.iter().map(|&name| tile(name, false)).collect();
        let looks: BTreeSet<_> = tiles.iter().map(|tile| &tile.pixels).collect();
        assert!(looks.len() > 20, "{} looks of 40 names", looks.len());
        let colours: BTreeSet<[u8; 3]> = tiles.iter().flat_map(|tile| tile.pixels.iter().copied()).collect();
        assert!(colours.len() <= HUES as usize * SHADES.len());
        assert_eq!(tile(names[3], false), tiles[3]);
        assert_ne!(tile(names[3], true).pixels, tiles[3].pixels);
    }
}
