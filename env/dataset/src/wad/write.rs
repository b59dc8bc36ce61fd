//! A map as a WAD file: for map editors, and with the lumps that the game needs to run it.

use super::{NO_SIDE, WadError, blocks, nodes};
use crate::doom_map::{DoomMap, LineDef, Sector, SideDef, Thing};

/// A PWAD with one map of the given name, for map editors and engines that build their own nodes: the lumps that are
/// computed from the others are empty.
///
/// # Errors
/// When a number of the map does not fit into its 16 bits.
pub fn to_bytes(map: &DoomMap, name: &str) -> Result<Vec<u8>, WadError> {
    Ok(assemble(name, &lumps(map, name)?))
}

/// The same with nodes, block map and reject table, as the original game and every engine since need them. Cuts of the
/// tree add vertices after the map's own.
///
/// # Errors
/// When a number of the map does not fit into its 16 bits, or what is computed passes the original game's limits:
/// [`WadError::Nodes`], and [`to_bytes`] still works.
pub fn to_playable(map: &DoomMap, name: &str) -> Result<Vec<u8>, WadError> {
    let mut lumps = lumps(map, name)?;
    let fail = |problem| WadError::Nodes { map: name.into(), problem };
    let tree = nodes::build(map).map_err(fail)?;
    for (lump, bytes) in &mut lumps {
        match *lump {
            "VERTEXES" => tree.added.iter().for_each(|at| bytes.extend(at.map(|c| (c as i16).to_le_bytes()).concat())),
            "SEGS" => bytes.clone_from(&tree.segs),
            "SSECTORS" => bytes.clone_from(&tree.subsectors),
            "NODES" => bytes.clone_from(&tree.nodes),
            "REJECT" => *bytes = blocks::reject(map).map_err(fail)?,
            "BLOCKMAP" => *bytes = blocks::blockmap(map).map_err(fail)?,
            _ => {}
        }
    }
    Ok(assemble(name, &lumps))
}

/// All lumps of a map in the order on which the game relies, the computed ones empty.
fn lumps(map: &DoomMap, name: &str) -> Result<Vec<(&'static str, Vec<u8>)>, WadError> {
    let lump = |lump: &'static str, records: Result<Vec<Vec<u8>>, String>| match records {
        Ok(records) => Ok((lump, records.concat())),
        Err(problem) => Err(WadError::TooLargeForWad { map: name.into(), lump, problem }),
    };
    let thing = |t: &Thing| Ok([i16s(&[t.x, t.y])?, u16s(&[t.angle, t.kind, t.flags])].concat());
    let side = |side: Option<u32>| side.map_or(Ok(NO_SIDE), index);
    let line = |l: &LineDef| {
        Ok(u16s(&[index(l.from)?, index(l.to)?, l.flags, l.special, l.tag, side(l.front)?, side(l.back)?]))
    };
    let sidedef = |s: &SideDef| {
        let offset: Vec<u8> = s.offset.iter().flat_map(|o| o.to_le_bytes()).collect();
        let names = [s.upper, s.lower, s.middle].map(|name| *name.bytes()).concat();
        Ok([offset, names, u16s(&[index(s.sector)?])].concat())
    };
    let sector = |s: &Sector| {
        let flats = [s.floor_flat, s.ceiling_flat].map(|name| *name.bytes()).concat();
        Ok([i16s(&[s.floor, s.ceiling])?, flats, u16s(&[s.light, s.special, s.tag])].concat())
    };
    Ok(vec![
        lump("THINGS", map.things.iter().map(thing).collect())?,
        lump("LINEDEFS", map.linedefs.iter().map(line).collect())?,
        lump("SIDEDEFS", map.sidedefs.iter().map(sidedef).collect())?,
        lump("VERTEXES", map.vertices.iter().map(|v| i16s(&[v.x, v.y])).collect())?,
        ("SEGS", Vec::new()),
        ("SSECTORS", Vec::new()),
        ("NODES", Vec::new()),
        lump("SECTORS", map.sectors.iter().map(sector).collect())?,
        ("REJECT", Vec::new()),
        ("BLOCKMAP", Vec::new()),
    ])
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
