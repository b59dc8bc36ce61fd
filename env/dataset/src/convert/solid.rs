//! Floors, ceilings and walls of the free space.
//!
//! Every triangle of the plan is a prism of air from floor to ceiling. Walls are where the air of two neighbours differs,
//! not where linedefs are, so the mesh is closed whatever the map's author did. Wall corners are cut at every height that
//! meets there: neighbouring faces share whole edges, and no ray slips through a T-junction.

use crate::doom_map::CAMERA_UNITS;
use crate::triangulate::Triangulation;
use std::collections::BTreeMap;

/// Air above a triangle: floor and ceiling, map units.
pub(crate) type Air = Option<(i32, i32)>;

/// The part of the air that becomes the scene.
#[derive(Debug, Clone)]
pub(crate) struct Kept {
    /// Air of each triangle of the plan; `None` outside of the largest connected part.
    pub(crate) air: Vec<Air>,
    /// Floor area of all parts, square map units.
    pub(crate) all_area: f64,
    /// Floor area of the part that is kept.
    pub(crate) area: f64,
    /// Floor height with the largest area.
    pub(crate) modal_floor: i32,
    /// Area that is connected in the camera plane.
    pub(crate) plane_area: f64,
}

/// Keeps the largest connected part of the air; `None` when there is no air.
pub(crate) fn keep_largest(plan: &Triangulation, air: &[Air]) -> Option<Kept> {
    let meets = |a: Air, b: Air| matches!((a, b), (Some(a), Some(b)) if a.1.min(b.1) > a.0.max(b.0));
    let (part, count) = plan.flood(|t| air[t].is_some(), |t, _, n| meets(air[t], air[n]));
    let (largest, areas) = largest_part(plan, &part, count)?;
    let air: Vec<Air> = air.iter().zip(&part).map(|(&a, &p)| a.filter(|_| p == Some(largest))).collect();
    let mut floors: BTreeMap<i32, f64> = BTreeMap::new();
    for (triangle, (floor, _)) in air.iter().enumerate().filter_map(|(t, a)| Some((t, (*a)?))) {
        *floors.entry(floor).or_default() += plan.area(triangle);
    }
    let (&modal_floor, _) = floors.iter().rev().max_by(|a, b| a.1.total_cmp(b.1))?;
    let plane = f64::from(modal_floor) + CAMERA_UNITS;
    let open = |t: usize| air[t].is_some_and(|(floor, ceiling)| f64::from(floor) < plane && plane < f64::from(ceiling));
    let (part, count) = plan.flood(open, |_, _, _| true);
    let plane_area = largest_part(plan, &part, count).map_or(0.0, |(best, areas)| areas[best as usize]);
    Some(Kept { all_area: areas.iter().sum(), area: areas[largest as usize], modal_floor, plane_area, air })
}

/// The part with the largest area, and the areas of all.
fn largest_part(plan: &Triangulation, part: &[Option<u32>], count: u32) -> Option<(u32, Vec<f64>)> {
    let mut areas = vec![0.0; count as usize];
    for (triangle, part) in part.iter().enumerate() {
        if let Some(part) = part {
            areas[*part as usize] += plan.area(triangle);
        }
    }
    let best = (0..count).rev().max_by(|&a, &b| areas[a as usize].total_cmp(&areas[b as usize]))?;
    Some((best, areas))
}

/// Faces in map units, corners `[x, y, height]`, counter-clockwise seen from the air.
#[derive(Debug, Clone, Default)]
pub(crate) struct Faces {
    pub(crate) vertices: Vec<[f64; 3]>,
    pub(crate) triangles: Vec<[u32; 3]>,
    /// What each triangle is a part of.
    pub(crate) surfaces: Vec<Surface>,
}

/// A surface of the air above one triangle of the plan.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Surface {
    Floor(u32),
    Ceiling(u32),
    Wall { triangle: u32, edge: u8, part: Part },
}

/// Part of a wall.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Part {
    /// From floor to ceiling, nothing beyond.
    Whole,
    /// Up to the floor beyond.
    Lower,
    /// Down to the ceiling beyond.
    Upper,
}

/// Most triangles of a mesh; the largest real maps have a hundred thousand. Where many floors of different heights meet at
/// one corner, all walls there are cut at all of them.
pub(crate) const MAX_FACES: usize = 500_000;

