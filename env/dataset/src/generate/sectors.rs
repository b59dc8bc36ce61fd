//! The boolean union of the pieces as sectors and linedefs.

use super::draft::Piece;
use super::raster::{bounds, contains, edges};
use crate::doom_map::{DoomMap, LineDef, Name, Sector, SideDef, Thing, Vertex};
use crate::triangulate::{TriangulateError, Triangulation};
use std::collections::BTreeMap;

const TWO_SIDED: u16 = 4;
const IMPASSABLE: u16 = 1;
/// Textures that every Doom 2 IWAD and Freedoom have.
const WALL: Name = Name::of("STONE2");
const FLOOR: Name = Name::of("FLOOR4_8");
const CEILING: Name = Name::of("CEIL3_5");
const LIGHT: u16 = 160;

/// Cuts the pieces against each other and names the sectors. Every triangle belongs to the topmost piece that contains
/// its middle, and linedefs run where the air changes, so the sectors are closed by construction.
///
/// # Errors
/// When the crossings of the outlines do not settle on whole map units.
pub(crate) fn to_map(name: &str, pieces: &[Piece]) -> Result<DoomMap, TriangulateError> {
    let outlines: Vec<_> = pieces.iter().flat_map(|piece| edges(&piece.polygon)).collect();
    // Crossings are rounded to whole units: a WAD holds no others.
    let plan = Triangulation::build(&outlines, 1)?;
    let tops = Tops::new(pieces);
    let air: Vec<Option<(i32, i32)>> = (0..plan.triangles.len()).map(|t| tops.air_at(plan.centroid(t))).collect();
    let mut sectors: BTreeMap<(i32, i32), u32> = air.iter().flatten().map(|&heights| (heights, 0)).collect();
    sectors.values_mut().enumerate().for_each(|(number, sector)| *sector = number as u32);
    let sector_of = |triangle: usize| air[triangle].and_then(|heights| sectors.get(&heights).copied());
    let mut map = DoomMap { name: name.into(), ..DoomMap::default() };
    let flats = Sector { floor_flat: FLOOR, ceiling_flat: CEILING, light: LIGHT, ..Sector::default() };
    map.sectors = sectors.keys().map(|&(floor, ceiling)| Sector { floor, ceiling, ..flats }).collect();
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
            let middle = if right.is_some() { Name::NONE } else { WALL };
            let mut side = |sector| {
                map.sidedefs.push(SideDef { sector, offset: [0; 2], upper: WALL, lower: WALL, middle });
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
