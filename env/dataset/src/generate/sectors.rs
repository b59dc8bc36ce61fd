//! The boolean union of the pieces as sectors and linedefs (aimdoom.md, section 3, step 5).

use super::draft::Piece;
use super::raster::{bounds, contains, edges};
use crate::doom_map::{DoomMap, LineDef, Sector, SideDef, Thing, Vertex};
use crate::triangulate::{TriangulateError, Triangulation};
use std::collections::BTreeMap;

/// Rounds of snapping crossings to whole map units; each moves lines by less than one unit.
const MAX_ROUNDS: usize = 12;

const TWO_SIDED: u16 = 4;
const IMPASSABLE: u16 = 1;

/// Cuts the pieces against each other and names the sectors. Every triangle belongs to the topmost piece that contains
/// its middle, and linedefs run where the air changes, so the sectors are closed by construction.
///
/// # Errors
/// When the crossings of the outlines do not settle on whole map units.
pub(crate) fn to_map(name: &str, pieces: &[Piece]) -> Result<DoomMap, TriangulateError> {
    let plan = snapped_plan(pieces)?;
    let tops = Tops::new(pieces);
    let air: Vec<Option<(i32, i32)>> = (0..plan.triangles.len()).map(|t| tops.air_at(plan.centroid(t))).collect();
    let mut sectors: BTreeMap<(i32, i32), u32> = air.iter().flatten().map(|&heights| (heights, 0)).collect();
    sectors.values_mut().enumerate().for_each(|(number, sector)| *sector = number as u32);
    let sector_of = |triangle: usize| air[triangle].and_then(|heights| sectors.get(&heights).copied());
    let mut map = DoomMap { name: name.into(), ..DoomMap::default() };
    map.sectors =
        sectors.keys().map(|&(floor, ceiling)| Sector { floor, ceiling, is_sky: false, special: 0, tag: 0 }).collect();
    let mut numbers: BTreeMap<u32, u32> = BTreeMap::new();
    for triangle in 0..plan.triangles.len() {
        for edge in 0..3 {
            let neighbour = plan.neighbours[triangle][edge].map(|n| n as usize);
            let (Some(left), right) = (sector_of(triangle), neighbour.and_then(sector_of)) else { continue };
            // Each line once: from the side with the higher triangle number, or the only side with air.
            let is_mine = right.is_none() || neighbour.is_some_and(|n| triangle > n);
            if right == Some(left) || !is_mine {
                continue;
            }
            // The triangle lies to the left of its edge, and a front side to the right of its line.
            let [to, from] = plan.edge(triangle, edge);
            let [from, to] = [from, to].map(|point| {
                let next = numbers.len() as u32;
                *numbers.entry(point).or_insert_with(|| {
                    let [x, y] = plan.points[point as usize].map(|c| c.round() as i32);
                    map.vertices.push(Vertex { x, y });
                    next
                })
            });
            let mut side = |sector| {
                map.sidedefs.push(SideDef { sector });
                map.sidedefs.len() as u32 - 1
            };
            let front = Some(side(left));
            let back = right.map(side);
            let flags = if back.is_some() { TWO_SIDED } else { IMPASSABLE };
            map.linedefs.push(LineDef { from, to, flags, special: 0, tag: 0, front, back });
        }
    }
    map.things = player_start(&plan, &air);
    Ok(map)
}

/// Triangulation of all outlines in which every corner has whole coordinates.
fn snapped_plan(pieces: &[Piece]) -> Result<Triangulation, TriangulateError> {
    let mut segments: Vec<[[i32; 2]; 2]> = pieces.iter().flat_map(|piece| edges(&piece.polygon)).collect();
    for _ in 0..MAX_ROUNDS {
        let mut points: Vec<[i32; 2]> = segments.iter().flatten().copied().collect();
        points.sort_unstable();
        points.dedup();
        let index = |p: &[i32; 2]| points.partition_point(|q| q < p) as u32;
        let mut pairs: Vec<[u32; 2]> = segments.iter().map(|[a, b]| [index(a), index(b)]).collect();
        pairs.iter_mut().for_each(|pair| pair.sort_unstable());
        pairs.sort_unstable();
        pairs.dedup();
        let corners: Vec<[f64; 2]> = points.iter().map(|p| p.map(f64::from)).collect();
        let plan = Triangulation::build(&corners, &pairs)?;
        if plan.points.iter().flatten().all(|c| c.fract() == 0.0) {
            return Ok(plan);
        }
        let whole = |point: u32| plan.points[point as usize].map(|c| c.round() as i32);
        segments.clear();
        for triangle in 0..plan.triangles.len() {
            for edge in (0..3).filter(|&edge| plan.is_constraint[triangle][edge]) {
                let [a, b] = plan.edge(triangle, edge).map(whole);
                if a != b && (a < b || plan.neighbours[triangle][edge].is_none()) {
                    segments.push([a, b]);
                }
            }
        }
    }
    let [x, y] = segments.first().map_or([0.0; 2], |[a, _]| a.map(f64::from));
    Err(TriangulateError { x, y, reason: format!("crossings did not settle in {MAX_ROUNDS} rounds") })
}

/// Finds the topmost piece at a point.
struct Tops<'a> {
    pieces: &'a [Piece],
    boxes: Vec<[[f64; 2]; 2]>,
}

impl<'a> Tops<'a> {
    fn new(pieces: &'a [Piece]) -> Self {
        Self { pieces, boxes: pieces.iter().map(|p| bounds(&p.polygon).map(|corner| corner.map(f64::from))).collect() }
    }

    fn air_at(&self, p: [f64; 2]) -> Option<(i32, i32)> {
        let near = |&n: &usize| {
            let [low, high] = self.boxes[n];
            p[0] >= low[0] && p[0] <= high[0] && p[1] >= low[1] && p[1] <= high[1]
        };
        let top = (0..self.pieces.len()).rev().filter(near).find(|&n| contains(&self.pieces[n].polygon, p))?;
        self.pieces[top].air
    }
}

/// A player start in the largest triangle, so that the map can be played.
fn player_start(plan: &Triangulation, air: &[Option<(i32, i32)>]) -> Vec<Thing> {
    let open = (0..plan.triangles.len()).filter(|&t| air[t].is_some());
    let Some(best) = open.max_by(|&a, &b| plan.area(a).total_cmp(&plan.area(b))) else { return Vec::new() };
    let [x, y] = plan.centroid(best).map(|c| c.round() as i32);
    vec![Thing { x, y, angle: 90, kind: 1, flags: 7 }]
}
