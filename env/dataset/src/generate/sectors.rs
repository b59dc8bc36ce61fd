//! The boolean union of the spaces, with their details, as sectors and linedefs.

use super::draft::{Change, Draft, Host};
use super::outline::{Polygon, bounds, contains, edges};
use super::theme::Air;
use crate::doom_map::{DoomMap, LineDef, Name, Sector, SideDef, Thing, Vertex};
use crate::triangulate::{TriangulateError, Triangulation};
use std::collections::BTreeMap;

const TWO_SIDED: u16 = 4;
const IMPASSABLE: u16 = 1;

/// Width of the strips in which polygons are looked up, map units.
const STRIP: i32 = 256;

/// Offsets of textures are multiples of a unit modulo this, which all widths of wall textures divide.
const OFFSET_PERIOD: f64 = 256.0;

/// What is at a place of the plan.
#[derive(Clone, Copy, Debug, Default)]
struct Place {
    air: Option<Air>,
    /// Texture of the solid's own, where it has one.
    face: Option<Name>,
}

/// A line between two places, with the smaller sector to its right.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Edge {
    ends: [u32; 2],
    right: Air,
    left: Option<Air>,
    face: Option<Name>,
}

/// Cuts the outlines against each other and names the sectors. All of a region between outlines has one air, and linedefs
/// run where the air changes, so the sectors are closed by construction.
///
/// # Errors
/// When the crossings of the outlines do not settle on whole map units.
pub(crate) fn to_map(name: &str, draft: &Draft) -> Result<DoomMap, TriangulateError> {
    let layers = Layers::new(draft);
    let outlines: Vec<_> = layers.polygons.iter().flat_map(|polygon| edges(polygon)).collect();
    // Crossings are rounded to whole units: a WAD holds no others.
    let plan = Triangulation::build(&outlines, 1)?;
    let places = places(&plan, &layers);
    let mut sectors: BTreeMap<Air, u32> = places.iter().filter_map(|place| Some((place.air?, 0))).collect();
    sectors.values_mut().enumerate().for_each(|(number, sector)| *sector = number as u32);
    let mut map = DoomMap { name: name.into(), ..DoomMap::default() };
    map.sectors = sectors.keys().map(sector).collect();
    let edges = whole_edges(&plan, border_edges(&plan, &places));
    let mut numbers: BTreeMap<u32, u32> = BTreeMap::new();
    for edge in edges {
        let corners = edge.ends.map(|point| plan.points[point as usize].map(|c| c.round() as i32));
        let [from, to] = [0, 1].map(|end| {
            *numbers.entry(edge.ends[end]).or_insert_with(|| {
                let [x, y] = corners[end];
                map.vertices.push(Vertex { x, y });
                map.vertices.len() as u32 - 1
            })
        });
        let mut side = |here: Air, there: Option<Air>, from: [i32; 2], to: [i32; 2]| {
            let sector = sectors.get(&here).copied().unwrap_or(0);
            let offset = [offset_along(from, to), 0];
            map.sidedefs.push(SideDef { sector, offset, ..textures(&here, there.as_ref(), edge.face) });
            map.sidedefs.len() as u32 - 1
        };
        let front = Some(side(edge.right, edge.left, corners[0], corners[1]));
        let back = edge.left.map(|left| side(left, Some(edge.right), corners[1], corners[0]));
        let flags = if back.is_some() { TWO_SIDED } else { IMPASSABLE };
        map.linedefs.push(LineDef { from, to, flags, special: 0, tag: 0, front, back });
    }
    map.things = player_start(&plan, &places);
    Ok(map)
}

fn sector(air: &Air) -> Sector {
    Sector {
        floor: air.floor.height,
        ceiling: air.ceiling.height,
        floor_flat: air.floor.flat,
        ceiling_flat: air.ceiling.flat,
        light: air.light,
        ..Sector::default()
    }
}

