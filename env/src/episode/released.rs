//! Coverage as the released code counts it, as a second curve of an episode.

use super::Episode;
use crate::coverage::Coverage;

/// The second curve, see [`Episode::count_as_released`].
pub(super) struct Released {
    every: usize,
    curve: Vec<f32>,
}

impl Released {
    /// On a straight line to `share`, the last of `len` values.
    fn go_on(&mut self, share: f32, len: usize) {
        let (from, last) = (self.curve.len(), self.curve.last().copied().unwrap_or(share));
        let steps = (len - from) as f32;
        self.curve.extend((1..=len - from).map(|step| last + (share - last) * (step as f32 / steps)));
    }

    /// Memory that it holds, bytes.
    pub(super) fn bytes(&self) -> usize {
        self.curve.capacity() * size_of::<f32>()
    }
}

impl Episode {
    /// Keeps a second curve, [`Episode::released_curve`], as the released code counts coverage ([`Counting::AsReleased`](crate::coverage::Counting)): at the
    /// start, where it is to be called, in every so many steps and in the last one, on a straight line between. Nothing else
    /// depends on it. To count takes a sample of the cloud: late in a long episode some 5 ms, as much as all else in three steps.
    pub fn count_as_released(&mut self, every: usize) {
        self.released = Some(Released { every: every.max(1), curve: vec![self.share_as_released()] });
    }

    /// Covered share as the released code counts it at the start and after each step up to the last one that was counted, see
    /// [`Episode::count_as_released`].
    pub fn released_curve(&self) -> Option<&[f32]> {
        self.released.as_ref().map(|released| &released.curve[..])
    }

    /// Counts the step that has just ended, if it is one of those.
    pub(super) fn count_on(&mut self) {
        let is_counted =
            |released: &mut Released| self.step.is_multiple_of(released.every) || self.step == self.horizon;
        if let Some(mut released) = self.released.take_if(is_counted) {
            released.go_on(self.share_as_released(), self.curve.len());
            self.released = Some(released);
        }
    }

    pub(super) fn covered_as_released(&mut self) -> usize {
        let surface = self.world.surface();
        let mut rng = self.sampling.child("step", self.step as u64).rng();
        let sample = self.map.cloud().sample(&mut rng, 2 * surface.len());
        self.recount.get_or_insert_with(|| Coverage::new(surface)).glance(surface, &sample).len()
    }

    fn share_as_released(&mut self) -> f32 {
        self.covered_as_released() as f32 / self.world.surface().len() as f32
    }
}

#[cfg(test)]
mod tests {
    use super::super::Action;
    use super::*;
    use crate::config::SimConfig;
    use crate::coverage::{Counting, CoverageConfig};
    use crate::pose::{Direction, Heading, LatticePose, Node};
    use crate::scene::Scene;
    use crate::seed::SeedTree;
    use crate::world::World;
    use std::sync::Arc;

    fn start(i: i32, k: i32) -> LatticePose {
        LatticePose { node: Node { i, k }, heading: Heading::new(0) }
    }

    #[test]
    fn both_ways_of_counting_fit_in_one_episode() {
        let released = CoverageConfig { counting: Counting::AsReleased, points: 300, ..CoverageConfig::default() };
        let exact = CoverageConfig { counting: Counting::Exact, ..released };
        let [both, alone] = [exact, released].map(|coverage| {
            let world = World::new(Scene::two_rooms(), &SimConfig { coverage, ..SimConfig::default() }).unwrap();
            let mut episode = Episode::new(Arc::new(world), start(1, 2), 5, SeedTree::new(1)).unwrap();
            if coverage.counting == Counting::Exact {
                episode.count_as_released(1);
            }
            for heading in [3, 6, 1, 4, 7] {
                episode.step(Action { direction: Some(Direction::PlusX), heading: Heading::new(heading) });
            }
            episode
        });
        assert_eq!((both.released_curve().unwrap(), alone.released_curve()), (alone.curve(), None));
        assert_ne!(both.curve(), alone.curve());
    }

    #[test]
    fn counted_now_and_then_it_is_the_same_there_and_a_line_between() {
        let world = Arc::new(World::new(Scene::two_rooms(), &SimConfig::default()).unwrap());
        let [each, third] = [1, 3].map(|every| {
            let mut episode = Episode::new(Arc::clone(&world), start(1, 2), 5, SeedTree::new(1)).unwrap();
            episode.count_as_released(every);
            for heading in [3, 6, 1, 4, 7] {
                episode.step(Action { direction: Some(Direction::PlusX), heading: Heading::new(heading) });
            }
            episode.released_curve().unwrap().to_vec()
        });
        let line = |a: f32, b: f32, t: f32| a + (b - a) * t;
        let expected = [
            each[0],
            line(each[0], each[3], 1.0 / 3.0),
            line(each[0], each[3], 2.0 / 3.0),
            each[3],
            line(each[3], each[5], 0.5),
            each[5],
        ];
        assert!(
            third.len() == 6 && third.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6),
            "{third:?} {expected:?}"
        );
    }

    #[test]
    fn the_released_counting_reads_lower() {
        let mut config = SimConfig::default();
        let mut last = |counting| {
            config.coverage = CoverageConfig { points: 500, counting, ..config.coverage };
            let world = Arc::new(World::new(Scene::two_rooms(), &config).unwrap());
            let mut episode = Episode::new(world, start(1, 2), 8, SeedTree::new(2)).unwrap();
            for heading in (1..=8).map(Heading::new) {
                episode.step(Action { direction: None, heading });
            }
            episode.curve()[8]
        };
        let (exact, released) = (last(Counting::Exact), last(Counting::AsReleased));
        assert!(released < exact && released > 0.7 * exact, "{released} {exact}");
    }
}
