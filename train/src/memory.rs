//! The replay memory: every sample ever admitted, on disk, append-only and checksummed.
//!
//! A file is a header and records: length, CRC-32, iteration and the LZ4-compressed sample. A record that was not
//! finished when the process died is overwritten by the next one.

use nbp_env::label::{Sample, ValueLabel};
use nbp_env::window::{Window, WindowSize};
use nbp_env::{EncoderInput, Heading};
use std::fs::{File, OpenOptions};
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

const MAGIC: &[u8; 8] = b"NBPMEM01";

/// Length, checksum, iteration.
const RECORD_HEADER: usize = 12;

/// No sample is larger, packed or not; a longer length is damage.
const MAX_BYTES: usize = 1 << 30;

/// Said of a record whose checksum fits and whose content does not.
const UNPACKED: &str = "it does not unpack";

/// Why the memory cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum MemoryError {
    /// The file system says no.
    #[error("replay memory {path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// Some other file.
    #[error("{0} is not a replay memory of this version: move it away or train in another --run")]
    Foreign(PathBuf),
    /// A record does not check.
    #[error("replay memory {path}: record {record} is damaged ({reason}): restore the file or train in another --run")]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Zero-based.
        record: usize,
        /// What does not fit.
        reason: &'static str,
    },
}

#[derive(Clone, Copy, Debug)]
struct Entry {
    offset: u64,
    length: u32,
    checksum: u32,
    iteration: u32,
}

/// An open memory file. A clone reads what was there when it was made, from any thread.
#[derive(Clone, Debug)]
pub struct Memory {
    path: PathBuf,
    file: Arc<Mutex<File>>,
    entries: Arc<Vec<Entry>>,
    end: u64,
}

impl Memory {
    /// Opens or creates a file. What follows its last whole record is not read, and not touched before something is
    /// appended: if it is damage and not a torn tail, [`Memory::truncate`] will miss records and say so.
    ///
    /// # Errors
    /// When the file cannot be opened or is something else.
    pub fn open(path: &Path) -> Result<Self, MemoryError> {
        let fail = |source| MemoryError::Io { path: path.to_path_buf(), source };
        let mut file =
            OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path).map_err(fail)?;
        let size = file.metadata().map_err(fail)?.len();
        let (mut entries, mut after) = (Vec::new(), MAGIC.len() as u64);
        let memory = |file, entries, end| Self {
            path: path.to_path_buf(),
            file: Arc::new(Mutex::new(file)),
            entries: Arc::new(entries),
            end,
        };
        if size == 0 {
            file.write_all(MAGIC).map_err(fail)?;
            return Ok(memory(file, entries, after));
        }
        let mut magic = [0; MAGIC.len()];
        if file.read_exact(&mut magic).is_err() || magic != *MAGIC {
            return Err(MemoryError::Foreign(path.to_path_buf()));
        }
        let mut header = [0; RECORD_HEADER];
        while after + RECORD_HEADER as u64 <= size {
            file.seek(SeekFrom::Start(after)).map_err(fail)?;
            file.read_exact(&mut header).map_err(fail)?;
            let word = |at: usize| u32::from_le_bytes([header[at], header[at + 1], header[at + 2], header[at + 3]]);
            let entry =
                Entry { offset: after + RECORD_HEADER as u64, length: word(0), checksum: word(4), iteration: word(8) };
            let end = entry.offset + u64::from(entry.length);
            if entry.length as usize > MAX_BYTES || end > size {
                break;
            }
            entries.push(entry);
            after = end;
        }
        Ok(memory(file, entries, after))
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// True without samples.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// Iteration that collected a sample.
    pub fn iteration(&self, index: usize) -> Option<usize> {
        self.entries.get(index).map(|entry| entry.iteration as usize)
    }

    /// Appends samples.
    ///
    /// # Errors
    /// When they cannot be written; what was written before stays.
    pub fn append(&mut self, iteration: usize, samples: &[PackedSample]) -> Result<(), MemoryError> {
        let mut file = lock(&self.file);
        file.set_len(self.end).map_err(|source| self.io(source))?;
        file.seek(SeekFrom::Start(self.end)).map_err(|source| self.io(source))?;
        for PackedSample { bytes, .. } in samples {
            let checksum = crc32fast::hash(bytes);
            let mut record = Vec::with_capacity(RECORD_HEADER + bytes.len());
            for word in [bytes.len() as u32, checksum, iteration as u32] {
                record.extend(word.to_le_bytes());
            }
            record.extend(bytes);
            file.write_all(&record).map_err(|source| self.io(source))?;
            let offset = self.end + RECORD_HEADER as u64;
            let entry = Entry { offset, length: bytes.len() as u32, checksum, iteration: iteration as u32 };
            Arc::make_mut(&mut self.entries).push(entry);
            self.end = offset + bytes.len() as u64;
        }
        Ok(())
    }

