//! A map as a WAD file, for tests and for map editors. Nodes are left to a node builder.

use super::{NO_SIDE, WadError};
use crate::doom_map::{DoomMap, SideDef};

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
    let side = |s: &SideDef| {
        let offset: Vec<u8> = s.offset.iter().flat_map(|o| o.to_le_bytes()).collect();
        let names = [s.upper, s.lower, s.middle].map(|name| *name.bytes()).concat();
        Ok([offset, names, u16s(&[index(s.sector)?])].concat())
    };
    lump("SIDEDEFS", map.sidedefs.iter().map(side).collect())?;
    lump("VERTEXES", map.vertices.iter().map(|v| i16s(&[v.x, v.y])).collect())?;
    let sectors = map.sectors.iter().map(|s| {
        let flats = [s.floor_flat, s.ceiling_flat].map(|name| *name.bytes()).concat();
        Ok([i16s(&[s.floor, s.ceiling])?, flats, u16s(&[s.light, s.special, s.tag])].concat())
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
