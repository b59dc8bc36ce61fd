//! Whether a data set can be trained and tested on, and what is wrong where it cannot.
//!
//! Faults make scenes useless or figures wrong; warnings should be known. Published scenes are held to the same, but that
//! their meshes are open.

use crate::split::{Part, part_of};
use crate::stats::{connected_area, floor_area};
use nbp_env::check::{Fault, check_geometry, check_scene};
use nbp_env::scene::load::{LoadError, find_scenes};
use nbp_env::scene::settings::LATTICE_STEP;
use nbp_env::scene::{Appearance, Interior, LoadOptions, Mesh, Settings};
use nbp_env::{Node, Scene};
use rayon::prelude::*;
use serde::Serialize;
use serde_json::Value;
use std::collections::BTreeMap;
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::path::{Path, PathBuf};

/// Trajectories that the paper tests in each scene.
const STARTS: usize = 5;

/// Share of the floor that should be connected in the camera plane, and below which a scene is no use.
const ACCESSIBLE: [f64; 2] = [0.9, 0.5];

/// Share of the surface that can be seen below which a scene is no use.
const VISIBLE: f64 = 0.5;

/// Most cells of the released surface grid along an axis, and points in one of them: our largest scene has 200 and 2,000.
const MAX_GRID: [u32; 2] = [1000, 1_000_000];

/// Most elevations of the released pose grid: one for each two degrees.
const MAX_THETA: i32 = 90;

/// The keys that the released loader reads.
const KEYS: [(&str, &[&str]); 2] = [
    ("scene", &["grid_l", "grid_w", "grid_h", "cell_capacity", "cell_resolution", "x_min", "x_max"]),
    (
        "camera",
        &[
            "x_min",
            "x_max",
            "pose_l",
            "pose_w",
            "pose_h",
            "pose_n_theta",
            "pose_n_azim",
            "start_positions",
            "contrast_factor",
        ],
    ),
];

/// How much a finding matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// The scene or the set cannot be used as it is.
    Fault,
    /// It can, and one should know.
    Warning,
}

/// One thing that was found.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize)]
pub struct Finding {
    /// How much it matters.
    pub severity: Severity,
    /// What kind of thing, the same for all scenes that have it, and what to do about it.
    pub kind: &'static str,
    /// Folder.
    pub place: PathBuf,
    /// The case at hand.
    pub detail: String,
}

/// What is known of a set after it was checked.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Checked {
    /// Number of scenes.
    pub scenes: usize,
    /// Faults first, then by kind and place.
    pub findings: Vec<Finding>,
}

impl Checked {
    /// Number of faults.
    pub fn faults(&self) -> usize {
        self.findings.iter().filter(|finding| finding.severity == Severity::Fault).count()
    }
}

/// Checks all scenes below a folder; `quick` leaves out what can be seen. `done` is called after each scene.
///
/// # Errors
/// When a folder cannot be listed.
pub fn check(dir: &Path, quick: bool, done: impl Fn() + Sync) -> Result<Checked, LoadError> {
    let paths = find_scenes(dir)?;
    let checked: Vec<SceneFindings> = paths
        .par_iter()
        .map(|path| {
            let found = SceneFindings::of(path, quick);
            done();
            found
        })
        .collect();
    let mut findings = set_findings(dir, &paths);
    findings.extend(duplicates(&paths, &checked));
    findings.extend(checked.into_iter().flat_map(|scene| scene.findings));
    findings.sort();
    Ok(Checked { scenes: paths.len(), findings })
}

/// Train and test parts, their names, their sizes.
fn set_findings(dir: &Path, paths: &[PathBuf]) -> Vec<Finding> {
    let mut findings = Vec::new();
    let mut tell = |severity, kind, detail: String| {
        findings.push(Finding { severity, kind, place: dir.into(), detail });
    };
    let count = |part: Option<Part>| paths.iter().filter(|path| part_of(path) == part).count();
    let [train, test, neither] = [Some(Part::Train), Some(Part::Test), None].map(count);
    if paths.is_empty() {
        let kind = "there is no scene: a scene is a folder with an OBJ file and settings.json";
        tell(Severity::Fault, kind, "no *.obj file at any depth".into());
    } else if train + test == 0 {
        let kind = "the set is not split: `dataset split` makes train and test";
        tell(Severity::Warning, kind, format!("{neither} scenes"));
    } else {
        if train == 0 || test == 0 {
            let kind = "one part is empty: a set needs scenes to train on and others to test on";
            tell(Severity::Warning, kind, format!("{train} scenes to train, {test} to test"));
        }
        if neither > 0 {
            let kind = "scenes lie beside train and test: move them into one of the two";
            tell(Severity::Fault, kind, format!("{neither} scenes"));
        }
    }
    findings
}

