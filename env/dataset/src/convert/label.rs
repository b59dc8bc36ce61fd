//! Which sector each triangle of the plan belongs to.
//!
//! Triangles are flooded up to linedefs; a region takes the sector that most of its border, by length, names. That reads
//! maps as players see them although their sectors overlap, leak, or name themselves on both sides of a line.

use crate::doom_map::{DoomMap, LineDef};
use crate::triangulate::{TriangulateError, Triangulation};
use std::collections::{BTreeMap, BTreeSet};

/// Crossings of linedefs are rounded to this share of a map unit.
const SUBUNITS: u16 = 256;

/// A region is in conflict when more than this share of its border names other sectors: the sector is not closed, and
/// which one wins changes the map. Less is a slip of a single line, of which real maps have many.
const TOLERATED_DISSENT: f64 = 0.1;

/// The plan with a sector for each triangle.
#[derive(Debug, Clone)]
pub struct LabelledPlan {
    /// The triangles.
    pub plan: Triangulation,
    /// Sector of each triangle; `None` is solid.
    pub sector: Vec<Option<u32>>,
    /// Area of the regions whose border names more than one sector, square map units.
    pub conflict_area: f64,
    /// The largest such region: area, middle of one of its triangles, the sector chosen.
    pub worst_conflict: Option<Conflict>,
}

/// A region whose border names several sectors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Conflict {
    /// Square map units.
    pub area: f64,
    /// Map units.
    pub at: [f64; 2],
    /// The winner of the vote.
    pub sector: Option<u32>,
}

#[derive(Default)]
struct Region {
    area: f64,
    middle: [f64; 2],
    is_outside: bool,
    /// Length of border that names each sector (`None`: the back of a one-sided line).
    votes: BTreeMap<Option<u32>, f64>,
    /// Length shared with each neighbour across lines that do not vote.
    silent: BTreeMap<u32, f64>,
}

/// Triangulates a map and labels its triangles.
///
/// # Errors
/// When the plan cannot be triangulated.
pub fn label(map: &DoomMap) -> Result<LabelledPlan, TriangulateError> {
    let corner = |v: u32| map.vertices.get(v as usize).map_or([0; 2], |v| [v.x, v.y]);
    let segments: Vec<_> = map.linedefs.iter().map(|line| [corner(line.from), corner(line.to)]).collect();
    let plan = Triangulation::build(&segments, SUBUNITS)?;
    let (region_of, count) = plan.flood(|_| true, |t, e, _| plan.segments_on(t, e).is_empty());
    let region_of: Vec<u32> = region_of.into_iter().map(|r| r.unwrap_or(0)).collect();
    let mut regions: Vec<Region> = (0..count).map(|_| Region::default()).collect();
    for triangle in 0..plan.triangles.len() {
        let area = plan.area(triangle);
        let region = &mut regions[region_of[triangle] as usize];
        if region.area == 0.0 {
            region.middle = plan.centroid(triangle);
        }
        region.area += area;
        for edge in 0..3 {
            let neighbour = plan.neighbours[triangle][edge];
            let lines = plan.segments_on(triangle, edge);
            if lines.is_empty() {
                region.is_outside |= neighbour.is_none();
                continue;
            }
            let length = plan.edge_length(triangle, edge);
            let ends = plan.edge(triangle, edge).map(|v| plan.points[v as usize]);
            let mut spoke = false;
            // Triangles are counter-clockwise, so the region lies to the left of its edges.
            for &line in lines {
                if let Some(vote) = side_to_the_left(map, segments[line as usize], &map.linedefs[line as usize], ends) {
                    *region.votes.entry(vote).or_default() += length;
                    spoke = true;
                }
            }
            if let (false, Some(neighbour)) = (spoke, neighbour) {
                *region.silent.entry(region_of[neighbour as usize]).or_default() += length;
            }
        }
    }
    let choice = choose(&regions);
    let mut labelled = LabelledPlan {
        sector: region_of.iter().map(|&r| choice[r as usize]).collect(),
        plan,
        conflict_area: 0.0,
        worst_conflict: None,
    };
    for (region, &sector) in regions.iter().zip(&choice) {
        let dissent: f64 = region.votes.iter().filter(|(vote, _)| **vote != sector).map(|(_, length)| length).sum();
        let border: f64 = region.votes.values().sum();
        if dissent > TOLERATED_DISSENT * border && !region.is_outside {
            labelled.conflict_area += region.area;
            let conflict = Conflict { area: region.area, at: region.middle, sector };
            if labelled.worst_conflict.is_none_or(|worst| worst.area < conflict.area) {
                labelled.worst_conflict = Some(conflict);
            }
        }
    }
    Ok(labelled)
}

