//! `fbe`, `fbe-gain`, `fbe-tsp`: frontier-based exploration (Yamauchi 1997), by the nearest frontier, by the largest for its
//! way, or by a tour of all.

mod clusters;
mod look;
mod tour;

use super::{Plan, Policy, PolicyError, action_towards, crosses_unknown, observed_price, turn_on_the_spot};
use crate::episode::Action;
use crate::map::{Cell, MapView, OccupancyGrid};
use crate::path::{PriceList, ShortestPaths};
use crate::pose::{Heading, LatticePose, Node};
use crate::seed::Rng;
use clusters::{CellIndex, clusters};
use look::{Look, best_look, nearest_unseen, nodes_near};
use std::cmp::Reverse;

/// From how far frontiers are looked at in passing, metres.
const PASSING_DISTANCE: f32 = 6.0;

/// What `fbe-gain` and `fbe-tsp` take a move across unknown cells to cost, in steps: behind walls most of them are solid.
const UNKNOWN_PRICE: f32 = 6.0;

/// Which frontier is next.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Rule {
    /// The nearest.
    #[default]
    Nearest,
    /// The most cells for each step of the way.
    Gain,
    /// The first on a tour of all, see `tour.rs`.
    Tsp,
}

/// Goes to clusters of unknown cells that border free ones.
#[derive(Debug, Default)]
pub struct Fbe {
    rule: Rule,
    plan: Option<Plan>,
    next: usize,
    /// Cells that the plan is made for; once all are known there is nothing to go for.
    target: Vec<CellIndex>,
}

impl Fbe {
    /// A policy that chooses frontiers by a rule.
    pub fn new(rule: Rule) -> Self {
        Self { rule, ..Self::default() }
    }

    fn follow(&self, view: &MapView<'_>) -> Option<LatticePose> {
        let plan = self.plan.as_ref()?;
        let arrived = self.next == 0 || plan.path.get(self.next - 1) == Some(&view.pose());
        let target = *plan.path.get(self.next)?;
        let here = view.pose().node;
        let is_worth_it = self.target.iter().any(|&cell| view.occupancy().get(cell) == Cell::Unknown);
        (arrived && is_worth_it && (target.node == here || observed_price(view, here, target.node).is_some()))
            .then_some(target)
    }

    fn make_plan(&mut self, view: &MapView<'_>) {
        let here = view.pose().node;
        let price = if self.rule == Rule::Nearest { observed_price } else { careful_price };
        let mut prices = PriceList::new(view.lattice(), |a, b| price(view, a, b));
        let paths = prices.paths_from(here);
        let clusters = clusters(view);
        let goal = match self.rule {
            Rule::Nearest => nearest(view, &paths, &clusters),
            Rule::Gain => largest_for_its_way(looks(view, &paths, &clusters)),
            Rule::Tsp => tour::first(&mut prices, looks(view, &paths, &clusters)),
        };
        let (path, target) = match goal.or_else(|| nearest_unseen(view, &paths)) {
            None => (Vec::new(), Vec::new()),
            Some(Look { pose, cells, .. }) => {
                let mut path = poses_along(here, &paths.path_to(pose.node).unwrap_or_default(), pose);
                if self.rule != Rule::Nearest {
                    look_around(view, &mut path, &clusters);
                }
                (path, cells)
            }
        };
        self.plan = Some(Plan { made_at: view.step(), path, thought: None });
        self.target = target;
        self.next = 0;
    }
}

impl Policy for Fbe {
    fn name(&self) -> &'static str {
        match self.rule {
            Rule::Nearest => "fbe",
            Rule::Gain => "fbe-gain",
            Rule::Tsp => "fbe-tsp",
        }
    }

    fn begin(&mut self) {
        *self = Self::new(self.rule);
    }

    fn act(&mut self, view: &MapView<'_>, rng: &mut Rng) -> Result<Action, PolicyError> {
        // The published baseline follows its plan to the end; the others look at what has changed.
        if self.rule != Rule::Nearest || self.follow(view).is_none() {
            self.make_plan(view);
        }
        Ok(match self.follow(view) {
            Some(target) => {
                self.next += 1;
                action_towards(view.pose().node, target)
            }
            None => turn_on_the_spot(view, rng),
        })
    }

    fn plan(&self) -> Option<&Plan> {
        self.plan.as_ref()
    }
}

/// Poses of a path: looking where one walks, and as the goal says at its end.
fn poses_along(from: Node, nodes: &[Node], goal: LatticePose) -> Vec<LatticePose> {
    let before = std::iter::once(from).chain(nodes.iter().copied());
    let mut poses: Vec<LatticePose> = before
        .zip(nodes)
        .map(|(a, &b)| LatticePose { node: b, heading: Heading::towards((b.i - a.i) as f32, (b.k - a.k) as f32) })
        .collect();
    match poses.last_mut() {
        Some(last) => *last = goal,
        None => poses.push(goal),
    }
    poses
}

/// As [`observed_price`], but the unknown is dear.
fn careful_price(view: &MapView<'_>, a: Node, b: Node) -> Option<f32> {
    let price = observed_price(view, a, b)?;
    let is_dear = price < UNKNOWN_PRICE && !view.is_traversed(a, b) && crosses_unknown(view, a, b);
    Some(if is_dear { UNKNOWN_PRICE } else { price })
}

