//! Why WADs are refused: the lump, the offset, what to do.

use std::path::PathBuf;

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
    /// A map that the format cannot hold.
    #[error("map {map}, lump {lump}: {problem}")]
    TooLargeForWad {
        /// Map.
        map: String,
        /// Lump.
        lump: &'static str,
        /// In words.
        problem: String,
    },
    /// A map that only newer engines can run.
    #[error(
        "map {map} gets no nodes: {problem}; an engine that builds its own nodes runs it all the same (ZDoom and its kin)"
    )]
    Nodes {
        /// Map.
        map: String,
        /// In words.
        problem: String,
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
