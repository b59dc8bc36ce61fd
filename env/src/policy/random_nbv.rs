//! `random-nbv`: a uniform draw among the candidates of MACARONS, a move to a neighbour with a turn of at most 135°.

use super::{Policy, PolicyError, headings_near, turn_on_the_spot};
use crate::episode::Action;
use crate::map::MapView;
use crate::pose::{Direction, LatticePose};
use crate::seed::Rng;
use rand::seq::IndexedRandom;

/// Uniform over the moves not known to be blocked and the headings near the current one. It never stays where it can go.
#[derive(Debug, Default, Clone, Copy)]
pub struct RandomNbv;

impl Policy for RandomNbv {
    fn name(&self) -> &'static str {
        "random-nbv"
    }

    fn begin(&mut self) {}

    fn act(&mut self, view: &MapView<'_>, rng: &mut Rng) -> Result<Action, PolicyError> {
        let LatticePose { node, heading } = view.pose();
        let open = Direction::ALL.into_iter().filter(|&direction| view.bumps(node, node.step(direction)) == 0);
        let candidates: Vec<Action> = open
            .flat_map(|direction| {
                headings_near(heading).map(move |heading| Action { direction: Some(direction), heading })
            })
            .collect();
        Ok(candidates.choose(rng).copied().unwrap_or_else(|| turn_on_the_spot(view, rng)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::check_policy;
    use crate::config::SimConfig;
    use crate::policy::tests::explore;
    use crate::pose::{HEADINGS, Heading, Node};
    use crate::scene::Scene;
    use crate::world::World;
    use std::collections::BTreeSet;
    use std::sync::Arc;

    #[test]
    fn it_draws_every_near_heading_and_never_looks_back() {
        let near: Vec<Heading> = headings_near(Heading::new(1)).collect();
        assert_eq!(near, [6, 7, 0, 1, 2, 3, 4].map(Heading::new));
        let world = Arc::new(World::new(Scene::two_rooms(), &SimConfig::default()).unwrap());
        let start = LatticePose { node: Node { i: 1, k: 1 }, heading: Heading::new(0) };
        let episode = explore(&world, &mut RandomNbv, start, 200);
        let poses = episode.view().history();
        let turns = poses
            .windows(2)
            .filter(|pair| pair[0].node != pair[1].node)
            .map(|pair| (pair[1].heading.index() + HEADINGS - pair[0].heading.index()) % HEADINGS);
        assert_eq!(turns.collect::<BTreeSet<_>>().into_iter().collect::<Vec<_>>(), [0, 1, 2, 3, 5, 6, 7]);
        let stays = poses.windows(2).filter(|pair| pair[0].node == pair[1].node).count();
        assert_eq!(stays, episode.bumps(), "only a wall keeps it where it is");
        assert_eq!(episode.bumps(), episode.view().blocked_edges(), "and each but once");
        assert_eq!(check_policy(&mut RandomNbv, &world), []);
    }
}