fn choose(regions: &[Region]) -> Vec<Option<u32>> {
    // `None` inside of `Some` is a decision for solid.
    let mut choice: Vec<Option<Option<u32>>> = regions
        .iter()
        .map(|region| {
            if region.is_outside {
                return Some(None);
            }
            // Of equals the last in order wins: a sector rather than solid, the higher number of two.
            region.votes.iter().max_by(|a, b| a.1.total_cmp(b.1)).map(|(&sector, _)| sector)
        })
        .collect();
    // Regions without a vote take over from the neighbour with the longest silent border, wave after wave.
    let mut open: BTreeSet<usize> = (0..regions.len()).filter(|&index| choice[index].is_none()).collect();
    while !open.is_empty() {
        let mut wave = Vec::new();
        for &index in open.iter().filter(|&&index| choice[index].is_none()) {
            let silent = regions[index].silent.iter();
            let decided = silent.filter_map(|(&n, length)| Some((choice[n as usize]?, length)));
            if let Some((sector, _)) = decided.max_by(|a, b| a.1.total_cmp(b.1)) {
                wave.push((index, sector));
            }
        }
        // Only next to the last wave can there be another one.
        open = wave.iter().flat_map(|&(index, _)| regions[index].silent.keys().map(|&n| n as usize)).collect();
        for (index, sector) in wave {
            choice[index] = Some(sector);
        }
    }
    choice.into_iter().map(Option::flatten).collect()
}

/// What a linedef says about the side to the left of a piece of it. A line with one sector on both sides says nothing;
/// `Some(None)` is solid.
fn side_to_the_left(
    map: &DoomMap,
    [a, b]: [[i32; 2]; 2],
    line: &LineDef,
    [p, q]: [[f64; 2]; 2],
) -> Option<Option<u32>> {
    let [front, back] = [line.front, line.back].map(|side| map.sector_of(side));
    let along = [0, 1].map(|axis| f64::from(b[axis]) - f64::from(a[axis]));
    let same_way = along[0] * (q[0] - p[0]) + along[1] * (q[1] - p[1]) > 0.0;
    (front != back).then_some(if same_way { back } else { front })
}

#[cfg(test)]
mod tests {
    use super::*;

    const SQUARE: [[i32; 2]; 5] = [[0, 0], [400, 0], [400, 400], [0, 400], [0, 0]];

    /// Area of each label.
    fn areas(map: &DoomMap) -> (BTreeMap<Option<u32>, f64>, LabelledPlan) {
        let labelled = label(map).unwrap();
        let mut areas = BTreeMap::new();
        for (triangle, &sector) in labelled.sector.iter().enumerate() {
            *areas.entry(sector).or_default() += labelled.plan.area(triangle);
        }
        (areas, labelled)
    }

    #[test]
    fn sectors_fill_their_outlines() {
        let (map, door) = DoomMap::with_door();
        let (areas, labelled) = areas(&map);
        assert_eq!(areas[&Some(0)], 160_000.0);
        assert_eq!(areas[&Some(door)], 3_200.0);
        assert_eq!(labelled.conflict_area, 0.0);
    }

    #[test]
    fn lines_with_one_sector_on_both_sides_do_not_vote() {
        let mut map = DoomMap::default();
        let (room, ghost) = (map.sector(0, 128), map.sector(0, 256));
        map.walls(&SQUARE, room);
        for pair in [[100, 100], [200, 100], [200, 200], [100, 200], [100, 100]].windows(2) {
            map.line(pair[0], pair[1], Some(ghost), Some(ghost));
        }
        let (areas, labelled) = areas(&map);
        assert_eq!(areas.into_iter().collect::<Vec<_>>(), [(Some(room), 160_000.0)]);
        assert_eq!(labelled.conflict_area, 0.0);
    }

    #[test]
    fn a_sector_that_is_not_closed_is_a_conflict() {
        let mut map = DoomMap::default();
        let (room, other) = (map.sector(0, 128), map.sector(0, 256));
        map.walls(&SQUARE[..3], room);
        map.walls(&SQUARE[2..], other);
        let (_, labelled) = areas(&map);
        assert_eq!(labelled.conflict_area, 160_000.0);
        assert_eq!(labelled.worst_conflict.unwrap().area, 160_000.0);
    }

    #[test]
    fn a_pillar_is_solid_and_the_outside_too() {
        let mut map = DoomMap::default();
        let room = map.sector(0, 128);
        map.walls(&SQUARE, room);
        let mut pillar = [[100, 100], [200, 100], [200, 200], [100, 200], [100, 100]];
        pillar.reverse();
        map.walls(&pillar, room);
        let (areas, _) = areas(&map);
        assert_eq!((areas[&Some(room)], areas[&None]), (150_000.0, 10_000.0));
    }
}
