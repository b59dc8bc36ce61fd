//! What is compared on what: the configuration of a bench, and what the command line changes of it.

use super::limits::{MOST_MAPS, MOST_SEEDS, MOST_STARTS, check_count, check_names};
use super::store::Published;
use crate::checkpoint;
use crate::registry::{PolicyKind, RegistryError};
use crate::rollout::MOST_STEPS;
use crate::source::{self, Source, SourceError};
use nbp_dataset::Level;
use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Data sets × rows, as in `configs/bench`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BenchConfig {
    /// The first so many starts of each scene (paper: 5), the same for all rows.
    pub starts: usize,
    /// First seed of the episodes.
    pub seed: u64,
    /// Name of the row that all others are compared with.
    pub reference: String,
    /// Measure how much of each scene can be seen at all, and show coverage as a share of it: up to half a minute a scene.
    pub visible: bool,
    /// Measure coverage a second time as the released code counts it, in every fifth step. Nothing else depends on it.
    pub released: bool,
    /// Folder that relative `paths` of data sets start from.
    pub maps: PathBuf,
    /// Settings of the simulator as in `[sim]` of other configurations. They hold for every row, checkpoints' own included.
    pub sim: toml::Table,
    /// Data sets, in the order of the tables.
    pub data: Vec<DataConfig>,
    /// Rows, in the order of the tables.
    pub policies: Vec<RowConfig>,
}

impl Default for BenchConfig {
    fn default() -> Self {
        Self {
            starts: 5,
            seed: 0,
            reference: "fbe".into(),
            visible: true,
            released: true,
            maps: PathBuf::new(),
            sim: toml::Table::new(),
            data: Vec::new(),
            policies: Vec::new(),
        }
    }
}

/// A data set: generated maps or scenes on disk.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DataConfig {
    /// In tables and file names.
    pub name: String,
    /// Steps of an episode (paper: 100, 200, 400, 500 from Simple to Insane).
    pub steps: usize,
    /// What [`LEVEL`] in a row's checkpoint stands for on this data set: simple, normal, hard or insane. If left out, the level of
    /// `generate`, or the one that the data set is called after.
    pub level: Option<String>,
    /// Maps made from seeds.
    pub generate: Option<Generate>,
    /// Scene folders, OBJ files, WADs, single maps as FILE.wad:MAP01, folders of these.
    pub paths: Vec<String>,
    /// Of the scenes found, only these: names of maps in WADs, else of files or folders. Each must be found once.
    pub only: Vec<String>,
    /// Leave out the last so many scenes.
    pub drop_last: usize,
    /// Of the rest, only the last so many.
    pub last: Option<usize>,
    /// Published figures, by the name of a row; those of rows that are not there are left out.
    pub paper: BTreeMap<String, Published>,
}

/// Generated maps: `count` of them from `seed` on.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Generate {
    /// simple, normal, hard or insane.
    pub level: String,
    /// How many.
    pub count: usize,
    /// Of the first one. Training maps have seeds from 1 on, held-out ones from 1,000,001 on.
    pub seed: u64,
}

/// In the path of a row's checkpoint: each data set's level.
pub const LEVEL: &str = "{level}";

/// A row of the tables.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RowConfig {
    /// In tables and file names.
    pub name: String,
    /// Kind of policy; the one of this name if left out.
    pub policy: Option<String>,
    /// Checkpoint folder, for policies that ask a network. Its settings hold for the row. [`LEVEL`] in it stands for each data set's
    /// [`DataConfig::level`]: a network for each level, as the paper has it, all of them with the same settings.
    pub checkpoint: Option<PathBuf>,
    /// Take the obstacle map from another checkpoint: networks that learnt one task each.
    pub obstacle_checkpoint: Option<PathBuf>,
    /// Episodes from each start, each with a seed of its own: 5 for policies that draw by chance.
    pub seeds: usize,
    /// Settings on top of the checkpoint's, as `"policy.obstacle_threshold" = 0.13`.
    pub set: toml::Table,
}

impl Default for RowConfig {
    fn default() -> Self {
        Self {
            name: String::new(),
            policy: None,
            checkpoint: None,
            obstacle_checkpoint: None,
            seeds: 1,
            set: toml::Table::new(),
        }
    }
}

