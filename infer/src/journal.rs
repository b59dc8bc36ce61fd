//! Finished episodes on disk, one JSON line each, written as they finish: what a second call takes over from the first.
//!
//! Every line carries a fingerprint of all that the episode depends on besides its key: scene, settings and, for policies
//! that ask it, network, and a checksum of the record. A line with another fingerprint is left alone and not used, so one file
//! serves many evaluations.

use crate::checkpoint::Settings;
use crate::eval::EvalConfig;
use crate::registry::PolicyKind;
use crate::rollout::EpisodeRecord;
use crate::seal::{hash, seal, unseal};
use nbp_env::{Scene, World};
use std::collections::BTreeMap;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

/// Raised with every change of what episodes give, so that nothing that an older program computed is taken over.
pub const BEHAVIOUR: u32 = 2;

/// Name of the file in an evaluation's folder.
pub const FILE: &str = "journal.jsonl";

/// What the episodes of an evaluation depend on.
#[derive(Clone, Debug)]
pub struct Fingerprints {
    scenes: BTreeMap<String, u64>,
    blind: String,
    network: String,
    search: String,
    nbv: String,
}

impl Fingerprints {
    /// Of `worlds` under `settings`; `weights` are the bytes of the network's file, if there is one.
    pub fn new(worlds: &[Arc<World>], settings: &Settings, config: &EvalConfig, weights: Option<&[u8]>) -> Self {
        let scenes = worlds.iter().map(|world| (world.scene().name().to_owned(), of_scene(world.scene()))).collect();
        // Debug forms of plain settings: every field enters, and there is no number that it cannot write.
        let blind = format!("{} {BEHAVIOUR} {:?} {}", env!("CARGO_PKG_VERSION"), settings.sim, config.steps);
        // The time of decisions depends on how many are made together; one by one is not named, as it once was the only way.
        let together = if config.batch > 1 { format!(" {}", config.batch) } else { String::new() };
        let network = format!("{blind} {:?} {:016x}{together}", settings.policy, weights.map_or(0, hash));
        let [search, nbv] = [format!("{blind} {:?}", settings.search), format!("{network} {:?}", settings.nbv)];
        Self { scenes, blind, network, search, nbv }
    }

    fn of(&self, record: &EpisodeRecord) -> Option<String> {
        let kind: PolicyKind = record.policy.parse().ok()?;
        let settings = match kind {
            PolicyKind::OracleBeam => &self.search,
            PolicyKind::Scone | PolicyKind::Macarons => &self.nbv,
            PolicyKind::Nbp | PolicyKind::OracleObstacles | PolicyKind::OracleLooks | PolicyKind::OracleMaps => {
                &self.network
            }
            PolicyKind::Random | PolicyKind::RandomNbv | PolicyKind::OracleGreedy => &self.blind,
            PolicyKind::Fbe | PolicyKind::FbeGain | PolicyKind::FbeTsp => &self.blind,
        };
        let scene = self.scenes.get(&record.scene)?;
        Some(format!("{:016x}", hash(format!("{scene:016x} {settings}").as_bytes())))
    }
}

pub(crate) fn of_scene(scene: &Scene) -> u64 {
    let corners = scene.mesh().iter_corners().flatten().flat_map(|v| v.to_array()).flat_map(f32::to_le_bytes);
    let setting = format!("{:?} {:?} {:?}", scene.bounds(), scene.lattice(), scene.starts());
    hash(&corners.chain(setting.into_bytes()).collect::<Vec<u8>>())
}

/// The journal of the evaluations in a folder.
pub struct Journal {
    fingerprints: Fingerprints,
    file: Mutex<File>,
}

impl Journal {
    /// Opens the journal of a folder, with the episodes in it that are still good.
    ///
    /// # Errors
    /// When the folder cannot be read or written.
    pub fn open(folder: &Path, fingerprints: Fingerprints) -> io::Result<(Self, Vec<EpisodeRecord>)> {
        let path = folder.join(FILE);
        let (lines, is_torn) = read(&path)?;
        let mut file = OpenOptions::new().create(true).append(true).open(path)?;
        if is_torn {
            // A crash left half a line: what follows must not become its end.
            file.write_all(b"\n")?;
        }
        let good = |(fingerprint, record): (String, EpisodeRecord)| {
            (fingerprints.of(&record) == Some(fingerprint)).then_some(record)
        };
        let records = lines.into_iter().filter_map(good).collect();
        Ok((Self { fingerprints, file: Mutex::new(file) }, records))
    }