/// Scenes with the very same mesh.
fn duplicates(paths: &[PathBuf], checked: &[SceneFindings]) -> Vec<Finding> {
    let mut same: BTreeMap<u64, Vec<&PathBuf>> = BTreeMap::new();
    for (path, scene) in paths.iter().zip(checked) {
        scene.mesh.iter().for_each(|&mesh| same.entry(mesh).or_default().push(path));
    }
    let finding = |group: Vec<&PathBuf>| {
        let parts: Vec<Option<Part>> = group.iter().map(|path| part_of(path)).collect();
        let leaks = [Part::Train, Part::Test].iter().all(|part| parts.contains(&Some(*part)));
        let (severity, kind) = match leaks {
            true => (Severity::Fault, "a mesh is trained and tested on: remove it from one part"),
            false => (Severity::Warning, "scenes have the same mesh: keep one"),
        };
        let others: Vec<String> = group[1..].iter().map(|path| path.display().to_string()).collect();
        Finding { severity, kind, place: group[0].clone(), detail: format!("the same as {}", others.join(", ")) }
    };
    same.into_values().filter(|group| group.len() > 1).map(finding).collect()
}

/// What was found in one scene.
struct SceneFindings {
    path: PathBuf,
    findings: Vec<Finding>,
    /// Of the mesh's corners; `None` where it cannot be read.
    mesh: Option<u64>,
}

impl SceneFindings {
    fn of(path: &Path, quick: bool) -> Self {
        let mut found = Self { path: path.into(), findings: Vec::new(), mesh: None };
        found.check_files();
        let raw = found.check_settings();
        let loaded = Scene::load_with(path, LoadOptions { colour: true }).or_else(|error| {
            let bare = Scene::load(path)?;
            found.fault("colours cannot be read: put the files that the OBJ and its MTL name beside them", error);
            Ok::<_, LoadError>(bare)
        });
        let scene = match loaded {
            Ok(scene) => scene,
            Err(error) => {
                found.fault("the scene cannot be read: write it again", error);
                return found;
            }
        };
        found.mesh = Some(hash(scene.mesh()));
        let is_plain = |looks: &Appearance| looks.images.is_empty() && looks.paints.windows(2).all(|p| p[0] == p[1]);
        if scene.mesh().appearance().is_none_or(is_plain) {
            found
                .warn("all faces have one colour: depth is all that a camera sees", "neither image nor vertex colours");
        }
        found.check_starts(&scene, raw.as_ref());
        // Files that name their unit were written by this toolkit, which closes all meshes but scans.
        let names_unit = raw.is_some_and(|raw| raw["scene"].get("metres_per_unit").is_some());
        let is_closed = names_unit && scene.graph().interior() == Interior::Closed;
        let faults = if quick { check_geometry(&scene) } else { check_scene(&scene) };
        faults.iter().for_each(|fault| found.take(fault, is_closed));
        found.check_reach(&scene);
        found
    }

    fn tell(&mut self, severity: Severity, kind: &'static str, detail: impl ToString) {
        self.findings.push(Finding { severity, kind, place: self.path.clone(), detail: detail.to_string() });
    }

    fn fault(&mut self, kind: &'static str, detail: impl ToString) {
        self.tell(Severity::Fault, kind, detail);
    }

    fn warn(&mut self, kind: &'static str, detail: impl ToString) {
        self.tell(Severity::Warning, kind, detail);
    }

