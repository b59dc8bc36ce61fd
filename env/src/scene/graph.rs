//! The true lattice graph of a scene: which nodes are free, which moves hit nothing. Computed once per scene.

use crate::pose::{Direction, Heading, Lattice, LatticePose, Node};
use crate::scene::Interior;
use crate::scene::rays::RayIndex;
use crate::seed::SeedTree;
use rand::seq::SliceRandom;
use std::collections::VecDeque;

/// Free nodes and passable moves, symmetric.
#[derive(Debug, Clone)]
pub struct LatticeGraph {
    lattice: Lattice,
    interior: Interior,
    free: Vec<bool>,
    /// Bit `d` is set when the move `Direction::ALL[d]` is possible.
    moves: Vec<u8>,
    largest: Vec<Node>,
}

impl LatticeGraph {
    /// The graph in a closed mesh.
    pub fn build(lattice: Lattice, rays: &RayIndex) -> Self {
        Self::inside(Interior::Closed, lattice, rays)
    }

    /// The graph of an agent that is a point.
    pub fn inside(interior: Interior, lattice: Lattice, rays: &RayIndex) -> Self {
        Self::with_clearance(interior, lattice, rays, 0.0)
    }

    /// Tests every node and move of the lattice against the mesh.
    ///
    /// A node is free when it lies inside. A move is possible between free nodes when its segment hits nothing (paper,
    /// section 5.1) and no surface is nearer to it than `clearance` metres.
    pub fn with_clearance(interior: Interior, lattice: Lattice, rays: &RayIndex, clearance: f32) -> Self {
        let nodes: Vec<Node> = (0..lattice.len()).map(|index| lattice.node(index)).collect();
        let is_clear = |at| clearance <= 0.0 || !rays.is_near(at, at, clearance);
        let is_free = |at| interior.contains(rays, at) && is_clear(at);
        let free: Vec<bool> = nodes.iter().map(|&node| is_free(lattice.position(node))).collect();
        let is_free = |node| lattice.index(node).is_some_and(|index| free[index]);
        let mut moves = vec![0_u8; nodes.len()];
        for (index, &node) in nodes.iter().enumerate().filter(|&(index, _)| free[index]) {
            // Half of the directions is enough: moves are symmetric, and testing once keeps them exactly so.
            for (bit, direction) in Direction::ALL.into_iter().enumerate().take(2) {
                let next = node.step(direction);
                if is_free(next) && !rays.is_near(lattice.position(node), lattice.position(next), clearance) {
                    moves[index] |= 1 << bit;
                    if let Some(back) = lattice.index(next) {
                        moves[back] |= 1 << (bit + 2);
                    }
                }
            }
        }
        let mut graph = Self { lattice, interior, free, moves, largest: Vec::new() };
        graph.largest = graph.find_largest_component();
        graph
    }

    /// The lattice.
    pub fn lattice(&self) -> &Lattice {
        &self.lattice
    }

    /// What counts as inside.
    pub fn interior(&self) -> Interior {
        self.interior
    }

    /// Whether the camera can be at a node.
    pub fn is_free(&self, node: Node) -> bool {
        self.lattice.index(node).is_some_and(|index| self.free[index])
    }

    /// Whether a move hits nothing.
    pub fn can_move(&self, node: Node, direction: Direction) -> bool {
        let bit = Direction::ALL.iter().position(|&d| d == direction).unwrap_or(0);
        self.lattice.index(node).is_some_and(|index| self.moves[index] >> bit & 1 == 1)
    }

    /// Whether two nodes are neighbours and the move between them hits nothing.
    pub fn is_passable(&self, a: Node, b: Node) -> bool {
        Direction::between(a, b).is_some_and(|direction| self.can_move(a, direction))
    }

    /// Nodes one possible move away, in the order of [`Direction::ALL`].
    pub fn neighbours(&self, node: Node) -> impl Iterator<Item = Node> + '_ {
        Direction::ALL.into_iter().filter(move |&d| self.can_move(node, d)).map(move |d| node.step(d))
    }

    /// Nodes of the largest connected component, sorted.
    pub fn largest_component(&self) -> &[Node] {
        &self.largest
    }

    /// `count` poses of the largest component, far from each other: the first at random, each next one the farthest of a
    /// random sample from those already drawn.
    pub fn spread_poses(&self, count: usize, seed: SeedTree) -> Vec<LatticePose> {
        let mut rng = seed.rng();
        let mut pool = self.largest.clone();
        pool.shuffle(&mut rng);
        pool.truncate(64.max(count));
        let mut chosen: Vec<Node> = pool.first().copied().into_iter().collect();
        while chosen.len() < count.min(pool.len()) {
            let square = |from: i32, to: i32| i64::from(to - from).pow(2);
            let distance =
                |node: &Node| chosen.iter().map(|c| square(c.i, node.i) + square(c.k, node.k)).min().unwrap_or(0);
            let Some(&next) = pool.iter().max_by_key(|node| (distance(node), **node)) else { break };
            chosen.push(next);
        }
        let headings: Vec<usize> = (0..chosen.len()).map(|n| (n * 3 + (seed.key() % 8) as usize) % 8).collect();
        chosen.into_iter().zip(headings).map(|(node, h)| LatticePose { node, heading: Heading::new(h) }).collect()
    }

    fn find_largest_component(&self) -> Vec<Node> {
        let mut seen = vec![false; self.lattice.len()];
        let mut largest = Vec::new();
        for start in (0..self.lattice.len()).filter(|&index| self.free[index]) {
            if std::mem::replace(&mut seen[start], true) {
                continue;
            }
            let mut component = Vec::new();
            let mut queue = VecDeque::from([self.lattice.node(start)]);
            while let Some(node) = queue.pop_front() {
                component.push(node);
                for next in self.neighbours(node) {
                    if let Some(index) = self.lattice.index(next)
                        && !std::mem::replace(&mut seen[index], true)
                    {
                        queue.push_back(next);
                    }
                }
            }
            if component.len() > largest.len() {
                largest = component;
            }
        }
        largest.sort_unstable();
        largest
    }
}
