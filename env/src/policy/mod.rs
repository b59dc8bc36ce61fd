//! Policies: from what the agent knows to its next action. One file, one policy.

pub mod fbe;
pub mod nbp;
pub mod oracle;
mod promise;
pub mod random;
pub mod random_nbv;
pub mod scone;
pub mod search;

use crate::episode::{Action, Decision, Episode};
use crate::map::grid::cells_between;
use crate::map::{Cell, MapView, occupancy};
use crate::motion::Motion;
use crate::pose::{Direction, HEADINGS, Heading, Lattice, LatticePose, Node};
use crate::predict::{EncoderInput, PredictError, Prediction};
use crate::seed::Rng;
use rand::RngExt as _;
use rand::seq::IndexedRandom;

/// Why a policy cannot act.
#[derive(Debug, thiserror::Error)]
pub enum PolicyError {
    /// Its network failed.
    #[error(transparent)]
    Predict(#[from] PredictError),
}

/// A path to a goal, as last planned, for pictures and for training.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Step of the episode at which it was made.
    pub made_at: usize,
    /// Poses from the one after the current to the goal.
    pub path: Vec<LatticePose>,
    /// What the network saw and answered, for policies that have one.
    pub thought: Option<(EncoderInput, Prediction)>,
}

/// Chooses actions.
pub trait Policy: Send {
    /// Name in tables and on the command line.
    fn name(&self) -> &'static str;

    /// Forgets the last episode.
    fn begin(&mut self);

    /// The next action.
    ///
    /// # Errors
    /// When a network fails.
    fn act(&mut self, view: &MapView<'_>, rng: &mut Rng) -> Result<Action, PolicyError>;

    /// The next motion, for policies that act in motions themselves; asked first in the continuous world. `None` leaves it
    /// to [`Policy::act`], whose actions a pilot carries out.
    ///
    /// # Errors
    /// When a network fails.
    fn motion(&mut self, view: &MapView<'_>, rng: &mut Rng) -> Result<Option<Motion>, PolicyError> {
        let _ = (view, rng);
        Ok(None)
    }

    /// The plan being followed, if the policy plans.
    fn plan(&self) -> Option<&Plan> {
        None
    }
}

/// What a policy wants in an episode: a motion where the agent has them and the policy acts in them, else an action.
///
/// # Errors
/// As [`Policy::motion`] and [`Policy::act`].
pub fn decide(policy: &mut dyn Policy, episode: &Episode, rng: &mut Rng) -> Result<Decision, PolicyError> {
    let view = episode.view();
    let motion = if episode.is_continuous() { policy.motion(&view, rng)? } else { None };
    motion.map_or_else(|| policy.act(&view, rng).map(Decision::Action), |motion| Ok(Decision::Motion(motion)))
}

impl From<Action> for Decision {
    fn from(action: Action) -> Self {
        Self::Action(action)
    }
}

impl From<Motion> for Decision {
    fn from(motion: Motion) -> Self {
        Self::Motion(motion)
    }
}

/// Price of a move across a wall that was seen: walls nearly along the way look the same on a grid, so such a move is a
/// last resort, and only a bump rules it out.
const DOUBTFUL_PRICE: f32 = 10.0;

/// What experience says a move costs: unknown space counts as free, so that the way across a lattice cell not yet seen
/// can be planned.
fn observed_price(view: &MapView<'_>, a: Node, b: Node) -> Option<f32> {
    let lattice = view.lattice();
    if !lattice.contains(b) || view.bumps(a, b) > 0 {
        return None;
    }
    let is_doubtful =
        !view.is_traversed(a, b) && view.occupancy().is_wall_between(lattice.position(a), lattice.position(b));
    Some(if is_doubtful { DOUBTFUL_PRICE } else { 1.0 })
}

/// Whether a move crosses cells that nothing is known of.
fn crosses_unknown(view: &MapView<'_>, a: Node, b: Node) -> bool {
    let (from, to) = (view.lattice().position(a), view.lattice().position(b));
    cells_between(from, to, occupancy::CELL).any(|cell| view.occupancy().get(cell) == Cell::Unknown)
}

/// The action that goes from one pose to a neighbouring one (or turns).
fn action_towards(from: Node, to: LatticePose) -> Action {
    Action { direction: Direction::between(from, to.node), heading: to.heading }
}

/// The lattice poses nearest to those at which a step takes its `captures` frames, the last of them where it ends.
fn poses_of_step(
    lattice: &Lattice,
    from: LatticePose,
    to: LatticePose,
    captures: usize,
) -> impl Iterator<Item = LatticePose> + use<> {
    let (lattice, begin, end) = (*lattice, lattice.pose(from), lattice.pose(to));
    (1..=captures).map(move |n| {
        let pose = begin.interpolate(&end, n as f32 / captures as f32);
        let heading = Heading::towards(pose.azimuth.sin(), pose.azimuth.cos());
        if n == captures { to } else { LatticePose { node: lattice.nearest(pose.position), heading } }
    })
}

/// The headings that one move of a next-best-view policy may end with: all but the one behind.
pub(crate) fn headings_near(heading: Heading) -> impl Iterator<Item = Heading> {
    (HEADINGS - 3..=HEADINGS + 3).map(move |turn| Heading::new(heading.index() + turn))
}

/// What every policy does when it has nowhere to go, the common rule: turn to a heading not used here yet, else to any other.
fn turn_on_the_spot(view: &MapView<'_>, rng: &mut Rng) -> Action {
    let node = view.pose().node;
    let fresh: Vec<Heading> =
        Heading::all().filter(|&heading| view.visits(LatticePose { node, heading }) == 0).collect();
    let turned = || Heading::new(view.pose().heading.index() + 1);
    let heading = match fresh.choose(rng) {
        Some(&heading) => heading,
        None => Heading::new(turned().index() + rng.random_range(0..7_usize)),
    };
    Action { direction: None, heading }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::seed::SeedTree;
    use crate::world::World;
    use std::sync::Arc;

    /// The episode of a policy from a start, to its end.
    pub(super) fn explore(world: &Arc<World>, policy: &mut dyn Policy, start: LatticePose, steps: usize) -> Episode {
        let mut episode = Episode::new(Arc::clone(world), start, steps, SeedTree::new(5)).unwrap();
        let mut rng = SeedTree::new(6).rng();
        policy.begin();
        while !episode.is_over() {
            let action = policy.act(&episode.view(), &mut rng).unwrap();
            episode.step(action);
        }
        episode
    }
}
