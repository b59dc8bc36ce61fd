//! WAD files: the directory, the binary map lumps of Doom and Doom 2, read and written (aimdoom.md, section 2, step 1).
//!
//! Everything is bounds-checked. An error names the lump and the byte offset in the file.

use crate::doom_map::{DoomMap, LineDef, Sector, SideDef, Thing, Vertex};
use std::path::{Path, PathBuf};

/// Largest file that is read.
const MAX_FILE: u64 = 1 << 30;
const HEADER: usize = 12;
const ENTRY: usize = 16;
/// "No side" in a linedef.
const NO_SIDE: u16 = 0xffff;

/// Lumps that may follow a map's marker, in any order.
const MAP_LUMPS: [&str; 11] = [
    "THINGS", "LINEDEFS", "SIDEDEFS", "VERTEXES", "SEGS", "SSECTORS", "NODES", "SECTORS", "REJECT", "BLOCKMAP",
    "BEHAVIOR",
];

/// Why a WAD cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum WadError {
    /// The file cannot be opened or read.
    #[error("cannot read {path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's word.
        source: std::io::Error,
    },
    /// Over 1 GiB.
    #[error("{path} has {bytes} bytes; the largest WAD that is read has 1 GiB")]
    TooLarge {
        /// The file.
        path: PathBuf,
        /// Its size.
        bytes: u64,
    },
    /// Not a WAD at all.
    #[error("not a WAD file: it starts with {found:?} instead of IWAD or PWAD")]
    Magic {
        /// First four bytes, escaped.
        found: String,
    },
    /// Header or directory outside of the file.
    #[error(
        "the WAD's {what} at byte {offset} needs {need} bytes, but the file has {size}: it is cut short or damaged"
    )]
    Directory {
        /// Header or directory.
        what: &'static str,
        /// Where.
        offset: u64,
        /// How many bytes.
        need: u64,
        /// Bytes in the file.
        size: usize,
    },
    /// A lump outside of the file.
    #[error(
        "lump {lump} (directory entry {index}) spans bytes {offset}..{end}, but the file has {size}: it is cut short or damaged"
    )]
    LumpBounds {
        /// Name.
        lump: String,
        /// Number in the directory.
        index: usize,
        /// First byte.
        offset: i64,
        /// One past the last byte.
        end: i64,
        /// Bytes in the file.
        size: usize,
    },
    /// A lump that holds a broken record.
    #[error("map {map}, lump {lump}, record {record} at byte {offset}: {problem}")]
    Record {
        /// Map.
        map: String,
        /// Lump.
        lump: &'static str,
        /// Number of the record.
        record: usize,
        /// Offset in the file.
        offset: usize,
        /// In words.
        problem: String,
    },
    /// A map lacks a lump.
    #[error("map {map} has no {lump} lump after its marker (directory entry {index})")]
    MissingLump {
        /// Map.
        map: String,
        /// Lump.
        lump: &'static str,
        /// Directory entry of the marker.
        index: usize,
    },
    /// Hexen or UDMF.
    #[error(
        "map {map} is in {format} format; only the binary format of Doom and Doom 2 is read: save it as such in a map editor"
    )]
    Format {
        /// Map.
        map: String,
        /// Which.
        format: &'static str,
    },
    /// The map asked for does not exist.
    #[error("there is no map {map}; the WAD has {available}")]
    NoSuchMap {
        /// As asked for.
        map: String,
        /// List of maps.
        available: String,
    },
}

#[derive(Debug, Clone)]
struct Lump {
    name: String,
    offset: usize,
    size: usize,
}

/// A WAD in memory with its directory.
#[derive(Debug, Clone)]
pub struct Wad {
    bytes: Vec<u8>,
    lumps: Vec<Lump>,
}

impl Wad {
    /// Reads a file.
    ///
    /// # Errors
    /// When it cannot be read or its directory is damaged.
    pub fn open(path: &Path) -> Result<Self, WadError> {
        let io = |source| WadError::Io { path: path.into(), source };
        let bytes = std::fs::metadata(path).map_err(io)?.len();
        if bytes > MAX_FILE {
            return Err(WadError::TooLarge { path: path.into(), bytes });
        }
        Self::parse(std::fs::read(path).map_err(io)?)
    }

