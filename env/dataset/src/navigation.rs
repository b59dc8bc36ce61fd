//! Navigation complexity: the largest ratio of walking distance to straight distance over pairs of lattice positions
//! (paper, section 5.1).

use nbp_env::scene::LatticeGraph;
use nbp_env::{Node, SeedTree};
use rand::RngExt as _;

/// Stands for "no way" in [`Distances`]; the sum of two still fits.
const FAR: u16 = u16::MAX / 4;

/// Connected lattice positions and their moves.
#[derive(Debug, Clone, Default)]
pub struct Navigation {
    nodes: Vec<[i32; 2]>,
    neighbours: Vec<[Option<u32>; 4]>,
    low: [i32; 2],
    size: [i32; 2],
    numbers: Vec<Option<u32>>,
}

/// Complexity of a scene and the pair of positions that sets it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Complexity {
    /// Walking distance over straight distance; 1 where there is no pair.
    pub ratio: f64,
    /// The two positions.
    pub pair: [[i32; 2]; 2],
}

impl Navigation {
    /// The largest connected component of a scene's lattice.
    pub fn of(graph: &LatticeGraph) -> Self {
        let nodes = graph.largest_component().iter().map(|node| [node.i, node.k]).collect();
        Self::new(nodes, |[i, k], [j, l]| graph.is_passable(Node { i, k }, Node { i: j, k: l }))
    }

    /// Positions `nodes` (each once) with the moves for which `passable` holds.
    pub fn new(nodes: Vec<[i32; 2]>, passable: impl Fn([i32; 2], [i32; 2]) -> bool) -> Self {
        let mut built = Self { nodes, ..Self::default() };
        if built.nodes.is_empty() {
            return built;
        }
        let extreme = |pick: fn(i32, i32) -> i32| {
            [0, 1].map(|axis| built.nodes.iter().map(|n| n[axis]).reduce(pick).unwrap_or(0))
        };
        let (low, high) = (extreme(i32::min), extreme(i32::max));
        (built.low, built.size) = (low, [high[0] - low[0] + 1, high[1] - low[1] + 1]);
        built.numbers = vec![None; built.size[0] as usize * built.size[1] as usize];
        for number in 0..built.nodes.len() {
            if let Some(cell) = built.cell(built.nodes[number]) {
                built.numbers[cell] = Some(number as u32);
            }
        }
        let moves = |node: [i32; 2]| {
            [[0, 1], [1, 0], [0, -1], [-1, 0]].map(|[di, dk]| {
                let next = [node[0] + di, node[1] + dk];
                built.number(next).filter(|_| passable(node, next))
            })
        };
        built.neighbours = built.nodes.iter().map(|&node| moves(node)).collect();
        built
    }

    fn cell(&self, [i, k]: [i32; 2]) -> Option<usize> {
        let (i, k) = (i - self.low[0], k - self.low[1]);
        let inside = (0..self.size[0]).contains(&i) && (0..self.size[1]).contains(&k);
        inside.then(|| i as usize * self.size[1] as usize + k as usize)
    }

    /// Number of a position.
    pub fn number(&self, node: [i32; 2]) -> Option<u32> {
        self.numbers[self.cell(node)?]
    }

    /// The positions, by number.
    pub fn nodes(&self) -> &[[i32; 2]] {
        &self.nodes
    }

    /// Steps from one position to all others; [`u16::MAX`]` / 4` where there is no way.
    fn steps_from(&self, start: u32, steps: &mut [u16], queue: &mut Vec<u32>) {
        steps.fill(FAR);
        queue.clear();
        queue.push(start);
        steps[start as usize] = 0;
        let mut next = 0;
        while let Some(&node) = queue.get(next) {
            next += 1;
            let one_more = steps[node as usize].saturating_add(1).min(FAR);
            for &neighbour in self.neighbours[node as usize].iter().flatten() {
                if steps[neighbour as usize] == FAR {
                    steps[neighbour as usize] = one_more;
                    queue.push(neighbour);
                }
            }
        }
    }

    /// The exact complexity, over all pairs that a way connects.
    pub fn complexity(&self) -> Complexity {
        let mut best = Complexity { ratio: 1.0, pair: [[0; 2]; 2] };
        let mut best_squared = 1.0_f32;
        let (mut steps, mut queue) = (vec![FAR; self.nodes.len()], Vec::new());
        for (number, &[i, k]) in self.nodes.iter().enumerate() {
            self.steps_from(number as u32, &mut steps, &mut queue);
            for (&[j, l], &walk) in self.nodes.iter().zip(&steps).skip(number + 1) {
                let straight = ((i - j).pow(2) + (k - l).pow(2)) as f32;
                let walk = f32::from(walk);
                if walk < f32::from(FAR) && walk * walk > best_squared * straight {
                    best_squared = walk * walk / straight;
                    best.pair = [[i, k], [j, l]];
                }
            }
        }
        best.ratio = f64::from(best_squared).sqrt();
        best
    }

