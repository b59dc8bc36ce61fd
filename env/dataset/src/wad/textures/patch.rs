//! Patches: pictures in columns of posts, with holes.

use super::{Lump, MAX_SIDE, TextureError};

/// Ends a column.
const END: u8 = 255;

/// Calls `put` with column, row and palette index for every texel of a patch, while they are within `budget`, which they
/// use up: columns may share their bytes, so small lumps can hold large patches.
pub(super) fn draw(
    lump: &Lump<'_>,
    budget: &mut usize,
    mut put: impl FnMut(usize, usize, u8),
) -> Result<(), TextureError> {
    let [width, height] = [lump.u16(0, "a patch's width")?, lump.u16(2, "a patch's height")?];
    if [width, height].iter().any(|side| !(1..=MAX_SIDE).contains(side)) {
        let problem =
            format!("a patch of {width} x {height} texels: both must be 1 to {MAX_SIDE}, in Doom's picture format");
        return Err(lump.fail(0, problem));
    }
    for column in 0..usize::from(width) {
        let mut at = lump.u32(8 + 4 * column, "a column's offset")? as usize;
        let mut top: Option<usize> = None;
        for posts in 0.. {
            if posts > height {
                return Err(lump.fail(at, format!("column {column} has more than {height} posts")));
            }
            let delta = lump.take(at, 1, "a post")?[0];
            if delta == END {
                break;
            }
            let delta = usize::from(delta);
            // Tall patches: a row that does not lie below the last post's counts from there.
            let row = top.filter(|&top| delta <= top).map_or(delta, |top| top + delta);
            let length = usize::from(lump.take(at + 1, 1, "a post's length")?[0]);
            // A byte of padding lies before and after the texels.
            let texels = lump.take(at + 3, length, "a post's texels")?;
            let Some(rest) = budget.checked_sub(1 + length) else {
                return Err(lump.fail(at, "the texture's patches have more texels than any texture can show".into()));
            };
            *budget = rest;
            texels.iter().zip(row..usize::from(height)).for_each(|(&index, row)| put(column, row, index));
            top = Some(row);
            at += length + 4;
        }
    }
    Ok(())
}
