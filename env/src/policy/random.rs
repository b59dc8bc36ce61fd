//! `random`: a uniformly drawn neighbour and heading (paper, section 5.2), or a uniformly drawn motion.

use super::{Policy, PolicyError, turn_on_the_spot};
use crate::episode::Action;
use crate::map::MapView;
use crate::motion::Motion;
use crate::pose::{Direction, Heading};
use crate::seed::Rng;
use rand::RngExt as _;
use rand::seq::IndexedRandom;

/// Uniform over four moves and eight headings, without the moves already known to be blocked.
#[derive(Debug, Default, Clone, Copy)]
pub struct Random;

impl Policy for Random {
    fn name(&self) -> &'static str {
        "random"
    }

    fn begin(&mut self) {}

    fn act(&mut self, view: &MapView<'_>, rng: &mut Rng) -> Result<Action, PolicyError> {
        let node = view.pose().node;
        let open: Vec<Direction> =
            Direction::ALL.into_iter().filter(|&direction| view.bumps(node, node.step(direction)) == 0).collect();
        let heading = Heading::new(rng.random_range(0..8_usize));
        Ok(match open.choose(rng) {
            Some(&direction) => Action { direction: Some(direction), heading },
            None => turn_on_the_spot(view, rng),
        })
    }

    fn motion(&mut self, _: &MapView<'_>, rng: &mut Rng) -> Result<Option<Motion>, PolicyError> {
        Ok(Motion::ALL.choose(rng).copied())
    }
}