/// Textures of a side: only those that are seen.
fn textures(here: &Air, there: Option<&Air>, face: Option<Name>) -> SideDef {
    let mut side = SideDef { upper: Name::NONE, lower: Name::NONE, middle: Name::NONE, ..SideDef::default() };
    match there {
        None => side.middle = face.unwrap_or(here.wall),
        Some(there) => {
            if there.floor.height > here.floor.height {
                side.lower = there.floor.edge;
            }
            if there.ceiling.height < here.ceiling.height {
                side.upper = there.ceiling.edge;
            }
        }
    }
    side
}

/// Textures keep their place in the world, so they go on from line to line.
fn offset_along(from: [i32; 2], to: [i32; 2]) -> i16 {
    let [dx, dy] = [0, 1].map(|axis| f64::from(to[axis] - from[axis]));
    let length = dx.hypot(dy).max(1.0);
    ((f64::from(from[0]) * dx + f64::from(from[1]) * dy) / length).round().rem_euclid(OFFSET_PERIOD) as i16
}

/// The edges of the triangles at which the place changes.
fn border_edges(plan: &Triangulation, places: &[Place]) -> Vec<Edge> {
    let mut found = Vec::new();
    for (triangle, here) in places.iter().enumerate() {
        for edge in 0..3 {
            let there = plan.neighbours[triangle][edge].map(|n| places[n as usize]).unwrap_or_default();
            // Each line once: from the smaller air, or the only one.
            let Some(right) = here.air.filter(|&air| there.air.is_none_or(|other| air < other)) else { continue };
            // The triangle lies to the left of its edge, and a front side to the right of its line.
            let [to, from] = plan.edge(triangle, edge);
            found.push(Edge { ends: [from, to], right, left: there.air, face: there.face });
        }
    }
    found
}

/// Joins edges that go on in a straight line between the same places: outlines that nothing is left of had cut them.
fn whole_edges(plan: &Triangulation, pieces: Vec<Edge>) -> Vec<Edge> {
    let mut at: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
    for (number, piece) in pieces.iter().enumerate() {
        piece.ends.iter().for_each(|&end| at.entry(end).or_default().push(number));
    }
    let point = |n: u32| plan.points[n as usize];
    let goes_on = |first: &Edge, second: &Edge| {
        let [a, b, c] = [first.ends[0], first.ends[1], second.ends[1]].map(point);
        let turn = (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0]);
        turn == 0.0 && Edge { ends: second.ends, ..*first } == *second
    };
    // The piece that follows at the far end, if only these two meet there.
    let next = |piece: &Edge| match at.get(&piece.ends[1]).map(Vec::as_slice) {
        Some(&[a, b]) => [a, b].into_iter().find(|&n| pieces[n].ends[0] == piece.ends[1] && goes_on(piece, &pieces[n])),
        _ => None,
    };
    let follows: Vec<Option<usize>> = pieces.iter().map(next).collect();
    let mut is_first = vec![true; pieces.len()];
    follows.iter().flatten().for_each(|&n| is_first[n] = false);
    let mut whole = Vec::new();
    for (number, piece) in pieces.iter().enumerate().filter(|&(number, _)| is_first[number]) {
        let mut last = number;
        while let Some(following) = follows[last] {
            last = following;
        }
        whole.push(Edge { ends: [piece.ends[0], pieces[last].ends[1]], ..*piece });
    }
    whole
}

/// What is at each triangle, region by region.
fn places(plan: &Triangulation, layers: &Layers<'_>) -> Vec<Place> {
    let (region_of, count) = plan.flood(|_| true, |t, e, _| plan.segments_on(t, e).is_empty());
    // A region is looked up in the middle of its largest triangle.
    let mut largest = vec![(0.0, 0); count as usize];
    for (triangle, region) in region_of.iter().enumerate() {
        let Some(region) = region else { continue };
        let (area, best) = &mut largest[*region as usize];
        if plan.area(triangle) > *area {
            (*area, *best) = (plan.area(triangle), triangle);
        }
    }
    let found: Vec<Place> = largest.iter().map(|&(_, triangle)| layers.at(plan.centroid(triangle))).collect();
    region_of.iter().map(|region| region.map_or_else(Place::default, |region| found[region as usize])).collect()
}