/// What the command line changes of a configuration.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Choices {
    /// Data sets to replace or to add: name and paths.
    pub data: Vec<(String, Vec<String>)>,
    /// The only data sets.
    pub sets: Vec<String>,
    /// The only rows.
    pub policies: Vec<String>,
    /// Checkpoints: of a row, or of all rows that ask the network of NextBestPath.
    pub checkpoints: Vec<(Option<String>, PathBuf)>,
    /// Row to compare with.
    pub reference: Option<String>,
    /// Folder of maps.
    pub maps: Option<PathBuf>,
    /// Steps, of one data set or of all.
    pub steps: Vec<(Option<String>, usize)>,
    /// Seeds of every row.
    pub seeds: Option<usize>,
    /// Starts.
    pub starts: Option<usize>,
    /// First of the seeds.
    pub seed: Option<u64>,
}

/// A configuration that makes no bench.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// Not the TOML that is wanted.
    #[error("{0}")]
    Toml(#[from] toml::de::Error),
    /// No such policy.
    #[error("row {row}: {source}")]
    Kind {
        /// Row.
        row: String,
        /// Why.
        source: RegistryError,
    },
    /// A data set's scenes.
    #[error("data set {set}: {source}")]
    Source {
        /// Data set.
        set: String,
        /// Why.
        source: Box<SourceError>,
    },
    /// Anything else.
    #[error("{0}")]
    Wrong(String),
}

impl From<String> for ConfigError {
    fn from(message: String) -> Self {
        Self::Wrong(message)
    }
}

fn wrong<T>(message: impl Into<String>) -> Result<T, ConfigError> {
    Err(ConfigError::Wrong(message.into()))
}

/// A path with the level of a data set in it, if it asks for one.
fn on_level(path: &Path, set: &DataConfig) -> Result<PathBuf, ConfigError> {
    match (path.to_str().filter(|text| text.contains(LEVEL)), set.level()) {
        (None, _) => Ok(path.to_owned()),
        (Some(text), Some(level)) => Ok(text.replace(LEVEL, level).into()),
        (Some(text), None) => wrong(format!(
            "{text} is a network for each level, and data set {} has none: give it one in the configuration (level = \"normal\") or \
             the row one network (--checkpoint ROW=DIR)",
            set.name
        )),
    }
}

impl RowConfig {
    /// Its checkpoint and the one of its obstacle map on a data set, as far as it names them.
    ///
    /// # Errors
    /// When they are of a level, and the data set of none.
    pub fn checkpoints_on(&self, set: &DataConfig) -> Result<[Option<PathBuf>; 2], ConfigError> {
        let on = |path: &Option<PathBuf>| path.as_ref().map(|path| on_level(path, set)).transpose();
        Ok([on(&self.checkpoint)?, on(&self.obstacle_checkpoint)?])
    }

    /// Its kind of policy.
    ///
    /// # Errors
    /// When there is none of that name.
    pub fn kind(&self) -> Result<PolicyKind, ConfigError> {
        let kind = self.policy.as_ref().unwrap_or(&self.name).parse();
        kind.map_err(|source| ConfigError::Kind { row: self.name.clone(), source })
    }
}

impl BenchConfig {
    /// Reads and checks configurations, of which later ones replace what they name in earlier ones.
    ///
    /// # Errors
    /// Naming the line or the field.
    pub fn parse(texts: &[impl AsRef<str>]) -> Result<Self, ConfigError> {
        let (mut all, mut rows) = (toml::Table::new(), BTreeSet::new());
        for text in texts {
            // By itself first: there, a mistake has a line.
            let own: Self = toml::from_str(text.as_ref())?;
            if !own.policies.is_empty() {
                rows = own.policies.into_iter().map(|row| row.name).collect();
            }
            // Rows that another file takes away later are no mistake of this one.
            own.data.iter().try_for_each(|set| set.check_paper(&rows))?;
            all.extend(text.as_ref().parse::<toml::Table>()?);
        }
        Ok(all.try_into()?)
    }

