//! Damage: what disks, editors, exporters and cut transfers do to files, and what a fuzzer knows to try.

use nbp_env::seed::Rng;
use rand::RngExt as _;

/// What a file is made of, so that damage gets past its outer shell.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Kind {
    Text,
    /// Records found by their offset: what changes the length breaks everything behind it.
    Records,
    /// Chunks with checksums, which are made right again most of the time.
    Png,
    /// A chunk of JSON and one of records.
    Glb,
}

/// Numbers at the edges of types and of common sense, and words that are none.
const WORDS: [&str; 32] = [
    "nan",
    "NaN",
    "inf",
    "-inf",
    "1e30",
    "-1e30",
    "1e39",
    "1e-40",
    "-1",
    "0",
    "1",
    "2",
    "255",
    "256",
    "65535",
    "65536",
    "2000000000",
    "2147483647",
    "-2147483648",
    "4294967295",
    "4294967296",
    "18446744073709551616",
    "0x10",
    "1/2/3",
    "-1/-1",
    "//",
    "\"\"",
    "null",
    "[[[[",
    "}",
    "\u{0}",
    "é",
];

const NUMBERS: [u32; 16] = [
    0,
    1,
    2,
    3,
    4,
    0x7f,
    0x80,
    0xff,
    0x7fff,
    0x8000,
    0xfffe,
    0xffff,
    0x7fff_ffff,
    0x8000_0000,
    0xffff_fffe,
    0xffff_ffff,
];

const FLOATS: [f32; 8] = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, 1e30, 1e-40, -0.0, 1e9];

/// Longest file that damage makes.
const LONGEST: usize = 1 << 20;

/// A damaged copy: one to four hits.
pub(crate) fn mutate(bytes: &[u8], kind: Kind, rng: &mut Rng) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    if kind == Kind::Glb && rng.random() {
        return damage_json(&bytes, rng);
    }
    for _ in 0..rng.random_range(1..=4) {
        match kind {
            Kind::Text if rng.random_bool(0.8) => hit_text(&mut bytes, rng),
            Kind::Text => hit(&mut bytes, true, rng),
            _ => hit(&mut bytes, rng.random_bool(0.1), rng),
        }
        bytes.truncate(LONGEST);
    }
    if kind == Kind::Png && rng.random_bool(0.8) {
        mend_checksums(&mut bytes);
    }
    bytes
}

/// A GLB file with other JSON and lengths that are right.
fn damage_json(glb: &[u8], rng: &mut Rng) -> Vec<u8> {
    let length = u32::from_le_bytes([glb[12], glb[13], glb[14], glb[15]]) as usize;
    let mut json = mutate(&glb[20..20 + length], Kind::Text, rng);
    json.resize(json.len().next_multiple_of(4), b' ');
    let rest = &glb[20 + length..];
    let all = (20 + json.len() + rest.len()) as u32;
    [&glb[..8], &all.to_le_bytes(), &(json.len() as u32).to_le_bytes(), b"JSON", &json, rest].concat()
}

fn hit(bytes: &mut Vec<u8>, may_move: bool, rng: &mut Rng) {
    let at = rng.random_range(0..bytes.len().max(1));
    let Some(byte) = bytes.get_mut(at) else { return bytes.push(rng.random()) };
    match rng.random_range(if may_move { 0 } else { 3 }..8) {
        0 => bytes.truncate(at),
        1 => drop(bytes.drain(at..end(at, bytes.len(), rng))),
        2 => {
            let copy = bytes[at..end(at, bytes.len(), rng)].repeat(rng.random_range(1..=3));
            let to = rng.random_range(0..=bytes.len());
            bytes.splice(to..to, copy);
        }
        3 => *byte ^= 1 << rng.random_range(0..8),
        4 => *byte = rng.random(),
        5 => {
            let copy = bytes[at..end(at, bytes.len(), rng)].to_vec();
            let to = rng.random_range(0..=bytes.len() - copy.len());
            bytes[to..to + copy.len()].copy_from_slice(&copy);
        }
        // Numbers lie at even offsets in most formats.
        6 => {
            write(bytes, at & !1, &NUMBERS[rng.random_range(0..NUMBERS.len())].to_le_bytes()[..*pick(&[1, 2, 4], rng)])
        }
        _ => {
            let value = if rng.random() { pick(&FLOATS, rng).to_bits() } else { *pick(&NUMBERS, rng) };
            write(bytes, at & !3, &if rng.random() { value.to_le_bytes() } else { value.to_be_bytes() });
        }
    }
}

fn hit_text(bytes: &mut Vec<u8>, rng: &mut Rng) {
    let is_word = |b: &u8| b.is_ascii_alphanumeric() || b"+-._/".contains(b);
    let at = rng.random_range(0..bytes.len().max(1)).min(bytes.len());
    let line = {
        let start = bytes[..at].iter().rposition(|&b| b == b'\n').map_or(0, |n| n + 1);
        start..bytes[at..].iter().position(|&b| b == b'\n').map_or(bytes.len(), |n| at + n + 1)
    };
    let word = |at: usize| {
        let from = bytes[..at].iter().rposition(|b| !is_word(b)).map_or(0, |n| n + 1);
        from..bytes[at..].iter().position(|b| !is_word(b)).map_or(bytes.len(), |n| at + n)
    };
    match rng.random_range(0..8) {
        0..=3 => drop(bytes.splice(word(at), pick(&WORDS, rng).bytes())),
        4 => {
            let other = word(rng.random_range(0..=bytes.len()));
            let other = bytes[other].to_vec();
            bytes.splice(word(at), other);
        }
        5 => drop(bytes.drain(line)),
        6 => {
            let copies = repeat(&bytes[line.clone()], *pick(&[1, 2, 50, 2000], rng));
            bytes.splice(line.start..line.start, copies);
        }
        _ => {
            let from = word(at);
            let copies = repeat(&bytes[from.clone()], *pick(&[1, 10, 1000, 20_000], rng));
            bytes.splice(from, copies);
        }
    }
}

fn repeat(bytes: &[u8], times: usize) -> Vec<u8> {
    bytes.repeat(times.min(LONGEST / bytes.len().max(1)))
}

/// End of a slice, short more often than long.
fn end(at: usize, len: usize, rng: &mut Rng) -> usize {
    let longest = *pick(&[4, 16, 64, 1024, usize::MAX], rng);
    rng.random_range(at..=len.min(at.saturating_add(longest)))
}

fn write(bytes: &mut [u8], at: usize, value: &[u8]) {
    bytes[at..].iter_mut().zip(value).for_each(|(to, from)| *to = *from);
}

fn pick<'a, T>(from: &'a [T], rng: &mut Rng) -> &'a T {
    &from[rng.random_range(0..from.len())]
}

/// Makes the checksums of a PNG's chunks right, as far as its lengths are.
fn mend_checksums(bytes: &mut [u8]) {
    let mut at = 8;
    while let Some(length) = bytes.get(at..at + 4) {
        let length = u32::from_be_bytes([length[0], length[1], length[2], length[3]]) as usize;
        let Some(body) = bytes.get(at + 4..at.saturating_add(8).saturating_add(length)) else { return };
        let checksum = crc32fast::hash(body).to_be_bytes();
        at += 8 + length;
        write(bytes, at.min(bytes.len()), &checksum);
        at += 4;
    }
}
