//! Segments cut at all their crossings, on a grid of fixed-point numbers.
//!
//! Maps hold lines that cross, touch and overlap. Crossings are rounded to the grid, which may make new ones, so rounds
//! follow until nothing crosses. All tests are exact integer arithmetic: what leaves this file is planar.

use std::collections::BTreeMap;

/// A point in grid units.
pub(crate) type Point = [i64; 2];

/// Largest coordinate, grid units: products of differences fit into 64 bits.
pub(crate) const LARGEST: i64 = 1 << 28;

const MAX_ROUNDS: usize = 24;

/// Pieces after which a map is given up; the largest real maps have a hundred thousand.
const MAX_PIECES: usize = 200_000;

/// Pairs of pieces after which a map is given up, about 0.2 s; the largest real maps need a sixtieth.
const MAX_PAIRS: usize = 1 << 26;

/// Planar pieces of segments.
#[derive(Debug, Clone, Default)]
pub(crate) struct Arrangement {
    /// Distinct ends of pieces, sorted.
    pub(crate) points: Vec<Point>,
    /// For each piece, as a pair of point indices with the smaller first, the segments it is part of, sorted.
    pub(crate) pieces: BTreeMap<[u32; 2], Vec<u32>>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Piece {
    /// The smaller end first.
    ends: [Point; 2],
    source: u32,
}

impl Piece {
    fn new(a: Point, b: Point, source: u32) -> Self {
        Self { ends: [a.min(b), a.max(b)], source }
    }
}

/// Cuts segments, given by their ends, at all crossings. Segments of no length vanish. On failure names a place and the
/// reason.
pub(crate) fn arrange(segments: &[[Point; 2]]) -> Result<Arrangement, (Point, &'static str)> {
    if let Some(&far) = segments.iter().flatten().find(|p| p.iter().any(|c| c.abs() > LARGEST)) {
        return Err((far, "the coordinate is too large"));
    }
    let numbered = segments.iter().zip(0..);
    let mut pieces: Vec<Piece> =
        numbered.filter(|([a, b], _)| a != b).map(|([a, b], n)| Piece::new(*a, *b, n)).collect();
    let mut pairs = 0;
    for _ in 0..MAX_ROUNDS {
        pieces.sort_unstable();
        pieces.dedup();
        let cuts = find_cuts(&pieces, &mut pairs)?;
        if cuts.is_empty() {
            return Ok(collect(&pieces));
        }
        pieces = split(&pieces, cuts);
    }
    Err((pieces.first().map_or([0; 2], |piece| piece.ends[0]), "crossing lines do not settle on the grid"))
}

/// `(piece, point)` for every point at which a piece is to be cut; counts the pairs that were looked at.
fn find_cuts(pieces: &[Piece], pairs: &mut usize) -> Result<Vec<(usize, Point)>, (Point, &'static str)> {
    let mut cuts = Vec::new();
    for (i, p) in pieces.iter().enumerate() {
        let y_range = |piece: &Piece| {
            let [a, b] = piece.ends.map(|end| end[1]);
            [a.min(b), a.max(b)]
        };
        let [low, high] = y_range(p);
        // Sorted by their left ends: no piece after the first that starts to the right can meet this one.
        for (j, q) in pieces.iter().enumerate().skip(i + 1).take_while(|(_, q)| q.ends[0][0] <= p.ends[1][0]) {
            *pairs += 1;
            let [q_low, q_high] = y_range(q);
            if q_low > high || q_high < low || p.ends == q.ends {
                continue;
            }
            meet(i, p, j, q, &mut cuts);
            if pieces.len() + cuts.len() > MAX_PIECES {
                return Err((p.ends[0], "too many lines cross each other"));
            }
        }
        if *pairs > MAX_PAIRS {
            return Err((p.ends[0], "too many long lines lie side by side or on each other"));
        }
    }
    Ok(cuts)
}

/// Where two pieces have to be cut.
fn meet(i: usize, p: &Piece, j: usize, q: &Piece, cuts: &mut Vec<(usize, Point)>) {
    let ([a, b], [c, d]) = (p.ends, q.ends);
    let [to_c, to_d] = [c, d].map(|end| turn(a, b, end));
    let [to_a, to_b] = [a, b].map(|end| turn(c, d, end));
    // An end of one that lies on the other, between its ends.
    for (end, side) in [(c, to_c), (d, to_d)] {
        if side == 0 && is_between(a, b, end) {
            cuts.push((i, end));
        }
    }
    for (end, side) in [(a, to_a), (b, to_b)] {
        if side == 0 && is_between(c, d, end) {
            cuts.push((j, end));
        }
    }
    if to_c.signum() * to_d.signum() < 0 && to_a.signum() * to_b.signum() < 0 {
        let t = to_a as f64 / (to_a - to_b) as f64;
        let at = [0, 1].map(|axis| a[axis] + (t * (b[axis] - a[axis]) as f64).round() as i64);
        for (piece, [from, to]) in [(i, p.ends), (j, q.ends)] {
            if at != from && at != to {
                cuts.push((piece, at));
            }
        }
    }
}

/// Twice the area of a triangle, positive for a turn to the left.
fn turn(a: Point, b: Point, c: Point) -> i64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Whether a point of the line through `a` and `b` lies strictly between them; ends of pieces are ordered.
fn is_between(a: Point, b: Point, p: Point) -> bool {
    a < p && p < b
}

fn split(pieces: &[Piece], mut cuts: Vec<(usize, Point)>) -> Vec<Piece> {
    // Ends are ordered, so the order of points along a piece is their own; a rounded cut may lie a little off it.
    cuts.sort_unstable();
    let mut cuts = cuts.into_iter().peekable();
    let mut split = Vec::with_capacity(pieces.len() + cuts.len());
    for (number, piece) in pieces.iter().enumerate() {
        let mut from = piece.ends[0];
        while let Some((_, at)) = cuts.next_if(|cut| cut.0 == number) {
            if at != from {
                split.push(Piece::new(from, at, piece.source));
                from = at;
            }
        }
        if from != piece.ends[1] {
            split.push(Piece::new(from, piece.ends[1], piece.source));
        }
    }
    split
}

fn collect(pieces: &[Piece]) -> Arrangement {
    let mut points: Vec<Point> = pieces.iter().flat_map(|piece| piece.ends).collect();
    points.sort_unstable();
    points.dedup();
    let index = |p: &Point| points.partition_point(|q| q < p) as u32;
    let mut by_ends: BTreeMap<[u32; 2], Vec<u32>> = BTreeMap::new();
    for piece in pieces {
        let sources = by_ends.entry([index(&piece.ends[0]), index(&piece.ends[1])]).or_default();
        if sources.last() != Some(&piece.source) {
            sources.push(piece.source);
        }
    }
    Arrangement { points, pieces: by_ends }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn crossings_touches_and_overlaps_are_cut() {
        let cross = arrange(&[[[0, 0], [10, 10]], [[0, 10], [10, 0]]]).unwrap();
        assert_eq!((cross.points.len(), cross.pieces.len()), (5, 4));
        let overlap = arrange(&[[[0, 0], [10, 0]], [[4, 0], [20, 0]], [[7, 0], [7, 5]]]).unwrap();
        assert_eq!(overlap.points.len(), 6);
        let shared: Vec<_> = overlap.pieces.values().filter(|sources| sources.len() == 2).collect();
        assert_eq!(shared, [&vec![0, 1], &vec![0, 1]]);
        assert!(arrange(&[[[0, 0], [1 << 40, 0]]]).is_err());
        assert!(arrange(&[[[3, 3], [3, 3]]]).unwrap().pieces.is_empty());
    }

    proptest! {
        #[test]
        fn nothing_crosses_afterwards(ends in prop::collection::vec(prop::array::uniform4(-60_i64..60), 1..60)) {
            let segments: Vec<[Point; 2]> = ends.iter().map(|&[a, b, c, d]| [[a, b], [c, d]]).collect();
            let Ok(arranged) = arrange(&segments) else { return Ok(()) };
            let pieces: Vec<Piece> = arranged
                .pieces
                .keys()
                .map(|&[a, b]| Piece::new(arranged.points[a as usize], arranged.points[b as usize], 0))
                .collect();
            prop_assert!(find_cuts(&pieces, &mut 0).unwrap().is_empty());
        }
    }
}