    /// The same with what the command line says.
    ///
    /// # Errors
    /// When it names a row or data set that is not there, or what is left makes no bench.
    pub fn choose(mut self, choices: &Choices) -> Result<Self, ConfigError> {
        self.maps = choices.maps.clone().unwrap_or(self.maps);
        for (number, (name, paths)) in choices.data.iter().enumerate() {
            let is_more = choices.data[..number].iter().any(|(other, _)| other == name);
            // Such paths are relative to where the command is given.
            let here =
                |path: &String| std::path::absolute(path).map_or(path.clone(), |path| path.display().to_string());
            let paths: Vec<String> = paths.iter().map(here).collect();
            match self.data.iter_mut().find(|set| set.name == *name) {
                Some(set) if is_more => set.paths.extend(paths),
                Some(set) => {
                    set.level = set.level().map(str::to_owned);
                    (set.generate, set.paths) = (None, paths);
                }
                None => self.data.push(DataConfig { name: name.clone(), paths, ..DataConfig::default() }),
            }
        }
        let names: Vec<String> = self.data.iter().map(|set| set.name.clone()).collect();
        known("data set", &choices.sets, &names)?;
        self.data.retain(|set| choices.sets.is_empty() || choices.sets.contains(&set.name));
        for (name, steps) in &choices.steps {
            known("data set", name.as_slice(), &names)?;
            let meant = |set: &&mut DataConfig| name.as_ref().is_none_or(|name| *name == set.name);
            self.data.iter_mut().filter(meant).for_each(|set| set.steps = *steps);
        }
        let names: Vec<String> = self.policies.iter().map(|row| row.name.clone()).collect();
        known("row", &choices.policies, &names)?;
        self.policies.retain(|row| choices.policies.is_empty() || choices.policies.contains(&row.name));
        for (name, path) in &choices.checkpoints {
            known("row", name.as_slice(), &names)?;
            // Without a name, for the rows of its network; if there are none, for all, which will say so.
            let one = self.data.iter().find_map(|set| on_level(path, set).ok());
            let architecture = one.and_then(|path| checkpoint::architecture(&path).ok());
            let asks = |row: &RowConfig| row.kind().is_ok_and(|kind| kind.architecture() == architecture.as_deref());
            let is_asked = architecture.is_some() && self.policies.iter().any(asks);
            for row in &mut self.policies {
                let is_meant = match name {
                    Some(name) => *name == row.name,
                    None if is_asked => asks(row),
                    None => row.kind()?.needs_network(),
                };
                if is_meant {
                    row.checkpoint = Some(path.clone());
                }
            }
        }
        let rows: BTreeSet<&String> = self.policies.iter().map(|row| &row.name).collect();
        self.data.iter_mut().for_each(|set| set.paper.retain(|row, _| rows.contains(row)));
        self.reference = choices.reference.clone().unwrap_or(self.reference);
        self.starts = choices.starts.unwrap_or(self.starts);
        self.seed = choices.seed.unwrap_or(self.seed);
        self.policies.iter_mut().for_each(|row| row.seeds = choices.seeds.unwrap_or(row.seeds));
        self.check()?;
        Ok(self)
    }

    fn check(&self) -> Result<(), ConfigError> {
        if self.data.is_empty() || self.policies.is_empty() {
            return wrong(
                "a bench needs at least one [[data]] and one [[policies]]: where a configuration has only one of them, give another \
                 before it (--config configs/bench/aimdoom.toml --config FILE)",
            );
        }
        check_count("starts", self.starts, MOST_STARTS)?;
        check_names("data sets", self.data.iter().map(|set| set.name.as_str()))?;
        check_names("rows", self.policies.iter().map(|row| row.name.as_str()))?;
        for row in &self.policies {
            row.kind()?;
            check_count(&format!("row {}: seeds", row.name), row.seeds, MOST_SEEDS)?;
        }
        if !self.policies.iter().any(|row| row.name == self.reference) {
            let rows: Vec<&str> = self.policies.iter().map(|row| row.name.as_str()).collect();
            let (reference, rows) = (&self.reference, rows.join(", "));
            return wrong(format!(
                "the reference {reference} is no row: name one of {rows} (reference, or --reference NAME)"
            ));
        }
        self.data.iter().try_for_each(DataConfig::check)
    }
}

/// Whether all of `chosen` are among `names`.
fn known(what: &str, chosen: &[String], names: &[String]) -> Result<(), ConfigError> {
    match chosen.iter().find(|name| !names.contains(name)) {
        Some(name) => wrong(format!("no {what} is called {name}, only {}", names.join(", "))),
        None => Ok(()),
    }
}

/// Where a scene of a data set comes from.
#[derive(Clone, Debug, PartialEq)]
pub enum Origin {
    /// Maps made from seeds.
    Generated(Level, Vec<u64>),
    /// Scenes on disk.
    Found(Vec<Source>),
}

impl DataConfig {
    /// What it stands in for [`LEVEL`], if anything does.
    pub fn level(&self) -> Option<&str> {
        let generated = self.generate.as_ref().map(|generate| &generate.level);
        let named = Some(&self.name).filter(|name| name.parse::<Level>().is_ok());
        self.level.as_ref().or(generated).or(named).map(String::as_str)
    }

