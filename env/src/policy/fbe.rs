//! `fbe`: frontier-based exploration, nearest frontier first (Yamauchi 1997).

use super::{Plan, Policy, PolicyError, action_towards, observed_price, turn_on_the_spot};
use crate::episode::Action;
use crate::map::grid::cells_between;
use crate::map::{Cell, MapView, OccupancyGrid, occupancy};
use crate::path::ShortestPaths;
use crate::pose::{Heading, LatticePose, Node};
use crate::seed::Rng;
use glam::Vec3;
use std::collections::{BTreeMap, BTreeSet, VecDeque};

/// Smaller clusters of frontier cells are noise (0.75 m).
const MIN_CLUSTER: usize = 5;

/// From how far a frontier is looked at, metres.
const VIEW_DISTANCE: f32 = 1.5;

/// Half the angle that one heading sees.
const HALF_VIEW: f32 = std::f32::consts::FRAC_PI_4;

type CellIndex = [i32; 2];

/// Goes to the nearest cluster of unknown cells that border free ones.
#[derive(Debug, Default)]
pub struct Fbe {
    plan: Option<Plan>,
    next: usize,
    /// Cells that the plan is made for; once all are known there is nothing to go for.
    target: Vec<CellIndex>,
}

impl Fbe {
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
        let paths = ShortestPaths::from(here, |a, b| observed_price(view, a, b));
        let goal = nearest_frontier(view, &paths).or_else(|| nearest_unseen(view, &paths));
        let (path, target) = match goal {
            None => (Vec::new(), Vec::new()),
            Some((pose, cells)) => (poses_along(here, &paths.path_to(pose.node).unwrap_or_default(), pose), cells),
        };
        self.plan = Some(Plan { made_at: view.step(), path, thought: None });
        self.target = target;
        self.next = 0;
    }
}

