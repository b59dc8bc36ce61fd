//! A bench as one page for the eyes: tables, coverage curves, episodes on floor plans, scenes against each other.
//!
//! `BenchResult → tables (HTML) + data (compact JSON) → page.html`, which carries its style and scripts and asks for nothing else:
//! it can be mailed, kept beside a paper, and opened from a disk. The tables need no script.

mod data;
mod figures;
mod outline;
mod pack;
mod tables;

use crate::bench::store::file_name;
use crate::bench::{BenchResult, summary};
use crate::plot::escape;
use crate::rollout::EpisodeRecord;
use std::fmt::Write as _;

const PAGE: &str = include_str!("page.html");
const STYLE: &str = include_str!("style.css");
/// In the order in which they need each other.
const SCRIPTS: [&str; 4] =
    [include_str!("base.js"), include_str!("curves.js"), include_str!("episode.js"), include_str!("scatter.js")];

/// Name of the page among the files of a bench.
pub const FILE: &str = "report.html";

/// The figures of a report as SVG files, names and contents: `coverage-SET.svg`, `scatter-SET.svg`, `episode-SET.svg`.
pub fn figures(result: &BenchResult) -> Vec<(String, String)> {
    figures::figures(result, &summary::summarise(result))
}

/// The names of the figures of a data set.
pub fn figure_names(set: &str) -> [String; 3] {
    ["coverage", "scatter", "episode"].map(|kind| format!("{kind}-{}.svg", file_name(set)))
}

/// The report of a bench: one HTML file that needs no other. Its bytes depend on nothing but the result.
///
/// # Errors
/// When the data have no JSON form.
pub fn html(result: &BenchResult) -> Result<String, serde_json::Error> {
    let summaries = summary::summarise(result);
    // Nothing in a text can end the element that it stands in.
    let data = data::data(result);
    let view = data.view[0].to_string();
    let data = serde_json::to_string(&data)?.replace('<', "\\u003c");
    let parts = [
        ("title", escape(&tables::title(result))),
        ("style", STYLE.to_owned()),
        ("facts", tables::facts(result)),
        ("overview", tables::overview(&summaries)),
        ("tables", tables::tables(&summaries)),
        ("meaning", tables::meaning(&summaries)),
        ("view", view),
        ("data", data),
        ("script", SCRIPTS.join("\n")),
    ];
    Ok(fill(PAGE, &parts))
}

/// Puts each part where the template names it as `{{part}}`; what stands in a part is left as it is.
fn fill(template: &str, parts: &[(&str, String)]) -> String {
    let mut pieces = template.split("{{");
    let mut page = pieces.next().unwrap_or_default().to_owned();
    for piece in pieces {
        let found = piece.split_once("}}").and_then(|(name, rest)| {
            let (_, part) = parts.iter().find(|(known, _)| *known == name)?;
            Some((part, rest))
        });
        let _ = match found {
            Some((part, rest)) => write!(page, "{part}{rest}"),
            None => write!(page, "{{{{{piece}"),
        };
    }
    page
}

