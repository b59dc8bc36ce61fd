//! Episodes summed up: mean and spread of Final Coverage and AUC for each policy, as the paper's tables have them.

use crate::rollout::EpisodeRecord;
use nbp_env::completion::Completion;
use nbp_env::metrics::mean_std;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// One line of the comparison. The spread is the sample standard deviation over episodes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SummaryRow {
    /// Policy.
    pub policy: String,
    /// Number of episodes.
    pub episodes: usize,
    /// Mean covered share at the end, 0 to 1.
    pub final_coverage_mean: f64,
    /// Its spread.
    pub final_coverage_std: f64,
    /// Mean area under the coverage curve, 0 to 1.
    pub auc_mean: f64,
    /// Its spread.
    pub auc_std: f64,
    /// Mean of the covered share at the end over the share that is visible from the scene's lattice poses; frames between
    /// poses see a little more, so it may pass 1. Absent where that was not measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub of_visible_mean: Option<f64>,
    /// Its spread.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub of_visible_std: Option<f64>,
    /// Comp. %, 0 to 100, and its spread, where it was measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub completion_percent: Option<[f64; 2]>,
    /// Comp. cm and its spread, where it was measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub completion_cm: Option<[f64; 2]>,
}

/// One row for each policy, in the order in which they first appear. `visible` has the visible share of each scene, or
/// nothing where it was not measured.
pub fn summarise(episodes: &[EpisodeRecord], visible: &BTreeMap<String, f64>) -> Vec<SummaryRow> {
    let mut policies: Vec<&str> = Vec::new();
    for record in episodes {
        if !policies.contains(&record.policy.as_str()) {
            policies.push(&record.policy);
        }
    }
    let row = |policy: &str| {
        let of_policy = || episodes.iter().filter(|record| record.policy == policy);
        let (final_coverage_mean, final_coverage_std) =
            mean_std(&of_policy().map(|r| r.final_coverage).collect::<Vec<_>>());
        let (auc_mean, auc_std) = mean_std(&of_policy().map(|r| r.auc).collect::<Vec<_>>());
        let of_visible: Option<Vec<f64>> = of_policy()
            .map(|r| visible.get(&r.scene).filter(|&&share| share > 0.0).map(|share| r.final_coverage / share))
            .collect();
        let (of_visible_mean, of_visible_std) = of_visible.map(|shares| mean_std(&shares)).unzip();
        let completion = |of: fn(&Completion) -> f64| {
            let values: Vec<f64> = of_policy().filter_map(|r| r.completion.as_ref().map(of)).collect();
            (!values.is_empty()).then(|| <[f64; 2]>::from(mean_std(&values)))
        };
        let (policy, episodes) = (policy.to_owned(), of_policy().count());
        SummaryRow {
            policy,
            episodes,
            final_coverage_mean,
            final_coverage_std,
            auc_mean,
            auc_std,
            of_visible_mean,
            of_visible_std,
            completion_percent: completion(|c| 100.0 * c.share),
            completion_cm: completion(|c| 100.0 * c.mean_distance),
        }
    };
    policies.into_iter().map(row).collect()
}

/// Head and rows; a column only where something stands in it.
fn lines(rows: &[SummaryRow]) -> Vec<Vec<String>> {
    let spread = |mean: f64, std: f64| format!("{mean:.3} ± {std:.3}");
    let cells = |row: &SummaryRow| {
        let coverage = spread(row.final_coverage_mean, row.final_coverage_std);
        let of_visible = row.of_visible_mean.zip(row.of_visible_std).map_or(String::new(), |(m, s)| spread(m, s));
        let [percent, cm] = [row.completion_percent, row.completion_cm]
            .map(|measured| measured.map_or(String::new(), |[mean, std]| format!("{mean:.2} ± {std:.2}")));
        let auc = spread(row.auc_mean, row.auc_std);
        [row.policy.clone(), row.episodes.to_string(), coverage, auc, of_visible, percent, cm]
    };
    let head = ["Policy", "Episodes", "Final Cov.", "AUC", "of visible", "Comp. %", "Comp. cm"].map(str::to_owned);
    let cells = std::iter::once(head).chain(rows.iter().map(cells));
    shown(cells.map(|line| line.to_vec()).collect())
}

/// A table, head first, without the columns in which only the head stands.
pub(crate) fn shown(lines: Vec<Vec<String>>) -> Vec<Vec<String>> {
    let columns = lines.first().map_or(0, Vec::len);
    let is_shown =
        |&column: &usize| lines.iter().skip(1).any(|line| line.get(column).is_some_and(|cell| !cell.is_empty()));
    let kept: Vec<usize> = (0..columns).filter(is_shown).collect();
    lines.into_iter().map(|line| kept.iter().filter_map(|&column| line.get(column).cloned()).collect()).collect()
}

