//! Settings from files and from the command line: `--config a.toml --config b.toml --set sim.keep=0.1`.

use anyhow::{Context, Result, bail};
use nbp_infer::{PolicyKind, Settings};
use serde::Deserialize;
use serde_json::Value;
use std::path::PathBuf;

/// Tables that a training configuration has besides: the same file serves both programs.
const OF_TRAINING: [&str; 8] = ["seed", "device", "scenes", "net", "collect", "curriculum", "optim", "train"];

/// The `[eval]` table of a configuration: what an option of the command line overrules.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct EvalSection {
    pub(super) policies: Option<Vec<PolicyKind>>,
    pub(super) steps: Option<usize>,
    pub(super) starts: Option<usize>,
    /// Of training alone, which has no rows to choose from at its end.
    #[serde(rename = "published")]
    _published: Option<bool>,
}

/// Settings with files stacked left to right and `KEY=VALUE` overrides applied in order.
pub(super) fn apply(settings: &Settings, files: &[PathBuf], overrides: &[String]) -> Result<(Settings, EvalSection)> {
    let (mut tree, mut eval) = (serde_json::to_value(settings)?, serde_json::Map::new());
    for path in files {
        let name = path.display();
        let text = std::fs::read_to_string(path).with_context(|| format!("cannot read the configuration {name}"))?;
        let table: toml::Table = text.parse().with_context(|| format!("{name} is not TOML"))?;
        for (key, value) in table {
            if let Some(key) = not_finite(&key, &value) {
                bail!("{name}: {key} must be a finite number");
            }
            let value = serde_json::to_value(value)?;
            match (key.as_str(), value) {
                ("sim" | "policy" | "search" | "nbv", value) => merge(&mut tree[&key], value),
                ("eval", Value::Object(section)) => eval.extend(section),
                (key, _) if OF_TRAINING.contains(&key) => (),
                _ => bail!(
                    "{name}: there is no {key} in a configuration, only sim, policy, search, nbv, eval and what train reads"
                ),
            }
        }
        tree = spelt_out(tree).with_context(|| format!("the configuration {name}"))?;
    }
    for text in overrides {
        tree = set(tree, text, "--set")?;
    }
    let settings: Settings = serde_json::from_value(tree)?;
    settings.sim.validate()?;
    Ok((settings, serde_json::from_value(Value::Object(eval)).context("[eval] of the configuration")?))
}

/// Settings with assignments `KEY=VALUE` of a row of a bench.
pub(super) fn assign(settings: &Settings, assignments: &[String]) -> Result<Settings> {
    let tree = serde_json::to_value(settings)?;
    let tree = assignments.iter().try_fold(tree, |tree, text| set(tree, text, "set"))?;
    let settings: Settings = serde_json::from_value(tree)?;
    settings.sim.validate()?;
    Ok(settings)
}

fn set(mut tree: Value, text: &str, what: &str) -> Result<Value> {
    let Some((key, value)) = text.split_once('=') else {
        bail!("{what} {text}: write it as KEY=VALUE, for example sim.keep=0.1");
    };
    let at = find(&mut tree, key.trim(), what)?;
    *at = serde_json::from_str(value.trim()).unwrap_or_else(|_| Value::String(value.trim().to_owned()));
    spelt_out(tree).with_context(|| format!("{what} {text}"))
}

/// A table of a configuration as assignments below `key`; a table that says which kind or rule it is stays whole.
pub(super) fn assignments(key: &str, value: &toml::Value) -> Result<Vec<String>> {
    if let Some(key) = not_finite(key, value) {
        bail!("{key} must be a finite number");
    }
    match value {
        toml::Value::Table(table) if !table.contains_key("kind") && !table.contains_key("rule") => {
            let below = |(name, value): (&String, &toml::Value)| assignments(&below(key, name), value);
            Ok(table.iter().map(below).collect::<Result<Vec<_>>>()?.concat())
        }
        value => Ok(vec![format!("{key}={}", serde_json::to_value(value)?)]),
    }
}

/// The key of a value in the table of another.
fn below(key: &str, name: &str) -> String {
    if key.is_empty() { name.to_owned() } else { format!("{key}.{name}") }
}

/// The same settings with every default written down, so that the next override finds its key.
fn spelt_out(tree: Value) -> Result<Value> {
    let spelt = serde_json::to_value(serde_json::from_value::<Settings>(tree.clone())?)?;
    match too_large("", &tree, &spelt) {
        Some((key, number)) => bail!("{key} is {number:e}, which is too large"),
        None => Ok(spelt),
    }
}

/// The key of a number that is infinite or none.
fn not_finite(key: &str, value: &toml::Value) -> Option<String> {
    match value {
        toml::Value::Float(number) if !number.is_finite() => Some(key.to_owned()),
        toml::Value::Table(table) => table.iter().find_map(|(name, value)| not_finite(&below(key, name), value)),
        _ => None,
    }
}

