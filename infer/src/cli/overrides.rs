//! `--set sim.keep=0.1`: any setting by its path.

use anyhow::{Context, Result, bail};
use nbp_infer::Settings;
use serde_json::Value;

/// Settings with `KEY=VALUE` overrides applied in order.
pub(super) fn apply(settings: &Settings, overrides: &[String]) -> Result<Settings> {
    let mut tree = serde_json::to_value(settings)?;
    for text in overrides {
        let Some((key, value)) = text.split_once('=') else {
            bail!("--set {text}: write it as KEY=VALUE, for example sim.keep=0.1");
        };
        let at = find(&mut tree, key.trim())?;
        *at = serde_json::from_str(value.trim()).unwrap_or_else(|_| Value::String(value.trim().to_owned()));
        serde_json::from_value::<Settings>(tree.clone()).with_context(|| format!("--set {text}"))?;
    }
    let settings: Settings = serde_json::from_value(tree)?;
    settings.sim.validate()?;
    Ok(settings)
}

fn find<'a>(tree: &'a mut Value, key: &str) -> Result<&'a mut Value> {
    let mut at = tree;
    for part in key.split('.') {
        let known = at.as_object().map(|map| map.keys().cloned().collect::<Vec<_>>().join(", "));
        match at.get_mut(part) {
            Some(next) => at = next,
            None => {
                bail!("--set {key}: there is no {part} here, only {}", known.unwrap_or_else(|| "a plain value".into()))
            }
        }
    }
    Ok(at)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_are_found_by_path_and_mistakes_are_named() {
        let set = |text: &str| apply(&Settings::default(), &[text.to_owned()]);
        assert_eq!(set("sim.coverage.points=50000").unwrap().sim.coverage.points, 50_000);
        assert!(set("policy.fuse_observed=true").unwrap().policy.fuse_observed);
        assert_eq!(set("sim.keep = 0.25").unwrap().sim.keep, 0.25);
        assert_eq!(apply(&Settings::default(), &[]).unwrap(), Settings::default());
        let message = |text: &str| format!("{:#}", set(text).unwrap_err());
        assert!(
            message("sim.keeep=1").contains("camera, captures, colour, coverage, encode, keep"),
            "{}",
            message("sim.keeep=1")
        );
        assert!(message("sim.keep").contains("KEY=VALUE"));
        assert!(message("sim.keep=many").contains("--set sim.keep=many"));
        assert!(message("sim.keep=7").contains("sim.keep is 7"));
        assert!(message("sim.keep.x=7").contains("plain value"));
    }
}
