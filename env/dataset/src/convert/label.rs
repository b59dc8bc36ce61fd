//! Which sector each triangle of the plan belongs to (aimdoom.md, section 2, steps 3 and 4).
//!
//! Triangles are flooded up to linedefs; a region takes the sector that most of its border, by length, names. That reads
//! maps as players see them although their sectors overlap, leak, or name themselves on both sides of a line.

use crate::doom_map::{DoomMap, LineDef};
use crate::triangulate::{TriangulateError, Triangulation};
use std::collections::BTreeMap;

/// Side of a bucket in the grid that finds linedefs, map units.
const BUCKET: f64 = 64.0;

/// A piece of a border lies on a linedef when its middle is this near; crossings are rounded to doubles.
const ON_LINE: f64 = 1e-3;

/// A border that disagrees with the region for less than this is rounding, map units.
const TOLERATED_DISSENT: f64 = 1.0;

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
    let points: Vec<[f64; 2]> = map.vertices.iter().map(|v| [f64::from(v.x), f64::from(v.y)]).collect();
    let segments: Vec<[u32; 2]> = map.linedefs.iter().map(|line| [line.from, line.to]).collect();
    let plan = Triangulation::build(&points, &segments)?;
    let (region_of, count) = plan.flood(|_| true, |t, e, _| !plan.is_constraint[t][e]);
    let region_of: Vec<u32> = region_of.into_iter().map(|r| r.unwrap_or(0)).collect();
    let mut regions: Vec<Region> = (0..count).map(|_| Region::default()).collect();
    let lines = LineGrid::new(map, &points);
    for triangle in 0..plan.triangles.len() {
        let area = plan.area(triangle);
        let region = &mut regions[region_of[triangle] as usize];
        if region.area == 0.0 {
            region.middle = plan.centroid(triangle);
        }
        region.area += area;
        for edge in 0..3 {
            let neighbour = plan.neighbours[triangle][edge];
            if !plan.is_constraint[triangle][edge] {
                region.is_outside |= neighbour.is_none();
                continue;
            }
            let length = plan.edge_length(triangle, edge);
            let ends = plan.edge(triangle, edge).map(|v| plan.points[v as usize]);
            let mut spoke = false;
            // Triangles are counter-clockwise, so the region lies to the left of its edges.
            for vote in lines.sides_to_the_left(ends) {
                *region.votes.entry(vote).or_default() += length;
                spoke = true;
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
        if dissent > TOLERATED_DISSENT && !region.is_outside {
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
    loop {
        let mut wave = Vec::new();
        for (index, region) in regions.iter().enumerate().filter(|&(index, _)| choice[index].is_none()) {
            let decided = region.silent.iter().filter_map(|(&n, length)| Some((choice[n as usize]?, length)));
            if let Some((sector, _)) = decided.max_by(|a, b| a.1.total_cmp(b.1)) {
                wave.push((index, sector));
            }
        }
        if wave.is_empty() {
            break;
        }
        for (index, sector) in wave {
            choice[index] = Some(sector);
        }
    }
    choice.into_iter().map(Option::flatten).collect()
}

/// Linedefs by place.
struct LineGrid<'a> {
    map: &'a DoomMap,
    points: &'a [[f64; 2]],
    buckets: BTreeMap<(i32, i32), Vec<u32>>,
}

impl<'a> LineGrid<'a> {
    fn new(map: &'a DoomMap, points: &'a [[f64; 2]]) -> Self {
        let mut buckets: BTreeMap<(i32, i32), Vec<u32>> = BTreeMap::new();
        for (index, line) in map.linedefs.iter().enumerate() {
            let Some([a, b]) = ends(points, line) else { continue };
            // Long lines pass few of the buckets in their box: walk along them in half-bucket steps and take a margin.
            let steps = ((b[0] - a[0]).hypot(b[1] - a[1]) / (BUCKET / 2.0)).ceil().max(1.0) as usize;
            let mut last = None;
            for step in 0..=steps {
                let t = step as f64 / steps as f64;
                let key = bucket([a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])]);
                if last != Some(key) {
                    for (dx, dy) in (-1..=1).flat_map(|dx| (-1..=1).map(move |dy| (dx, dy))) {
                        let entry = buckets.entry((key.0 + dx, key.1 + dy)).or_default();
                        if entry.last() != Some(&(index as u32)) {
                            entry.push(index as u32);
                        }
                    }
                    last = Some(key);
                }
            }
        }
        Self { map, points, buckets }
    }

    /// What the linedefs under a piece of border say about the side to its left. Lines with one sector on both sides say
    /// nothing.
    fn sides_to_the_left(&self, [p, q]: [[f64; 2]; 2]) -> Vec<Option<u32>> {
        let middle = [(p[0] + q[0]) / 2.0, (p[1] + q[1]) / 2.0];
        let candidates = self.buckets.get(&bucket(middle)).into_iter().flatten();
        let mut votes = Vec::new();
        for line in candidates.filter_map(|&index| self.map.linedefs.get(index as usize)) {
            let Some([a, b]) = ends(self.points, line) else { continue };
            let (along, length) = ([b[0] - a[0], b[1] - a[1]], (b[0] - a[0]).hypot(b[1] - a[1]));
            if length == 0.0 {
                continue;
            }
            let from_a = [middle[0] - a[0], middle[1] - a[1]];
            let off = (along[0] * from_a[1] - along[1] * from_a[0]) / length;
            let t = (along[0] * from_a[0] + along[1] * from_a[1]) / length;
            // A short piece may lie near a line that it crosses: it must run along the line, too.
            let piece = [q[0] - p[0], q[1] - p[1]];
            let turn = (along[0] * piece[1] - along[1] * piece[0]) / length;
            if off.abs() > ON_LINE || t < -ON_LINE || t > length + ON_LINE || turn.abs() > 2.0 * ON_LINE {
                continue;
            }
            let sectors = [line.front, line.back].map(|side| self.map.sector_of(side));
            if sectors[0] == sectors[1] {
                continue;
            }
            let same_way = along[0] * piece[0] + along[1] * piece[1] > 0.0;
            votes.push(if same_way { sectors[1] } else { sectors[0] });
        }
        votes
    }
}

fn ends(points: &[[f64; 2]], line: &LineDef) -> Option<[[f64; 2]; 2]> {
    Some([*points.get(line.from as usize)?, *points.get(line.to as usize)?])
}

fn bucket(p: [f64; 2]) -> (i32, i32) {
    ((p[0] / BUCKET).floor() as i32, (p[1] / BUCKET).floor() as i32)
}
