//! Episodes summed up: mean and spread of Final Coverage and AUC for each policy, as the paper's tables have them.

use crate::rollout::EpisodeRecord;
use nbp_env::metrics::mean_std;
use serde::{Deserialize, Serialize};

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
}

/// One row for each policy, in the order in which they first appear.
pub fn summarise(episodes: &[EpisodeRecord]) -> Vec<SummaryRow> {
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
        let (policy, episodes) = (policy.to_owned(), of_policy().count());
        SummaryRow { policy, episodes, final_coverage_mean, final_coverage_std, auc_mean, auc_std }
    };
    policies.into_iter().map(row).collect()
}

const HEAD: [&str; 4] = ["Policy", "Episodes", "Final Cov.", "AUC"];

fn cells(row: &SummaryRow) -> [String; 4] {
    let spread = |mean: f64, std: f64| format!("{mean:.3} ± {std:.3}");
    [
        row.policy.clone(),
        row.episodes.to_string(),
        spread(row.final_coverage_mean, row.final_coverage_std),
        spread(row.auc_mean, row.auc_std),
    ]
}

/// A Markdown table in the paper's columns.
pub fn markdown(rows: &[SummaryRow]) -> String {
    let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
    let mut out = line(&HEAD.map(str::to_owned));
    out += "|---|---:|---:|---:|\n";
    out.extend(rows.iter().map(|row| line(&cells(row))));
    out
}

/// The same for a terminal, in columns.
pub fn text(rows: &[SummaryRow]) -> String {
    let lines: Vec<[String; 4]> = std::iter::once(HEAD.map(str::to_owned)).chain(rows.iter().map(cells)).collect();
    let width = |column: usize| lines.iter().map(|line| line[column].chars().count()).max().unwrap_or(0);
    let widths = [0, 1, 2, 3].map(width);
    let mut out = String::new();
    for [policy, numbers @ ..] in &lines {
        out += &format!("{policy:<0$}", widths[0]);
        for (number, width) in numbers.iter().zip(&widths[1..]) {
            out += &format!("  {number:>width$}");
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
            bumps: 0,
            path_length: 0.0,
            decision_ms: 0.0,
            poses: Vec::new(),
        }
    }

    #[test]
    fn policies_keep_their_order_and_show_mean_and_spread() {
        let episodes = [record("nbp", 0.9, 0.7), record("fbe", 0.5, 0.4), record("nbp", 0.8, 0.5)];
        let rows = summarise(&episodes);
        assert_eq!(rows.iter().map(|row| row.policy.as_str()).collect::<Vec<_>>(), ["nbp", "fbe"]);
        assert!((rows[0].final_coverage_mean - 0.85).abs() < 1e-12 && rows[1].auc_std == 0.0);
        let table = markdown(&rows);
        assert!(table.contains("| Policy | Episodes | Final Cov. | AUC |\n"), "{table}");
        assert!(table.contains("| nbp | 2 | 0.850 ± 0.071 | 0.600 ± 0.141 |"), "{table}");
        assert!(
            text(&rows).lines().all(|line| line.chars().count() == text(&rows).lines().next().unwrap().chars().count())
        );
        let keys = serde_json::to_value(&rows[0]).unwrap();
        let expected = ["auc_mean", "auc_std", "episodes", "final_coverage_mean", "final_coverage_std", "policy"];
        assert_eq!(
            keys.as_object().unwrap().keys().map(String::as_str).collect::<std::collections::BTreeSet<_>>(),
            expected.into()
        );
    }
}
