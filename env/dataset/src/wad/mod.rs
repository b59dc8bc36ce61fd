//! WAD files: the directory, the binary map lumps of Doom and Doom 2, read and written.
//!
//! Everything is bounds-checked. An error names the lump and the byte offset in the file.

mod blocks;
mod error;
mod map;
mod nodes;
mod starts;
pub mod textures;
mod write;

pub use error::WadError;
pub use starts::starts;
pub use textures::Textures;
pub use write::{to_bytes, to_playable};

use crate::doom_map::DoomMap;
use map::MapReader;
use std::path::Path;

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
                let lump = if name.is_empty() { "without a name".into() } else { name };
                return Err(WadError::LumpBounds { lump, index, offset, end, size });
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

fn read_i32(bytes: &[u8], at: usize) -> Option<i32> {
    bytes.get(at..at + 4).map(|b| i32::from_le_bytes([b[0], b[1], b[2], b[3]]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::convert::{ConvertOptions, convert};
    use crate::generate::{Level, generate};
    use proptest::prelude::*;

    fn example() -> (DoomMap, Vec<u8>) {
        let map = generate(Level::Simple, 3).unwrap().map;
        let bytes = to_bytes(&map, "MAP01").unwrap();
        (map, bytes)
    }

    #[test]
    fn a_written_map_reads_as_it_was() {
        let (map, bytes) = example();
        let wad = Wad::parse(bytes).unwrap();
        assert_eq!(wad.maps(), ["MAP01"]);
        assert_eq!(wad.map("map01").unwrap(), DoomMap { name: "MAP01".into(), ..map });
    }

    #[test]
    fn a_playable_map_becomes_the_same_scene() {
        for (level, seed) in [(Level::Simple, 8), (Level::Normal, 9), (Level::Hard, 10), (Level::Insane, 11)] {
            let made = generate(level, seed).unwrap();
            let wad = Wad::parse(to_playable(&made.map, "MAP01").unwrap()).unwrap();
            let mut read = wad.map("MAP01").unwrap();
            read.name.clone_from(&made.map.name);
            let scene = convert(&read, ConvertOptions::default()).unwrap();
            assert_eq!(scene.mesh, made.scene.mesh, "{level}");
            assert_eq!(scene.settings, made.scene.settings, "{level}");
            assert_eq!(scene.report, made.scene.report, "{level}");
        }
    }

    #[test]
    fn errors_say_what_and_where() {
        let (_, bytes) = example();
        let message = |bytes: &[u8]| {
            let wad = Wad::parse(bytes.to_vec());
            wad.and_then(|wad| wad.map("MAP01").map(|_| ())).unwrap_err().to_string()
        };
        assert!(message(b"").contains("not a WAD"));
        assert!(message(b"PK\x03\x04rest").contains("IWAD or PWAD"));
        assert!(message(&bytes[..9]).contains("cut short"));
        assert!(message(&bytes[..bytes.len() - 1]).contains("directory"));
        let directory = read_i32(&bytes, 8).unwrap() as usize;
        let entry = |name: &str| {
            let at = (directory..bytes.len()).step_by(ENTRY).find(|&at| bytes[at + 8..].starts_with(name.as_bytes()));
            let at = at.unwrap();
            (at, read_i32(&bytes, at).unwrap() as usize)
        };
        let (at, lump) = entry("LINEDEFS");
        let mut broken = bytes.clone();
        broken[lump + 14..lump + 16].copy_from_slice(&[0xfe, 0xff]);
        let text = message(&broken);
        assert!(text.contains("LINEDEFS, record 1") && text.contains(&format!("byte {}", lump + 14)), "{text}");
        assert!(text.contains("vertex 65534"), "{text}");
        broken = bytes.clone();
        broken[at + 4] = broken[at + 4].wrapping_sub(1);
        assert!(message(&broken).contains("left over"), "{}", message(&broken));
        broken[at + 4..at + 8].copy_from_slice(&i32::MAX.to_le_bytes());
        assert!(message(&broken).contains("lump LINEDEFS (directory entry 2)"), "{}", message(&broken));
        broken = bytes.clone();
        broken[entry("SECTORS").0 + 8] = b'X';
        assert!(message(&broken).contains("no SECTORS lump"), "{}", message(&broken));
        broken = bytes.clone();
        broken[entry("SECTORS").0 + 8..][..8].copy_from_slice(b"BEHAVIOR");
        assert!(message(&broken).contains("Hexen"));
        let error = Wad::parse(bytes).unwrap().map("MAP07").unwrap_err().to_string();
        assert!(error.contains("MAP07") && error.contains("MAP01"), "{error}");
    }

    fn use_all(bytes: Vec<u8>) {
        if let Ok(wad) = Wad::parse(bytes) {
            for name in wad.maps() {
                // Only that it returns matters here.
                drop(
                    wad.map(name).map(|map| convert(&map, ConvertOptions { force: true, ..ConvertOptions::default() })),
                );
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(200))]

        #[test]
        fn random_bytes_never_panic(body in prop::collection::vec(any::<u8>(), 0..400)) {
            use_all(body.clone());
            use_all([b"IWAD".as_slice(), &body].concat());
            use_all([b"PWAD\x03\0\0\0\x0c\0\0\0".as_slice(), &body].concat());
        }

        #[test]
        fn damaged_maps_never_panic(
            hits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..12),
            cut in prop::option::weighted(0.2, any::<prop::sample::Index>()),
        ) {
            let mut bytes = EXAMPLE.with(Clone::clone);
            for (at, value) in hits {
                let at = at.index(bytes.len());
                bytes[at] = value;
            }
            bytes.truncate(cut.map_or(bytes.len(), |cut| cut.index(bytes.len())));
            use_all(bytes);
        }
    }

    thread_local! {
        static EXAMPLE: Vec<u8> = example().1;
    }
}