/// A Markdown table in the paper's columns.
pub fn markdown(rows: &[SummaryRow]) -> String {
    markdown_of(&lines(rows))
}

/// The same for a terminal, in columns.
pub fn text(rows: &[SummaryRow]) -> String {
    text_of(&lines(rows))
}

/// A table, head first, as Markdown; numbers to the right of the first column.
pub(crate) fn markdown_of(lines: &[Vec<String>]) -> String {
    let line = |cells: &Vec<String>| {
        format!("| {} |\n", cells.iter().map(|cell| cell.replace('|', "\\|")).collect::<Vec<_>>().join(" | "))
    };
    let mut text: Vec<String> = lines.iter().map(line).collect();
    text.insert(1, format!("|---|{}\n", "---:|".repeat(lines.first().map_or(0, Vec::len).saturating_sub(1))));
    text.concat()
}

/// The same for a terminal.
pub(crate) fn text_of(lines: &[Vec<String>]) -> String {
    let width = |column: usize| {
        lines.iter().filter_map(|line| line.get(column)).map(|cell| cell.chars().count()).max().unwrap_or(0)
    };
    let mut out = String::new();
    for line in lines {
        for (column, cell) in line.iter().enumerate() {
            match column {
                0 => out += &format!("{cell:<0$}", width(0)),
                _ => out += &format!("  {cell:>0$}", width(column)),
            }
        }
        out.push('\n');
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(policy: &str, final_coverage: f64, auc: f64) -> EpisodeRecord {
        EpisodeRecord {
            scene: "s".into(),
            policy: policy.into(),
            start: 0,
            seed: 0,
            steps: 0,
            curve: Vec::new(),
            final_coverage,
            auc,
            released_curve: None,
            released_final: None,
            released_auc: None,
            bumps: 0,
            path_length: 0.0,
            decision_ms: 0.0,
            completion: None,
            poses: Vec::new(),
        }
    }

    #[test]
    fn policies_keep_their_order_and_show_mean_and_spread() {
        let episodes = [record("nbp", 0.9, 0.7), record("fbe", 0.5, 0.4), record("nbp", 0.8, 0.5)];
        let rows = summarise(&episodes, &BTreeMap::new());
        assert_eq!(rows.iter().map(|row| row.policy.as_str()).collect::<Vec<_>>(), ["nbp", "fbe"]);
        assert!((rows[0].final_coverage_mean - 0.85).abs() < 1e-12 && rows[1].auc_std == 0.0);
        let table = markdown(&rows);
        assert!(table.contains("| Policy | Episodes | Final Cov. | AUC |\n"), "{table}");
        assert!(table.contains("| nbp | 2 | 0.850 ± 0.071 | 0.600 ± 0.141 |"), "{table}");
        assert!(
            text(&rows).lines().all(|line| line.chars().count() == text(&rows).lines().next().unwrap().chars().count())
        );
        let lines = [["a|b", "c"], ["d", "|"]].map(|line| line.map(str::to_owned).to_vec());
        assert_eq!(markdown_of(&lines), "| a\\|b | c |\n|---|---:|\n| d | \\| |\n");
        let visible = BTreeMap::from([("s".to_owned(), 0.5)]);
        let seen = summarise(&episodes, &visible);
        assert!((seen[0].of_visible_mean.unwrap() - 1.7).abs() < 1e-12 && seen[1].of_visible_std == Some(0.0));
        assert!(markdown(&seen).contains("| AUC | of visible |\n|---|---:|---:|---:|---:|\n"), "{}", markdown(&seen));
        assert!(text(&seen).lines().nth(2).unwrap().ends_with("1.000 ± 0.000"), "{}", text(&seen));
        let measured = |share| Some(Completion { share, mean_distance: 0.5 - 0.5 * share });
        let episodes =
            [0.25, 0.75].map(|share| EpisodeRecord { completion: measured(share), ..record("fbe", 0.5, 0.4) });
        let table = markdown(&summarise(&episodes, &BTreeMap::new()));
        assert!(table.contains("| AUC | Comp. % | Comp. cm |\n|---|---:|---:|---:|---:|---:|\n"), "{table}");
        assert!(table.ends_with("| 50.00 ± 35.36 | 25.00 ± 17.68 |\n"), "{table}");
        let keys = serde_json::to_value(&rows[0]).unwrap();
        let expected = ["auc_mean", "auc_std", "episodes", "final_coverage_mean", "final_coverage_std", "policy"];
        assert_eq!(
            keys.as_object().unwrap().keys().map(String::as_str).collect::<std::collections::BTreeSet<_>>(),
            expected.into()
        );
    }
}
