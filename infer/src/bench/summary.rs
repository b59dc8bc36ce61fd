//! The figures of a bench: means and spreads over episodes as the paper has them, and paired differences over scenes.

use super::store::{BenchResult, Manifest, Published, SetResult};
use crate::rollout::EpisodeRecord;
use nbp_env::SeedTree;
use nbp_env::metrics::{Difference, mean_std, paired_difference};
use serde::{Deserialize, Serialize};

/// Mean and sample standard deviation over episodes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Spread {
    /// Mean.
    pub mean: f64,
    /// Deviation.
    pub std: f64,
}

/// The table of a data set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SetSummary {
    /// Data set.
    pub set: String,
    /// Steps of an episode.
    pub steps: usize,
    /// Number of scenes.
    pub scenes: usize,
    /// Row that the differences are to.
    pub reference: String,
    /// Rows, in the order of the bench.
    pub rows: Vec<RowSummary>,
}

/// A row on a data set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RowSummary {
    /// Row.
    pub row: String,
    /// Kind of policy.
    pub policy: String,
    /// Whether it looks at the true map, or at its mesh before a move, and so does not compete with the others.
    pub knows_map: bool,
    /// Number of episodes.
    pub episodes: usize,
    /// Covered share at the end, 0 to 1.
    pub coverage: Spread,
    /// Area under the curve, 0 to 1.
    pub auc: Spread,
    /// Covered share at the end over the share that can be seen from the lattice; frames between poses see a little more, so
    /// it may pass 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub of_visible: Option<Spread>,
    /// Mean over scenes of the difference of the scene's means to the reference, Final Cov.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub coverage_difference: Option<Difference>,
    /// The same, AUC.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub auc_difference: Option<Difference>,
    /// Final Cov. as the released code counts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub released_coverage: Option<Spread>,
    /// AUC of that.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub released_auc: Option<Spread>,
    /// Metres walked.
    pub path_length: Spread,
    /// Moves that hit an obstacle.
    pub bumps: Spread,
    /// Comp. %, in the continuous world.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub completion_percent: Option<Spread>,
    /// Comp. cm, in the continuous world.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub completion_cm: Option<Spread>,
    /// Published figures.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub paper: Option<Published>,
}

fn spread(values: &[f64]) -> Spread {
    let (mean, std) = mean_std(values);
    Spread { mean, std }
}

/// The tables of a bench, one for each data set.
pub fn summarise(result: &BenchResult) -> Vec<SetSummary> {
    let one = |(number, set): (usize, &SetResult)| {
        let row = |index: usize| {
            let paper = result.about.sets[number].paper.get(&result.about.rows[index].name).copied();
            RowSummary { paper, ..row(&result.about, set, index) }
        };
        SetSummary {
            set: set.name.clone(),
            steps: set.steps,
            scenes: set.scenes.len(),
            reference: result.about.reference.clone(),
            rows: (0..result.about.rows.len()).map(row).collect(),
        }
    };
    result.sets.iter().enumerate().map(one).collect()
}

