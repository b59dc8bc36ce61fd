//! `infer bench`: rows of policies on data sets, resumable and in shards.

use super::output::Output;
use super::overrides;
use super::setup;
use super::talk::Talk;
use super::usage;
use anyhow::{Context, Result, bail};
use nbp_dataset::SceneBundle;
use nbp_env::explain::show;
use nbp_env::scene::LoadOptions;
use nbp_env::{Scene, parallel};
use nbp_infer::bench::config::{BenchConfig, Choices, DataConfig, Origin, RowConfig};
use nbp_infer::bench::plan::{self, DataSet, Row, Survey, Terms, Weights};
use nbp_infer::bench::run::{self, Measures, Place, Runner};
use nbp_infer::bench::store::{self, BenchError, FileKey};
use nbp_infer::bench::{BenchResult, Manifest, tables};
use nbp_infer::{PolicyKind, Settings, checkpoint, report, source};
use nbp_model::{CheckpointConfig, DeviceChoice};
use std::collections::BTreeSet;
use std::collections::btree_map::{BTreeMap, Entry};
use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::atomic::{AtomicUsize, Ordering};

const EXAMPLES: &str = "\
Examples:
  infer bench --config configs/bench/aimdoom.toml --out out/bench
  infer bench --config configs/bench/aimdoom.toml --out out/quick --policies random,fbe --sets simple --starts 1
  infer bench --config configs/bench/aimdoom.toml --config configs/bench/obsidian.toml --maps maps --out out/obsidian
  infer bench --config configs/bench/aimdoom.toml --checkpoint nbp=runs/mine/checkpoints/best --out out/mine
  infer bench --config configs/bench/aimdoom.toml --data simple=maps/a,maps/b --out out/mine
  infer bench --config configs/bench/aimdoom.toml --out out/bench --shard 1/2
  infer bench --config configs/bench/aimdoom.toml --out out/bench --shard 2/2
  infer bench --merge --out out/bench

OUT/cells has one file for each row in each scene of each data set, written as its last episode ends. The same command goes on
where it stopped; what is damaged is computed again, and what was computed with other settings, scenes, networks or programs is
too if --replace says so. Shards may run at the same time, on one machine or on several that share OUT. Whoever computes the
last cell writes report.html, summary.md, summary.json, episodes.csv, curves.csv and figures (SVG), whose bytes are the same in
every order, and timing.csv. Times of decisions are what a clock says: measure them with --threads 1 on a machine that does nothing else.";

/// Options of `infer bench`.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct Args {
    /// What is compared on what (TOML), as in configs/bench; later files replace what they name in earlier ones
    #[arg(long, value_name = "FILE", required_unless_present = "merge")]
    config: Vec<PathBuf>,
    /// Folder of the bench; a second call goes on where the first stopped
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Scenes of a data set, in place of the configuration's or as a further set: folders, OBJ files, WADs, FILE.wad:MAP01
    #[arg(long, value_name = "NAME=PATH,…", value_parser = named_paths)]
    data: Vec<(String, Vec<String>)>,
    /// Only these data sets
    #[arg(long, value_delimiter = ',', value_name = "NAMES")]
    sets: Vec<String>,
    /// Folder that the relative paths of data sets start from, in place of the configuration's
    #[arg(long, value_name = "DIR")]
    maps: Option<PathBuf>,
    /// Only these rows
    #[arg(long, value_delimiter = ',', value_name = "NAMES")]
    policies: Vec<String>,
    /// Row that the others are compared with
    #[arg(long, value_name = "NAME")]
    reference: Option<String>,
    /// Checkpoint of a row, or of all rows that ask the network of nbp; {level} in it stands for that of each data set
    #[arg(long, value_name = "[ROW=]DIR", value_parser = maybe_named::<PathBuf>)]
    checkpoint: Vec<(Option<String>, PathBuf)>,
    /// Steps of an episode, on one data set or on all
    #[arg(long, value_name = "[NAME=]N", value_parser = maybe_named::<usize>)]
    steps: Vec<(Option<String>, usize)>,
    /// Episodes from each start, for all rows
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=10_000))]
    seeds: Option<u16>,
    /// The first of the seeds
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Only the first so many starts of each scene
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    starts: Option<u16>,
    /// Only this part of the work, from 1/N to N/N
    #[arg(long, value_name = "I/N", conflicts_with = "merge")]
    shard: Option<Shard>,
    /// Compute nothing: write the tables of what all shards have computed
    #[arg(long)]
    merge: bool,
    /// Compute again what OUT has of other settings, scenes, networks or programs
    #[arg(long, conflicts_with = "merge")]
    replace: bool,
}

