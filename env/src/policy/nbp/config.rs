//! Settings of `nbp`. The defaults are the paper's; where the released code has other rules, each of them is a setting.

use crate::goal::GoalRule;
use crate::policy::DOUBTFUL_PRICE;
use serde::{Deserialize, Serialize};

/// How the value and obstacle maps become a path.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct NbpConfig {
    /// How the goal, and the headings on the way, are chosen: greedy in inference, Boltzmann in training.
    pub goal: GoalRule,
    /// What can be a goal.
    pub goals: Goals,
    /// When a new path is planned.
    pub replan: Replan,
    /// After more than so many steps that have shown next to nothing new of the carved plane, a tour of frontiers (`fbe-tsp`), which knows
    /// neither the network's walls nor the true ones, leads until something is new: where promises are false, there is always one more
    /// of them near. 0: never.
    pub patience: usize,
    /// With `goals = "surroundings"`: what a gain one step later is worth, below 1.
    pub discount: f32,
    /// With `goals = "surroundings"`: count the headings that a step turns through, too, and not only the look at its end: a turn by half
    /// a circle shows three more.
    pub sweeps: bool,
    /// With `goals = "surroundings"`: what is taken off the promise of a look whose rays meet no cell that nothing is known of, as a
    /// frontier's do, ares: small promises are noise, and there is always one near.
    pub seen_penalty: f32,
    /// With `goals = "surroundings"`: by what share the goal of the last plan is worth more than it promises, 0 or more. Answers
    /// change from step to step, and who turns around for each of them goes nowhere.
    pub commitment: f32,
    /// With `goals = "surroundings"`: share of what was promised before in what is promised now, from 0 to below 1.
    pub memory: f32,
    /// With `goals = "surroundings"` and `fuse_observed`: what a move across cells that nothing is known of costs, in steps, at
    /// least 1 and below 10: behind walls most of them are solid, whatever the network answers.
    pub unknown_price: f32,
    /// With `fuse_observed`: what a move across a wall that was seen or is predicted costs, in steps, at least 10. Walls nearly along
    /// the way look the same on a grid, so it is not ruled out; bars let looks through and nobody.
    pub wall_price: f32,
    /// Probability from which a pixel is an obstacle (paper: not given; released code: 0.13).
    pub obstacle_threshold: f32,
    /// Obstacle pixels on a move's segment from which it is blocked (released code: 2 at 256 pixels).
    pub blocking_pixels: usize,
    /// Let the carved map overrule the predicted one where it knows better. Off in the paper.
    pub fuse_observed: bool,
    /// Leave poses already visited out of goals and headings (released code: headings only; paper: silent).
    pub skip_visited: bool,
    /// Probability that a heading on the way is replaced by a random one (released code, in collection: 0.6).
    pub random_heading: f32,
    /// Percent points taken from the value of a goal whose own pixel shows a point of the cloud (released planner: 10, which
    /// makes a frontier of what it chooses; paper: none).
    pub observed_penalty: f32,
    /// A goal needs a pixel with a point of the cloud within so many metres along each axis (released planner: 10 pixels of 256,
    /// so 1.5625; paper: no such rule).
    pub observed_within: Option<f32>,
    /// A goal whose path was stopped is none any more, for the whole episode (released planner; paper: silent).
    pub blacklist_goals: bool,
    /// Where the cloud has points, those within 5 cm of the camera's height say whether a pixel is an obstacle, not the
    /// network; the agent's own way is free (released planner; paper: predicted obstacles alone).
    pub slice_overrides: bool,
    /// Look at the true mesh before a move, free of charge: an edge that hits it is closed, and the way planned anew, at no
    /// cost of a step (released planner; the paper's obstacles are predicted). Without it the move bumps.
    pub oracle_edges: bool,
}

/// When a new path is planned.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Replan {
    /// Once the goal is reached or the way is stopped (paper, section 4.2).
    #[default]
    OnArrival,
    /// Before every step (the "new strategy" of the paper's appendix, which covers less).
    EveryStep,
}

