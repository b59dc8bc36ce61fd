//! The records of a map's lumps.

use super::{Lump, NO_SIDE, WadError};
use crate::doom_map::{DoomMap, LineDef, Name, Sector, SideDef, Thing, Vertex};

/// The lumps of one map.
pub(super) struct MapReader<'a> {
    pub(super) bytes: &'a [u8],
    pub(super) members: Vec<&'a Lump>,
    /// Name, for errors.
    pub(super) map: String,
    /// Directory entry of the marker, for errors.
    pub(super) marker: usize,
}

impl MapReader<'_> {
    /// Reads all records and checks that they name what exists.
    pub(super) fn read(&self) -> Result<DoomMap, WadError> {
        let vertices =
            self.records("VERTEXES", 4, |r| Ok(Vertex { x: i32::from(r.i16(0)), y: i32::from(r.i16(2)) }))?;
        let sectors = self.records("SECTORS", 26, |r| {
            let ceiling_flat = r.name(12);
            Ok(Sector {
                floor: i32::from(r.i16(0)),
                ceiling: i32::from(r.i16(2)),
                is_sky: ceiling_flat.bytes().starts_with(b"F_SKY"),
                floor_flat: r.name(4),
                ceiling_flat,
                light: r.u16(20),
                special: r.u16(22),
                tag: r.u16(24),
            })
        })?;
        let sidedefs = self.records("SIDEDEFS", 30, |r| {
            let sector = r.u16(28);
            below("sector", sector, sectors.len())?;
            Ok(SideDef {
                sector: u32::from(sector),
                offset: [r.i16(0), r.i16(2)],
                upper: r.name(4),
                lower: r.name(12),
                middle: r.name(20),
            })
        })?;
        let linedefs = self.records("LINEDEFS", 14, |r| {
            let side = |at| {
                let side = r.u16(at);
                (side != NO_SIDE).then(|| below("sidedef", side, sidedefs.len()).map(|()| u32::from(side))).transpose()
            };
            below("vertex", r.u16(0), vertices.len())?;
            below("vertex", r.u16(2), vertices.len())?;
            Ok(LineDef {
                from: u32::from(r.u16(0)),
                to: u32::from(r.u16(2)),
                flags: r.u16(4),
                special: r.u16(6),
                tag: r.u16(8),
                front: side(10)?,
                back: side(12)?,
            })
        })?;
        let things = self.records("THINGS", 10, |r| {
            let [x, y] = [0, 2].map(|at| i32::from(r.i16(at)));
            Ok(Thing { x, y, angle: r.u16(4), kind: r.u16(6), flags: r.u16(8) })
        })?;
        Ok(DoomMap { name: self.map.clone(), vertices, linedefs, sidedefs, sectors, things })
    }

    fn records<T>(
        &self,
        lump: &'static str,
        size: usize,
        read: impl Fn(Record<'_>) -> Result<T, String>,
    ) -> Result<Vec<T>, WadError> {
        let Some(found) = self.members.iter().find(|member| member.name == lump) else {
            return Err(WadError::MissingLump { map: self.map.clone(), lump, index: self.marker });
        };
        let fail = |record: usize, problem: String| WadError::Record {
            map: self.map.clone(),
            lump,
            record,
            offset: found.offset + record * size,
            problem,
        };
        let bytes = self.bytes.get(found.offset..found.offset + found.size).unwrap_or_default();
        let rest = found.size % size;
        if rest != 0 {
            let problem =
                format!("{rest} bytes are left over; a record has {size}, so the lump is cut short or damaged");
            return Err(fail(found.size / size, problem));
        }
        let records = bytes.chunks_exact(size).enumerate();
        records.map(|(n, chunk)| read(Record(chunk)).map_err(|problem| fail(n, problem))).collect()
    }
}

struct Record<'a>(&'a [u8]);

impl Record<'_> {
    fn u16(&self, at: usize) -> u16 {
        self.0.get(at..at + 2).map_or(0, |b| u16::from_le_bytes([b[0], b[1]]))
    }

    fn i16(&self, at: usize) -> i16 {
        self.u16(at) as i16
    }

    fn name(&self, at: usize) -> Name {
        Name::from_record(self.0.get(at..at + 8).unwrap_or_default())
    }
}

fn below(what: &str, index: u16, count: usize) -> Result<(), String> {
    if usize::from(index) < count {
        Ok(())
    } else {
        Err(format!("it names {what} {index}, but there are only {count}"))
    }
}