fn row(about: &Manifest, set: &SetResult, index: usize) -> RowSummary {
    let info = &about.rows[index];
    let episodes: Vec<&EpisodeRecord> = set.episodes_of(&info.name).collect();
    let over = |of: &dyn Fn(&EpisodeRecord) -> f64| spread(&episodes.iter().map(|r| of(r)).collect::<Vec<_>>());
    // A figure that one episode lacks is none.
    let if_all = |of: &dyn Fn(&EpisodeRecord) -> Option<f64>| {
        episodes
            .iter()
            .map(|r| of(r))
            .collect::<Option<Vec<f64>>>()
            .filter(|all| !all.is_empty())
            .map(|all| spread(&all))
    };
    let visible = |r: &EpisodeRecord| {
        let scene = set.scenes.iter().find(|scene| scene.name == r.scene)?;
        scene.visible.filter(|&share| share > 0.0).map(|share| r.final_coverage / share)
    };
    // Every row and measure meets the same resamples of the scenes.
    let seed = SeedTree::new(about.seed).child(&format!("set:{}", set.name), 0);
    let difference = |of: fn(&EpisodeRecord) -> f64| {
        let mean = |scene: &str, row: &str| {
            let values: Vec<f64> = set.episodes_of(row).filter(|r| r.scene == scene).map(of).collect();
            mean_std(&values).0
        };
        let of_scene = |scene: &str| mean(scene, &info.name) - mean(scene, &about.reference);
        let all: Vec<f64> = set.scenes.iter().map(|scene| of_scene(&scene.name)).collect();
        if info.name == about.reference { None } else { paired_difference(&all, seed) }
    };
    RowSummary {
        row: info.name.clone(),
        policy: info.policy.name().to_owned(),
        knows_map: info.knows_map(),
        episodes: episodes.len(),
        coverage: over(&|r| r.final_coverage),
        auc: over(&|r| r.auc),
        of_visible: if_all(&visible),
        coverage_difference: difference(|r| r.final_coverage),
        auc_difference: difference(|r| r.auc),
        released_coverage: if_all(&|r| r.released_final),
        released_auc: if_all(&|r| r.released_auc),
        path_length: over(&|r| f64::from(r.path_length)),
        bumps: over(&|r| r.bumps as f64),
        completion_percent: if_all(&|r| r.completion.map(|c| 100.0 * c.share)),
        completion_cm: if_all(&|r| r.completion.map(|c| 100.0 * c.mean_distance)),
        paper: None,
    }
}

impl SetResult {
    /// The episodes of a row, by scene, start and seed.
    pub fn episodes_of<'a>(&'a self, row: &'a str) -> impl Iterator<Item = &'a EpisodeRecord> {
        self.episodes.iter().filter(move |record| record.policy == row)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::store::tests::{record, write};

    #[test]
    fn differences_are_paired_by_scene_and_means_are_over_episodes() {
        let dir = tempfile::tempdir().unwrap();
        let mut result = write(dir.path());
        let paper = Published { coverage: 0.5, auc: 0.4, coverage_std: None, auc_std: None };
        result.about.sets[0].paper.insert("random".into(), paper);
        let set = &mut result.sets[0];
        for (name, visible) in [("b", Some(0.5)), ("c", Some(1.0))] {
            let mut scene = set.scenes[0].clone();
            (scene.name, scene.visible) = (name.into(), visible);
            set.scenes.push(scene);
        }
        set.episodes.clear();
        // In every scene random is worse by 0.1, 0.2 and 0.3; the scenes themselves differ more.
        for (scene, fbe, random) in [("two_rooms", 0.9, [0.8, 0.8]), ("b", 0.4, [0.3, 0.1]), ("c", 0.6, [0.2, 0.4])] {
            let one = |policy: &str, seed, value| EpisodeRecord {
                scene: scene.into(),
                final_coverage: value,
                ..record(policy, 0, seed)
            };
            set.episodes.extend([one("fbe", 7, fbe), one("random", 7, random[0]), one("random", 8, random[1])]);
        }
        let [table] = &summarise(&result)[..] else { panic!("one set") };
        let [fbe, random] = &table.rows[..] else { panic!("two rows") };
        assert_eq!((fbe.episodes, random.episodes, fbe.coverage_difference, random.paper), (3, 6, None, Some(paper)));
        assert!((fbe.coverage.mean - 1.9 / 3.0).abs() < 1e-12);
        let difference = random.coverage_difference.unwrap();
        assert!((difference.mean + 0.2).abs() < 1e-12 && difference.p == 0.25, "{difference:?}");
        assert!(difference.interval[0] >= -0.3 - 1e-12 && difference.interval[1] <= -0.1 + 1e-12);
        assert_eq!(random.auc_difference.unwrap().p, 1.0, "equal AUC");
        assert!((fbe.of_visible.unwrap().mean - (0.9 / 0.75 + 0.8 + 0.6) / 3.0).abs() < 1e-12);
        assert_eq!((random.released_coverage, random.completion_cm), (None, None));
    }
}
