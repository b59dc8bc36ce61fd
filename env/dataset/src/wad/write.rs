//! A map as a WAD file, for tests and for map editors. Nodes are left to a node builder.

use super::{NO_SIDE, WadError};
use crate::doom_map::DoomMap;

/// A texture and flats that every Doom 2 IWAD and Freedoom have.
const WALL: &[u8; 8] = b"STONE2\0\0";
const NO_WALL: &[u8; 8] = b"-\0\0\0\0\0\0\0";
const FLOOR: &[u8; 8] = b"FLOOR4_8";
const CEILING: &[u8; 8] = b"CEIL3_5\0";
const SKY: &[u8; 8] = b"F_SKY1\0\0";

/// A PWAD with one map of the given name.
///
/// # Errors
/// When a number of the map does not fit into its 16 bits.
pub fn to_bytes(map: &DoomMap, name: &str) -> Result<Vec<u8>, WadError> {
    let mut lumps: Vec<(&'static str, Vec<u8>)> = Vec::new();
    let mut lump = |lump: &'static str, records: Result<Vec<Vec<u8>>, String>| match records {
        Ok(records) => {
            lumps.push((lump, records.concat()));
            Ok(())
        }
        Err(problem) => Err(WadError::TooLargeForWad { map: name.into(), lump, problem }),
    };
    lump(
        "THINGS",
        map.things.iter().map(|t| Ok([i16s(&[t.x, t.y])?, u16s(&[t.angle, t.kind, t.flags])].concat())).collect(),
    )?;
    let side = |side: Option<u32>| side.map_or(Ok(NO_SIDE), index);
    let line = |l: &crate::doom_map::LineDef| {
        Ok(u16s(&[index(l.from)?, index(l.to)?, l.flags, l.special, l.tag, side(l.front)?, side(l.back)?]))
    };
    lump("LINEDEFS", map.linedefs.iter().map(line).collect())?;
    let mut is_two_sided = vec![false; map.sidedefs.len()];
    for line in map.linedefs.iter().filter(|line| line.front.is_some() && line.back.is_some()) {
        for side in [line.front, line.back].into_iter().flatten() {
            if let Some(mark) = is_two_sided.get_mut(side as usize) {
                *mark = true;
            }
        }
    }
    let sides = map.sidedefs.iter().zip(&is_two_sided).map(|(s, &open)| {
        let middle = if open { NO_WALL } else { WALL };
        Ok([&[0; 4], WALL.as_slice(), WALL, middle, &u16s(&[index(s.sector)?])].concat())
    });
    lump("SIDEDEFS", sides.collect())?;
    lump("VERTEXES", map.vertices.iter().map(|v| i16s(&[v.x, v.y])).collect())?;
    let sectors = map.sectors.iter().map(|s| {
        let ceiling = if s.is_sky { SKY } else { CEILING };
        const LIGHT: u16 = 160;
        Ok([i16s(&[s.floor, s.ceiling])?, FLOOR.to_vec(), ceiling.to_vec(), u16s(&[LIGHT, s.special, s.tag])].concat())
    });
    lump("SECTORS", sectors.collect())?;
    Ok(assemble(name, &lumps))
}

fn assemble(name: &str, lumps: &[(&str, Vec<u8>)]) -> Vec<u8> {
    let mut body = Vec::new();
    let mut directory = entry(12, 0, name);
    for (name, bytes) in lumps {
        directory.extend(entry(12 + body.len(), bytes.len(), name));
        body.extend(bytes);
    }
    let header = [(lumps.len() + 1) as u32, (12 + body.len()) as u32].map(u32::to_le_bytes).concat();
    [b"PWAD".as_slice(), &header, &body, &directory].concat()
}

fn entry(offset: usize, size: usize, name: &str) -> Vec<u8> {
    let mut entry = [offset as u32, size as u32].map(u32::to_le_bytes).concat();
    entry.extend(name.bytes().chain(std::iter::repeat(0)).take(8));
    entry
}

fn i16s(values: &[i32]) -> Result<Vec<u8>, String> {
    let fits = |&v: &i32| i16::try_from(v).map(i16::to_le_bytes).map_err(|_| format!("{v} is no 16-bit number"));
    Ok(values.iter().map(fits).collect::<Result<Vec<_>, _>>()?.concat())
}

fn u16s(values: &[u16]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

fn index(value: u32) -> Result<u16, String> {
    let fits = u16::try_from(value).ok().filter(|&v| v != NO_SIDE);
    fits.ok_or_else(|| format!("number {value} is over the format's 65534"))
}
