//! From a checkpoint's folder to a network and the settings that it was trained with.
//!
//! The trainer leaves notes in the `meta` of a checkpoint's `config.json`: [`SIM`], the simulator, and [`POLICY`], how its maps
//! become paths, or [`NBV`], what a next-best-view baseline is asked. Where one is missing the defaults hold, with the
//! checkpoint's own window.

use nbp_env::SimConfig;
use nbp_env::encode::Trajectory;
use nbp_env::nbv::NbvConfig;
use nbp_env::policy::nbp::NbpConfig;
use nbp_env::policy::search::SearchConfig;
use nbp_model::config::ARCHITECTURE;
use nbp_model::scone::SconePredictor;
use nbp_model::weights::scone::{self, Baseline, SconeDescription};
use nbp_model::weights::{self, CONFIG_FILE, WEIGHTS_FILE, WeightsError};
use nbp_model::{CheckpointConfig, DeviceChoice, DeviceError, NetConfig, NetPredictor, device_name};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use std::fs;
use std::path::{Path, PathBuf};

/// Key of the simulator's settings in a checkpoint's `meta`.
pub const SIM: &str = "sim";
/// Key of the policy's settings in a checkpoint's `meta`.
pub const POLICY: &str = "policy";

/// Key of the next-best-view baselines' settings in a checkpoint's `meta`.
pub const NBV: &str = "nbv";

/// What stands for a network that comes with the repository.
pub const PUBLISHED: &str = "published";

/// Obstacle threshold of the released code.
const RELEASED_THRESHOLD: f32 = 0.13;

/// All that decides an episode besides scene, seed and weights.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// The simulator.
    pub sim: SimConfig,
    /// How value and obstacle maps become paths.
    pub policy: NbpConfig,
    /// How far `oracle-beam` looks ahead.
    pub search: SearchConfig,
    /// What the networks of the next-best-view baselines are asked.
    pub nbv: NbvConfig,
}

/// A checkpoint in use.
pub struct Loaded {
    /// The network.
    pub predictor: NetPredictor,
    /// Its description.
    pub config: CheckpointConfig,
    /// Where it computes, for logs.
    pub device: String,
}

/// A checkpoint of `scone` or `macarons` in use.
pub struct LoadedScone {
    /// The networks.
    pub predictor: SconePredictor,
    /// Where they compute, for logs.
    pub device: String,
}

/// A checkpoint that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    /// Neither a checkpoint's folder nor the weights in one.
    #[error("{path} is no checkpoint: {hint}")]
    NotOne {
        /// As given.
        path: PathBuf,
        /// What to do.
        hint: String,
    },
    /// The network of another policy.
    #[error("{path} holds the network of {found}, not of {wanted}: give a checkpoint of {wanted}")]
    Other {
        /// The checkpoint.
        path: PathBuf,
        /// Its architecture.
        found: String,
        /// What the policy needs.
        wanted: String,
    },
    /// Damaged, or from another architecture.
    #[error(transparent)]
    Weights(#[from] WeightsError),
    /// No such device.
    #[error(transparent)]
    Device(#[from] DeviceError),
    /// A note that cannot be read.
    #[error("{path}: meta.{key} cannot be read: {reason}")]
    Meta {
        /// The `config.json`.
        path: PathBuf,
        /// [`SIM`], [`POLICY`] or [`NBV`].
        key: &'static str,
        /// Why.
        reason: String,
    },
    /// The network sees something else than the simulator shows.
    #[error(
        "the checkpoint was trained with {what} {trained}, but the settings have {found}: leave this setting as trained"
    )]
    Mismatch {
        /// Which setting.
        what: String,
        /// As trained.
        trained: String,
        /// As set.
        found: String,
    },
}

/// The folder of the network of an architecture that comes with the repository, seen from here or where the program was built.
pub fn published(architecture: &str) -> PathBuf {
    let of = |root: &Path| root.join("runs").join(PUBLISHED).join(architecture);
    let built_in = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap_or(Path::new(""));
    [Path::new(""), built_in].map(of).into_iter().find(|dir| dir.is_dir()).unwrap_or_else(|| of(Path::new("")))
}