    /// Figures must be shares, and those of `rows` where these are known.
    fn check_paper(&self, rows: &BTreeSet<String>) -> Result<(), ConfigError> {
        for (row, paper) in &self.paper {
            if !rows.is_empty() && !rows.contains(row) {
                return wrong(format!("data set {}: paper names {row}, which is no row", self.name));
            }
            if let Some((key, value)) = paper.outside() {
                return wrong(format!(
                    "data set {}: {key} of paper.{row} is {value}: it must be from 0 to 1",
                    self.name
                ));
            }
        }
        Ok(())
    }

    fn check(&self) -> Result<(), ConfigError> {
        let set = &self.name;
        if self.steps == 0 {
            return wrong(format!("data set {set}: steps are missing or 0 (steps = 100, or --steps {set}=100)"));
        }
        check_count(&format!("data set {set}: steps"), self.steps, MOST_STEPS)?;
        self.level().map(str::parse::<Level>).transpose().map_err(|reason| format!("data set {set}: {reason}"))?;
        let chooses = !self.only.is_empty() || self.drop_last > 0 || self.last.is_some();
        match &self.generate {
            Some(_) if chooses => wrong(format!(
                "data set {set} has only, last or drop_last beside generate: they choose among paths, count and seed say which \
                 maps are generated"
            )),
            Some(_) if !self.paths.is_empty() => wrong(format!("data set {set} has both generate and paths: take one")),
            Some(generate) => Ok(check_count(&format!("data set {set}: generate.count"), generate.count, MOST_MAPS)?),
            None if self.paths.is_empty() => {
                wrong(format!("data set {set} has no scenes: give generate or paths (--data {set}=FOLDER)"))
            }
            _ => Ok(()),
        }
    }

    /// Its scenes, none of which is read yet; relative paths start from `maps`.
    ///
    /// # Errors
    /// When there are none, or not those that are asked for.
    pub fn origin(&self, maps: &Path) -> Result<Origin, ConfigError> {
        let set = &self.name;
        if let Some(Generate { level, count, seed }) = &self.generate {
            let level = level.parse().map_err(|reason: String| format!("data set {set}: {reason}"))?;
            return Ok(Origin::Generated(level, (0..*count as u64).map(|n| seed.wrapping_add(n)).collect()));
        }
        let paths: Vec<String> = self.paths.iter().map(|path| maps.join(path).display().to_string()).collect();
        let found = source::find_all(&paths)
            .map_err(|source| ConfigError::Source { set: set.clone(), source: Box::new(source) })?;
        let found = self.select(found)?;
        if found.is_empty() { wrong(format!("data set {set} has no scenes")) } else { Ok(Origin::Found(found)) }
    }

