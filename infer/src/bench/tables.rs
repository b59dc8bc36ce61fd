//! What a complete bench becomes: tables, CSV files, figures and a report. All but the times of decisions depend on the cells' results
//! alone, so their bytes are those of any other run.

use super::store::{BenchResult, RowInfo, SetResult};
use super::summary::{RowSummary, SetSummary, Spread, summarise};
use crate::{report, table};
use nbp_env::metrics::{Difference, mean_std};
use std::fmt::Write as _;

/// A bench for people and for other programs.
pub struct Tables {
    /// Names and contents of the files.
    pub files: Vec<(String, String)>,
    /// The tables for a terminal.
    pub text: String,
    /// The table of decision times for a terminal.
    pub times: String,
}

/// Tables and files of a bench.
///
/// # Errors
/// When a number is not finite.
pub fn tables(result: &BenchResult) -> Result<Tables, serde_json::Error> {
    let summaries = summarise(result);
    let mut files = vec![
        ("summary.json".to_owned(), serde_json::to_string_pretty(&summaries)? + "\n"),
        ("summary.md".to_owned(), markdown(result, &summaries)),
        ("episodes.csv".to_owned(), episodes_csv(result)),
        ("curves.csv".to_owned(), curves_csv(result)),
        ("timing.csv".to_owned(), timing_csv(result)),
        (report::FILE.to_owned(), report::html(result)?),
    ];
    files.extend(report::figures(result));
    let blocks = summaries.iter().flat_map(|summary| {
        let tables = [first_table(summary), second_table(summary)].map(|lines| table::text_of(&lines));
        std::iter::once(heading(result, summary) + "\n").chain(tables)
    });
    let text = blocks.collect::<Vec<_>>().join("\n");
    Ok(Tables { files, text, times: table::text_of(&times(result)) })
}

/// Names of the files that [`tables`] makes of any bench; figures besides.
pub const FILES: [&str; 6] = ["summary.json", "summary.md", "episodes.csv", "curves.csv", "timing.csv", report::FILE];

fn heading(result: &BenchResult, summary: &SetSummary) -> String {
    let starts = result.about.starts;
    let SetSummary { set, scenes, steps, reference, .. } = summary;
    format!(
        "{set}: {steps} steps, scenes: {scenes}, starts of each: up to {starts}; Δ: difference to {reference}, mean over scenes \
         and 95 % of a paired bootstrap; p: Fisher's randomisation test over scenes, not corrected for the number of comparisons"
    )
}

fn markdown(result: &BenchResult, summaries: &[SetSummary]) -> String {
    let mut text = String::new();
    for summary in summaries {
        let [first, second] = [first_table(summary), second_table(summary)].map(|lines| table::markdown_of(&lines));
        let heading = heading(result, summary);
        let (name, rest) = heading.split_once(": ").unwrap_or((&heading, ""));
        let _ = write!(text, "## {name}\n\n{rest}.\n\n{first}\n{second}\n");
    }
    text.trim_end().to_owned() + "\n"
}

fn of(spread: Spread) -> String {
    format!("{:.3} ± {:.3}", spread.mean, spread.std)
}

fn maybe(spread: Option<Spread>) -> String {
    spread.map_or(String::new(), of)
}

fn published(mean: f64, std: Option<f64>) -> String {
    std.map_or(format!("{mean:.3}"), |std| format!("{mean:.3} ± {std:.3}"))
}

/// Coverage, beside the paper's.
fn first_table(summary: &SetSummary) -> Vec<Vec<String>> {
    let head = [
        "Policy",
        "Episodes",
        "Final Cov.",
        "AUC",
        "of visible",
        "paper: Final Cov.",
        "paper: AUC",
        "Comp. %",
        "Comp. cm",
    ];
    let line = |row: &RowSummary| {
        let paper = row.paper;
        let two = |spread: Option<Spread>| spread.map_or(String::new(), |s| format!("{:.2} ± {:.2}", s.mean, s.std));
        vec![
            row.row.clone(),
            row.episodes.to_string(),
            of(row.coverage),
            of(row.auc),
            maybe(row.of_visible),
            paper.map_or(String::new(), |paper| published(paper.coverage, paper.coverage_std)),
            paper.map_or(String::new(), |paper| published(paper.auc, paper.auc_std)),
            two(row.completion_percent),
            two(row.completion_cm),
        ]
    };
    table::shown(std::iter::once(head.map(str::to_owned).to_vec()).chain(summary.rows.iter().map(line)).collect())
}

/// Differences, and what else there is to say.
fn second_table(summary: &SetSummary) -> Vec<Vec<String>> {
    let head = [
        "Policy",
        "Δ Final Cov.",
        "p",
        "Δ AUC",
        "p",
        "as released: Final Cov.",
        "as released: AUC",
        "path, m",
        "bumps",
    ];
    let line = |row: &RowSummary| {
        let interval = |difference: Option<Difference>| {
            difference
                .map_or(String::new(), |d| format!("{:+.3} [{:+.3}, {:+.3}]", d.mean, d.interval[0], d.interval[1]))
        };
        let p = |difference: Option<Difference>| {
            difference.map_or(String::new(), |d| if d.p < 0.001 { "< 0.001".into() } else { format!("{:.3}", d.p) })
        };
        vec![
            row.row.clone(),
            interval(row.coverage_difference),
            p(row.coverage_difference),
            interval(row.auc_difference),
            p(row.auc_difference),
            maybe(row.released_coverage),
            maybe(row.released_auc),
            format!("{:.0}", row.path_length.mean),
            format!("{:.1}", row.bumps.mean),
        ]
    };
    table::shown(std::iter::once(head.map(str::to_owned).to_vec()).chain(summary.rows.iter().map(line)).collect())
}