    /// The paper's protocol: the largest ratio over a random share of the pairs, a lower bound of [`Self::complexity`].
    pub fn sampled_complexity(&self, share: f64, seed: SeedTree) -> f64 {
        let count = self.nodes.len();
        if count < 2 {
            return 1.0;
        }
        let mut rng = seed.rng();
        let pairs = (share * count as f64 * (count - 1) as f64 / 2.0).ceil() as usize;
        let mut draws: Vec<(usize, usize)> =
            (0..pairs).map(|_| (rng.random_range(0..count), rng.random_range(0..count))).collect();
        draws.sort_unstable();
        let (mut steps, mut queue, mut from) = (vec![FAR; count], Vec::new(), None);
        let mut best = 1.0_f64;
        for (a, b) in draws.into_iter().filter(|(a, b)| a != b) {
            if from != Some(a) {
                self.steps_from(a as u32, &mut steps, &mut queue);
                from = Some(a);
            }
            let ([i, k], [j, l]) = (self.nodes[a], self.nodes[b]);
            if steps[b] < FAR {
                best = best.max(f64::from(steps[b]) / f64::from((i - j).pow(2) + (k - l).pow(2)).sqrt());
            }
        }
        best
    }

    /// All distances at once.
    pub fn distances(&self) -> Distances {
        let count = self.nodes.len();
        let (mut steps, mut queue) = (vec![FAR; count * count], Vec::new());
        for (start, row) in steps.chunks_exact_mut(count.max(1)).enumerate() {
            self.steps_from(start as u32, row, &mut queue);
        }
        Distances { count, steps }
    }
}

/// Steps between all pairs of positions, kept up to date while walls are opened.
#[derive(Debug, Clone)]
pub struct Distances {
    count: usize,
    steps: Vec<u16>,
}

impl Distances {
    /// Steps between two positions, by number; `None` without a way.
    pub fn between(&self, a: u32, b: u32) -> Option<u16> {
        Some(self.steps[a as usize * self.count + b as usize]).filter(|&steps| steps < FAR)
    }

    /// Opens a way of `length` steps between two positions: `O(count²)`, and much less where few distances change.
    pub fn connect(&mut self, a: u32, b: u32, length: u16) {
        let row = |n: u32| n as usize * self.count..(n as usize + 1) * self.count;
        let (from_a, from_b) = (self.steps[row(a)].to_vec(), self.steps[row(b)].to_vec());
        for (steps, (&to_a, &to_b)) in self.steps.chunks_exact_mut(self.count.max(1)).zip(from_a.iter().zip(&from_b)) {
            let (near, from_far) = if to_a < to_b { (to_a, &from_b) } else { (to_b, &from_a) };
            let through = near + length;
            if through >= to_a.max(to_b) {
                continue;
            }
            for (step, &rest) in steps.iter_mut().zip(from_far) {
                *step = (*step).min(through + rest).min(FAR);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A 6×2 strip with a wall between its rows, open at `i = 0`, and at `i = 3` if asked for.
    fn strip(is_open: bool) -> Navigation {
        let nodes = (0..6).flat_map(|i| (0..2).map(move |k| [i, k])).collect();
        Navigation::new(nodes, |a, b| a[1] == b[1] || a[0] == 0 || (is_open && a[0] == 3))
    }

    #[test]
    fn the_far_end_of_a_wall_sets_the_complexity() {
        let walled = strip(false).complexity();
        assert!((walled.ratio - 11.0).abs() < 1e-5, "{walled:?}");
        assert_eq!(walled.pair, [[5, 0], [5, 1]]);
        assert!((strip(true).complexity().ratio - 5.0).abs() < 1e-5);
        let sampled = strip(false).sampled_complexity(1.0, SeedTree::new(1));
        assert!((1.0..=11.0).contains(&sampled));
        assert_eq!(Navigation::new(Vec::new(), |_, _| true).complexity().ratio, 1.0);
    }

    #[test]
    fn distances_follow_an_opened_wall() {
        let before = strip(false);
        let mut distances = before.distances();
        let [a, b] = [[3, 0], [3, 1]].map(|n| before.number(n).unwrap());
        distances.connect(a, b, 1);
        assert_eq!(distances.steps, strip(true).distances().steps);
    }
}
