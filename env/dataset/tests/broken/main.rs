//! Damaged files end in an error or a valid result: no panic, no hang, little memory.
//!
//! `cargo test` tries a few hundred files a reader. All of them, two seconds a file allowed:
//!
//! ```text
//! NBP_BROKEN_FILES=20000 cargo test -p dataset --test broken -- --nocapture
//! ```
//!
//! A file that fails is kept, and its reader and number are told; `NBP_BROKEN_ERRORS=20` prints that many refusals of each
//! reader. The libFuzzer targets in `fuzz/` feed the same readers.

#![allow(clippy::unwrap_used)] // helpers of tests

mod absurd;
mod examples;
mod mutate;
mod readers;
#[path = "../../src/import/tests/samples.rs"]
#[allow(dead_code)]
mod samples;

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD as STANDARD;
use mutate::{Kind, mutate};
use nbp_env::SeedTree;
use peak_alloc::PeakAlloc;
use rand::RngExt as _;
use readers::Read;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

/// Most that a damaged file may take.
const MOST_MEMORY: usize = 256 << 20;

/// Files a reader in the short run.
const FEW: u64 = 300;

struct Reader {
    name: &'static str,
    read: Read,
    kind: Kind,
    examples: Vec<Vec<u8>>,
}

fn readers() -> Vec<Reader> {
    let (house, textured) = (samples::House::two_rooms(), textured_triangle());
    let reader = |name, read, kind, examples| Reader { name, read, kind, examples };
    vec![
        reader("wad", readers::wad, Kind::Records, examples::wads()),
        reader("obj", readers::obj, Kind::Text, vec![examples::OBJ.into()]),
        reader("settings.json", readers::settings, Kind::Text, vec![examples::settings()]),
        reader("mtl", readers::mtl, Kind::Text, vec![examples::MTL.into()]),
        reader("png", readers::image, Kind::Png, examples::pngs()),
        reader("jpeg", readers::image, Kind::Records, vec![examples::JPEG.into()]),
        reader("ply, text", readers::ply, Kind::Text, vec![house.ply(None)]),
        reader("ply, binary", readers::ply, Kind::Records, vec![house.ply(Some(true)), house.ply(Some(false))]),
        reader("glb", readers::gltf, Kind::Glb, vec![house.glb(), textured.clone()]),
        reader("gltf", readers::gltf, Kind::Text, vec![embedded(&house.glb()), embedded(&textured)]),
    ]
}