    /// The published layout: one OBJ file called like the folder.
    fn check_files(&mut self) {
        let Ok(entries) = std::fs::read_dir(&self.path) else {
            return self.warn("a lone OBJ file: the layout is SCENE/SCENE.obj with settings.json", "no folder");
        };
        let mut objs: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
        objs.retain(|path| path.extension().is_some_and(|e| e.eq_ignore_ascii_case("obj")));
        objs.sort();
        if objs.len() > 1 {
            let kind = "there are several OBJ files: the first by name is the scene";
            self.warn(kind, format!("{} of them", objs.len()));
        }
        let folder = self.path.file_name().map(ToOwned::to_owned);
        if let Some(obj) = objs.first().filter(|obj| obj.file_stem().map(ToOwned::to_owned) != folder) {
            let kind = "the OBJ file is not called like its folder, as in the published layout";
            self.warn(kind, obj.file_name().unwrap_or_default().display());
        }
    }

    /// That the file is there and complete, and its numbers agree with each other. Returns it as it was written.
    fn check_settings(&mut self) -> Option<Value> {
        let folder = if self.path.is_dir() { self.path.clone() } else { self.path.parent()?.into() };
        let file = ["settings.json", "setting.json"].map(|name| folder.join(name)).into_iter().find(|f| f.is_file());
        let Some(file) = file else {
            self.fault("there is no settings.json: without it, lattice and starts are guesses", "not found");
            return None;
        };
        // What cannot be read is told when the scene is loaded.
        let raw: Value = serde_json::from_slice(&std::fs::read(file).ok()?).ok()?;
        let missing: Vec<String> = KEYS
            .iter()
            .flat_map(|(part, keys)| keys.iter().map(move |key| (part, key)))
            .filter(|(part, key)| raw[**part].get(**key).is_none())
            .map(|(part, key)| format!("{part}.{key}"))
            .collect();
        if !missing.is_empty() {
            self.fault("settings.json is not complete: the released loader needs all keys", missing.join(", "));
        }
        let settings: Settings = serde_json::from_value(raw.clone()).ok()?;
        self.check_numbers(&settings);
        Some(raw)
    }

    fn check_numbers(&mut self, settings: &Settings) {
        let (scene, camera) = (&settings.scene, &settings.camera);
        let kind = "settings.json contradicts itself: write the scene again";
        for (name, low, high) in [("scene", scene.x_min, scene.x_max), ("camera", camera.x_min, camera.x_max)] {
            if (0..3).any(|axis| low[axis] > high[axis]) {
                self.fault(kind, format!("{name}.x_min {low:?} lies above {name}.x_max {high:?}"));
            }
        }
        for (axis, nodes) in [(0, camera.pose_l), (2, camera.pose_h)] {
            let last = camera.x_min[axis] * scene.metres_per_unit + LATTICE_STEP * (nodes - 1) as f32;
            let end = scene.x_max[axis] * scene.metres_per_unit;
            if last > end + LATTICE_STEP {
                let name = if axis == 0 { "pose_l" } else { "pose_h" };
                let detail = format!("camera.{name} {nodes} ends {:.1} m outside the scene's box", last - end);
                self.warn("the lattice is larger than the scene", detail);
            }
        }
        if camera.pose_n_theta != 5 {
            self.warn(
                "camera.pose_n_theta is not 5: the released code would not look horizontally",
                camera.pose_n_theta,
            );
        }
        let [grid, capacity] = MAX_GRID.map(|most| 1..=i64::from(most));
        let factor = camera.contrast_factor;
        let numbers = [
            ("scene.grid_l", i64::from(scene.grid_l), &grid),
            ("scene.grid_w", i64::from(scene.grid_w), &grid),
            ("scene.grid_h", i64::from(scene.grid_h), &grid),
            ("scene.cell_capacity", i64::from(scene.cell_capacity), &capacity),
            ("camera.pose_w", i64::from(camera.pose_w), &grid),
            ("camera.pose_n_theta", i64::from(camera.pose_n_theta), &(1..=i64::from(MAX_THETA))),
        ];
        let kind = "a number in settings.json is absurd: the released loader would fail or fill the memory";
        for (name, value, usual) in numbers.into_iter().filter(|(_, value, usual)| !usual.contains(value)) {
            self.fault(kind, format!("{name} is {value}: from {} to {}", usual.start(), usual.end()));
        }
        if !(factor.is_finite() && factor > 0.0) {
            self.fault(kind, format!("camera.contrast_factor is {factor}: a positive number, usually 1"));
        }
        if let Some(resolution) = scene.cell_resolution.filter(|r| !(r.is_finite() && *r > 0.0)) {
            self.fault(kind, format!("scene.cell_resolution is {resolution}: null or a positive number"));
        }
    }