/// The folder of a checkpoint, given the folder itself, its `model.safetensors` or [`PUBLISHED`].
///
/// # Errors
/// When neither is there.
pub fn folder(path: &Path) -> Result<PathBuf, CheckpointError> {
    let refuse = |hint: String| Err(CheckpointError::NotOne { path: path.to_owned(), hint });
    let has = |dir: &Path, name: &str| dir.join(name).is_file();
    if path.is_dir() {
        return match (has(path, WEIGHTS_FILE), has(path, CONFIG_FILE)) {
            (true, true) => Ok(path.to_owned()),
            (true, false) => refuse(format!("{CONFIG_FILE} is missing beside {WEIGHTS_FILE}")),
            (false, _) => refuse(format!("the folder holds no {WEIGHTS_FILE}")),
        };
    }
    let name = path.file_name().unwrap_or_default();
    match path.extension().and_then(|extension| extension.to_str()) {
        _ if !path.exists() && path == Path::new(PUBLISHED) => folder(&published(ARCHITECTURE)),
        _ if !path.exists() => refuse("there is no such file or folder".into()),
        _ if name == WEIGHTS_FILE || name == CONFIG_FILE => {
            let parent = path.parent().filter(|parent| !parent.as_os_str().is_empty());
            folder(parent.unwrap_or(Path::new(".")))
        }
        Some("pth" | "pt") => {
            refuse("it is a PyTorch file, turn it into one first: infer import FILE --out DIR".into())
        }
        _ => refuse(format!("name a folder with {WEIGHTS_FILE} and {CONFIG_FILE}, or that {WEIGHTS_FILE}")),
    }
}

/// A checkpoint's description and the settings in it, without its weights.
///
/// # Errors
/// When it is not one, or its notes cannot be read.
pub fn read(path: &Path) -> Result<(CheckpointConfig, Settings), CheckpointError> {
    let dir = folder(path)?;
    let config = weights::read_config(&dir)?;
    let settings = settings_of(&config).map_err(meta(&dir))?;
    check(&config, &settings.sim)?;
    Ok((config, settings))
}

/// The same for a checkpoint of `scone` or `macarons`.
///
/// # Errors
/// When it is not one, or its notes cannot be read.
pub fn read_scone(path: &Path) -> Result<(SconeDescription, Settings), CheckpointError> {
    let dir = folder(path)?;
    let config = scone::read_config(&dir)?;
    let settings = scone_settings_of(&config).map_err(meta(&dir))?;
    Ok((config, settings))
}

/// Settings of a checkpoint of this architecture, and what its maps must look like if it has maps.
///
/// # Errors
/// When it is of another architecture, or its notes cannot be read.
pub fn read_as(architecture: &str, path: &Path) -> Result<(Option<CheckpointConfig>, Settings), CheckpointError> {
    let found = self::architecture(path)?;
    if found != architecture {
        let (path, wanted) = (path.to_owned(), architecture.to_owned());
        return Err(CheckpointError::Other { path, found, wanted });
    }
    match Baseline::named(architecture) {
        Some(_) => read_scone(path).map(|(_, settings)| (None, settings)),
        None => read(path).map(|(config, settings)| (Some(config), settings)),
    }
}

/// What a checkpoint holds: `nbp`, `scone` or `macarons`, or what a newer program calls it.
///
/// # Errors
/// When it is no checkpoint.
pub fn architecture(path: &Path) -> Result<String, CheckpointError> {
    Ok(weights::architecture(&folder(path)?)?)
}

/// The bytes of a checkpoint's files: what its answers depend on, and the settings that it brings along.
///
/// # Errors
/// When it is no checkpoint or cannot be read.
pub fn bytes(path: &Path) -> Result<Vec<u8>, CheckpointError> {
    let dir = folder(path)?;
    let read = |name: &str| {
        let path = dir.join(name);
        fs::read(&path).map_err(|source| WeightsError::Io { what: "read", path, source })
    };
    Ok([read(WEIGHTS_FILE)?, read(CONFIG_FILE)?].concat())
}

