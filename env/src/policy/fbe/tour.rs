//! The order in which to visit all frontiers: a tour improved by 2-opt and by moving single stops (after TARE: Cao et al., "TARE:
//! A Hierarchical Framework for Efficiently Exploring Complex 3D Environments", RSS 2021).

use super::look::Look;
use crate::map::MapView;
use crate::path::ShortestPaths;
use crate::policy::observed_price;
use crate::pose::Node;

/// The first stop of the best tour found that begins at the agent and ends anywhere.
pub(super) fn first(view: &MapView<'_>, looks: Vec<Look>) -> Option<Look> {
    let tour = tour(view, &looks);
    let first = *tour.first()?;
    looks.into_iter().nth(first)
}

/// Order of the looks.
fn tour(view: &MapView<'_>, looks: &[Look]) -> Vec<usize> {
    let nodes: Vec<Node> = looks.iter().map(|look| look.pose.node).collect();
    let distances = |from: &Node| {
        let paths = ShortestPaths::from(*from, |a, b| observed_price(view, a, b));
        nodes.iter().map(|&to| paths.distance(to).unwrap_or(f32::INFINITY).max(1.0)).collect::<Vec<f32>>()
    };
    let between: Vec<Vec<f32>> = nodes.iter().map(distances).collect();
    let start: Vec<f32> = looks.iter().map(|look| look.distance.max(1.0)).collect();
    improve(&between, &start, nearest_first(&between, &start))
}

/// From each stop to the nearest that is left.
fn nearest_first(between: &[Vec<f32>], start: &[f32]) -> Vec<usize> {
    let mut left: Vec<usize> = (0..start.len()).collect();
    let mut tour: Vec<usize> = Vec::with_capacity(left.len());
    while !left.is_empty() {
        let from = tour.last().map_or(start, |&last| &between[last][..]);
        let place = (0..left.len()).min_by(|&a, &b| from[left[a]].total_cmp(&from[left[b]])).unwrap_or(0);
        tour.push(left.remove(place));
    }
    tour
}

/// Length of a tour.
fn length(between: &[Vec<f32>], start: &[f32], tour: &[usize]) -> f32 {
    let steps = tour.windows(2).map(|stops| between[stops[0]][stops[1]]);
    tour.first().map_or(0.0, |&first| start[first]) + steps.sum::<f32>()
}

/// Reverses parts of the tour and moves single stops as long as that makes it shorter.
fn improve(between: &[Vec<f32>], start: &[f32], mut tour: Vec<usize>) -> Vec<usize> {
    let changes: [fn(&mut [usize]); 3] = [<[usize]>::reverse, |part| part.rotate_left(1), |part| part.rotate_right(1)];
    let (count, mut best) = (tour.len(), length(between, start, &tour));
    loop {
        let before = best;
        for (from, to) in (0..count).flat_map(|from| (from + 1..count).map(move |to| (from, to))) {
            for change in changes {
                let mut other = tour.clone();
                change(&mut other[from..=to]);
                let length = length(between, start, &other);
                if length < best {
                    (tour, best) = (other, length);
                }
            }
        }
        if best >= before {
            return tour;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Lengths of all tours, the shortest first.
    fn all_lengths(between: &[Vec<f32>], start: &[f32], tour: &mut Vec<usize>, found: &mut Vec<f32>) {
        if tour.len() == start.len() {
            found.push(length(between, start, tour));
        }
        for stop in 0..start.len() {
            if !tour.contains(&stop) {
                tour.push(stop);
                all_lengths(between, start, tour, found);
                tour.pop();
            }
        }
    }

    proptest! {
        #[test]
        fn tours_visit_all_and_no_reversal_makes_them_shorter(
            places in prop::collection::vec((0_u8..40, 0_u8..40), 0..7),
        ) {
            let steps = |a: &(u8, u8), b: &(u8, u8)| f32::from(a.0.abs_diff(b.0)) + f32::from(a.1.abs_diff(b.1));
            let between: Vec<Vec<f32>> = places.iter().map(|a| places.iter().map(|b| steps(a, b)).collect()).collect();
            let start: Vec<f32> = places.iter().map(|place| steps(&(20, 20), place)).collect();
            let first = nearest_first(&between, &start);
            let tour = improve(&between, &start, first.clone());
            let mut stops = tour.clone();
            stops.sort_unstable();
            prop_assert!(stops.into_iter().eq(0..places.len()));
            let found = length(&between, &start, &tour);
            prop_assert!(found <= length(&between, &start, &first));
            for (from, to) in (0..tour.len()).flat_map(|from| (from..tour.len()).map(move |to| (from, to))) {
                let mut other = tour.clone();
                other[from..=to].reverse();
                prop_assert!(length(&between, &start, &other) >= found);
            }
            let mut all = Vec::new();
            all_lengths(&between, &start, &mut Vec::new(), &mut all);
            let shortest = all.into_iter().fold(f32::INFINITY, f32::min);
            prop_assert!(places.is_empty() || found <= 1.5 * shortest, "{} for {}", found, shortest);
        }
    }

    #[test]
    fn the_near_stop_on_the_way_back_waits() {
        // The nearest stop lies 3 to the right, then 10 to 12 follow there; one lies 4 to the left.
        let places = [3.0_f32, 10.0, 11.0, 12.0, -4.0];
        let between: Vec<Vec<f32>> = places.iter().map(|a| places.iter().map(|b| (a - b).abs()).collect()).collect();
        let start = places.map(f32::abs);
        assert_eq!(nearest_first(&between, &start)[0], 0);
        assert_eq!(improve(&between, &start, nearest_first(&between, &start)), [4, 0, 1, 2, 3]);
    }
}