/// One part of the work, from 0.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Shard {
    number: usize,
    count: usize,
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parse = || {
            let (number, count) = text.split_once('/')?;
            Some((number.parse::<usize>().ok()?, count.parse::<usize>().ok()?))
        };
        match parse() {
            Some((number, count)) if (1..=count).contains(&number) => Ok(Self { number: number - 1, count }),
            _ => Err("write it as I/N with I from 1 to N, for example 1/2".into()),
        }
    }
}

fn named_paths(text: &str) -> Result<(String, Vec<String>), String> {
    match text.split_once('=') {
        Some((name, paths)) if !name.is_empty() && !paths.is_empty() => {
            Ok((name.to_owned(), paths.split(',').filter(|path| !path.is_empty()).map(str::to_owned).collect()))
        }
        _ => Err("write it as NAME=PATH or NAME=PATH,PATH".into()),
    }
}

fn maybe_named<T: FromStr>(text: &str) -> Result<(Option<String>, T), String>
where
    T::Err: std::fmt::Display,
{
    let (name, value) = text.split_once('=').map_or((None, text), |(name, value)| (Some(name.to_owned()), value));
    value.parse().map(|value| (name, value)).map_err(|error: T::Err| error.to_string())
}

pub(super) fn run(args: &Args, device: DeviceChoice, talk: Talk) -> Result<()> {
    if args.config.is_empty() && args.choices() != Choices::default() {
        usage("--merge without --config takes the bench as it is: options that change it need a --config FILE");
    }
    let out = Output::prepare(&args.out)?;
    if args.config.is_empty() {
        return publish(&out, talk);
    }
    let names: Vec<String> = args.config.iter().map(|path| path.display().to_string()).collect();
    let read =
        |name: &String| std::fs::read_to_string(name).with_context(|| format!("cannot read the configuration {name}"));
    let texts = names.iter().map(read).collect::<Result<Vec<String>>>()?;
    let config = BenchConfig::parse(&texts).and_then(|config| config.choose(&args.choices()));
    let config = config.with_context(|| format!("the configuration {}", names.join(" and ")))?;
    let rows: Vec<Row> = config.policies.iter().map(|row| resolve(row, &config)).collect::<Result<_>>()?;
    plan::check_equal_terms(&rows)?;
    let sets = load(&config, talk)?;
    let terms = Terms {
        starts: config.starts,
        seed: config.seed,
        reference: config.reference.clone(),
        visible: config.visible,
        released: config.released,
    };
    let manifest = Manifest::new(&terms, &rows, &sets)?;
    let old = refuse_to_shrink(&out, &manifest, args.merge)?;
    if args.merge {
        return publish(&out, talk);
    }
    if !args.replace {
        refuse_to_replace(&out, &manifest)?;
    }
    let Shard { number, count } = args.shard.unwrap_or(Shard { number: 0, count: 1 });
    let mine = manifest.shard(number, count);
    let survey = plan::survey(out.folder(), &manifest, &mine)?;
    tell_survey(&survey, mine.len(), talk);
    let open = &survey.open;
    let runners = runners(&rows, open, device, talk)?;
    let sim = rows.first().map(|row| row.settings.sim.clone()).unwrap_or_default();
    let worlds = run::worlds(needed(sets, open), &sim)?;
    // From here on the old tables are gone.
    settle(&out, old.as_ref(), &manifest, talk)?;
    let total = open.iter().map(|&key| manifest.trials(key).len() * manifest.steps_of(key)).sum();
    let (bar, done) = (talk.bar(total, "steps"), AtomicUsize::new(0));
    let on_steps = |steps| bar.set(done.fetch_add(steps, Ordering::Relaxed) + steps, total);
    let measures = Measures { visible: terms.visible, released: terms.released };
    let finished = run::run(out.folder(), &manifest, worlds, &runners, measures, open, on_steps);
    bar.finish();
    finished?;
    let left = plan::survey(out.folder(), &manifest, &manifest.files())?.open;
    if left.is_empty() {
        return publish(&out, talk);
    }
    let cells = |keys: &[FileKey]| keys.iter().filter(|key| key.row.is_some()).count();
    let all = cells(&manifest.files());
    show(format_args!(
        "{} of {all} cells done: run the other shards; whoever computes the last cell writes the tables",
        all - cells(&left)
    ))?;
    Ok(())
}

