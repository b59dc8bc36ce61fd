//! The long-term goal: the best predicted pose, or one drawn by its value (paper, section 4.2, equation 1).

use crate::pose::LatticePose;
use crate::seed::Rng;
use rand::RngExt as _;
use serde::{Deserialize, Serialize};

/// A pose that can be reached and the gain predicted for going there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Position and heading.
    pub pose: LatticePose,
    /// Predicted gain, percent points.
    pub value: f32,
}

/// How the goal is chosen.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields, tag = "rule")]
pub enum GoalRule {
    /// The highest value (paper, inference).
    Greedy,
    /// Drawn with probability proportional to `exp(value / beta)` (paper, training).
    Boltzmann {
        /// Temperature in percent points (released code: 0.5).
        beta: f32,
    },
}

impl GoalRule {
    /// Chooses among candidates; `None` without any. Ties go to the first in order.
    pub fn choose(&self, candidates: &[Candidate], rng: &mut Rng) -> Option<Candidate> {
        match *self {
            Self::Greedy => candidates.iter().copied().reduce(|best, c| if c.value > best.value { c } else { best }),
            Self::Boltzmann { beta } => boltzmann(candidates, beta, rng),
        }
    }
}

fn boltzmann(candidates: &[Candidate], beta: f32, rng: &mut Rng) -> Option<Candidate> {
    let highest = candidates.iter().map(|c| c.value).fold(f32::NEG_INFINITY, f32::max);
    let weight = |c: &Candidate| f64::from((c.value - highest) / beta).exp();
    let total: f64 = candidates.iter().map(weight).sum();
    let mut rest = rng.random::<f64>() * total;
    candidates
        .iter()
        .find(|c| {
            rest -= weight(c);
            rest <= 0.0
        })
        .or(candidates.last())
        .copied()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::{Heading, Node};
    use crate::seed::SeedTree;

    fn candidates() -> Vec<Candidate> {
        [1.0, 3.0, 2.0, 3.0]
            .into_iter()
            .enumerate()
            .map(|(n, value)| {
                let pose = LatticePose { node: Node { i: n as i32, k: 0 }, heading: Heading::new(0) };
                Candidate { pose, value }
            })
            .collect()
    }

    #[test]
    fn greedy_takes_the_first_of_the_best() {
        let chosen = GoalRule::Greedy.choose(&candidates(), &mut SeedTree::new(0).rng());
        assert_eq!(chosen, Some(candidates()[1]));
        assert_eq!(GoalRule::Greedy.choose(&[], &mut SeedTree::new(0).rng()), None);
    }

    #[test]
    fn boltzmann_follows_its_temperature() {
        let mut rng = SeedTree::new(1).rng();
        let rule = GoalRule::Boltzmann { beta: 1.0 };
        let mut counts = [0_u32; 4];
        for _ in 0..20_000 {
            counts[rule.choose(&candidates(), &mut rng).unwrap().pose.node.i as usize] += 1;
        }
        let expected = [1.0_f64, 3.0, 2.0, 3.0].map(f64::exp);
        let total: f64 = expected.iter().sum();
        for (count, weight) in counts.iter().zip(expected) {
            assert!((f64::from(*count) / 20_000.0 - weight / total).abs() < 0.015, "{counts:?}");
        }
        let cold = GoalRule::Boltzmann { beta: 1e-4 };
        assert_eq!(cold.choose(&candidates()[..3], &mut rng).unwrap().value, 3.0);
    }
}