    fn check_starts(&mut self, scene: &Scene, raw: Option<&Value>) {
        let starts: Option<Vec<[i32; 5]>> =
            raw.and_then(|raw| serde_json::from_value(raw["camera"]["start_positions"].clone()).ok());
        let mut starts = starts.unwrap_or_default();
        let is_blocked = |start: &&[i32; 5]| !scene.graph().is_free(Node { i: start[0], k: start[2] });
        let blocked = starts.iter().filter(is_blocked).count();
        if blocked > 0 {
            self.fault("start positions are in a wall or outside", format!("{blocked} of {}", starts.len()));
        }
        let looking_up = starts.iter().filter(|start| start[3] != 2).count();
        if looking_up > 0 {
            let detail = format!("{looking_up} of {}", starts.len());
            self.warn("start positions do not look horizontally: only theta 2 is used", detail);
        }
        starts.sort_unstable();
        starts.dedup();
        if starts.len() < STARTS {
            let detail = format!("{} different ones", starts.len());
            self.fault("there are fewer than five start positions, which a test runs from", detail);
        }
    }

    /// What the simulator finds wrong with a scene. Meshes `is_closed` by the toolkit that wrote them must be.
    fn take(&mut self, fault: &Fault, is_closed: bool) {
        let fault_if = |is_fault| if is_fault { Severity::Fault } else { Severity::Warning };
        let (severity, kind) = match fault {
            Fault::Escapes { .. } => (fault_if(is_closed), "the mesh is open: what looks through a hole sees nothing"),
            Fault::Hidden { share } => (
                fault_if(*share < VISIBLE),
                "much of the surface cannot be seen from any position: coverage stays low whatever a policy does",
            ),
            Fault::StartsCutOff { .. } => (Severity::Fault, "start positions are cut off from the largest part"),
            Fault::Scattered { .. } => (Severity::Warning, "many positions are cut off from the largest part"),
            Fault::Scale { .. } => (Severity::Warning, "rooms have an unusual height: the unit may be wrong"),
            Fault::OutsideBox { .. } | Fault::OtherLattice { .. } => {
                (Severity::Warning, "settings.json does not fit the mesh: it may belong to another one")
            }
            _ => (Severity::Warning, "something is missing or left out"),
        };
        self.tell(severity, kind, fault);
    }

    /// By share of the floor: a fault below the second of two bounds, a warning below the first.
    fn check_reach(&mut self, scene: &Scene) {
        let (share, [warn, fault]) = (connected_area(scene) / floor_area(scene).max(f64::MIN_POSITIVE), ACCESSIBLE);
        if share < warn {
            let severity = if share < fault { Severity::Fault } else { Severity::Warning };
            let kind =
                "much of the floor is out of reach: doors are closed, or it lies above or below the camera plane";
            let detail = format!(
                "{:.0} % of the floor is connected in the camera plane; from {:.0} % on is usual",
                100.0 * share,
                100.0 * warn
            );
            self.tell(severity, kind, detail);
        }
    }
}

