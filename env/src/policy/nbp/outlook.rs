//! Goals by what looking around from them promises: the receding horizon of [`Goals::Surroundings`](super::Goals).
//!
//! Answers outlive their window: a room that was left behind is still known to be worth a visit.

use super::Thought;
use crate::map::MapView;
use crate::path::{PriceList, ShortestPaths};
use crate::pose::{HEADINGS, Heading, LatticePose, Node};

/// What the network last promised for a look from each lattice pose, by node; nothing where it was not asked.
#[derive(Default)]
pub(super) struct Outlook {
    gains: Vec<[f32; HEADINGS]>,
}

/// A pose one step away, what is found there and what is promised after it.
struct Step {
    pose: LatticePose,
    worth: f32,
    /// The position that promises most from there.
    goal: Node,
}

impl Outlook {
    /// Takes in what the network answered.
    pub(super) fn update(&mut self, view: &MapView<'_>, (input, prediction): &Thought) {
        let lattice = view.lattice();
        self.gains.resize(lattice.len(), [0.0; HEADINGS]);
        for (index, gains) in self.gains.iter_mut().enumerate() {
            let poses = Heading::all().map(|heading| LatticePose { node: lattice.node(index), heading });
            for (gain, pose) in gains.iter_mut().zip(poses) {
                if let Some(answer) = prediction.value.of_pose(&input.window, lattice, pose) {
                    *gain = answer.max(0.0);
                }
            }
        }
    }

    /// The path to where the best next step leads on; empty if there is none.
    pub(super) fn path(&self, view: &MapView<'_>, prices: &mut PriceList<'_>, discount: f32) -> Vec<LatticePose> {
        let here = view.pose().node;
        let paths = prices.paths_from(here);
        let around: Vec<(Node, f32)> = paths.reached().map(|(node, _)| (node, self.around(view, node))).collect();
        let steps = paths.reached().filter(|&(_, distance)| distance <= 1.0).map(|(node, _)| node);
        let worth = |node: Node| {
            let after = if node == here { paths.clone() } else { prices.paths_from(node) };
            self.step(view, node, &around, &after, discount)
        };
        let best = steps.filter_map(worth).reduce(|best, step| if step.worth > best.worth { step } else { best });
        let Some(Step { pose, goal, .. }) = best.filter(|best| best.worth > 0.0) else { return Vec::new() };
        let later = prices.paths_from(pose.node).path_to(goal).unwrap_or_default();
        let looks = later.into_iter().map(|node| LatticePose { node, heading: self.best(view, node).0 });
        std::iter::once(pose).chain(looks).collect()
    }

    /// The best look from a node that is one step away, and the best position after it.
    fn step(
        &self,
        view: &MapView<'_>,
        node: Node,
        around: &[(Node, f32)],
        after: &ShortestPaths,
        discount: f32,
    ) -> Option<Step> {
        let (heading, gain) = self.best(view, node);
        let promise = |&(other, around): &(Node, f32)| {
            // What is looked at now is not found again.
            let rest = if other == node { (around - gain).max(0.0) } else { around };
            Some((other, discount.powf(after.distance(other)?.max(1.0)) * rest))
        };
        let promises = around.iter().filter_map(promise);
        let (goal, promise) = promises.reduce(|best, other| if other.1 > best.1 { other } else { best })?;
        Some(Step { pose: LatticePose { node, heading }, worth: gain + promise, goal })
    }

    /// What a look promises; nothing from where the agent has looked.
    fn gain(&self, view: &MapView<'_>, pose: LatticePose) -> f32 {
        let of_node = view.lattice().index(pose.node).and_then(|index| self.gains.get(index));
        if view.visits(pose) > 0 { 0.0 } else { of_node.map_or(0.0, |gains| gains[pose.heading.index()]) }
    }

    /// The best of the headings that were not tried yet, or the agent's own.
    fn best(&self, view: &MapView<'_>, node: Node) -> (Heading, f32) {
        let poses = Heading::all().map(|heading| LatticePose { node, heading });
        let looks = poses.filter(|&pose| view.visits(pose) == 0).map(|pose| (pose.heading, self.gain(view, pose)));
        looks.reduce(|best, look| if look.1 > best.1 { look } else { best }).unwrap_or((view.pose().heading, 0.0))
    }

    /// What all looks from a node promise together: views overlap by half, since a frame spans two headings.
    fn around(&self, view: &MapView<'_>, node: Node) -> f32 {
        Heading::all().map(|heading| self.gain(view, LatticePose { node, heading })).sum::<f32>() / 2.0
    }
}
