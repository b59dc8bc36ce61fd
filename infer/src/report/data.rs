//! What the scripts of a report draw from: curves, walks, floor plans and scores, as one compact JSON object.

use super::{outline, pack};
use crate::bench::{BenchResult, SceneInfo, SetResult, Tile};
use crate::rollout::EpisodeRecord;
use nbp_env::metrics::mean_std;
use nbp_env::sensor::Camera;
use serde::{Deserialize as _, Serialize};
use std::cmp::Reverse;

/// Walks of more steps than this are left out, but for the best, median and worst of each row and set: 5 bytes a step.
const MOST_STEPS: usize = 700_000;

/// All of it. Fields are named for the scripts, which read them.
#[derive(Serialize)]
pub(super) struct Data {
    /// Ways to count coverage that were recorded: `exact`, and `released` or not.
    counts: Vec<&'static str>,
    rows: Vec<String>,
    /// Number of the row that others are compared with.
    reference: usize,
    /// Horizontal field of view, degrees, and range, metres.
    pub(super) view: [f32; 2],
    sets: Vec<Set>,
}

#[derive(Serialize)]
struct Set {
    name: String,
    steps: usize,
    scenes: Vec<Plan>,
    rows: Vec<Row>,
    episodes: Vec<Walk>,
}

/// A floor plan as images have it, `+z` up and `+x` left.
#[derive(Serialize)]
struct Plan {
    name: String,
    /// Width and height, pixels.
    size: [usize; 2],
    /// Side of a pixel, metres.
    pixel: f32,
    /// Where the lattice has its node `(0, 0)`, pixels, and how far apart nodes are.
    lattice: [f32; 3],
    free: String,
    wall: String,
}

#[derive(Serialize)]
struct Row {
    /// Mean over episodes at each step and its spread, for each way to count.
    curves: Vec<[String; 2]>,
    /// For each scene, Final Cov. and AUC for each way to count; nothing where it has no episode.
    scenes: Vec<Vec<[f64; 2]>>,
    /// Numbers of the best, median and worst episode.
    picks: Vec<usize>,
}

/// Row, scene, start, seed, bumps, metres; then the walk, and a curve for each way to count.
#[derive(Serialize)]
struct Walk(usize, usize, usize, u64, usize, f32, String, Vec<String>);

/// The curve of an episode by the given way to count.
pub(super) fn curve(record: &EpisodeRecord, released: bool) -> Option<&[f32]> {
    match released {
        false => Some(&record.curve),
        true => record.released_curve.as_deref(),
    }
}

/// Whether every episode has the second way to count.
pub(super) fn has_released(result: &BenchResult) -> bool {
    let mut all = result.sets.iter().flat_map(|set| &set.episodes).peekable();
    all.peek().is_some() && all.all(|record| record.released_curve.is_some())
}

pub(super) fn data(result: &BenchResult) -> Data {
    let rows: Vec<String> = result.about.rows.iter().map(|row| row.name.clone()).collect();
    let counts: &[bool] = if has_released(result) { &[false, true] } else { &[false] };
    let kept = kept(result);
    Data {
        counts: counts.iter().map(|released| if *released { "released" } else { "exact" }).collect(),
        view: view(result),
        reference: rows.iter().position(|name| *name == result.about.reference).unwrap_or(0),
        sets: result.sets.iter().zip(kept).map(|(set, kept)| of_set(set, &rows, counts, &kept)).collect(),
        rows,
    }
}

/// Of the first row; how wide views are drawn, and nothing else, depends on it.
fn view(result: &BenchResult) -> [f32; 2] {
    let camera = result.about.rows.first().and_then(|row| row.settings.get("sim")?.get("camera"));
    let camera = camera.and_then(|camera| Camera::deserialize(camera).ok()).unwrap_or_default();
    [camera.hfov_degrees, camera.range]
}

/// Best, median and worst of the episodes of a row, as indices into a set's episodes.
pub(super) fn picks(set: &SetResult, row: &str) -> Vec<usize> {
    let mut order: Vec<usize> = (0..set.episodes.len()).filter(|&n| set.episodes[n].policy == row).collect();
    // Stable: of equals the first.
    order.sort_by(|&a, &b| set.episodes[b].final_coverage.total_cmp(&set.episodes[a].final_coverage));
    let middle = order.len() / 2;
    order.first().into_iter().chain(order.get(middle)).chain(order.last()).copied().collect()
}