fn meta(dir: &Path) -> impl FnOnce((&'static str, String)) -> CheckpointError {
    let path = dir.join(CONFIG_FILE);
    |(key, reason)| CheckpointError::Meta { path, key, reason }
}

/// The network of a checkpoint on a device.
///
/// # Errors
/// When it is not one, is damaged, or the device does not work.
pub fn load(path: &Path, device: DeviceChoice) -> Result<Loaded, CheckpointError> {
    let dir = folder(path)?;
    let device = device.resolve_for("infer")?;
    let predictor = NetPredictor::load(&dir, &device)?;
    let (config, device) = (predictor.config().clone(), device_name(&device));
    Ok(Loaded { predictor, config, device })
}

/// The networks of a checkpoint of `scone` or `macarons` on a device.
///
/// # Errors
/// When it is not one, is damaged, or the device does not work.
pub fn load_scone(path: &Path, device: DeviceChoice) -> Result<LoadedScone, CheckpointError> {
    let dir = folder(path)?;
    let device = device.resolve_for("infer")?;
    Ok(LoadedScone { predictor: SconePredictor::load(&dir, &device)?, device: device_name(&device) })
}

/// Whether the simulator shows what the network was trained to see.
///
/// # Errors
/// Naming the setting that differs.
pub fn check(config: &CheckpointConfig, sim: &SimConfig) -> Result<(), CheckpointError> {
    let window = |pixels: usize, metres: f32| format!("{pixels} pixels over {metres} m");
    let (trained, found) = (config.window, sim.encode.window);
    let pairs = [
        ("a window of", window(trained.pixels, trained.metres), window(found.pixels, found.metres)),
        ("this number of input channels:", config.net.in_channels.to_string(), sim.encode.channels().to_string()),
    ];
    let mismatch = |what: &str, trained: String, found: String| {
        Err(CheckpointError::Mismatch { what: what.to_owned(), trained, found })
    };
    if let Some((what, trained, found)) = pairs.into_iter().find(|(_, trained, found)| trained != found) {
        return mismatch(what, trained, found);
    }
    // As many channels may mean other things. Without a note nobody knows; one that cannot be read is an error of `read`.
    let Ok(Some(trained)) = note::<SimConfig>(&config.meta, SIM) else { return Ok(()) };
    let values = plain(&trained.encode).and_then(|trained| Ok((trained, plain(&sim.encode)?)));
    match values.ok().and_then(|(trained, found)| difference("sim.encode", &trained, &found)) {
        Some((key, trained, found)) => mismatch(&key, trained.to_string(), found.to_string()),
        None => Ok(()),
    }
}

/// The first key in which two values differ, and both.
pub(crate) fn difference(key: &str, a: &Value, b: &Value) -> Option<(String, Value, Value)> {
    match (a, b) {
        (Value::Object(a), Value::Object(b)) => {
            let keys = a.keys().chain(b.keys());
            let of = |map: &Map<String, Value>, name: &str| map.get(name).cloned().unwrap_or_default();
            keys.into_iter().find_map(|name| difference(&format!("{key}.{name}"), &of(a, name), &of(b, name)))
        }
        _ => (a != b).then(|| (key.to_owned(), a.clone(), b.clone())),
    }
}

/// Leaves the settings in a checkpoint's description, for [`read`] to find.
///
/// # Errors
/// When a setting has no JSON form (a number that is not finite).
pub fn remember(config: &mut CheckpointConfig, settings: &Settings) -> Result<(), serde_json::Error> {
    config.meta.insert(SIM.into(), plain(&settings.sim)?);
    config.meta.insert(POLICY.into(), plain(&settings.policy)?);
    Ok(())
}

/// The same for a checkpoint of `scone` or `macarons`, for [`read_scone`] to find.
///
/// # Errors
/// As [`remember`].
pub fn remember_scone(config: &mut SconeDescription, settings: &Settings) -> Result<(), serde_json::Error> {
    config.meta.insert(SIM.into(), plain(&settings.sim)?);
    config.meta.insert(NBV.into(), plain(&settings.nbv)?);
    Ok(())
}

/// A value as JSON for people: `0.13` stays `0.13`, which the direct way to a [`Value`] would widen to the nearest `f64`.
///
/// # Errors
/// When it has no JSON form.
pub fn plain(value: &impl Serialize) -> Result<Value, serde_json::Error> {
    serde_json::from_str(&serde_json::to_string(value)?)
}

/// Settings for the weights that came with the paper, given the shape of their network.
pub fn released(net: &NetConfig) -> Settings {
    let mut settings = Settings::default();
    settings.sim.encode.layers.count = net.layers();
    settings.sim.encode.trajectory = Trajectory::Captures;
    settings.policy.obstacle_threshold = RELEASED_THRESHOLD;
    settings
}

fn settings_of(config: &CheckpointConfig) -> Result<Settings, (&'static str, String)> {
    let mut settings = Settings::default();
    settings.sim.encode.window = config.window;
    settings.sim.encode.layers.count = config.net.layers();
    if let Some(sim) = note(&config.meta, SIM)? {
        settings.sim = sim;
    }
    if let Some(policy) = note(&config.meta, POLICY)? {
        settings.policy = policy;
    }
    settings.sim.validate().map_err(|error| (SIM, error.to_string()))?;
    Ok(settings)
}

fn scone_settings_of(config: &SconeDescription) -> Result<Settings, (&'static str, String)> {
    let mut settings = Settings::default();
    if let Some(sim) = note(&config.meta, SIM)? {
        settings.sim = sim;
    }
    if let Some(nbv) = note(&config.meta, NBV)? {
        settings.nbv = nbv;
    }
    settings.sim.validate().map_err(|error| (SIM, error.to_string()))?;
    settings.nbv.validate().map_err(|error| (NBV, error.to_string()))?;
    Ok(settings)
}

fn note<T: for<'a> Deserialize<'a>>(
    meta: &Map<String, Value>,
    key: &'static str,
) -> Result<Option<T>, (&'static str, String)> {
    let parse = |value: &Value| T::deserialize(value).map_err(|error| (key, error.to_string()));
    meta.get(key).map(parse).transpose()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nbp_env::window::WindowSize;
    use nbp_model::scone::{Scone, SconeConfig};

    fn small() -> CheckpointConfig {
        CheckpointConfig::new(NetConfig { base: 2, ..NetConfig::default() }, WindowSize { pixels: 32, metres: 20.0 })
    }

    fn write(dir: &Path, config: &CheckpointConfig) {
        fs::write(dir.join(CONFIG_FILE), serde_json::to_string(config).unwrap()).unwrap();
        fs::write(dir.join(WEIGHTS_FILE), b"").unwrap();
    }

    #[test]
    fn notes_come_back_and_defaults_take_the_window() {
        let dir = tempfile::tempdir().unwrap();
        write(dir.path(), &small());
        let (_, settings) = read(dir.path()).unwrap();
        assert_eq!(settings.sim.encode.window, small().window);
        assert_eq!(settings.policy, NbpConfig::default());

        let mut mine = Settings::default();
        mine.sim.encode.window = small().window;
        mine.sim.keep = 0.1;
        mine.policy.fuse_observed = true;
        let mut config = small();
        remember(&mut config, &mine).unwrap();
        write(dir.path(), &config);
        assert_eq!(read(&dir.path().join(WEIGHTS_FILE)).unwrap(), (config, mine));
    }

    #[test]
    fn settings_that_the_network_does_not_fit_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        let mut config = small();
        remember(&mut config, &Settings::default()).unwrap();
        write(dir.path(), &config);
        let error = read(dir.path()).unwrap_err().to_string();
        assert!(error.contains("32 pixels over 20 m") && error.contains("256 pixels over 40 m"), "{error}");
        // As many channels, but not the same ones.
        config.window = WindowSize::default();
        let mut sim = SimConfig::default();
        sim.encode.trajectory = Trajectory::Captures;
        let error = check(&config, &sim).unwrap_err().to_string();
        assert!(
            error.contains("trained with sim.encode.trajectory \"key_poses\", but the settings have \"captures\""),
            "{error}"
        );
        let older = serde_json::json!({"encode": {"window": {"pixels": 256, "metres": 40.0}}});
        config.meta.insert(SIM.into(), older);
        assert!(check(&config, &SimConfig::default()).is_ok(), "older notes say less");
        assert!(check(&config, &sim).is_err());
        config.meta.clear();
        assert!(check(&config, &sim).is_ok(), "nobody knows");
        config.meta.insert(SIM.into(), serde_json::json!({"keeep": 0.1}));
        write(dir.path(), &config);
        let error = read(dir.path()).unwrap_err().to_string();
        assert!(error.contains("meta.sim") && error.contains("keeep"), "{error}");
    }

    #[test]
    fn baselines_remember_what_they_are_asked() {
        let dir = tempfile::tempdir().unwrap();
        let net = SconeConfig { width: 16, ..SconeConfig::default() };
        let mut config = SconeDescription::new(Baseline::Macarons, net);
        let nbv = NbvConfig { carving: 5.0, ..NbvConfig::default() };
        let mine = Settings { nbv, ..Settings::default() };
        remember_scone(&mut config, &mine).unwrap();
        let device = DeviceChoice::Flex.resolve().unwrap();
        scone::save(dir.path(), &Scone::new(&net, 1, &device).unwrap(), &config).unwrap();
        assert_eq!(architecture(dir.path()).unwrap(), "macarons");
        assert_eq!(read_scone(&dir.path().join(WEIGHTS_FILE)).unwrap(), (config.clone(), mine));
        assert_eq!(*load_scone(dir.path(), DeviceChoice::Flex).unwrap().predictor.config(), config);
        let error = read(dir.path()).unwrap_err().to_string();
        assert!(error.contains("(macarons), not the nbp network"), "{error}");
        assert!(read_as("macarons", dir.path()).unwrap().0.is_none());
        let error = read_as("scone", dir.path()).unwrap_err().to_string();
        assert!(error.contains("holds the network of macarons, not of scone"), "{error}");

        config.meta.insert(NBV.into(), serde_json::json!({"draws": 0}));
        scone::save(dir.path(), &Scone::new(&net, 1, &device).unwrap(), &config).unwrap();
        let error = read_as("macarons", dir.path()).unwrap_err().to_string();
        assert!(error.contains("meta.nbv cannot be read: draws is 0"), "{error}");
    }

    #[test]
    fn what_is_no_checkpoint_says_what_to_do() {
        let dir = tempfile::tempdir().unwrap();
        let message = |path: &Path| folder(path).unwrap_err().to_string();
        assert!(message(&dir.path().join("nowhere")).contains("no such file"));
        assert!(message(dir.path()).contains("holds no model.safetensors"));
        let pth = dir.path().join("nbp.pth");
        fs::write(&pth, b"").unwrap();
        assert!(message(&pth).contains("infer import"));
        fs::write(dir.path().join(WEIGHTS_FILE), b"").unwrap();
        assert!(message(dir.path()).contains("config.json is missing"));
        assert!(message(&dir.path().join(WEIGHTS_FILE)).contains("config.json is missing"));
    }

    #[test]
    fn the_released_settings_are_those_of_the_released_code() {
        let settings = released(&NetConfig::default());
        assert_eq!(plain(&settings.policy).unwrap()["obstacle_threshold"].to_string(), "0.13");
        assert_eq!(settings.sim.encode.window, WindowSize { pixels: 256, metres: 40.0 });
        assert!(settings.sim.validate().is_ok());
    }
}