/// Of the corners of all triangles: names and the order of vertices do not matter.
fn hash(mesh: &Mesh) -> u64 {
    let mut hasher = DefaultHasher::new();
    mesh.iter_corners().flatten().flat_map(|v| v.to_array()).for_each(|c| (c + 0.0).to_bits().hash(&mut hasher));
    hasher.finish()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Level, generate, write_scene};
    use std::fs;

    fn kinds(checked: &Checked, severity: Severity) -> Vec<&'static str> {
        checked.findings.iter().filter(|f| f.severity == severity).map(|f| f.kind).collect()
    }

    #[test]
    fn a_whole_set_has_no_fault_and_every_damage_is_found() {
        let dir = tempfile::tempdir().unwrap();
        let [train, test] = ["Training dataset", "test"].map(|part| dir.path().join(part));
        let mut scene = generate(Level::Simple, 3).unwrap().scene;
        let folder = write_scene(&scene, &train, false).unwrap();
        let other = write_scene(&generate(Level::Simple, 4).unwrap().scene, &test, false).unwrap();
        let look = || check(dir.path(), true, || {}).unwrap();
        let whole = look();
        assert_eq!((whole.scenes, whole.faults()), (2, 0), "{whole:?}");

        let has = |what: &str| {
            let checked = look();
            let found = kinds(&checked, Severity::Fault);
            assert!(found.iter().any(|kind| kind.contains(what)), "{what}: {checked:?}");
        };
        let settings = fs::read_to_string(folder.join("settings.json")).unwrap();
        let obj = folder.join(format!("{}.obj", scene.name));
        let mesh = fs::read_to_string(&obj).unwrap();
        let damage = |change: &dyn Fn(&mut Value)| {
            let mut value: Value = serde_json::from_str(&settings).unwrap();
            change(&mut value);
            fs::write(folder.join("settings.json"), value.to_string()).unwrap();
        };
        damage(&|v| drop(v["camera"].as_object_mut().unwrap().remove("contrast_factor")));
        has("not complete");
        damage(&|v| {
            let first = v["camera"]["start_positions"][0].clone();
            v["camera"]["start_positions"] = vec![first; 5].into();
        });
        has("fewer than five");
        damage(&|v| v["scene"]["x_min"][0] = 1e6.into());
        has("contradicts itself");
        for (part, key, value) in [
            ("scene", "grid_l", 4_000_000_000_i64),
            ("scene", "cell_capacity", 0),
            ("camera", "pose_n_theta", -1),
            ("camera", "pose_n_theta", 1_000_000),
            ("camera", "contrast_factor", 0),
        ] {
            damage(&|v| v[part][key] = value.into());
            has("absurd");
        }
        fs::remove_file(folder.join("settings.json")).unwrap();
        has("no settings.json");
        fs::write(folder.join("settings.json"), &settings).unwrap();

        // An eighth of the faces goes missing.
        let faces = mesh.lines().filter(|line| line.starts_with("f ")).count();
        let holed: Vec<&str> = mesh.lines().take(mesh.lines().count() - faces / 8).collect();
        fs::write(&obj, holed.join("\n")).unwrap();
        has("the mesh is open");
        fs::write(&obj, "v 0 0 nan\n").unwrap();
        has("cannot be read");
        fs::write(&obj, &mesh).unwrap();
        fs::remove_file(folder.join(format!("{}.mtl", scene.name))).unwrap();
        assert!(!look().findings.is_empty(), "no MTL");

        scene.name = "again".into();
        fs::remove_dir_all(&other).unwrap();
        write_scene(&scene, &test, false).unwrap();
        has("trained and tested on");
    }

    #[test]
    fn published_scenes_may_be_open() {
        let dir = tempfile::tempdir().unwrap();
        let folder = write_scene(&generate(Level::Simple, 3).unwrap().scene, dir.path(), false).unwrap();
        let text = fs::read_to_string(folder.join("settings.json")).unwrap();
        let mut settings: Settings = serde_json::from_str(&text).unwrap();
        settings = settings.in_units(5.0);
        let mut value = serde_json::to_value(&settings).unwrap();
        value["scene"].as_object_mut().unwrap().remove("metres_per_unit");
        fs::write(folder.join("settings.json"), value.to_string()).unwrap();
        let obj = fs::read_dir(&folder).unwrap().flatten().find(|e| e.path().extension().is_some_and(|x| x == "obj"));
        let obj = obj.unwrap().path();
        let scale = |line: &str| match line.strip_prefix("v ") {
            Some(rest) => {
                let numbers: Vec<String> =
                    rest.split(' ').take(3).map(|n| (n.parse::<f32>().unwrap() / 5.0).to_string()).collect();
                format!("v {}", numbers.join(" "))
            }
            None => line.to_string(),
        };
        let mesh = fs::read_to_string(&obj).unwrap();
        let lines: Vec<String> = mesh.lines().map(scale).collect();
        fs::write(&obj, lines[..lines.len() - 600].join("\n")).unwrap();
        let checked = check(dir.path(), true, || {}).unwrap();
        let open = |severity| kinds(&checked, severity).iter().any(|kind| kind.contains("open"));
        assert!(open(Severity::Warning) && !open(Severity::Fault), "{checked:?}");
    }
}
