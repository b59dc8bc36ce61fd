//! Shortest paths on the lattice: Dijkstra with ties broken by node, so that equal costs give equal paths.

use crate::pose::{Direction, Lattice, Node};
use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;

/// Shortest paths from one node to all that can be reached.
#[derive(Debug, Clone)]
pub struct ShortestPaths {
    lattice: Lattice,
    start: Node,
    /// Cost of the way to each node of the lattice, infinite out of reach, and the node before it.
    ways: Vec<(f32, Node)>,
}

/// Prices of moves, each worked out once: who plans several ways at once asks for the same moves again and again.
pub struct PriceList<'a> {
    lattice: Lattice,
    price: Box<dyn Fn(Node, Node) -> Option<f32> + 'a>,
    /// By node and direction.
    known: Vec<[Option<Option<f32>>; 4]>,
}

impl<'a> PriceList<'a> {
    /// Of moves on a lattice.
    pub fn new(lattice: &Lattice, price: impl Fn(Node, Node) -> Option<f32> + 'a) -> Self {
        Self { lattice: *lattice, price: Box::new(price), known: vec![[None; 4]; lattice.len()] }
    }

    /// What the move from `a` to its neighbour `b` costs.
    pub fn of(&mut self, a: Node, b: Node) -> Option<f32> {
        let known = &mut self.known[self.lattice.index(a)?][Direction::between(a, b)? as usize];
        *known.get_or_insert_with(|| (self.price)(a, b))
    }

    /// Shortest paths at these prices.
    pub fn paths_from(&mut self, start: Node) -> ShortestPaths {
        let lattice = self.lattice;
        ShortestPaths::from(&lattice, start, |a, b| self.of(a, b))
    }
}

/// Costs are finite and not negative, so their order is total.
#[derive(PartialEq)]
struct Cost(f32);

impl Eq for Cost {}

impl PartialOrd for Cost {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Cost {
    fn cmp(&self, other: &Self) -> Ordering {
        self.0.total_cmp(&other.0)
    }
}

impl ShortestPaths {
    /// Paths on a lattice from `start` over the moves for which `cost` gives a finite, non-negative price.
    pub fn from(lattice: &Lattice, start: Node, mut cost: impl FnMut(Node, Node) -> Option<f32>) -> Self {
        let mut ways = vec![(f32::INFINITY, start); lattice.len()];
        let mut heap = BinaryHeap::new();
        if let Some(index) = lattice.index(start) {
            ways[index].0 = 0.0;
            heap.push(Reverse((Cost(0.0), start)));
        }
        while let Some(Reverse((Cost(distance), node))) = heap.pop() {
            if lattice.index(node).is_none_or(|index| distance > ways[index].0) {
                continue;
            }
            for next in Direction::ALL.map(|direction| node.step(direction)) {
                let (Some(index), Some(price)) = (lattice.index(next), cost(node, next)) else { continue };
                let candidate = distance + price;
                if candidate < ways[index].0 {
                    ways[index] = (candidate, node);
                    heap.push(Reverse((Cost(candidate), next)));
                }
            }
        }
        Self { lattice: *lattice, start, ways }
    }

    fn way(&self, node: Node) -> Option<(f32, Node)> {
        let way = self.ways[self.lattice.index(node)?];
        way.0.is_finite().then_some(way)
    }

    /// Cost of the shortest path to a node.
    pub fn distance(&self, node: Node) -> Option<f32> {
        self.way(node).map(|(distance, _)| distance)
    }

    /// Reached nodes and their distances, sorted by node, the start included.
    pub fn reached(&self) -> impl Iterator<Item = (Node, f32)> + '_ {
        let ways = self.ways.iter().enumerate().filter(|(_, (distance, _))| distance.is_finite());
        ways.map(|(index, &(distance, _))| (self.lattice.node(index), distance))
    }

    /// Nodes of the shortest path after the start up to `goal`; empty for the start itself, `None` if out of reach.
    pub fn path_to(&self, goal: Node) -> Option<Vec<Node>> {
        let mut path = Vec::new();
        let mut node = goal;
        while node != self.start {
            path.push(node);
            node = self.way(node)?.1;
        }
        path.reverse();
        Some(path)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use proptest::prelude::*;
    use std::collections::BTreeMap;

    const SIDE: i32 = 6;
    const LATTICE: Lattice = Lattice { origin: Vec3::ZERO, spacing: 1.0, size: [SIDE; 2] };

    /// Price of an undirected edge from a table of random numbers; every seventh edge is blocked.
    fn price(table: &[u8], a: Node, b: Node) -> Option<f32> {
        let inside = |n: Node| (0..SIDE).contains(&n.i) && (0..SIDE).contains(&n.k);
        if !inside(a) || !inside(b) {
            return None;
        }
        let (low, high) = (a.min(b), a.max(b));
        let index = ((low.i * SIDE + low.k) * 2 + i32::from(high.i > low.i)) as usize;
        let value = table[index % table.len()];
        (!value.is_multiple_of(7)).then_some(f32::from(value % 5) + 1.0)
    }

    proptest! {
        #[test]
        fn optimal_against_bellman_ford_and_so_is_every_sub_path(table in prop::collection::vec(any::<u8>(), 72)) {
            let nodes: Vec<Node> = (0..SIDE * SIDE).map(|n| Node { i: n / SIDE, k: n % SIDE }).collect();
            let bellman_ford = |start: Node| {
                let mut best: BTreeMap<Node, f32> = BTreeMap::from([(start, 0.0)]);
                for _ in 0..nodes.len() {
                    for &a in &nodes {
                        for b in Direction::ALL.map(|d| a.step(d)) {
                            if let (Some(&from), Some(cost)) = (best.get(&a), price(&table, a, b)) {
                                let to = best.entry(b).or_insert(f32::INFINITY);
                                *to = to.min(from + cost);
                            }
                        }
                    }
                }
                best
            };
            let start = Node { i: 2, k: 3 };
            let paths = ShortestPaths::from(&LATTICE, start, |a, b| price(&table, a, b));
            let expected = bellman_ford(start);
            for &node in &nodes {
                prop_assert_eq!(paths.distance(node), expected.get(&node).copied());
                let Some(path) = paths.path_to(node) else { continue };
                let whole: Vec<Node> = std::iter::once(start).chain(path).collect();
                let cost = |part: &[Node]| part.windows(2).map(|w| price(&table, w[0], w[1]).unwrap()).sum::<f32>();
                prop_assert_eq!(cost(&whole), paths.distance(node).unwrap());
                for i in 0..whole.len() {
                    let from_i = bellman_ford(whole[i]);
                    for j in i + 1..whole.len() {
                        prop_assert_eq!(cost(&whole[i..=j]), from_i[&whole[j]]);
                    }
                }
            }
        }
    }
}