    /// Writes down a finished episode.
    ///
    /// # Errors
    /// When the disk is full or gone.
    pub fn append(&self, record: &EpisodeRecord) -> io::Result<()> {
        let line = self.line(record)?;
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.write_all(line.as_bytes())?;
        file.flush()
    }

    fn line(&self, record: &EpisodeRecord) -> io::Result<String> {
        let fingerprint = self.fingerprints.of(record).unwrap_or_default();
        Ok(seal(&fingerprint, &serde_json::to_string(record)?) + "\n")
    }
}

/// Fingerprints and records of a file's readable lines, none if it is not there, and whether its last line is torn.
fn read(path: &Path) -> io::Result<(Vec<(String, EpisodeRecord)>, bool)> {
    match fs::read(path) {
        Ok(bytes) => {
            // A damaged line is one episode to run again.
            let text = String::from_utf8_lossy(&bytes);
            let line = |line: &str| {
                let (fingerprint, record) = unseal(line)?;
                Some((fingerprint.to_owned(), serde_json::from_str(record).ok()?))
            };
            let lines = text.lines().filter_map(line).collect();
            Ok((lines, !text.is_empty() && !text.ends_with('\n')))
        }
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok((Vec::new(), false)),
        Err(error) => Err(error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export;
    use nbp_env::SimConfig;

    fn fingerprints(settings: &Settings, weights: &[u8]) -> Fingerprints {
        let world = World::new(Scene::two_rooms(), &SimConfig::default()).unwrap();
        Fingerprints::new(&[Arc::new(world)], settings, &EvalConfig::default(), Some(weights))
    }

    fn record(policy: &str, start: usize) -> EpisodeRecord {
        EpisodeRecord { scene: "two_rooms".into(), policy: policy.into(), start, ..export::tests::record() }
    }

    #[test]
    fn episodes_survive_a_crash() {
        let dir = tempfile::tempdir().unwrap();
        let prints = fingerprints(&Settings::default(), b"w");
        let (journal, records) = Journal::open(dir.path(), prints.clone()).unwrap();
        assert!(records.is_empty());
        journal.append(&record("fbe", 0)).unwrap();
        journal.append(&record("nbp", 1)).unwrap();
        drop(journal);
        let file = dir.path().join(FILE);
        let text = fs::read_to_string(&file).unwrap();
        fs::write(&file, [&b"\xff\xfe\n"[..], &text.as_bytes()[..text.len() - 30]].concat()).unwrap();

        let (journal, records) = Journal::open(dir.path(), prints.clone()).unwrap();
        assert_eq!(records, [record("fbe", 0)]);
        journal.append(&record("fbe", 2)).unwrap();
        drop(journal);
        assert_eq!(Journal::open(dir.path(), prints.clone()).unwrap().1, [record("fbe", 0), record("fbe", 2)]);
        // A figure that is not what was written is none.
        let text = String::from_utf8_lossy(&fs::read(&file).unwrap()).replacen("0.25", "0.35", 1);
        fs::write(&file, text).unwrap();
        assert_eq!(Journal::open(dir.path(), prints).unwrap().1, [record("fbe", 2)]);
    }

    #[test]
    fn other_settings_and_weights_make_episodes_useless_where_they_matter() {
        let dir = tempfile::tempdir().unwrap();
        let settings = Settings::default();
        let (journal, _) = Journal::open(dir.path(), fingerprints(&settings, b"w")).unwrap();
        for policy in ["fbe", "nbp", "scone", "oracle-beam"] {
            journal.append(&record(policy, 0)).unwrap();
        }
        let kept = |settings: &Settings, weights: &[u8]| {
            let (_, records) = Journal::open(dir.path(), fingerprints(settings, weights)).unwrap();
            records.into_iter().map(|record| record.policy).collect::<Vec<_>>()
        };
        assert_eq!(kept(&settings, b"w"), ["fbe", "nbp", "scone", "oracle-beam"]);
        assert_eq!(kept(&settings, b"other"), ["fbe", "oracle-beam"]);
        let mut policy = settings.clone();
        policy.policy.fuse_observed = true;
        assert_eq!(kept(&policy, b"w"), ["fbe", "oracle-beam"]);
        let mut asked = settings.clone();
        asked.nbv.carving = 5.0;
        assert_eq!(kept(&asked, b"w"), ["fbe", "nbp", "oracle-beam"]);
        let mut search = settings.clone();
        search.search.depth = 3;
        assert_eq!(kept(&search, b"w"), ["fbe", "nbp", "scone"]);
        let mut sim = settings;
        sim.sim.keep = 0.1;
        assert!(kept(&sim, b"w").is_empty());
    }
}