    /// Reads the directory of a WAD in memory.
    ///
    /// # Errors
    /// When the header, the directory or a lump lies outside of the bytes.
    pub fn parse(bytes: Vec<u8>) -> Result<Self, WadError> {
        let size = bytes.len();
        let magic = bytes.get(..4).unwrap_or(&bytes);
        if magic != b"IWAD" && magic != b"PWAD" {
            return Err(WadError::Magic { found: magic.escape_ascii().to_string() });
        }
        let (Some(count), Some(start)) = (read_i32(&bytes, 4), read_i32(&bytes, 8)) else {
            return Err(WadError::Directory { what: "header", offset: 0, need: HEADER as u64, size });
        };
        let need = u64::from(count.max(0).unsigned_abs()) * ENTRY as u64;
        if count < 0 || start < 0 || u64::from(start.unsigned_abs()) + need > size as u64 {
            let offset = u64::from(start.max(0).unsigned_abs());
            return Err(WadError::Directory { what: "directory", offset, need, size });
        }
        let directory = bytes.get(start as usize..start as usize + need as usize).unwrap_or_default();
        let mut lumps = Vec::with_capacity(count as usize);
        for (index, entry) in directory.chunks_exact(ENTRY).enumerate() {
            let [offset, length] = [0, 4].map(|at| i64::from(read_i32(entry, at).unwrap_or(-1)));
            let raw = entry.get(8..).unwrap_or_default();
            let name: String =
                raw.iter().take_while(|&&b| b != 0).flat_map(|b| b.escape_ascii()).map(char::from).collect();
            let end = offset + length;
            // Markers have no bytes, and writers put any offset there.
            if length < 0 || (length > 0 && (offset < 0 || end > size as i64)) {
                return Err(WadError::LumpBounds { lump: name, index, offset, end, size });
            }
            lumps.push(Lump { name: name.to_ascii_uppercase(), offset: offset.max(0) as usize, size: length as usize });
        }
        Ok(Self { bytes, lumps })
    }

    /// Names of the maps, in the order of the file.
    pub fn maps(&self) -> Vec<&str> {
        self.markers().map(|index| self.lumps[index].name.as_str()).collect()
    }

    fn markers(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.lumps.len()).filter(|&index| {
            let next = |n: usize| self.lumps.get(index + n).map_or("", |lump| lump.name.as_str());
            let starts_map = next(1) == "TEXTMAP" || (MAP_LUMPS.contains(&next(1)) && MAP_LUMPS.contains(&next(2)));
            starts_map && !MAP_LUMPS.contains(&self.lumps[index].name.as_str())
        })
    }

    /// Reads one map; its scene is called like the map.
    ///
    /// # Errors
    /// When there is no such map, it is in another format, or a record of it is broken.
    pub fn map(&self, name: &str) -> Result<DoomMap, WadError> {
        let wanted = name.to_ascii_uppercase();
        let Some(marker) = self.markers().find(|&index| self.lumps[index].name == wanted) else {
            let available = if self.maps().is_empty() { "no maps".into() } else { self.maps().join(", ") };
            return Err(WadError::NoSuchMap { map: name.into(), available });
        };
        let following = self.lumps.get(marker + 1..).unwrap_or_default();
        if following.first().is_some_and(|lump| lump.name == "TEXTMAP") {
            return Err(WadError::Format { map: wanted, format: "UDMF" });
        }
        let members: Vec<&Lump> =
            following.iter().take_while(|lump| MAP_LUMPS.contains(&lump.name.as_str())).take(MAP_LUMPS.len()).collect();
        if members.iter().any(|lump| lump.name == "BEHAVIOR") {
            return Err(WadError::Format { map: wanted, format: "Hexen" });
        }
        let reader = MapReader { bytes: &self.bytes, members, map: wanted, marker };
        reader.read()
    }
}

struct MapReader<'a> {
    bytes: &'a [u8],
    members: Vec<&'a Lump>,
    map: String,
    marker: usize,
}

impl MapReader<'_> {
    fn read(&self) -> Result<DoomMap, WadError> {
        let vertices =
            self.records("VERTEXES", 4, |r| Ok(Vertex { x: i32::from(r.i16(0)), y: i32::from(r.i16(2)) }))?;
        let sectors = self.records("SECTORS", 26, |r| {
            let flat: Vec<u8> = r.0.get(12..20).unwrap_or_default().to_ascii_uppercase();
            Ok(Sector {
                floor: i32::from(r.i16(0)),
                ceiling: i32::from(r.i16(2)),
                is_sky: flat.starts_with(b"F_SKY"),
                special: r.u16(22),
                tag: r.u16(24),
            })
        })?;
        let sidedefs = self.records("SIDEDEFS", 30, |r| {
            let sector = r.u16(28);
            below("sector", sector, sectors.len())?;
            Ok(SideDef { sector: u32::from(sector) })
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
}

fn below(what: &str, index: u16, count: usize) -> Result<(), String> {
    if usize::from(index) < count {
        Ok(())
    } else {
        Err(format!("it names {what} {index}, but there are only {count}"))
    }
}

fn read_i32(bytes: &[u8], at: usize) -> Option<i32> {
    bytes.get(at..at + 4).map(|b| i32::from_le_bytes([b[0], b[1], b[2], b[3]]))
}