/// Turns the poses before the goal to the frontiers that they pass: to look where one walks is to look at what is known.
fn look_around(view: &MapView<'_>, path: &mut [LatticePose], clusters: &[Vec<CellIndex>]) {
    // Later poses are planned anew before they are taken.
    let [first, _, ..] = path else { return };
    let at = view.lattice().position(first.node);
    let is_near = |cell: &CellIndex| {
        let away = OccupancyGrid::middle(*cell) - at;
        away.x.hypot(away.z) <= PASSING_DISTANCE
    };
    let near: Vec<CellIndex> = clusters.iter().flatten().copied().filter(is_near).collect();
    if let Some(look) = best_look(view, first.node, &near) {
        *first = look;
    }
}

/// The nearest cluster; of equally near ones the largest.
fn nearest(view: &MapView<'_>, paths: &ShortestPaths, clusters: &[Vec<CellIndex>]) -> Option<Look> {
    let mut best: Option<Look> = None;
    for cluster in clusters {
        let size = Reverse(cluster.len());
        for (distance, node) in nodes_near(view, paths, cluster) {
            if best.as_ref().is_some_and(|look| (look.distance, Reverse(look.cells.len())) <= (distance, size)) {
                break;
            }
            if let Some(pose) = best_look(view, node, cluster) {
                best = Some(Look { distance, pose, cells: cluster.clone() });
                break;
            }
        }
    }
    best
}

/// The nearest look at each cluster that can be looked at.
fn looks(view: &MapView<'_>, paths: &ShortestPaths, clusters: &[Vec<CellIndex>]) -> Vec<Look> {
    let nearest = |cells: &Vec<CellIndex>| {
        let mut nodes = nodes_near(view, paths, cells).into_iter();
        let (distance, pose) =
            nodes.find_map(|(distance, node)| best_look(view, node, cells).map(|pose| (distance, pose)))?;
        Some(Look { distance, pose, cells: cells.clone() })
    };
    clusters.iter().filter_map(nearest).collect()
}

/// The cluster with the most cells for each step; of equals the first.
fn largest_for_its_way(looks: Vec<Look>) -> Option<Look> {
    // A turn on the spot is a step as well.
    let rate = |look: &Look| look.cells.len() as f32 / look.distance.max(1.0);
    looks.into_iter().reduce(|best, look| if rate(&look) > rate(&best) { look } else { best })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::check_policy;
    use crate::config::SimConfig;
    use crate::map::grid::cells_between;
    use crate::map::occupancy;
    use crate::policy::random::Random;
    use crate::policy::tests::explore;
    use crate::scene::Scene;
    use crate::world::World;
    use std::sync::Arc;

    #[test]
    fn it_finds_the_second_room_and_beats_chance() {
        let world = Arc::new(World::new(Scene::two_rooms(), &SimConfig::default()).unwrap());
        let start = LatticePose { node: Node { i: 1, k: 1 }, heading: Heading::new(6) };
        let random = explore(&world, &mut Random, start, 30);
        for rule in [Rule::Nearest, Rule::Gain, Rule::Tsp] {
            let mut policy = Fbe::new(rule);
            let fbe = explore(&world, &mut policy, start, 30);
            assert!(fbe.view().history().iter().any(|pose| pose.node.i >= 5), "{:?}", fbe.view().history());
            assert!(fbe.curve()[30] > 0.9, "{rule:?} {:?}", fbe.curve());
            assert!(fbe.curve().iter().sum::<f32>() > random.curve().iter().sum::<f32>());
            assert_eq!(check_policy(&mut policy, &world), []);
        }
    }

    #[test]
    fn a_way_through_the_unknown_is_dear_and_what_was_walked_is_not() {
        let world = Arc::new(World::new(Scene::two_rooms(), &SimConfig::default()).unwrap());
        let start = LatticePose { node: Node { i: 1, k: 1 }, heading: Heading::new(6) };
        let episode = explore(&world, &mut Fbe::new(Rule::Gain), start, 3);
        let (view, lattice) = (episode.view(), *world.scene().lattice());
        let (mut dear, mut cheap) = (0, 0);
        for a in (0..lattice.len()).map(|index| lattice.node(index)) {
            for b in crate::pose::Direction::ALL.map(|direction| a.step(direction)) {
                let is_unknown = |cell| view.occupancy().get(cell) == Cell::Unknown;
                let crosses = cells_between(lattice.position(a), lattice.position(b), occupancy::CELL).any(is_unknown);
                match (observed_price(&view, a, b), careful_price(&view, a, b)) {
                    (Some(1.0), Some(price)) if crosses && !view.is_traversed(a, b) => {
                        assert_eq!(price, UNKNOWN_PRICE);
                        dear += 1;
                    }
                    (observed, careful) => {
                        assert_eq!(careful, observed);
                        cheap += usize::from(careful == Some(1.0));
                    }
                }
            }
        }
        assert!(dear > 0 && cheap > 0, "{dear} {cheap}");
    }

    #[test]
    fn gain_takes_the_long_way_to_much_and_the_short_one_to_little() {
        let look = |distance, cells| Look {
            distance,
            pose: LatticePose { node: Node { i: cells as i32, k: 0 }, heading: Heading::new(0) },
            cells: vec![[0, 0]; cells],
        };
        let chosen = |looks: Vec<Look>| largest_for_its_way(looks).map(|look| look.cells.len());
        assert_eq!(chosen(vec![look(1.0, 5), look(3.0, 16)]), Some(16));
        assert_eq!(chosen(vec![look(1.0, 6), look(3.0, 16)]), Some(6));
        // A turn on the spot is no free step.
        assert_eq!(chosen(vec![look(0.0, 5), look(1.0, 6)]), Some(6));
        assert_eq!(chosen(Vec::new()), None);
    }
}