/// Final Cov. and AUC of an episode by the given way to count, where it was counted so.
fn scores(record: &EpisodeRecord, released: bool) -> Option<[f64; 2]> {
    match released {
        false => Some([record.final_coverage, record.auc]),
        true => Some([record.released_final?, record.released_auc?]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn html(result: &BenchResult) -> String {
        super::html(result).unwrap()
    }

    use crate::bench::store::{RowInfo, tests::write};
    use crate::bench::{SceneInfo, SetResult};

    fn sample() -> BenchResult {
        write(tempfile::tempdir().unwrap().path())
    }

    fn json(page: &str) -> serde_json::Value {
        let start = page.split_once("<script type=\"application/json\" id=\"data\">").unwrap().1;
        serde_json::from_str(start.split_once("</script>").unwrap().0).unwrap()
    }

    #[test]
    fn a_page_holds_everything_once_and_asks_for_nothing() {
        let result = sample();
        let page = html(&result);
        assert_eq!(page, html(&result));
        let data = json(&page);
        assert_eq!(data["rows"], serde_json::json!(["fbe", "random"]));
        let set = &data["sets"][0];
        assert_eq!((set["name"].as_str(), set["episodes"].as_array().unwrap().len()), (Some("simple"), 6));
        assert_eq!(set["rows"][1]["picks"], serde_json::json!([2, 4, 5]), "best, median and worst of its four");
        // A share of 0.25 is this in three digits of base 64.
        let mean = set["rows"][0]["curves"][0][0].as_str().unwrap();
        assert!(mean.len() == 9 && mean.ends_with("G00"), "{mean}");
        assert!(set["scenes"][0]["wall"].as_str().unwrap().starts_with('M'));
        let free = page.replace("http://www.w3.org/2000/svg", "");
        for asked in ["http:", "https:", "src=", "href=", "@import", "url(", "fetch("] {
            assert!(!free.contains(asked), "{asked}");
        }
        assert!(page.contains("0.250 <small>± 0.000</small>") && !page.contains("{{"));
        let names: Vec<String> = figures(&result).into_iter().map(|(name, _)| name).collect();
        assert_eq!(names, ["coverage-simple.svg", "scatter-simple.svg", "episode-simple.svg"]);
    }

    #[test]
    fn the_view_is_that_of_the_camera() {
        let mut result = sample();
        assert!(html(&result).contains("agent’s 90° view"));
        let camera = nbp_env::sensor::Camera { hfov_degrees: 62.5, ..Default::default() };
        result.about.rows[0].settings = serde_json::json!({"sim": {"camera": camera}});
        assert!(html(&result).contains("agent’s 62.5° view"));
    }

    #[test]
    fn names_are_names_whatever_is_in_them() {
        let mut result = sample();
        let name = "</script><b>\"&{{data}}";
        result.about.rows[0].name = name.into();
        result.about.reference = name.into();
        let set = &mut result.sets[0];
        (set.name, set.scenes[0].name) = (name.into(), name.into());
        result.about.sets[0].name = name.into();
        for record in &mut result.sets[0].episodes {
            record.scene = name.into();
            if record.policy == "fbe" {
                record.policy = name.into();
            }
        }
        let page = html(&result);
        assert_eq!(page.matches("</script>").count(), 2, "one for the data, one for the scripts");
        assert!(!page.contains("<b>"));
        let data = json(&page);
        assert_eq!([&data["rows"][0], &data["sets"][0]["scenes"][0]["name"]], [name, name]);
        assert!(figures(&result).iter().all(|(file, svg)| !svg.contains("<b>") && !file.contains('/')));
    }

    #[test]
    fn little_is_enough_for_a_page() {
        let mut result = sample();
        let set = &mut result.sets[0];
        set.episodes.truncate(1);
        set.episodes[0].released_curve = Some(vec![0.0, 0.1, 0.05]);
        (set.episodes[0].released_final, set.episodes[0].released_auc) = (Some(0.05), Some(0.0625));
        result.about.rows.truncate(1);
        result.about.sets[0].scenes[0].cells.truncate(1);
        let data = json(&html(&result));
        assert_eq!(
            (&data["counts"], &data["sets"][0]["rows"][0]["picks"]),
            (&"exact released".split(' ').collect(), &serde_json::json!([0, 0, 0]))
        );
        assert_eq!(figures(&result).len(), 3);
        result.sets[0].episodes[0].curve.clear();
        result.sets[0].episodes[0].poses.clear();
        let data = json(&html(&result));
        assert_eq!(data["sets"][0]["rows"][0]["curves"][0], serde_json::json!(["", ""]));
        result.sets[0].episodes.clear();
        result.sets[0].scenes.clear();
        assert!(html(&result).contains("</html>") && figures(&result).len() == 2);
        let empty = BenchResult {
            about: crate::bench::Manifest { rows: Vec::new(), sets: Vec::new(), ..result.about },
            sets: Vec::new(),
        };
        assert!(html(&empty).contains("</html>") && figures(&empty).is_empty());
    }

    #[test]
    fn when_there_is_too_much_the_best_the_median_and_the_worst_stay() {
        let mut result = sample();
        let long = result.sets[0].episodes[0].poses[0];
        for (n, record) in result.sets[0].episodes.iter_mut().enumerate() {
            record.poses = vec![long; 300_000];
            record.final_coverage = [0.9, 0.1, 0.5, 0.6, 0.7, 0.8][n];
        }
        let data = json(&html(&result));
        let walks = data["sets"][0]["episodes"].as_array().unwrap();
        assert_eq!(walks.len(), 5);
        let picks = data["sets"][0]["rows"][1]["picks"].as_array().unwrap();
        let trial =
            |pick: &serde_json::Value| [2, 3].map(|n| walks[pick.as_u64().unwrap() as usize][n].as_u64().unwrap());
        assert_eq!(picks.iter().map(trial).collect::<Vec<_>>(), [[1, 8], [0, 8], [0, 7]]);
    }

    #[test]
    fn a_report_of_the_papers_size_can_be_mailed() {
        let mut result = sample();
        let (set, row) = (result.sets[0].clone(), result.about.rows[0].clone());
        let pose = set.episodes[0].poses[0];
        let one = |scene: usize, policy: String, start| EpisodeRecord {
            scene: scene.to_string(),
            policy,
            start,
            curve: (0..=500).map(|n| n as f32 / 600.0).collect(),
            released_curve: Some((0..=500).map(|n| n as f32 / 700.0).collect()),
            released_final: Some(0.7),
            released_auc: Some(0.4),
            poses: vec![pose; 501],
            ..set.episodes[0].clone()
        };
        let names = || (0..12).map(|n| format!("row {n}"));
        result.about.rows = names().map(|name| RowInfo { name, ..row.clone() }).collect();
        result.about.sets = (0..5).map(|_| result.about.sets[0].clone()).collect();
        let scenes = (0..6).map(|n| SceneInfo { name: n.to_string(), ..set.scenes[0].clone() }).collect();
        let trials = (0..6)
            .flat_map(|scene| names().flat_map(move |name| (0..5).map(move |start| (scene, name.clone(), start))));
        let episodes = trials.map(|(scene, name, start)| one(scene, name, start)).collect();
        let full = SetResult { steps: 500, scenes, episodes, ..set };
        result.sets = vec![full; 5];
        let page = html(&result);
        assert!(page.len() < 6_000_000, "{}", page.len());
        let data = json(&page);
        let walks: usize =
            data["sets"].as_array().unwrap().iter().map(|set| set["episodes"].as_array().unwrap().len()).sum();
        assert!((1390..1800).contains(&walks), "{walks} of 1800 episodes");
    }
}
