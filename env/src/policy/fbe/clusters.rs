//! Frontiers of the carved plane: unknown cells beside free ones, grown into clusters.

use crate::map::{Cell, MapView, OccupancyGrid};
use std::collections::VecDeque;

/// A cell of the occupancy grid, `[x, z]`.
pub(super) type CellIndex = [i32; 2];

/// Smaller clusters of frontier cells are noise (0.75 m).
pub(super) const MIN_CLUSTER: usize = 5;

/// Frontier cells, grown into clusters of neighbours, in the order in which a breadth-first search from the agent
/// through free cells meets them.
pub(super) fn clusters(view: &MapView<'_>) -> Vec<Vec<CellIndex>> {
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

fn neighbours_4([x, z]: CellIndex) -> [CellIndex; 4] {
    [[x + 1, z], [x - 1, z], [x, z + 1], [x, z - 1]]
}

fn neighbours_8([x, z]: CellIndex) -> [CellIndex; 8] {
    let [a, b, c, d] = neighbours_4([x, z]);
    [a, b, c, d, [x + 1, z + 1], [x + 1, z - 1], [x - 1, z + 1], [x - 1, z - 1]]
}