/// Floors, ceilings and walls of the kept air; `None` when they have more than [`MAX_FACES`] triangles.
pub(crate) fn faces(plan: &Triangulation, air: &[Air]) -> Option<Faces> {
    let mut faces = Faces::default();
    let columns = Columns::new(plan, air, &mut faces.vertices);
    for (triangle, (floor, ceiling)) in air.iter().enumerate().filter_map(|(t, a)| Some((t, (*a)?))) {
        let (corners, number) = (plan.triangles[triangle], triangle as u32);
        let [a, b, c] = corners.map(|v| columns.vertex(v, floor));
        faces.add(Surface::Floor(number), |triangles| triangles.push([a, b, c]));
        let [a, b, c] = corners.map(|v| columns.vertex(v, ceiling));
        faces.add(Surface::Ceiling(number), |triangles| triangles.push([a, c, b]));
        for edge in 0..3 {
            let other = plan.neighbours[triangle][edge].and_then(|n| air[n as usize]);
            let ends = plan.edge(triangle, edge);
            let mut wall = |part, low, high| {
                let surface = Surface::Wall { triangle: number, edge: edge as u8, part };
                faces.add(surface, |triangles| columns.wall(ends, low, high, triangles));
            };
            // This side's part of the difference; the neighbour adds its own.
            match other {
                None => wall(Part::Whole, floor, ceiling),
                Some((low, high)) => {
                    wall(Part::Lower, floor, ceiling.min(low));
                    wall(Part::Upper, floor.max(high), ceiling);
                }
            }
        }
        if faces.triangles.len() > MAX_FACES {
            return None;
        }
    }
    Some(faces)
}

impl Faces {
    fn add(&mut self, surface: Surface, push: impl FnOnce(&mut Vec<[u32; 3]>)) {
        push(&mut self.triangles);
        self.surfaces.resize(self.triangles.len(), surface);
    }
}

/// The heights that meet above each point of the plan, as mesh vertices.
struct Columns {
    /// First mesh vertex of each point's column; one more entry than points.
    first: Vec<u32>,
    heights: Vec<i32>,
}

impl Columns {
    fn new(plan: &Triangulation, air: &[Air], vertices: &mut Vec<[f64; 3]>) -> Self {
        let mut at = vec![Vec::new(); plan.points.len()];
        for (corners, air) in plan.triangles.iter().zip(air) {
            if let Some((floor, ceiling)) = *air {
                corners.iter().for_each(|&v| at[v as usize].extend([floor, ceiling]));
            }
        }
        let mut columns = Self { first: vec![0], heights: Vec::new() };
        for (heights, &[x, y]) in at.iter_mut().zip(&plan.points) {
            heights.sort_unstable();
            heights.dedup();
            vertices.extend(heights.iter().map(|&h| [x, y, f64::from(h)]));
            columns.heights.append(heights);
            columns.first.push(columns.heights.len() as u32);
        }
        columns
    }

    fn range(&self, point: u32) -> std::ops::Range<usize> {
        self.first[point as usize] as usize..self.first[point as usize + 1] as usize
    }

    fn vertex(&self, point: u32, height: i32) -> u32 {
        let range = self.range(point);
        let offset = self.heights[range.clone()].partition_point(|&h| h < height);
        (range.start + offset) as u32
    }

    /// The wall above an edge `[a, b]` of a triangle, seen from that triangle (to its left), from `low` to `high`.
    fn wall(&self, [a, b]: [u32; 2], low: i32, high: i32, triangles: &mut Vec<[u32; 3]>) {
        if low >= high {
            return;
        }
        let [mut left, mut right] = [a, b].map(|point| self.vertex(point, low));
        let [left_end, right_end] = [a, b].map(|point| self.vertex(point, high));
        let height = |vertex: u32| self.heights[vertex as usize];
        while left < left_end || right < right_end {
            // Climb on the side whose next corner is lower.
            if right == right_end || (left < left_end && height(left + 1) <= height(right + 1)) {
                triangles.push([left, left + 1, right]);
                left += 1;
            } else {
                triangles.push([left, right + 1, right]);
                right += 1;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_between_two_cells_makes_a_closed_mesh() {
        let outline = [[0, 0], [100, 0], [200, 0], [200, 100], [100, 100], [0, 100], [0, 0]];
        let mut segments: Vec<_> = outline.windows(2).map(|pair| [pair[0], pair[1]]).collect();
        segments.push([[100, 0], [100, 100]]);
        let plan = Triangulation::build(&segments, 1).unwrap();
        let air: Vec<Air> = (0..plan.triangles.len())
            .map(|t| Some(if plan.centroid(t)[0] < 100.0 { (0, 96) } else { (24, 128) }))
            .collect();
        let kept = keep_largest(&plan, &air).unwrap();
        assert_eq!((kept.area, kept.modal_floor, kept.plane_area), (20_000.0, 0, 20_000.0));
        let mesh = faces(&plan, &kept.air).unwrap();
        let mut edges: BTreeMap<(u32, u32), i32> = BTreeMap::new();
        for &[a, b, c] in &mesh.triangles {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                *edges.entry((from.min(to), from.max(to))).or_default() += if from < to { 1 } else { -1 };
            }
        }
        assert!(edges.values().all(|&balance| balance == 0));
        assert!((volume(&mesh) - 100.0 * 100.0 * (96.0 + 104.0)).abs() < 1e-6, "{}", volume(&mesh));
    }

    /// Volume of the air, by the divergence theorem with normals into the air.
    fn volume(mesh: &Faces) -> f64 {
        let sum: f64 = mesh
            .triangles
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(|v| mesh.vertices[v as usize]);
                a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0])
                    + a[2] * (b[0] * c[1] - b[1] * c[0])
            })
            .sum();
        -sum / 6.0
    }
}
