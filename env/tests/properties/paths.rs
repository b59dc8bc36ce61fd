//! Shortest paths against Floyd and Warshall's algorithm.

use super::{MANY, for_all};
use glam::Vec3;
use nbp_env::path::ShortestPaths;
use nbp_env::{Direction, Lattice, Node};
use rand::RngExt as _;

const SIDE: i32 = 5;
const LATTICE: Lattice = Lattice { origin: Vec3::ZERO, spacing: 1.0, size: [SIDE; 2] };
const COUNT: usize = (SIDE * SIDE) as usize;

#[test]
fn paths_are_the_shortest() {
    for_all("paths_are_the_shortest", MANY, |rng| {
        // Small whole prices, so that sums are exact and ties are many; another price in each direction.
        let (blocked, dearest) = (rng.random_range(0.0..0.7), rng.random_range(0..9_u32));
        let price: Vec<[Option<f32>; 4]> = (0..COUNT)
            .map(|_| [(); 4].map(|()| (!rng.random_bool(blocked)).then(|| rng.random_range(0..=dearest) as f32)))
            .collect();
        let inside = |node: Node| (0..SIDE).contains(&node.i) && (0..SIDE).contains(&node.k);
        let number = |node: Node| (node.i * SIDE + node.k) as usize;
        let cost = |a: Node, b: Node| {
            let way = Direction::ALL.iter().position(|&d| a.step(d) == b)?;
            price[number(a)][way].filter(|_| inside(b))
        };
        let node = |n: usize| Node { i: n as i32 / SIDE, k: n as i32 % SIDE };
        let mut best = [[f32::INFINITY; COUNT]; COUNT];
        for (a, best) in best.iter_mut().enumerate() {
            for b in Direction::ALL.map(|d| node(a).step(d)).into_iter().filter(|&b| inside(b)) {
                best[number(b)] = cost(node(a), b).unwrap_or(f32::INFINITY);
            }
            best[a] = 0.0;
        }
        for through in 0..COUNT {
            for a in 0..COUNT {
                for b in 0..COUNT {
                    best[a][b] = best[a][b].min(best[a][through] + best[through][b]);
                }
            }
        }
        let start = rng.random_range(0..COUNT);
        let paths = ShortestPaths::from(&LATTICE, node(start), cost);
        let again = ShortestPaths::from(&LATTICE, node(start), cost);
        for (goal, &best) in best[start].iter().enumerate() {
            let expected = Some(best).filter(|d| d.is_finite());
            assert_eq!(paths.distance(node(goal)), expected);
            let path = paths.path_to(node(goal));
            assert_eq!(path, again.path_to(node(goal)));
            assert_eq!(path.is_some(), expected.is_some());
            let Some(path) = path else { continue };
            let whole: Vec<Node> = std::iter::once(node(start)).chain(path).collect();
            assert_eq!(*whole.last().unwrap(), node(goal));
            let sum: f32 = whole.windows(2).map(|pair| cost(pair[0], pair[1]).unwrap()).sum();
            assert_eq!(Some(sum), expected);
            // What leads to the goal leads to every node on the way.
            let before = whole[..whole.len() - 1].to_vec();
            if let Some(&last) = before.last() {
                assert_eq!(paths.path_to(last).unwrap(), before[1..]);
            }
        }
        let reached: Vec<Node> = paths.reached().map(|(node, _)| node).collect();
        assert!(reached.is_sorted() && reached.len() == best[start].iter().filter(|d| d.is_finite()).count());
    });
}