    /// Forces what was appended to the disk.
    ///
    /// # Errors
    /// When the disk refuses.
    pub fn sync(&self) -> Result<(), MemoryError> {
        lock(&self.file).sync_data().map_err(|source| self.io(source))
    }

    /// Forgets all but the first `count` samples: what was appended after the checkpoint that a run resumes from.
    ///
    /// # Errors
    /// When there are fewer, or the file cannot be cut.
    pub fn truncate(&mut self, count: usize) -> Result<(), MemoryError> {
        if count > self.entries.len() {
            return Err(self.damaged(self.entries.len(), "the checkpoint knows of more records"));
        }
        Arc::make_mut(&mut self.entries).truncate(count);
        self.end = self.entries.last().map_or(MAGIC.len() as u64, |e| e.offset + u64::from(e.length));
        lock(&self.file).set_len(self.end).map_err(|source| self.io(source))
    }

    /// Reads a sample back.
    ///
    /// # Errors
    /// When it cannot be read or does not check.
    pub fn get(&self, index: usize) -> Result<Sample, MemoryError> {
        unpack(&self.bytes(index)?).ok_or_else(|| self.damaged(index, UNPACKED))
    }

    /// Reads back the bytes that a sample was made of.
    ///
    /// # Errors
    /// When they cannot be read or do not check.
    pub fn bytes(&self, index: usize) -> Result<Vec<u8>, MemoryError> {
        let Some(&entry) = self.entries.get(index) else {
            return Err(self.damaged(index, "there is no such record"));
        };
        let mut packed = vec![0; entry.length as usize];
        {
            let mut file = lock(&self.file);
            file.seek(SeekFrom::Start(entry.offset)).map_err(|source| self.io(source))?;
            file.read_exact(&mut packed).map_err(|source| self.io(source))?;
        }
        if crc32fast::hash(&packed) != entry.checksum {
            return Err(self.damaged(index, "its checksum differs"));
        }
        let is_sane = packed.first_chunk().is_some_and(|size| u32::from_le_bytes(*size) as usize <= MAX_BYTES);
        let bytes = if is_sane { lz4_flex::block::decompress_size_prepended(&packed).ok() } else { None };
        bytes.ok_or_else(|| self.damaged(index, UNPACKED))
    }

    fn io(&self, source: std::io::Error) -> MemoryError {
        MemoryError::Io { path: self.path.clone(), source }
    }

    fn damaged(&self, record: usize, reason: &'static str) -> MemoryError {
        MemoryError::Damaged { path: self.path.clone(), record, reason }
    }
}

fn lock(file: &Mutex<File>) -> MutexGuard<'_, File> {
    file.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A sample as it is stored: a few kilobytes, where the arrays of a 256-pixel window take 700.
#[derive(Clone, Debug, PartialEq)]
pub struct PackedSample {
    /// Step of its trajectory, for the curriculum.
    pub step: usize,
    bytes: Vec<u8>,
}

impl PackedSample {
    /// Packs a sample.
    pub fn new(sample: &Sample) -> Self {
        Self { step: sample.step, bytes: lz4_flex::block::compress_prepend_size(&pack(sample)) }
    }

    /// Packs a sample of another kind, made of these bytes; it has no step.
    pub fn of_bytes(bytes: &[u8]) -> Self {
        Self { step: 0, bytes: lz4_flex::block::compress_prepend_size(bytes) }
    }
}

fn pack(sample: &Sample) -> Vec<u8> {
    let input = &sample.input;
    let mut out = Vec::with_capacity(input.counts.len() * 2 + sample.obstacles.len() + 64);
    for word in [sample.step as u32, input.window.size.pixels as u32, input.channels as u32, sample.labels.len() as u32]
    {
        out.extend(word.to_le_bytes());
    }
    out.extend(input.window.size.metres.to_le_bytes());
    out.extend(input.window.height.to_le_bytes());
    input.window.centre.iter().for_each(|c| out.extend(c.to_le_bytes()));
    for label in &sample.labels {
        for word in [label.heading.index() as u32, label.row as u32, label.col as u32] {
            out.extend(word.to_le_bytes());
        }
        out.extend(label.gain.to_le_bytes());
    }
    // Low and high bytes apart: counts are small, and a plane of zeros packs to nothing.
    out.extend(input.counts.iter().map(|c| c.to_le_bytes()[0]));
    out.extend(input.counts.iter().map(|c| c.to_le_bytes()[1]));
    out.extend(&sample.obstacles);
    out
}