/// What can be a goal.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Goals {
    /// Every pose but the current one, by its own value (paper, equation 1).
    #[default]
    Poses,
    /// Every position but the current one, by the value of its best heading; all headings of the path are then the best
    /// that are not visited, whatever the rule for goals (released code).
    Positions,
    /// Every position, by what looking around from it promises, the less the longer the way: a receding horizon (Bircher et
    /// al., ICRA 2016). Wants a network that learnt from `collect.labels = "looks"`, whose values are not those of ways, and
    /// `replan = "every-step"`, since each look changes what the next is worth.
    Surroundings,
}

impl Default for NbpConfig {
    fn default() -> Self {
        Self {
            goal: GoalRule::Greedy,
            goals: Goals::Poses,
            replan: Replan::OnArrival,
            patience: 0,
            discount: 0.96,
            sweeps: false,
            seen_penalty: 0.0,
            commitment: 0.0,
            memory: 0.0,
            unknown_price: 1.0,
            wall_price: DOUBTFUL_PRICE,
            obstacle_threshold: 0.5,
            blocking_pixels: 2,
            fuse_observed: false,
            skip_visited: true,
            random_heading: 0.0,
            observed_penalty: 0.0,
            observed_within: None,
            blacklist_goals: false,
            slice_overrides: false,
            oracle_edges: false,
        }
    }
}

/// A setting that the policy cannot work with.
#[derive(Debug, thiserror::Error)]
#[error("{field} is {value}: it must be {want}")]
pub struct NbpConfigError {
    field: &'static str,
    value: String,
    want: &'static str,
}

impl NbpConfig {
    /// Checks every number.
    ///
    /// # Errors
    /// Naming the first setting that is out of range.
    pub fn validate(&self) -> Result<(), NbpConfigError> {
        let refuse = |field, value: String, want| Err(NbpConfigError { field, value, want });
        if let GoalRule::Boltzmann { beta } = self.goal
            && !(beta.is_finite() && beta > 0.0)
        {
            return refuse("goal.beta", beta.to_string(), "a positive number of percent points");
        }
        if !(0.0..=1.0).contains(&self.obstacle_threshold) {
            return refuse("obstacle_threshold", self.obstacle_threshold.to_string(), "a probability, 0 to 1");
        }
        if !(self.discount > 0.0 && self.discount < 1.0) {
            return refuse("discount", self.discount.to_string(), "between 0 and 1");
        }
        if !(self.commitment.is_finite() && self.commitment >= 0.0) {
            return refuse("commitment", self.commitment.to_string(), "a share that is not negative");
        }
        if !(0.0..1.0).contains(&self.memory) {
            return refuse("memory", self.memory.to_string(), "a share below 1");
        }
        if !(1.0..DOUBTFUL_PRICE).contains(&self.unknown_price) {
            return refuse("unknown_price", self.unknown_price.to_string(), "at least 1 and below 10 steps");
        }
        if !(self.wall_price.is_finite() && self.wall_price >= DOUBTFUL_PRICE) {
            return refuse("wall_price", self.wall_price.to_string(), "at least 10 steps");
        }
        if self.blocking_pixels == 0 {
            return refuse("blocking_pixels", "0".into(), "at least 1, or every move is blocked");
        }
        if !(0.0..=1.0).contains(&self.random_heading) {
            return refuse("random_heading", self.random_heading.to_string(), "a probability, 0 to 1");
        }
        let lengths = [
            ("seen_penalty", self.seen_penalty),
            ("observed_penalty", self.observed_penalty),
            ("observed_within", self.observed_within.unwrap_or(0.0)),
        ];
        if let Some((field, value)) = lengths.into_iter().find(|(_, value)| !(value.is_finite() && *value >= 0.0)) {
            return refuse(field, value.to_string(), "a number that is not negative");
        }
        Ok(())
    }
}