impl Args {
    fn choices(&self) -> Choices {
        Choices {
            data: self.data.clone(),
            sets: self.sets.clone(),
            policies: self.policies.clone(),
            checkpoints: self.checkpoint.clone(),
            reference: self.reference.clone(),
            maps: self.maps.clone(),
            steps: self.steps.clone(),
            seeds: self.seeds.map(usize::from),
            starts: self.starts.map(usize::from),
            seed: self.seed,
        }
    }
}

/// A row's settings: its checkpoint's, the bench's simulator over them, its own on top.
fn resolve(row: &RowConfig, config: &BenchConfig) -> Result<Row> {
    let resolve = || {
        let kind = row.kind()?;
        if !kind.needs_network() && (row.checkpoint.is_some() || row.obstacle_checkpoint.is_some()) {
            bail!("policy {kind} asks no network: leave the checkpoint out");
        }
        if row.obstacle_checkpoint.is_some() && kind.architecture() != PolicyKind::Nbp.architecture() {
            bail!("policy {kind} asks for no obstacle map: leave obstacle_checkpoint out");
        }
        let published = kind.architecture().map(checkpoint::published);
        let places = |set| row.checkpoints_on(set).map(|[net, obstacle]| (net.or_else(|| published.clone()), obstacle));
        let places = config.data.iter().map(places).collect::<Result<Vec<_>, _>>()?;
        let mut found = BTreeMap::new();
        for place in &places {
            if let ((Some(path), obstacle), false) = (place, found.contains_key(place)) {
                found.insert(place, Found::read(kind, path, obstacle.as_deref())?);
            }
        }
        let first = found.first_key_value();
        let mut settings = first.map(|(_, first)| first.settings.clone()).unwrap_or_default();
        let other = found.iter().find(|(_, found)| found.settings != settings);
        if let (Some(((Some(first), _), _)), Some(((Some(other), _), _))) = (first, other) {
            let (first, other) = (first.display(), other.display());
            bail!("{other} was trained with other settings than {first}, so they are not one row: make them two");
        }
        for (key, table) in [("sim", &config.sim), ("", &row.set)] {
            settings = overrides::assign(&settings, &overrides::assignments(key, &toml::Value::Table(table.clone()))?)?;
        }
        settings.policy.validate().context("policy")?;
        settings.search.validate()?;
        settings.nbv.validate().context("nbv")?;
        let mut trained = found.values().flat_map(|found| &found.trained);
        trained.try_for_each(|trained| checkpoint::check(trained, &settings.sim))?;
        let bytes = |place| found.get(place).map_or(&[][..], |found| &found.weights);
        let networks = places.iter().map(|place| Weights::new(place.clone(), bytes(place))).collect();
        Ok(Row {
            name: row.name.clone(),
            kind,
            seeds: row.seeds,
            settings,
            checkpoint: row.checkpoint.clone().or(published),
            networks,
        })
    };
    resolve().with_context(|| format!("row {}", row.name))
}

/// A network of a row, with that of its obstacle map if that is another.
struct Found {
    /// What the simulator must show them.
    trained: Vec<CheckpointConfig>,
    settings: Settings,
    weights: Vec<u8>,
}

impl Found {
    fn read(kind: PolicyKind, path: &Path, obstacle: Option<&Path>) -> Result<Self> {
        let architecture = kind.architecture().unwrap_or_default();
        let read = |path| checkpoint::read_as(architecture, path).context("cannot use the checkpoint");
        let (maps, settings) = read(path)?;
        let (mut trained, mut weights) = (Vec::from_iter(maps), checkpoint::bytes(path)?);
        if let Some(path) = obstacle {
            trained.extend(read(path)?.0);
            weights.extend(checkpoint::bytes(path)?);
        }
        Ok(Self { trained, settings, weights })
    }
}