/// Milliseconds of a decision: rows by data sets.
fn times(result: &BenchResult) -> Vec<Vec<String>> {
    let head = std::iter::once("ms a decision".to_owned()).chain(result.sets.iter().map(|set| set.name.clone()));
    let line = |row: &RowInfo| {
        let mean = |set: &SetResult| {
            let all: Vec<f64> = set.episodes_of(&row.name).map(|record| record.decision_ms).collect();
            format!("{:.2}", mean_std(&all).0)
        };
        std::iter::once(row.name.clone()).chain(result.sets.iter().map(mean)).collect()
    };
    std::iter::once(head.collect()).chain(result.about.rows.iter().map(line)).collect()
}

/// A text as a CSV field.
fn field(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_owned() }
}

fn optional(value: Option<f64>) -> String {
    value.map_or(String::new(), |value| format!("{value:.6}"))
}

/// One line for each episode; a column is empty where something was not measured.
fn episodes_csv(result: &BenchResult) -> String {
    let mut csv =
        "set,scene,row,start,seed,steps,final_coverage,auc,of_visible,released_final_coverage,released_auc,bumps,\
        path_length_m,completion_percent,completion_cm\n"
            .to_owned();
    for set in &result.sets {
        for r in &set.episodes {
            let visible = set.scenes.iter().find(|scene| scene.name == r.scene).and_then(|scene| scene.visible);
            let of_visible = visible.filter(|&share| share > 0.0).map(|share| r.final_coverage / share);
            let [percent, cm] = [r.completion.map(|c| 100.0 * c.share), r.completion.map(|c| 100.0 * c.mean_distance)];
            let names = [&set.name, &r.scene, &r.policy].map(|name| field(name)).join(",");
            let _ = writeln!(
                csv,
                "{names},{},{},{},{:.6},{:.6},{},{},{},{},{:.3},{},{}",
                r.start,
                r.seed,
                r.steps,
                r.final_coverage,
                r.auc,
                optional(of_visible),
                optional(r.released_final),
                optional(r.released_auc),
                r.bumps,
                r.path_length,
                optional(percent),
                optional(cm),
            );
        }
    }
    csv
}

/// Mean and deviation of coverage over the episodes of a row, step by step.
fn curves_csv(result: &BenchResult) -> String {
    let mut csv = "set,row,step,coverage_mean,coverage_std,released_mean,released_std\n".to_owned();
    for set in &result.sets {
        for row in &result.about.rows {
            let curves: Vec<&[f32]> = set.episodes_of(&row.name).map(|r| r.curve.as_slice()).collect();
            let released: Option<Vec<&[f32]>> =
                set.episodes_of(&row.name).map(|r| r.released_curve.as_deref()).collect();
            let at = |curves: &[&[f32]], step: usize| {
                mean_std(&curves.iter().filter_map(|curve| curve.get(step)).map(|&c| f64::from(c)).collect::<Vec<_>>())
            };
            for step in 0..=set.steps {
                let (mean, std) = at(&curves, step);
                let second = released.as_ref().map(|curves| at(curves, step));
                let names = [&set.name, &row.name].map(|name| field(name)).join(",");
                let [mean_2, std_2] = [second.map(|s| s.0), second.map(|s| s.1)].map(optional);
                let _ = writeln!(csv, "{names},{step},{mean:.6},{std:.6},{mean_2},{std_2}");
            }
        }
    }
    csv
}

fn timing_csv(result: &BenchResult) -> String {
    let mut csv = "set,scene,row,start,seed,decision_ms\n".to_owned();
    for set in &result.sets {
        for r in &set.episodes {
            let names = [&set.name, &r.scene, &r.policy].map(|name| field(name)).join(",");
            let _ = writeln!(csv, "{names},{},{},{:.4}", r.start, r.seed, r.decision_ms);
        }
    }
    csv
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::store::tests::write;

    #[test]
    fn files_are_whole_and_times_are_apart() {
        let dir = tempfile::tempdir().unwrap();
        let result = write(dir.path());
        let made = tables(&result).unwrap();
        let mut later = result.clone();
        later.sets[0].episodes.iter_mut().for_each(|record| record.decision_ms += 1.0);
        let again = tables(&later).unwrap();
        for ((name, content), (_, second)) in made.files.iter().zip(&again.files) {
            assert_eq!(content == second, name != "timing.csv", "{name}");
        }
        let names: Vec<&str> = made.files.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, [FILES.map(String::from).to_vec(), report::figure_names("simple").to_vec()].concat());
        let file = |name: &str| &made.files.iter().find(|(found, _)| found == name).unwrap().1;
        assert_eq!((file("episodes.csv").lines().count(), file("curves.csv").lines().count()), (1 + 6, 1 + 2 * 3));
        assert!(
            file("episodes.csv").contains("simple,two_rooms,random,0,8,2,0.250000,0.187500,0.333333,,,1,1.500,,\n")
        );
        assert!(file("curves.csv").contains("simple,fbe,1,0.200000,0.000000,,\n"));
        assert!(
            file("summary.md").contains("## simple\n\n2 steps, scenes: 1")
                && file("summary.md").contains("| fbe | 2 | 0.250 ± 0.000 |")
        );
        assert!(made.text.contains("of visible") && !made.text.contains("Comp."), "{}", made.text);
        assert!(made.times.contains("0.50") && !made.text.contains("0.50"), "{}", made.times);
    }
}