    fn select(&self, mut found: Vec<Source>) -> Result<Vec<Source>, ConfigError> {
        let set = &self.name;
        for name in &self.only {
            let count = found.iter().filter(|source| source.label().eq_ignore_ascii_case(name)).count();
            if count != 1 {
                return wrong(format!("data set {set}: {count} scenes are called {name}, there must be one"));
            }
        }
        found.retain(|source| {
            self.only.is_empty() || self.only.iter().any(|name| source.label().eq_ignore_ascii_case(name))
        });
        let count = found.len();
        let wanted = self.drop_last + self.last.unwrap_or(0);
        if wanted > count {
            return wrong(format!(
                "data set {set} holds {count} scenes, fewer than its last and drop_last ask for ({wanted})"
            ));
        }
        found.truncate(count - self.drop_last);
        Ok(self.last.map_or(found.clone(), |last| found.split_off(found.len() - last)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SMALL: &str = "reference = 'fbe'\n[[data]]\nname = 'simple'\nsteps = 10\n\
        generate = { level = 'simple', count = 2, seed = 9 }\n\
        [[policies]]\nname = 'fbe'\n[[policies]]\nname = 'chance'\npolicy = 'random'\nseeds = 5\n\
        [[policies]]\nname = 'nbp'\n[[policies]]\nname = 'nbp-mine'\npolicy = 'nbp'\ncheckpoint = 'mine'";

    fn small() -> BenchConfig {
        BenchConfig::parse(&[SMALL]).unwrap()
    }

    #[test]
    fn the_command_line_chooses_and_adds() {
        let choices = Choices {
            data: [("simple", "/a"), ("mine", "/b"), ("mine", "/c")]
                .map(|(set, path)| (set.into(), vec![path.into()]))
                .into(),
            steps: vec![(None, 7), (Some("mine".into()), 9)],
            policies: vec!["nbp".into(), "fbe".into(), "nbp-mine".into()],
            checkpoints: vec![(None, "all".into()), (Some("nbp-mine".into()), "one".into())],
            seeds: Some(3),
            starts: Some(2),
            ..Choices::default()
        };
        let chosen = small().choose(&choices).unwrap();
        assert_eq!((chosen.data[0].generate.as_ref(), chosen.data[0].steps, chosen.data[1].steps), (None, 7, 9));
        assert_eq!(
            (&chosen.data[0].paths[..], &chosen.data[1].paths[..]),
            (&["/a".into()][..], &["/b".into(), "/c".into()][..])
        );
        let rows: Vec<_> =
            chosen.policies.iter().map(|row| (row.name.as_str(), row.checkpoint.as_deref(), row.seeds)).collect();
        let path = |path: &'static str| Some(Path::new(path));
        assert_eq!(
            rows,
            [("fbe", None, 3), ("nbp", path("all"), 3), ("nbp-mine", path("one"), 3)],
            "in the file's order"
        );
        assert_eq!(chosen.starts, 2);
    }

    #[test]
    fn what_makes_no_bench_is_refused_by_name() {
        let resolve = |text: &str, choices: &Choices| BenchConfig::parse(&[text])?.choose(choices);
        let parse =
            |from: &str, to: &str| resolve(&SMALL.replace(from, to), &Choices::default()).unwrap_err().to_string();
        assert!(parse("seeds = 5", "seed = 5").contains("unknown field `seed`"));
        assert!(parse("policy = 'random'", "").contains("row chance: no policy is called `chance`"));
        assert!(
            parse("reference = 'fbe'", "reference = 'fb'").contains("reference fb is no row: name one of fbe, chance")
        );
        assert!(parse("name = 'chance'", "name = 'FBE'").contains("two rows are called FBE"));
        assert!(parse("name = 'simple'", "").contains("data sets has no name"));
        assert!(parse("steps = 10", "").contains("data set simple: steps are missing or 0"));
        assert!(parse("steps = 10", "steps = 10\npaths = ['a']").contains("both generate and paths"));
        assert!(parse("generate", "#generate").contains("--data simple=FOLDER"));
        assert!(parse("count = 2", "count = 0").contains("data set simple: generate.count is 0"));
        assert!(parse("seeds = 5", "seeds = 0").contains("row chance: seeds is 0"));
        for (from, to, says) in [
            ("steps = 10", "steps = 10\nlast = 1", "data set simple has only, last or drop_last beside generate"),
            ("steps = 10", "steps = 10\nonly = ['a']", "data set simple has only, last or drop_last beside generate"),
            ("steps = 10", "steps = 10\ndrop_last = 1", "data set simple has only, last or drop_last beside generate"),
            ("seeds = 5", "seeds = 1000000000000", "row chance: seeds is 1000000000000: it must be at most 10000"),
            (
                "steps = 10",
                "steps = 1000000000000",
                "data set simple: steps is 1000000000000: it must be at most 100000",
            ),
            ("count = 2", "count = 1000000000000", "data set simple: generate.count is 1000000000000"),
            ("reference", "starts = 1000000000000\nreference", "starts is 1000000000000: it must be at most 65535"),
        ] {
            assert!(parse(from, to).contains(says), "{}", parse(from, to));
        }
        assert!(
            parse("steps = 10", "steps = 10\npaper.nbpp = { coverage = 1, auc = 1 }").contains("nbpp, which is no row")
        );
        for (wrong, says) in [
            ("coverage = nan, auc = 0.5", "data set simple: coverage of paper.fbe is NaN: it must be from 0 to 1"),
            ("coverage = 0.5, auc = inf", "auc of paper.fbe is inf"),
            ("coverage = 0.5, auc = 0.5, coverage_std = 76.0", "coverage_std of paper.fbe is 76"),
            ("coverage = 0.5, auc = 0.5, auc_std = -0.1", "auc_std of paper.fbe is -0.1"),
        ] {
            let error = parse("steps = 10", &format!("steps = 10\npaper.fbe = {{ {wrong} }}"));
            assert!(error.contains(says), "{error}");
        }
        assert!(resolve("", &Choices::default()).unwrap_err().to_string().contains("at least one [[data]]"));
        // What a message advises to say on the command line helps.
        for (from, to, choices) in [
            (
                "reference = 'fbe'",
                "reference = 'fb'",
                Choices { reference: Some("chance".into()), ..Choices::default() },
            ),
            ("steps = 10", "", Choices { steps: vec![(Some("simple".into()), 7)], ..Choices::default() }),
            ("generate", "#", Choices { data: vec![("simple".into(), vec!["/a".into()])], ..Choices::default() }),
        ] {
            let text = SMALL.replacen(from, to, 1);
            assert!(resolve(&text, &Choices::default()).is_err() && resolve(&text, &choices).is_ok(), "{from}");
        }
        let choose = |choices: Choices| small().choose(&choices).unwrap_err().to_string();
        let rows = || Choices { policies: vec!["fbi".into()], ..Choices::default() };
        assert!(choose(rows()).contains("no row is called fbi, only fbe, chance, nbp, nbp-mine"));
        assert!(choose(Choices { sets: rows().policies, ..Choices::default() }).contains("no data set is called fbi"));
        assert!(
            choose(Choices { policies: vec!["nbp".into()], ..Choices::default() }).contains("reference fbe is no row")
        );
        assert!(
            choose(Choices { data: vec![("new".into(), vec!["/a".into()])], ..Choices::default() })
                .contains("--steps new=100")
        );
        assert!(choose(Choices { starts: Some(0), ..Choices::default() }).contains("starts is 0"));
    }

    #[test]
    fn later_configurations_replace_what_they_name() {
        let data = "starts = 3\n[[data]]\nname = 'other'\nsteps = 5\npaths = ['x']";
        let both = BenchConfig::parse(&[SMALL, data]).unwrap();
        assert_eq!((both.starts, both.data.len(), both.data[0].name.as_str(), both.policies.len()), (3, 1, "other", 4));
        // Figures of rows that a later file takes away are left out; a name that no row has had is a mistake.
        let paper = "steps = 10\npaper.nbp = { coverage = 0.5, auc = 0.5 }";
        let figures = SMALL.replace("steps = 10", paper);
        let rows = "[[policies]]\nname = 'fbe'";
        let config = BenchConfig::parse(&[figures.as_str(), rows]).unwrap();
        assert!(config.choose(&Choices::default()).unwrap().data[0].paper.is_empty());
        let data = data.replace("steps = 5", paper);
        let chosen = |texts: &[&str]| BenchConfig::parse(texts)?.choose(&Choices::default());
        assert!(chosen(&[SMALL, &data]).unwrap().data[0].paper.contains_key("nbp"));
        assert!(chosen(&[&data, rows]).unwrap().data[0].paper.is_empty());
        let error = chosen(&[SMALL, &data.replace("nbp", "nbpp")]).unwrap_err().to_string();
        assert!(error.contains("data set other: paper names nbpp, which is no row"), "{error}");
        let error = BenchConfig::parse(&[SMALL, "start = 3"]).unwrap_err().to_string();
        assert!(error.contains("line 1") && error.contains("unknown field `start`"), "{error}");
    }

    #[test]
    fn scenes_are_selected_from_the_end_or_by_name() {
        let map = |map: &str| Source::Map { wad: "a.wad".into(), map: map.into() };
        let all = || (1..=8).map(|n| map(&format!("MAP0{n}"))).collect::<Vec<_>>();
        let set = |only: &[&str], drop_last, last| DataConfig {
            name: "x".into(),
            only: only.iter().map(|&name| name.to_owned()).collect(),
            drop_last,
            last,
            ..DataConfig::default()
        };
        assert_eq!(set(&[], 0, Some(2)).select(all()).unwrap(), [map("MAP07"), map("MAP08")]);
        assert_eq!(set(&[], 2, Some(1)).select(all()).unwrap(), [map("MAP06")]);
        assert_eq!(set(&["map02", "MAP05"], 0, None).select(all()).unwrap(), [map("MAP02"), map("MAP05")]);
        let message = |set: DataConfig| set.select(all()).unwrap_err().to_string();
        assert!(message(set(&["MAP09"], 0, None)).contains("0 scenes are called MAP09"));
        assert!(message(set(&[], 3, Some(6))).contains("holds 8 scenes, fewer"));
        let nowhere = DataConfig { paths: vec!["nowhere".into()], ..set(&[], 0, None) };
        let error = nowhere.origin(Path::new("/maps")).unwrap_err().to_string();
        assert!(error.contains("data set x: there is no /maps/nowhere"), "{error}");
    }
}