/// The scenes of all data sets.
fn load(config: &BenchConfig, talk: Talk) -> Result<Vec<DataSet>> {
    let origins = config.data.iter().map(|set| Ok(set.origin(&config.maps)?)).collect::<Result<Vec<_>>>()?;
    let count = |origin: &Origin| match origin {
        Origin::Generated(_, seeds) => seeds.len(),
        Origin::Found(sources) => sources.len(),
    };
    let total = origins.iter().map(count).sum();
    let (bar, done) = (talk.bar(total, "scenes"), AtomicUsize::new(0));
    let on_scene = || bar.set(done.fetch_add(1, Ordering::Relaxed) + 1, total);
    let set = |(set, origin): (&DataConfig, &Origin)| -> Result<DataSet> {
        let scenes = scenes(origin, on_scene).with_context(|| format!("data set {}", set.name))?;
        Ok(DataSet { name: set.name.clone(), steps: set.steps, paper: set.paper.clone(), scenes })
    };
    let sets = config.data.iter().zip(&origins).map(set).collect::<Result<Vec<_>>>()?;
    bar.finish();
    for note in sets.iter().flat_map(|set| &set.scenes).flat_map(Scene::notes) {
        talk.say(format!("note: {note}"));
    }
    Ok(sets)
}

fn scenes(origin: &Origin, on_scene: impl Fn() + Sync) -> Result<Vec<Scene>> {
    match origin {
        Origin::Found(sources) => Ok(source::load_found(sources, LoadOptions::default(), |_| on_scene())?),
        Origin::Generated(level, seeds) => parallel::try_map(seeds, |&seed| {
            let made = nbp_dataset::generate(*level, seed)?;
            let scene = nbp_dataset::to_scene(SceneBundle { mesh: made.scene.mesh.bare(), ..made.scene })?;
            on_scene();
            Ok(scene)
        }),
    }
}

/// What was computed otherwise may be wanted, and took its time.
fn refuse_to_replace(out: &Output, manifest: &Manifest) -> Result<()> {
    let other = plan::survey(out.folder(), manifest, &manifest.files())?.other;
    let Some(first) = other.first() else { return Ok(()) };
    bail!(
        "{} has {} files of other settings, scenes, networks or programs, {} for one: name another folder, or have them computed \
         again (--replace)",
        out.folder().display(),
        other.len(),
        first.display()
    )
}

/// The bench that the folder holds, unless this one would make it smaller.
fn refuse_to_shrink(out: &Output, manifest: &Manifest, is_merge: bool) -> Result<Option<Manifest>> {
    let folder = out.folder().display();
    let old = match Manifest::read(out.folder()) {
        Err(BenchError::None(_)) if !is_merge => return Ok(None),
        old => old?,
    };
    if is_merge && !manifest.is_of(&old) {
        bail!("{folder} was computed with another configuration: give the one that it was computed with, or none");
    }
    if let Some(lost) = manifest.lacks(&old) {
        bail!(
            "{folder} holds a bench with {lost}, and this one would make its tables smaller: name another folder, or remove \
             {folder}/{} to begin anew with the cells that fit",
            store::MANIFEST
        );
    }
    Ok(Some(old))
}

/// Leaves `bench.json`, and nothing of the tables of another bench.
fn settle(out: &Output, old: Option<&Manifest>, manifest: &Manifest, talk: Talk) -> Result<()> {
    if let Some(old) = old {
        if manifest.is_of(old) {
            return Ok(());
        }
        talk.say(format!(
            "{} holds another bench: its cells are kept where they fit, its tables are removed until all is there",
            out.folder().display()
        ));
        let figures = old.sets.iter().flat_map(|set| report::figure_names(&set.name));
        for name in tables::FILES.map(str::to_owned).into_iter().chain(figures) {
            let path = out.folder().join(name);
            if path.exists() {
                std::fs::remove_file(&path).with_context(|| format!("cannot remove {}", path.display()))?;
            }
        }
    }
    Ok(manifest.write(out.folder())?)
}

fn tell_survey(survey: &Survey, total: usize, talk: Talk) {
    let done = total - survey.open.len();
    if done > 0 {
        talk.say(format!("{done} of {total} files are there"));
    }
    for (files, why) in [(&survey.other, "of other settings, scenes or networks"), (&survey.damaged, "damaged")] {
        if let Some(first) = files.first() {
            let and = if files.len() > 1 { ", …" } else { "" };
            talk.say(format!("{} files are {why} and computed again: {}{and}", files.len(), first.display()));
        }
    }
}