/// The key of a number that `f32` cannot hold: it was read as infinite, and JSON has no word for that.
fn too_large(key: &str, given: &Value, read: &Value) -> Option<(String, f64)> {
    match (given, read) {
        (Value::Number(number), Value::Null) => Some((key.to_owned(), number.as_f64()?)),
        (Value::Object(given), Value::Object(read)) => {
            given.iter().find_map(|(name, value)| too_large(&below(key, name), value, read.get(name)?))
        }
        _ => None,
    }
}

/// Tables merge key by key, everything else is replaced; so is a table that says which kind or rule it is, whose keys
/// depend on that.
fn merge(base: &mut Value, over: Value) {
    match (base, over) {
        (Value::Object(base), Value::Object(over)) if !over.contains_key("kind") && !over.contains_key("rule") => {
            over.into_iter().for_each(|(key, value)| merge(base.entry(key).or_insert(Value::Null), value));
        }
        (base, over) => *base = over,
    }
}

fn find<'a>(tree: &'a mut Value, key: &str, what: &str) -> Result<&'a mut Value> {
    let mut at = tree;
    for part in key.split('.') {
        let known = at.as_object().map(|map| map.keys().cloned().collect::<Vec<_>>().join(", "));
        match at.get_mut(part) {
            Some(next) => at = next,
            None => {
                bail!("{what} {key}: there is no {part} here, only {}", known.unwrap_or_else(|| "a plain value".into()))
            }
        }
    }
    Ok(at)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nbp_env::{Agent, MotionConfig};

    #[test]
    fn settings_are_found_by_path_and_mistakes_are_named() {
        let set = |text: &str| apply(&Settings::default(), &[], &[text.to_owned()]).map(|(settings, _)| settings);
        assert_eq!(set("sim.coverage.points=50000").unwrap().sim.coverage.points, 50_000);
        assert!(set("policy.fuse_observed=true").unwrap().policy.fuse_observed);
        assert_eq!(set("sim.keep = 0.25").unwrap().sim.keep, 0.25);
        assert_eq!(apply(&Settings::default(), &[], &[]).unwrap().0, Settings::default());
        let message = |text: &str| format!("{:#}", set(text).unwrap_err());
        assert!(
            message("sim.keeep=1").contains("agent, camera, captures, colour, coverage, encode, keep"),
            "{}",
            message("sim.keeep=1")
        );
        assert!(message("sim.keep").contains("KEY=VALUE"));
        assert!(message("sim.keep=many").contains("--set sim.keep=many"));
        assert!(message("sim.keep=7").contains("sim.keep is 7"));
        assert!(message("sim.keep.x=7").contains("plain value"));
        let row = toml::toml! { nbv.carving = nan };
        let error = assignments("", &toml::Value::Table(row)).unwrap_err().to_string();
        assert_eq!(error, "nbv.carving must be a finite number");
        assert!(message("sim.camera.hfov_degrees=1e39").contains("sim.camera.hfov_degrees is 1e39"));
    }

    #[test]
    fn files_stack_and_the_tables_of_training_are_left_alone() {
        let folder = tempfile::tempdir().unwrap();
        let read = |texts: &[&str], overrides: &[&str]| {
            let path = |(n, text): (usize, &&str)| {
                let path = folder.path().join(format!("{n}.toml"));
                std::fs::write(&path, text).unwrap();
                path
            };
            let files: Vec<PathBuf> = texts.iter().enumerate().map(path).collect();
            apply(&Settings::default(), &files, &overrides.iter().map(|&o| o.to_owned()).collect::<Vec<_>>())
        };
        let first = "seed = 3\n[sim.agent]\nkind = 'continuous'\nforward = 0.25\n[eval]\nsteps = 7\nstarts = 2\n[train]\nbatch = 9";
        let second = "[sim.agent]\nturn_degrees = 15\n[eval]\nsteps = 9";
        let (settings, eval) = read(&[first, second], &["sim.agent.radius=0.1"]).unwrap();
        let motions = MotionConfig { forward: 0.25, turn_degrees: 15.0, radius: 0.1, ..MotionConfig::default() };
        assert_eq!(settings.sim.agent, Agent::Continuous(motions));
        assert_eq!((eval.steps, eval.starts, eval.policies), (Some(9), Some(2), None));
        let back = read(&[first, "[sim.agent]\nkind = 'lattice'"], &[]).unwrap().0;
        assert_eq!(back, Settings::default());
        let message = |text: &str| format!("{:#}", read(&[text], &[]).unwrap_err());
        assert!(message("[sim]\nkeeep = 1").contains("keeep"), "{}", message("[sim]\nkeeep = 1"));
        assert!(message("[simm]\nkeep = 1").contains("0.toml: there is no simm"));
        assert!(message("[eval]\nstep = 1").contains("step"));
        assert!(message("[sim.agent]\nkind = 'flying'").contains("flying"));
        assert!(message("sim = ").contains("0.toml is not TOML"));
    }
}
