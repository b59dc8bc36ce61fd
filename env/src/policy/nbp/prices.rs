//! What a move costs the planner: what was seen of it, what is predicted, and how much the settings make of doubt.

use super::projection::Seen;
use super::{Goals, Nbp, Passability, Thought};
use crate::map::grid::cells_between;
use crate::map::{Cell, MapView, occupancy};
use crate::policy::{DOUBTFUL_PRICE, crosses_unknown, observed_price};
use crate::pose::Node;

impl Nbp {
    /// What the planner pays for an edge; `None` where it is closed or leaves the window.
    pub(super) fn price(&self, view: &MapView<'_>, thought: &Thought, a: Node, b: Node) -> Option<f32> {
        let input = &thought.0;
        let (from, to) = (view.lattice().position(a), view.lattice().position(b));
        let is_known = || cells_between(from, to, occupancy::CELL).all(|cell| view.occupancy().get(cell) == Cell::Free);
        if input.window.pixel(to).is_none() && !(self.config.goals == Goals::Surroundings && is_known()) {
            return None;
        }
        if let Passability::Truth(world) = &self.passability {
            return world.scene().graph().is_passable(a, b).then_some(1.0);
        }
        let observed = observed_price(view, a, b).filter(|_| !self.closed.contains(&[a, b]))?;
        let observed = if observed >= DOUBTFUL_PRICE { self.config.wall_price } else { observed };
        if view.is_traversed(a, b) || (self.config.fuse_observed && is_known()) {
            return Some(1.0);
        }
        let pixels = cells_between(from, to, input.window.size.pixel());
        let obstacles = pixels.filter(|&pixel| self.is_obstacle(view, thought, pixel)).count();
        match (obstacles < self.config.blocking_pixels, self.config.fuse_observed) {
            (true, false) => Some(1.0),
            (true, true) => Some(self.price_of_unknown(view, a, b).max(observed)),
            (false, false) => None,
            // A predicted wall is as doubtful as a seen one: an agent that stands beside a wall is not walled in by it.
            (false, true) => Some(self.config.wall_price),
        }
    }

    /// What a move costs for the cells on it that nothing is known of.
    fn price_of_unknown(&self, view: &MapView<'_>, a: Node, b: Node) -> f32 {
        if self.config.goals != Goals::Surroundings || self.config.unknown_price <= 1.0 {
            return 1.0;
        }
        if crosses_unknown(view, a, b) { self.config.unknown_price } else { 1.0 }
    }

    /// Whether a world pixel of the window is taken for an obstacle.
    fn is_obstacle(&self, view: &MapView<'_>, (input, prediction): &Thought, pixel: [i32; 2]) -> bool {
        let Some((row, col)) = input.window.pixel_of(pixel) else { return false };
        let seen = if self.config.slice_overrides { self.projection.get(pixel) } else { Seen::Nothing };
        let is_on_way = || {
            // The input may show more or less than the answers.
            let seen = view.density().window_size().around(view.position()).pixel(input.window.position(row, col));
            let way = input.channel(input.channels - 1);
            self.config.slice_overrides && seen.is_some_and(|(row, col)| way[row * input.size() + col] > 0)
        };
        match seen {
            Seen::Nothing => prediction.obstacle.at(row, col) >= self.config.obstacle_threshold && !is_on_way(),
            Seen::Open => false,
            Seen::Wall => !is_on_way(),
        }
    }
}