/// The rows, with the networks of those that have something to do.
fn runners(rows: &[Row], open: &[FileKey], device: DeviceChoice, talk: Talk) -> Result<Vec<Runner>> {
    let mut networks = BTreeMap::new();
    let mut runners = Vec::new();
    for (number, row) in rows.iter().enumerate() {
        let mut of_sets = Vec::new();
        for (set, weights) in row.networks.iter().enumerate() {
            let is_open = open.iter().any(|key| key.row == Some(number) && key.set == set);
            let (Some(path), true) = (&weights.checkpoint, is_open) else {
                of_sets.push(None);
                continue;
            };
            let obstacle = weights.obstacle_checkpoint.as_deref();
            let network = match networks.entry((path, obstacle)) {
                Entry::Occupied(network) => network.into_mut(),
                Entry::Vacant(place) => {
                    let network = setup::network(path, obstacle, &row.settings, device, 1, talk);
                    place.insert(network.with_context(|| format!("row {}", row.name))?)
                }
            };
            of_sets.push(Some(network.clone()));
        }
        runners.push(Runner::new(row, of_sets));
    }
    Ok(runners)
}

/// The scenes that have something to do.
fn needed(sets: Vec<DataSet>, open: &[FileKey]) -> BTreeMap<Place, Scene> {
    let needed: BTreeSet<Place> = open.iter().map(|key| (key.set, key.scene)).collect();
    let numbered = sets.into_iter().enumerate().flat_map(|(number, set)| {
        set.scenes.into_iter().enumerate().map(move |(scene, found)| ((number, scene), found))
    });
    numbered.filter(|(place, _)| needed.contains(place)).collect()
}

/// Shows and writes the tables of a complete bench.
fn publish(out: &Output, talk: Talk) -> Result<()> {
    let made = tables::tables(&BenchResult::load(out.folder())?)?;
    // First to the terminal: there it is safe whatever the disk says.
    let shown = show(format_args!("{}\n{}", made.text, made.times.trim_end()));
    for (name, content) in &made.files {
        out.write(name, content)?;
    }
    let names: Vec<&str> = made.files.iter().map(|(name, _)| name.as_str()).collect();
    talk.say(format!("wrote {} to {}", names.join(", "), out.folder().display()));
    Ok(shown?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_that_come_with_the_program_have_settings_that_exist() {
        let text = include_str!("../../../configs/bench/aimdoom.toml");
        let config = BenchConfig::parse(&[text]).unwrap();
        let rows = config.policies.iter().map(|row| {
            let set = overrides::assignments("", &toml::Value::Table(row.set.clone())).unwrap();
            (row.name.as_str(), overrides::assign(&Settings::default(), &set).unwrap())
        });
        let rows: BTreeMap<&str, Settings> = rows.collect();
        assert_eq!(rows["nbp"], Settings::default());
        let released = &rows["nbp-as-released"].policy;
        assert!(released.oracle_edges && released.observed_penalty == 10.0 && released.observed_within == Some(1.5625));
        for (row, policy) in [
            ("nbp-as-released-no-oracle", nbp_env::policy::nbp::NbpConfig { oracle_edges: false, ..*released }),
            ("nbp-as-released-no-penalty", nbp_env::policy::nbp::NbpConfig { observed_penalty: 0.0, ..*released }),
        ] {
            assert_eq!(rows[row].policy, policy, "{row}");
        }
    }

    #[test]
    fn parts_and_names_are_read_as_they_are_written() {
        assert_eq!("2/3".parse(), Ok(Shard { number: 1, count: 3 }));
        for wrong in ["0/2", "3/2", "1", "a/2", "-1/2", "1/"] {
            assert!(wrong.parse::<Shard>().is_err(), "{wrong}");
        }
        assert_eq!(named_paths("a=b,c").unwrap(), ("a".into(), vec!["b".into(), "c".into()]));
        assert_eq!(maybe_named::<usize>("simple=7").unwrap(), (Some("simple".into()), 7));
        assert!(maybe_named::<usize>("simple=x").is_err() && named_paths("=b").is_err() && named_paths("a=").is_err());
    }
}