fn unpack(bytes: &[u8]) -> Option<Sample> {
    let mut rest = bytes;
    let mut word = || {
        let (head, tail) = rest.split_first_chunk::<4>()?;
        rest = tail;
        Some(*head)
    };
    let mut number = || word().map(|w| u32::from_le_bytes(w) as usize);
    let (step, pixels, channels, labels) = (number()?, number()?, number()?, number()?);
    let metres = f32::from_le_bytes(word()?);
    let height = f32::from_le_bytes(word()?);
    let centre = [i32::from_le_bytes(word()?), i32::from_le_bytes(word()?)];
    let mut read = Vec::new();
    for _ in 0..labels {
        let mut number = || word().map(|w| u32::from_le_bytes(w) as usize);
        let (heading, row, col) = (number()?, number()?, number()?);
        read.push(ValueLabel { heading: Heading::new(heading), row, col, gain: f32::from_le_bytes(word()?) });
    }
    let area = pixels.checked_mul(pixels)?;
    let counts = area.checked_mul(channels)?;
    if rest.len() != counts.checked_mul(2)?.checked_add(area)? {
        return None;
    }
    let (low, rest) = rest.split_at(counts);
    let (high, obstacles) = rest.split_at(counts);
    let window = Window { size: WindowSize { pixels, metres }, centre, height };
    let counts = low.iter().zip(high).map(|(&l, &h)| u16::from_le_bytes([l, h])).collect();
    Some(Sample { input: EncoderInput { window, channels, counts }, step, labels: read, obstacles: obstacles.to_vec() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn sample(n: u32) -> Sample {
        let window = Window { size: WindowSize { pixels: 16, metres: 10.0 }, centre: [-3, n as i32], height: 1.65 };
        let counts = (0..2 * 256).map(|i| if i % 37 == 0 { (n * 300 + i) as u16 } else { 0 }).collect();
        let label = ValueLabel { heading: Heading::new(n as usize), row: 1, col: 2, gain: n as f32 / 3.0 };
        let obstacles = (0..256).map(|i| u8::from((i + n).is_multiple_of(5))).collect();
        Sample {
            input: EncoderInput { window, channels: 2, counts },
            step: n as usize,
            labels: vec![label; n as usize % 4],
            obstacles,
        }
    }

    fn samples(range: std::ops::Range<u32>) -> Vec<PackedSample> {
        range.map(|n| PackedSample::new(&sample(n))).collect()
    }

    #[test]
    fn samples_survive_reopening_and_truncation() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("memory.bin");
        let mut memory = Memory::open(&path).unwrap();
        memory.append(0, &samples(0..5)).unwrap();
        memory.append(1, &samples(5..9)).unwrap();
        drop(memory);
        let mut memory = Memory::open(&path).unwrap();
        assert_eq!((memory.len(), memory.iteration(4), memory.iteration(5)), (9, Some(0), Some(1)));
        assert_eq!(memory.get(7).unwrap(), sample(7));
        memory.truncate(6).unwrap();
        memory.append(2, &samples(20..21)).unwrap();
        assert_eq!(memory.get(6).unwrap(), sample(20));
        assert_eq!(Memory::open(&path).unwrap().len(), 7);
        assert!(memory.truncate(8).unwrap_err().to_string().contains("more records"));
    }

    #[test]
    fn a_torn_tail_is_cut_and_damage_is_found() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("memory.bin");
        Memory::open(&path).unwrap().append(0, &samples(0..3)).unwrap();
        let whole = std::fs::read(&path).unwrap();
        std::fs::write(&path, &whole[..whole.len() - 5]).unwrap();
        let memory = Memory::open(&path).unwrap();
        assert_eq!(memory.len(), 2);
        assert_eq!(memory.get(1).unwrap(), sample(1));
        let mut damaged = whole.clone();
        let last = damaged.len() - 3;
        damaged[last] ^= 0x10;
        std::fs::write(&path, damaged).unwrap();
        assert!(Memory::open(&path).unwrap().get(2).unwrap_err().to_string().contains("record 2"));
        std::fs::write(&path, b"something else").unwrap();
        assert!(matches!(Memory::open(&path), Err(MemoryError::Foreign(_))));
    }

    proptest! {
        #[test]
        fn unpacking_never_panics(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            let _ = unpack(&bytes);
        }
    }
}
