//! The figures of a report as files: curves, scenes against each other, and one episode from above, for each data set.

use super::{data, outline};
use crate::bench::store::{BenchResult, SetResult};
use crate::bench::summary::SetSummary;
use crate::bench::{SceneInfo, Tile};
use crate::plot::{self, Series};
use crate::rollout::EpisodeRecord;
use nbp_env::metrics::mean_std;
use std::fmt::Write as _;

/// Names and contents: `coverage-SET.svg`, `scatter-SET.svg` (the best competitor against the reference) and `episode-SET.svg`
/// (that competitor's median episode).
pub(super) fn figures(result: &BenchResult, summaries: &[SetSummary]) -> Vec<(String, String)> {
    let mut files = Vec::new();
    for (set, summary) in result.sets.iter().zip(summaries) {
        let [coverage, scatter, walk] = super::figure_names(&set.name);
        let rows: Vec<&str> = summary.rows.iter().map(|row| row.row.as_str()).collect();
        let title = format!("Coverage on {}, mean of {} scenes", set.name, set.scenes.len());
        files.push((coverage, plot::coverage(&title, &series(set, &rows))));
        let reference = &result.about.reference;
        let competitors = summary.rows.iter().filter(|row| !row.knows_map && row.row != *reference);
        let best = competitors.max_by(|a, b| a.coverage.mean.total_cmp(&b.coverage.mean));
        let best = best.map_or(reference, |row| &row.row);
        files.push((scatter, plot::scatter(&set.name, [reference, best], &points(set, [reference, best]))));
        let median = data::picks(set, best).get(1).map(|&index| &set.episodes[index]);
        let scene = median.and_then(|record| set.scenes.iter().find(|scene| scene.name == record.scene));
        if let (Some(record), Some(scene)) = (median, scene) {
            files.push((walk, episode(scene, record)));
        }
    }
    files
}

fn series(set: &SetResult, rows: &[&str]) -> Vec<Series> {
    let one = |row: &&str| {
        let curves: Vec<&[f32]> = set.episodes_of(row).map(|record| record.curve.as_slice()).collect();
        let (mean, spread) = data::mean_curve(&curves);
        Series { name: (*row).to_owned(), mean, spread: if curves.len() > 1 { spread } else { Vec::new() } }
    };
    rows.iter().map(one).collect()
}

/// Name and mean Final Cov. of both rows in each scene that both have episodes in.
fn points(set: &SetResult, rows: [&str; 2]) -> Vec<(String, [f64; 2])> {
    let mean = |scene: &SceneInfo, row: &str| {
        let found: Vec<f64> =
            set.episodes_of(row).filter(|record| record.scene == scene.name).map(|r| r.final_coverage).collect();
        (!found.is_empty()).then(|| mean_std(&found).0)
    };
    let point = |scene: &SceneInfo| Some((scene.name.clone(), [mean(scene, rows[0])?, mean(scene, rows[1])?]));
    set.scenes.iter().filter_map(point).collect()
}

/// Longer side of the map of an episode, pixels.
const LONGEST: f64 = 700.0;

/// An episode on the floor plan of its scene.
pub(super) fn episode(scene: &SceneInfo, record: &EpisodeRecord) -> String {
    let plan = &scene.plan;
    let scale = LONGEST / plan.width.max(plan.height).max(1) as f64;
    let (width, height) = (plan.width as f64 * scale, plan.height as f64 * scale);
    let (margin, head, foot) = (24.0, 56.0, 44.0);
    let (whole, tall) = (width.max(360.0) + 2.0 * margin, height + head + foot);
    let title = plot::escape(&format!("{}, {}, start {}", record.scene, record.policy, record.start));
    let facts = format!(
        "{:.1} % covered after {} steps, {:.0} m walked, bumps: {}",
        100.0 * record.final_coverage,
        record.steps,
        record.path_length,
        record.bumps
    );
    let mut svg = plot::open([whole, tall]);
    let _ = writeln!(svg, "<text x=\"{margin}\" y=\"26\" font-size=\"16\" font-weight=\"600\">{title}</text>");
    let _ = writeln!(svg, "<text x=\"{margin}\" y=\"45\" fill=\"#777\">{facts}</text>");
    let _ = writeln!(svg, "<g transform=\"translate({margin} {head}) scale({:.4})\">", scale / 2.0);
    for (tile, ink) in [(Tile::Free, "#eef0f3"), (Tile::Wall, "#3a424c")] {
        let _ = writeln!(svg, "<path d=\"{}\" fill=\"{ink}\"/>", outline::of_plan(plan, tile));
    }
    let [left, top, gap] = outline::lattice(scene);
    let at = |pose: &nbp_env::LatticePose| {
        [left - gap * pose.node.i as f32, top - gap * pose.node.k as f32].map(|pixel| 2.0 * pixel)
    };
    let points: Vec<String> = record.poses.iter().map(|pose| at(pose).map(|v| format!("{v:.1}")).join(",")).collect();
    let thick = 5.0 / scale;
    let _ = writeln!(
        svg,
        "<polyline points=\"{}\" fill=\"none\" stroke=\"#0072b2\" stroke-width=\"{thick:.2}\" stroke-linejoin=\"round\" \
         stroke-linecap=\"round\"/>",
        points.join(" ")
    );
    for (pose, fill) in [(record.poses.first(), "#fff"), (record.poses.last(), "#d55e00")] {
        let Some([x, y]) = pose.map(at) else { continue };
        let radius = 10.0 / scale;
        let _ = writeln!(
            svg,
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius:.2}\" fill=\"{fill}\" stroke=\"#0072b2\" stroke-width=\"{thick:.2}\"/>"
        );
    }
    let metres = plot::round_below(0.3 * plan.width as f64 * f64::from(plan.metres_per_pixel));
    let (long, base) = (metres / f64::from(plan.metres_per_pixel) * scale, height + head + 24.0);
    let _ = writeln!(svg, "</g>\n<path d=\"M{margin} {base:.1}v6h{long:.1}v-6\" fill=\"none\" stroke=\"#777\"/>");
    let _ =
        writeln!(svg, "<text x=\"{:.1}\" y=\"{:.1}\" fill=\"#777\">{metres} m</text>", margin + long + 8.0, base + 8.0);
    svg + "</svg>\n"
}