fn textured_triangle() -> Vec<u8> {
    let mut glb = samples::Glb::default();
    let floats = |values: &[f32]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>().into_iter();
    let positions = glb.accessor(5126, "VEC3", 3, floats(&[0., 0., 0., 1., 0., 0., 0., 0., 1.]));
    let uv = glb.accessor(5126, "VEC2", 3, floats(&[0., 0., 1., 0., 0., 1.]));
    let corners = glb.accessor(5123, "SCALAR", 3, [0, 0, 1, 0, 2, 0].into_iter());
    let image = glb.view(examples::pngs()[0].clone().into_iter());
    let material = glb.raw_material(r#"{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}"#);
    glb.more = format!(r#","textures":[{{"source":0}}],"images":[{{"bufferView":{image},"mimeType":"image/png"}}]"#);
    let attributes = format!(r#""POSITION":{positions},"TEXCOORD_0":{uv}"#);
    let mesh =
        format!(r#"{{"primitives":[{{"attributes":{{{attributes}}},"indices":{corners},"material":{material}}}]}}"#);
    glb.file(&[mesh], &[r#"{"mesh":0,"scale":[2,2,2]}"#.into()])
}

/// The same file as text, its buffer in base64.
fn embedded(glb: &[u8]) -> Vec<u8> {
    let length = u32::from_le_bytes([glb[12], glb[13], glb[14], glb[15]]) as usize;
    let (json, data) = (String::from_utf8_lossy(&glb[20..20 + length]), &glb[28 + length..]);
    let uri = format!(r#""buffers":[{{"uri":"data:application/octet-stream;base64,{}","#, STANDARD.encode(data));
    json.replace(r#""buffers":[{"#, &uri).replace("},{", "},\n{").into_bytes()
}

#[derive(Default)]
struct Row {
    accepted: u64,
    refused: u64,
    slowest: Duration,
    memory: usize,
    failures: Vec<String>,
}

#[test]
fn damaged_files_are_refused_or_valid() {
    let number = |name: &str| std::env::var(name).ok().and_then(|text| text.parse().ok());
    let files: Option<u64> = number("NBP_BROKEN_FILES");
    // A machine under load may be slow: the short run finds hangs only.
    let patience = Duration::from_secs(if files.is_some() { 2 } else { 120 });
    let folder = tempfile::tempdir().unwrap();
    let mut failures = Vec::new();
    println!(
        "{:<14}{:>8}{:>10}{:>9}{:>12}{:>10}{:>10}",
        "reader", "files", "accepted", "refused", "slowest ms", "peak MiB", "files/s"
    );
    for reader in readers() {
        let folder = folder.path().join(reader.name);
        std::fs::create_dir(&folder).unwrap();
        examples::write_folder(&folder);
        (reader.read)(&folder, &reader.examples[0]).unwrap_or_else(|error| panic!("{}: {error}", reader.name));
        let began = Instant::now();
        let files = files.unwrap_or(FEW);
        let row = try_all(&reader, &folder, files, patience, number("NBP_BROKEN_ERRORS").unwrap_or(0));
        let per_second = files as f64 / began.elapsed().as_secs_f64();
        let (slowest, memory) = (row.slowest.as_secs_f64() * 1e3, row.memory as f64 / f64::from(1 << 20));
        println!(
            "{:<14}{files:>8}{:>10}{:>9}{slowest:>12.1}{memory:>10.1}{per_second:>10.0}",
            reader.name, row.accepted, row.refused
        );
        failures.extend(row.failures);
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

/// Files that are well formed and unreasonable.
#[test]
fn absurd_files_are_refused_or_valid() {
    let all = std::env::var("NBP_BROKEN_FILES").is_ok();
    for (name, read, bytes) in absurd::all().into_iter().filter(|(name, ..)| all || !absurd::SLOW.contains(name)) {
        let folder = tempfile::tempdir().unwrap();
        examples::write_folder(folder.path());
        let began = Instant::now();
        MEMORY.reset_peak_usage();
        let before = MEMORY.current_usage();
        let answer = read(folder.path(), &bytes);
        let memory = MEMORY.peak_usage().saturating_sub(before);
        let (ms, told) = (began.elapsed().as_millis(), answer.err().unwrap_or("accepted".into()));
        println!("{name:<44}{ms:>7} ms{:>5} MiB  {told}", memory >> 20);
        assert!(memory <= MOST_MEMORY, "{name} took {} MiB", memory >> 20);
    }
}

fn try_all(reader: &Reader, folder: &Path, files: u64, patience: Duration, shown: u64) -> Row {
    let mut row = Row::default();
    for number in 0..files {
        let mut rng = SeedTree::new(0).child(reader.name, number).rng();
        let example = &reader.examples[rng.random_range(0..reader.examples.len())];
        let bytes = mutate(example, reader.kind, &mut rng);
        let mut fail = |what: String| {
            let kept = keep(reader.name, number, &bytes);
            row.failures.push(format!("{} {number}: {what}; the file is kept as {}", reader.name, kept.display()));
        };
        let (send, receive) = channel();
        let (read, copy, place) = (reader.read, bytes.clone(), folder.to_path_buf());
        MEMORY.reset_peak_usage();
        let before = MEMORY.current_usage();
        let began = Instant::now();
        let thread = std::thread::Builder::new().name(format!("{} {number}", reader.name));
        // A panic drops the sender.
        let thread = thread.spawn(move || send.send(read(&place, &copy))).unwrap();
        let answer = receive.recv_timeout(patience);
        let memory = MEMORY.peak_usage().saturating_sub(before);
        row.slowest = row.slowest.max(began.elapsed());
        row.memory = row.memory.max(memory);
        if memory > MOST_MEMORY {
            fail(format!("took {} MiB", memory >> 20));
        }
        let hangs = answer == Err(RecvTimeoutError::Timeout);
        match answer {
            Ok(Ok(())) => row.accepted += 1,
            Ok(Err(error)) => {
                if row.refused < shown {
                    println!("    {number}: {error}");
                }
                row.refused += 1;
            }
            Err(RecvTimeoutError::Timeout) => fail(format!("no answer after {} s", patience.as_secs())),
            Err(RecvTimeoutError::Disconnected) => fail("panicked".into()),
        }
        if !hangs {
            // A panic is noted already.
            drop(thread.join());
        }
        if row.failures.len() >= 10 {
            break;
        }
    }
    row
}

fn keep(reader: &str, number: u64, bytes: &[u8]) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("broken");
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join(format!("{number}-{reader}"));
    std::fs::write(&path, bytes).unwrap();
    path
}