/// All polygons from the lowest to the highest: niches, passages, rooms, details.
struct Layers<'a> {
    draft: &'a Draft,
    polygons: Vec<&'a Polygon>,
    boxes: Vec<[[f64; 2]; 2]>,
    /// For each strip of the plan the polygons that may lie in it, the highest first.
    strips: Vec<Vec<usize>>,
}

impl<'a> Layers<'a> {
    fn new(draft: &'a Draft) -> Self {
        let niches = draft.niches.iter().map(|space| &space.polygon);
        let passages = draft.passages.iter().map(|space| &space.polygon);
        let rooms = draft.site.rooms.iter().map(|room| &room.polygon);
        let details = draft.details.iter().map(|detail| &detail.polygon);
        let polygons: Vec<&Polygon> = niches.chain(passages).chain(rooms).chain(details).collect();
        let corners: Vec<_> = polygons.iter().map(|polygon| bounds(polygon)).collect();
        let count = (draft.raster.size()[0] / STRIP + 1).max(1) as usize;
        let mut strips = vec![Vec::new(); count];
        for (number, [low, high]) in corners.iter().enumerate().rev() {
            let [first, last] = [low[0], high[0]].map(|x| x.div_euclid(STRIP).clamp(0, count as i32 - 1) as usize);
            strips[first..=last].iter_mut().for_each(|strip| strip.push(number));
        }
        let boxes = corners.iter().map(|corners| corners.map(|corner| corner.map(f64::from))).collect();
        Self { draft, polygons, boxes, strips }
    }

    fn at(&self, p: [f64; 2]) -> Place {
        let strip = (p[0] / f64::from(STRIP)).clamp(0.0, (self.strips.len() - 1) as f64) as usize;
        let is_near = |&&n: &&usize| {
            let [low, high] = self.boxes[n];
            p[0] >= low[0] && p[0] <= high[0] && p[1] >= low[1] && p[1] <= high[1]
        };
        let mut found = self.strips[strip].iter().filter(is_near).filter(|&&n| contains(self.polygons[n], p)).copied();
        let Draft { niches, passages, site, details, .. } = self.draft;
        let spaces = niches.len() + passages.len() + site.rooms.len();
        let mut changes: Vec<usize> = Vec::new();
        let Some(top) = found.find(|&n| {
            changes.extend(n.checked_sub(spaces));
            n < spaces
        }) else {
            return Place::default();
        };
        let (mut air, host) = match top.checked_sub(niches.len()) {
            None => (niches[top].air, None),
            Some(n) if n < passages.len() => (passages[n].air, Some(Host::Passage(n))),
            Some(n) => (site.rooms[n - passages.len()].air, Some(Host::Room(n - passages.len()))),
        };
        for detail in changes.iter().rev().map(|&n| &details[n]).filter(|detail| Some(detail.host) == host) {
            match detail.change {
                Change::Solid(face) => return Place { air: None, face: Some(face) },
                Change::Floor(floor) => air.floor = floor,
                Change::Ceiling(ceiling, light) => {
                    (air.ceiling, air.light) = (ceiling, air.light.saturating_add_signed(light).min(255));
                }
            }
        }
        if air.floor.height >= air.ceiling.height {
            return Place { air: None, face: Some(air.floor.edge) };
        }
        Place { air: Some(air), face: None }
    }
}

/// A player start in the largest triangle, so that the map can be played.
fn player_start(plan: &Triangulation, places: &[Place]) -> Vec<Thing> {
    let open = (0..plan.triangles.len()).filter(|&t| places[t].air.is_some());
    let Some(best) = open.max_by(|&a, &b| plan.area(a).total_cmp(&plan.area(b))) else { return Vec::new() };
    let [x, y] = plan.centroid(best).map(|c| c.round() as i32);
    vec![Thing { x, y, angle: 90, kind: 1, flags: 7 }]
}
