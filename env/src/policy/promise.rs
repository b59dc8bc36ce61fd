//! What a search promises itself from where it does not look: the most that looking around from any one node would add,
//! discounted by the walk to it.
//!
//! Only the best node counts, and what a node adds can only shrink as more is covered. So nodes are asked in the order of
//! what they promised at first, and most of them never: a search asks a hundred times in each step.

use crate::pose::{LatticePose, Node};
use crate::visibility::PointSet;
use crate::world::World;
use std::collections::{HashMap, VecDeque};

/// What a gain one step later is worth.
pub(super) const DISCOUNT: f32 = 0.96;

/// Promises from anywhere, made before a search.
pub(super) struct Promises<'a> {
    world: &'a World,
    /// Poses that may still add something, those of a node together, and what these add before the search.
    places: Vec<(&'a [LatticePose], f32)>,
    /// For nodes that were asked from: places within reach by what they promise at most, highest first.
    ranked: HashMap<Node, Vec<Bound>>,
}

/// What a place promises at most.
#[derive(Clone, Copy)]
struct Bound {
    promise: f32,
    discount: f32,
    place: usize,
}

/// Promises once more is covered.
pub(super) struct After<'a, 'b> {
    promises: &'b mut Promises<'a>,
    covered: &'b PointSet,
    /// What places add now, as far as known.
    added: HashMap<usize, f32>,
}

impl<'a> Promises<'a> {
    /// Of `open` poses, sorted by node, where `covered` is covered.
    pub(super) fn new(world: &'a World, open: &'a [LatticePose], covered: &PointSet) -> Self {
        let mut around = covered.clone();
        let mut place = |poses: &'a [LatticePose]| (poses, add_around(world, poses, covered, &mut around));
        let places = open.chunk_by(|a, b| a.node == b.node).map(&mut place).collect();
        Self { world, places, ranked: HashMap::new() }
    }

    /// Promises where `covered`, which is no less than at first, is covered.
    pub(super) fn after<'b>(&'b mut self, covered: &'b PointSet) -> After<'a, 'b> {
        After { promises: self, covered, added: HashMap::new() }
    }

    fn rank(&self, from: Node) -> Vec<Bound> {
        let discounts = discounts(self.world, from);
        let bound = |(place, &(poses, added)): (usize, &(&[LatticePose], f32))| {
            let index = self.world.scene().lattice().index(poses.first()?.node)?;
            let discount = discounts[index];
            (discount > 0.0).then_some(Bound { promise: discount * added, discount, place })
        };
        let mut bounds: Vec<Bound> = self.places.iter().enumerate().filter_map(bound).collect();
        bounds.sort_unstable_by(|a, b| b.promise.total_cmp(&a.promise).then(a.place.cmp(&b.place)));
        bounds
    }
}

impl After<'_, '_> {
    /// The most that is promised at a node.
    pub(super) fn at(&mut self, node: Node) -> f32 {
        let Self { promises, covered, added } = self;
        if !promises.ranked.contains_key(&node) {
            let ranked = promises.rank(node);
            promises.ranked.insert(node, ranked);
        }
        let (mut best, mut around) = (0.0_f32, PointSet::clone(covered));
        for bound in &promises.ranked[&node] {
            if bound.promise <= best {
                break;
            }
            let poses = promises.places[bound.place].0;
            let add = || add_around(promises.world, poses, covered, &mut around);
            best = best.max(bound.discount * *added.entry(bound.place).or_insert_with(add));
        }
        best
    }
}

/// Points that some poses add together to `covered`; `around` is room to work in.
fn add_around(world: &World, poses: &[LatticePose], covered: &PointSet, around: &mut PointSet) -> f32 {
    around.clone_from(covered);
    poses.iter().map(|&pose| world.glimpses().cover(pose, around)).sum::<usize>() as f32
}

/// By node of the lattice, what a gain there is worth after the walk from `start`; 0 out of reach.
fn discounts(world: &World, start: Node) -> Vec<f32> {
    let (lattice, graph) = (world.scene().lattice(), world.scene().graph());
    let mut discounts = vec![0.0; lattice.len()];
    let mut queue: VecDeque<(Node, f32)> = VecDeque::from([(start, 1.0)]);
    while let Some((node, discount)) = queue.pop_front() {
        match lattice.index(node).map(|index| &mut discounts[index]) {
            Some(known) if *known == 0.0 => *known = discount,
            _ => continue,
        }
        queue.extend(graph.neighbours(node).map(|next| (next, DISCOUNT * discount)));
    }
    discounts
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::SimConfig;
    use crate::path::ShortestPaths;
    use crate::pose::Heading;
    use crate::scene::Scene;
    use crate::sensor::Camera;

    #[test]
    fn promises_are_the_best_of_all_places_whatever_is_covered_since() {
        let camera = Camera { width: 112, height: 64, ..Camera::default() };
        let world = World::new(Scene::two_rooms(), &SimConfig { camera, ..SimConfig::default() }).unwrap();
        let (lattice, graph, glimpses) = (world.scene().lattice(), world.scene().graph(), world.glimpses());
        let nodes: Vec<Node> = graph.largest_component().to_vec();
        let open: Vec<LatticePose> =
            nodes.iter().flat_map(|&node| Heading::all().map(move |heading| LatticePose { node, heading })).collect();
        let mut covered = glimpses.nothing();
        let mut promises = Promises::new(&world, &open, &covered);
        for &seen in open.iter().step_by(17) {
            let mut room = covered.clone();
            for &from in nodes.iter().step_by(5) {
                let paths = ShortestPaths::from(lattice, from, |a, b| graph.is_passable(a, b).then_some(1.0));
                let worth = open.chunk_by(|a, b| a.node == b.node).map(|poses| {
                    let steps = paths.distance(poses[0].node).unwrap();
                    DISCOUNT.powf(steps) * add_around(&world, poses, &covered, &mut room)
                });
                let (best, found) = (worth.fold(0.0, f32::max), promises.after(&covered).at(from));
                assert!((found - best).abs() <= 1e-4 * best, "{from:?}: {found} {best}");
            }
            glimpses.cover(seen, &mut covered);
        }
        open.iter().for_each(|&pose| _ = glimpses.cover(pose, &mut covered));
        assert_eq!(promises.after(&covered).at(nodes[0]), 0.0);
    }
}
