//! The continuous world's half of an episode: actions as motions, one step each.

use super::Episode;
use crate::episode::Action;
use crate::motion::{Motion, Walker};
use crate::pilot;
use crate::pose::{Heading, LatticePose, Node, Pose};

impl Episode {
    /// An action as motions; tells whether one was blocked.
    pub(super) fn walk(&mut self, action: Action) -> bool {
        let (from, before) = (self.pose.node, self.step);
        let to = action.direction.map(|direction| from.step(direction));
        // By way of its own node: after a bump the agent stands beside it. Where the way back is blocked, straight on.
        let bumped = to.is_some_and(|to| {
            self.walk_to(from);
            !self.walk_to(to)
        });
        if let Some(to) = to.filter(|&to| bumped && to != self.pose.node) {
            self.map.bump(from, to);
        }
        let next_turn = |episode: &Self| pilot::turn_to(episode.walker.as_ref()?, action.heading.azimuth());
        while !bumped
            && !self.is_over()
            && let Some(turn) = next_turn(self)
        {
            self.perform(Some(turn));
        }
        if self.step == before {
            self.perform(None);
        }
        bumped
    }

    /// Walks to a node until there, or over; `false` if the way is blocked.
    fn walk_to(&mut self, node: Node) -> bool {
        let goal = self.world.scene().lattice().position(node);
        while !self.is_over()
            && let Some(motion) = self.walker.as_ref().and_then(|walker| pilot::towards(walker, goal))
        {
            if !self.perform(Some(motion)) {
                return false;
            }
        }
        true
    }

    /// One step of the continuous agent, standing for `None`; tells whether it was possible.
    pub(super) fn perform(&mut self, motion: Option<Motion>) -> bool {
        self.step += 1;
        let Some(mut walker) = self.walker else {
            self.bumps += 1;
            self.arrive();
            return false;
        };
        let from = walker.pose().position;
        let moved = motion.is_none_or(|motion| walker.attempt(motion, self.world.scene().rays()));
        let pose = walker.pose();
        self.walker = Some(walker);
        self.bumps += usize::from(!moved);
        self.path_length += from.distance(pose.position);
        self.pose = self.nearest(&walker);
        self.capture(&pose, 1);
        self.arrive();
        moved
    }

    /// The nearest lattice pose to which the way is free; on the other side of a wall there is none, and the node stays.
    fn nearest(&self, walker: &Walker) -> LatticePose {
        let (scene, Pose { position, azimuth }) = (self.world.scene(), walker.pose());
        let node = scene.lattice().nearest(position);
        let place = scene.lattice().position(node);
        let is_there = position.distance(place) <= pilot::arrival_distance(walker.config());
        let can_go = || !scene.rays().is_near(position, place, walker.config().radius);
        let node = if node == self.pose.node || is_there || can_go() { node } else { self.pose.node };
        LatticePose { node, heading: Heading::towards(azimuth.sin(), azimuth.cos()) }
    }
}