/// For each set, which episodes are embedded, in order: the picks of each row, and as many of the others as there is room
/// for, first starts and seeds first.
fn kept(result: &BenchResult) -> Vec<Vec<usize>> {
    let mut wanted = Vec::new();
    for (number, set) in result.sets.iter().enumerate() {
        let picked: Vec<usize> = result.about.rows.iter().flat_map(|row| picks(set, &row.name)).collect();
        for (index, record) in set.episodes.iter().enumerate() {
            let is_picked = picked.contains(&index);
            let seed = record.seed.wrapping_sub(result.about.seed);
            wanted.push((Reverse(is_picked), seed, record.start, number, index, record.poses.len()));
        }
    }
    wanted.sort_unstable();
    let mut kept = vec![Vec::new(); result.sets.len()];
    let mut steps = 0;
    for (Reverse(is_picked), _, _, set, index, length) in wanted {
        steps += length;
        if is_picked || steps <= MOST_STEPS {
            kept[set].push(index);
        }
    }
    kept.iter_mut().for_each(|indices| indices.sort_unstable());
    kept
}

fn of_set(set: &SetResult, rows: &[String], counts: &[bool], kept: &[usize]) -> Set {
    let number = |name: &str| rows.iter().position(|row| row == name);
    let scene = |name: &str| set.scenes.iter().position(|scene| scene.name == name);
    let walk = |record: &EpisodeRecord| {
        let curves = counts.iter().filter_map(|&released| curve(record, released));
        Some(Walk(
            number(&record.policy)?,
            scene(&record.scene)?,
            record.start,
            record.seed,
            record.bumps,
            (10.0 * record.path_length).round() / 10.0,
            pack::walk(&record.poses),
            curves.map(|curve| pack::shares(curve.iter().copied(), 2)).collect(),
        ))
    };
    Set {
        name: set.name.clone(),
        steps: set.steps,
        scenes: set.scenes.iter().map(plan).collect(),
        rows: rows.iter().map(|row| of_row(set, row, counts, kept)).collect(),
        episodes: kept.iter().filter_map(|&index| walk(&set.episodes[index])).collect(),
    }
}

fn of_row(set: &SetResult, name: &str, counts: &[bool], kept: &[usize]) -> Row {
    let of_row = || set.episodes.iter().filter(|record| record.policy == name);
    let curves = |&released: &bool| {
        let (mean, spread) = mean_curve(&of_row().filter_map(|record| curve(record, released)).collect::<Vec<_>>());
        [pack::shares(mean, 3), pack::shares(spread, 3)]
    };
    let scores = |scene: &SceneInfo| {
        let score = |&released: &bool| {
            let found = of_row().filter(|record| record.scene == scene.name);
            let (ends, areas): (Vec<f64>, Vec<f64>) =
                found.filter_map(|record| super::scores(record, released)).map(|[end, area]| (end, area)).unzip();
            (!ends.is_empty()).then(|| [mean_std(&ends).0, mean_std(&areas).0].map(|v| (1e5 * v).round() / 1e5))
        };
        counts.iter().filter_map(score).collect()
    };
    let picks = picks(set, name).into_iter().filter_map(|index| kept.binary_search(&index).ok());
    Row {
        curves: counts.iter().map(curves).collect(),
        scenes: set.scenes.iter().map(scores).collect(),
        picks: picks.collect(),
    }
}

/// Mean and standard deviation at each step, as long as the shortest curve.
pub(super) fn mean_curve(curves: &[&[f32]]) -> (Vec<f32>, Vec<f32>) {
    let steps = curves.iter().map(|curve| curve.len()).min().unwrap_or(0);
    let at = |step: usize| mean_std(&curves.iter().map(|curve| f64::from(curve[step])).collect::<Vec<_>>());
    (0..steps).map(at).map(|(mean, spread)| (mean as f32, spread as f32)).unzip()
}

fn plan(scene: &SceneInfo) -> Plan {
    let plan = &scene.plan;
    let tidy = |v: f32| (1e3 * v).round() / 1e3;
    Plan {
        name: scene.name.clone(),
        size: [plan.width, plan.height],
        pixel: plan.metres_per_pixel,
        lattice: outline::lattice(scene).map(tidy),
        free: outline::of_plan(plan, Tile::Free),
        wall: outline::of_plan(plan, Tile::Wall),
    }
}
