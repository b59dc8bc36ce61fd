//! The order in which to visit all frontiers: a tour improved by 2-opt and by moving single stops (after TARE: Cao et al., "TARE:
//! A Hierarchical Framework for Efficiently Exploring Complex 3D Environments", RSS 2021).
//!
//! The shortest tour of all picks up every crumb on its way, and steps run out before it ends. So a tour is rated by what it
//! finds and when: each find is worth the less the later it comes.

use super::look::Look;
use crate::path::PriceList;
use crate::pose::Node;

/// What a find one step later is worth.
const DISCOUNT: f32 = 0.9;

/// Stops of a tour: what would come after them counts for little.
const MOST_STOPS: usize = 16;

/// The first stop of the best tour found that begins at the agent and ends anywhere.
pub(super) fn first(prices: &mut PriceList<'_>, mut looks: Vec<Look>) -> Option<Look> {
    let promise = |look: &Look| worth(look) * DISCOUNT.powf(look.distance);
    looks.sort_by(|a, b| promise(b).total_cmp(&promise(a)));
    looks.truncate(MOST_STOPS);
    let tour = tour(prices, &looks);
    let first = *tour.first()?;
    looks.into_iter().nth(first)
}

/// What a look finds: an area that grows as the square of the frontier's width.
fn worth(look: &Look) -> f32 {
    (look.cells.len() as f32).powi(2)
}

/// What there is to visit.
struct Stops {
    /// Steps from each to each.
    between: Vec<Vec<f32>>,
    /// Steps from the agent.
    start: Vec<f32>,
    /// What each is worth now.
    worth: Vec<f32>,
}

/// Order of the looks.
fn tour(prices: &mut PriceList<'_>, looks: &[Look]) -> Vec<usize> {
    let nodes: Vec<Node> = looks.iter().map(|look| look.pose.node).collect();
    let mut distances = |&from: &Node| {
        let paths = prices.paths_from(from);
        // A look from where another one was is a turn, which is a step.
        nodes.iter().map(|&to| paths.distance(to).unwrap_or(f32::INFINITY).max(1.0)).collect::<Vec<f32>>()
    };
    let between = nodes.iter().map(&mut distances).collect();
    let start = looks.iter().map(|look| look.distance.max(1.0)).collect();
    let worth = looks.iter().map(worth).collect();
    let stops = Stops { between, start, worth };
    stops.improve(stops.nearest_first())
}

impl Stops {
    /// From each stop to the nearest that is left.
    fn nearest_first(&self) -> Vec<usize> {
        let mut left: Vec<usize> = (0..self.start.len()).collect();
        let mut tour: Vec<usize> = Vec::with_capacity(left.len());
        while !left.is_empty() {
            let from = tour.last().map_or(&self.start, |&last| &self.between[last]);
            let place = (0..left.len()).min_by(|&a, &b| from[left[a]].total_cmp(&from[left[b]])).unwrap_or(0);
            tour.push(left.remove(place));
        }
        tour
    }

    /// What a tour finds, discounted by the steps to it.
    fn found(&self, tour: &[usize]) -> f32 {
        let (mut from, mut steps, mut sum) = (&self.start, 0.0, 0.0);
        for &stop in tour {
            steps += from[stop];
            sum += self.worth[stop] * DISCOUNT.powf(steps);
            from = &self.between[stop];
        }
        sum
    }

    /// Reverses parts of the tour and moves single stops as long as that makes it better.
    fn improve(&self, mut tour: Vec<usize>) -> Vec<usize> {
        let changes: [fn(&mut [usize]); 3] =
            [<[usize]>::reverse, |part| part.rotate_left(1), |part| part.rotate_right(1)];
        let (count, mut best) = (tour.len(), self.found(&tour));
        loop {
            let before = best;
            for (from, to) in (0..count).flat_map(|from| (from + 1..count).map(move |to| (from, to))) {
                for change in changes {
                    let mut other = tour.clone();
                    change(&mut other[from..=to]);
                    let found = self.found(&other);
                    if found > best {
                        (tour, best) = (other, found);
                    }
                }
            }
            if best <= before {
                return tour;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::seed::SeedTree;
    use proptest::prelude::*;

    /// Stops at `(x, z, worth)` for an agent at `(20, 20)`.
    fn stops(places: &[(u8, u8, u8)]) -> Stops {
        let steps = |a: &(u8, u8, u8), b: &(u8, u8, u8)| f32::from(a.0.abs_diff(b.0)) + f32::from(a.1.abs_diff(b.1));
        Stops {
            between: places.iter().map(|a| places.iter().map(|b| steps(a, b)).collect()).collect(),
            start: places.iter().map(|place| steps(&(20, 20, 0), place)).collect(),
            worth: places.iter().map(|place| f32::from(place.2)).collect(),
        }
    }

    /// What the best of all tours finds.
    fn most(stops: &Stops, tour: &mut Vec<usize>) -> f32 {
        let count = stops.start.len();
        let mut best = if tour.len() == count { stops.found(tour) } else { 0.0 };
        for stop in 0..count {
            if tour.contains(&stop) {
                continue;
            }
            tour.push(stop);
            best = most(stops, tour).max(best);
            tour.pop();
        }
        best
    }

    proptest! {
        #[test]
        fn tours_visit_all_and_no_part_is_better_reversed(
            places in prop::collection::vec((0_u8..40, 0_u8..40, 1_u8..200), 0..7),
        ) {
            let stops = stops(&places);
            let tour = stops.improve(stops.nearest_first());
            let mut sorted = tour.clone();
            sorted.sort_unstable();
            prop_assert!(sorted.into_iter().eq(0..places.len()));
            for (from, to) in (0..tour.len()).flat_map(|from| (from..tour.len()).map(move |to| (from, to))) {
                let mut other = tour.clone();
                other[from..=to].reverse();
                prop_assert!(stops.found(&other) <= stops.found(&tour) + 1e-3);
            }
        }
    }

    #[test]
    fn tours_find_nearly_what_the_best_of_all_do() {
        let mut rng = SeedTree::new(1).rng();
        let mut draw = |most: u8| rng.random_range(0..most);
        let (mut found, mut best, mut worst) = (0.0, 0.0, 1.0_f32);
        for case in 0..300 {
            let places: Vec<_> = (0..2 + case % 5).map(|_| (draw(40), draw(40), 1 + draw(199))).collect();
            let stops = stops(&places);
            let [ours, most] = [stops.found(&stops.improve(stops.nearest_first())), most(&stops, &mut Vec::new())];
            (found, best, worst) = (found + ours, best + most, worst.min(ours / most));
        }
        // The best order of all is not promised: single tours end up in a worse one that no change improves.
        assert!(found > 0.99 * best && worst > 0.5, "{found} of {best}, worst {worst}");
    }

    #[test]
    fn crumbs_wait_unless_they_lie_on_the_way() {
        let first = |places: &[(u8, u8, u8)]| {
            let stops = stops(places);
            stops.improve(stops.nearest_first())[0]
        };
        // A crumb two steps to the left, much five steps to the right.
        assert_eq!(first(&[(18, 20, 2), (25, 20, 200)]), 1);
        assert_eq!(first(&[(22, 20, 2), (25, 20, 200)]), 0);
        // Two to the right are worth as much as each of them alone cannot be.
        assert_eq!(first(&[(15, 20, 50), (25, 20, 40), (26, 20, 40)]), 1);
    }
}
