//! From where frontiers are looked at.

use super::clusters::{CellIndex, MIN_CLUSTER};
use crate::map::grid::cells_between;
use crate::map::{Cell, MapView, OccupancyGrid, occupancy};
use crate::path::ShortestPaths;
use crate::pose::{Heading, LatticePose, Node};
use glam::Vec3;
use std::collections::{BTreeMap, BTreeSet};

/// From how far a frontier is looked at, metres.
const VIEW_DISTANCE: f32 = 1.5;

/// Half the angle that one heading sees.
const HALF_VIEW: f32 = std::f32::consts::FRAC_PI_4;

/// A pose from which unknown cells can be seen.
#[derive(Debug)]
pub(super) struct Look {
    /// Cost of the way there.
    pub(super) distance: f32,
    pub(super) pose: LatticePose,
    /// What is looked at.
    pub(super) cells: Vec<CellIndex>,
}

/// Nodes within reach and viewing distance of a cluster, nearest first.
pub(super) fn nodes_near(view: &MapView<'_>, paths: &ShortestPaths, cluster: &[CellIndex]) -> Vec<(f32, Node)> {
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
pub(super) fn best_look(view: &MapView<'_>, node: Node, cells: &[CellIndex]) -> Option<LatticePose> {
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

/// When no frontier is left: the nearest untried pose whose rays still cross unknown cells.
pub(super) fn nearest_unseen(view: &MapView<'_>, paths: &ShortestPaths) -> Option<Look> {
    const RAYS: usize = 9;
    const REACH: f32 = 6.0;
    let mut nodes: Vec<(f32, Node)> = paths.reached().map(|(node, distance)| (distance, node)).collect();
    nodes.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let known_free =
        |node: Node| view.occupancy().get(OccupancyGrid::cell_of(view.lattice().position(node))) == Cell::Free;
    for (distance, node) in nodes.into_iter().filter(|&(_, node)| known_free(node)) {
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
                let pose = LatticePose { node, heading };
                return Some(Look { distance, pose, cells: unseen.into_keys().collect() });
            }
        }
    }
    None
}