impl Policy for Fbe {
    fn name(&self) -> &'static str {
        "fbe"
    }

    fn begin(&mut self) {
        *self = Self::default();
    }

    fn act(&mut self, view: &MapView<'_>, rng: &mut Rng) -> Result<Action, PolicyError> {
        if self.follow(view).is_none() {
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

/// The pose that looks at the nearest cluster, and the cluster's cells.
fn nearest_frontier(view: &MapView<'_>, paths: &ShortestPaths) -> Option<(LatticePose, Vec<CellIndex>)> {
    let mut best: Option<(f32, std::cmp::Reverse<usize>, LatticePose, Vec<CellIndex>)> = None;
    for cluster in clusters(view) {
        let size = std::cmp::Reverse(cluster.len());
        for (distance, node) in nodes_near(view, paths, &cluster) {
            if best.as_ref().is_some_and(|(d, s, ..)| (*d, *s) <= (distance, size)) {
                break;
            }
            if let Some(pose) = best_look(view, node, &cluster) {
                best = Some((distance, size, pose, cluster));
                break;
            }
        }
    }
    best.map(|(.., pose, cluster)| (pose, cluster))
}

/// Nodes within reach and viewing distance of a cluster, nearest first.
fn nodes_near(view: &MapView<'_>, paths: &ShortestPaths, cluster: &[CellIndex]) -> Vec<(f32, Node)> {
    let lattice = view.lattice();
    let mut nodes = BTreeSet::new();
    for &cell in cluster {
        let middle = OccupancyGrid::middle(cell);
        let nearest = lattice.nearest(middle);
        for (di, dk) in (-1..=1).flat_map(|di| (-1..=1).map(move |dk| (di, dk))) {
            let node = Node { i: nearest.i + di, k: nearest.k + dk };
            let away = lattice.position(node) - middle;
            if Vec3::new(away.x, 0.0, away.z).length() <= VIEW_DISTANCE {
                nodes.insert(node);
            }
        }
    }
    let mut near: Vec<(f32, Node)> =
        nodes.into_iter().filter_map(|node| paths.distance(node).map(|distance| (distance, node))).collect();
    near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    near
}

/// The heading at `node` that sees most of `cells` and was not tried yet.
fn best_look(view: &MapView<'_>, node: Node, cells: &[CellIndex]) -> Option<LatticePose> {
    let eye = view.lattice().position(node);
    let mut seen = [0_usize; 8];
    for &cell in cells {
        let away = OccupancyGrid::middle(cell) - eye;
        let azimuth = away.x.atan2(away.z);
        let is_visible = !view.occupancy().is_wall_between(eye, OccupancyGrid::middle(cell));
        for heading in Heading::all().filter(|_| is_visible) {
            // Not `shorter_arc`: half of a heading's view ends on a diagonal of cells, where roundings decide, and with them the walk.
            let turn = (azimuth - heading.azimuth()).sin().atan2((azimuth - heading.azimuth()).cos());
            seen[heading.index()] += usize::from(turn.abs() <= HALF_VIEW);
        }
    }
    let untried =
        |heading: &Heading| seen[heading.index()] > 0 && view.visits(LatticePose { node, heading: *heading }) == 0;
    let order = |heading: &Heading| (seen[heading.index()], std::cmp::Reverse(heading.index()));
    Heading::all().filter(untried).max_by_key(order).map(|heading| LatticePose { node, heading })
}

/// Frontier cells, grown into clusters of neighbours, in the order in which a breadth-first search from the agent
/// through free cells meets them.
fn clusters(view: &MapView<'_>) -> Vec<Vec<CellIndex>> {
    let grid = view.occupancy();
    let start = OccupancyGrid::cell_of(view.position());
    let (low, shape) = grid.extent();
    // One cell of margin: frontiers may lie just outside of what was ever touched.
    let (low, shape) = ([low[0] - 1, low[1] - 1], [shape[0] + 2, shape[1] + 2]);
    let index = |cell: CellIndex| {
        let (x, z) = (usize::try_from(cell[0] - low[0]).ok()?, usize::try_from(cell[1] - low[1]).ok()?);
        (x < shape[0] && z < shape[1]).then_some(x * shape[1] + z)
    };
    let mut reached = vec![false; shape[0] * shape[1]];
    let mut clustered = vec![false; shape[0] * shape[1]];
    let mark = |marks: &mut Vec<bool>, cell| index(cell).is_some_and(|at| !std::mem::replace(&mut marks[at], true));
    let is_frontier = |cell: CellIndex| {
        grid.get(cell) == Cell::Unknown && neighbours_4(cell).into_iter().any(|n| grid.get(n) == Cell::Free)
    };
    let mut queue = VecDeque::from([start]);
    mark(&mut reached, start);
    let mut found = Vec::new();
    while let Some(cell) = queue.pop_front() {
        for next in neighbours_8(cell) {
            if grid.get(next) == Cell::Free {
                if mark(&mut reached, next) {
                    queue.push_back(next);
                }
            } else if is_frontier(next) && mark(&mut clustered, next) {
                let mut cluster = vec![next];
                let mut at = 0;
                while let Some(&member) = cluster.get(at) {
                    at += 1;
                    cluster.extend(
                        neighbours_8(member).into_iter().filter(|&n| is_frontier(n) && mark(&mut clustered, n)),
                    );
                }
                if cluster.len() >= MIN_CLUSTER {
                    found.push(cluster);
                }
            }
        }
    }
    found
}

/// When no frontier is left: the nearest untried pose whose rays still cross unknown cells, and those cells.
fn nearest_unseen(view: &MapView<'_>, paths: &ShortestPaths) -> Option<(LatticePose, Vec<CellIndex>)> {
    const RAYS: usize = 9;
    const REACH: f32 = 6.0;
    let mut nodes: Vec<(f32, Node)> = paths.reached().map(|(node, distance)| (distance, node)).collect();
    nodes.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let known_free =
        |node: Node| view.occupancy().get(OccupancyGrid::cell_of(view.lattice().position(node))) == Cell::Free;
    for (_, node) in nodes.into_iter().filter(|&(_, node)| known_free(node)) {
        let eye = view.lattice().position(node);
        for heading in Heading::all().filter(|&heading| view.visits(LatticePose { node, heading }) == 0) {
            let mut unseen = BTreeMap::new();
            for ray in 0..RAYS {
                let azimuth = heading.azimuth() + HALF_VIEW * (2.0 * ray as f32 / (RAYS - 1) as f32 - 1.0);
                let end = eye + REACH * Vec3::new(azimuth.sin(), 0.0, azimuth.cos());
                let clear = cells_between(eye, end, occupancy::CELL)
                    .take_while(|&cell| view.occupancy().get(cell) != Cell::Occupied);
                unseen.extend(clear.filter(|&cell| view.occupancy().get(cell) == Cell::Unknown).map(|cell| (cell, ())));
            }
            if unseen.len() >= MIN_CLUSTER {
                return Some((LatticePose { node, heading }, unseen.into_keys().collect()));
            }
        }
    }
    None
}

fn neighbours_4([x, z]: CellIndex) -> [CellIndex; 4] {
    [[x + 1, z], [x - 1, z], [x, z + 1], [x, z - 1]]
}

fn neighbours_8([x, z]: CellIndex) -> [CellIndex; 8] {
    let [a, b, c, d] = neighbours_4([x, z]);
    [a, b, c, d, [x + 1, z + 1], [x + 1, z - 1], [x - 1, z + 1], [x - 1, z - 1]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::SimConfig;
    use crate::policy::random::Random;
    use crate::policy::tests::explore;
    use crate::scene::Scene;
    use crate::world::World;
    use std::sync::Arc;

    #[test]
    fn it_finds_the_second_room_and_beats_chance() {
        let world = Arc::new(World::new(Scene::two_rooms(), &SimConfig::default()).unwrap());
        let start = LatticePose { node: Node { i: 1, k: 1 }, heading: Heading::new(6) };
        let fbe = explore(&world, &mut Fbe::default(), start, 30);
        let random = explore(&world, &mut Random, start, 30);
        assert!(fbe.view().history().iter().any(|pose| pose.node.i >= 5), "{:?}", fbe.view().history());
        assert!(fbe.curve()[30] > 0.9, "{:?}", fbe.curve());
        assert!(fbe.curve().iter().sum::<f32>() > random.curve().iter().sum::<f32>());
    }
}
