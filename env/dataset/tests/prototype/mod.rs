//! The measure of the independent prototype that made the manifest of the Obsidian maps, found by trying rasters and phases
//! until its figures came out to the last decimal.
//!
//! It draws walls at the camera plane on cells of 10 map units (0.2 m), the first 16 units below the smallest vertex
//! coordinates, as Bresenham lines. A position is every 7.5th cell, rounded down, so that neighbours are 1.4 or 1.6 m apart
//! while a step counts 1.5 m. The largest ratio often belongs to two neighbours with a wall between them: it then differs by
//! 7 % from that of an exact lattice at the same place, and by far more from that of a shifted one.

use glam::Vec2;
use nbp_dataset::convert::open_heights;
use nbp_dataset::doom_map::{CAMERA_UNITS, UNITS_PER_METRE};
use nbp_dataset::navigation::Navigation;
use nbp_dataset::{DoomMap, SceneBundle};
use nbp_env::scene::slice::slice_at;

const CELL: f64 = 10.0;
const PAD: f64 = 16.0;
const CELLS_A_STEP: f64 = 7.5;
const STEP: f64 = 1.5;

/// Area connected at the camera plane, m², and navigation complexity over all pairs.
pub(crate) struct Measured {
    pub(crate) area: f64,
    pub(crate) complexity: f64,
}

pub(crate) fn measure(map: &DoomMap, scene: &SceneBundle) -> Measured {
    let mut raster = Raster::inside(map, scene);
    raster.draw_walls(map, f64::from(scene.report.modal_floor) + CAMERA_UNITS);
    raster.keep_largest();
    let cells = raster.free.iter().filter(|&&free| free).count();
    Measured { area: cells as f64 * (CELL / UNITS_PER_METRE).powi(2), complexity: raster.complexity() }
}

struct Raster {
    low: [f64; 2],
    size: [usize; 2],
    free: Vec<bool>,
}

impl Raster {
    /// Cells whose middle lies in free space: an odd number of walls to one side of it.
    fn inside(map: &DoomMap, scene: &SceneBundle) -> Self {
        let bound = |pick: fn(f64, f64) -> f64| {
            let axis = |of: fn(&nbp_dataset::doom_map::Vertex) -> i32| {
                map.vertices.iter().map(|v| f64::from(of(v))).reduce(pick).unwrap()
            };
            [axis(|v| v.x), axis(|v| v.y)]
        };
        let low = bound(f64::min).map(|c| c - PAD);
        let high = bound(f64::max);
        let size = [0, 1].map(|axis| ((high[axis] - low[axis]) / CELL) as usize + 4);
        let mut raster = Self { low, size, free: vec![false; size[0] * size[1]] };
        let to_map = |p: Vec2| {
            [f64::from(scene.report.origin[0]) - UNITS_PER_METRE * f64::from(p.x), {
                f64::from(scene.report.origin[1]) + UNITS_PER_METRE * f64::from(p.y)
            }]
        };
        for wall in slice_at(&scene.mesh, scene.lattice().origin.y) {
            let [mut a, mut b] = wall.map(|p| raster.cell(to_map(p)));
            if a[1] > b[1] {
                std::mem::swap(&mut a, &mut b);
            }
            // A hair above the middles, which walls on whole units may touch.
            let row_above = |y: f64| (y - 1e-4).ceil().max(0.0) as usize;
            for row in row_above(a[1])..row_above(b[1]).min(size[1]) {
                let x = a[0] + (b[0] - a[0]) * (row as f64 + 1e-4 - a[1]) / (b[1] - a[1]);
                let first = (x.ceil().max(0.0) as usize).min(size[0]);
                raster.free[row * size[0]..][first..size[0]].iter_mut().for_each(|free| *free = !*free);
            }
        }
        raster
    }

    /// Coordinates in cells: whole numbers at their middles.
    fn cell(&self, p: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|axis| (p[axis] - self.low[axis]) / CELL)
    }

    /// Blocks the cells under every line that the camera plane does not pass.
    fn draw_walls(&mut self, map: &DoomMap, plane: f64) {
        let open = open_heights(map);
        let passes = |side: Option<u32>| {
            map.sector_of(side).is_some_and(|sector| {
                let (floor, ceiling) = open.heights[sector as usize];
                (f64::from(floor)..f64::from(ceiling)).contains(&plane)
            })
        };
        for line in map.linedefs.iter().filter(|line| !passes(line.front) || !passes(line.back)) {
            let ends = [line.from, line.to].map(|end| {
                let vertex = &map.vertices[end as usize];
                self.cell([f64::from(vertex.x), f64::from(vertex.y)]).map(|c| c.round_ties_even() as i64)
            });
            for [x, y] in bresenham(ends) {
                if (0..self.size[0] as i64).contains(&x) && (0..self.size[1] as i64).contains(&y) {
                    self.free[y as usize * self.size[0] + x as usize] = false;
                }
            }
        }
    }

    fn keep_largest(&mut self) {
        let mut part = vec![0_usize; self.free.len()];
        let (mut largest, mut parts) = ((0, 0), 0);
        for start in 0..self.free.len() {
            if !self.free[start] || part[start] > 0 {
                continue;
            }
            parts += 1;
            part[start] = parts;
            let (mut stack, mut count) = (vec![start], 0);
            while let Some(at) = stack.pop() {
                count += 1;
                // The raster has a rim that is never free.
                for next in [at + 1, at - 1, at + self.size[0], at - self.size[0]] {
                    if self.free[next] && part[next] == 0 {
                        part[next] = parts;
                        stack.push(next);
                    }
                }
            }
            largest = largest.max((count, parts));
        }
        self.free.iter_mut().zip(part).for_each(|(free, part)| *free = part == largest.1);
    }

    fn complexity(&self) -> f64 {
        let nodes_along = |axis: usize| (self.size[axis] as f64 / CELLS_A_STEP).ceil() as i32;
        let cell = |node: [i32; 2]| node.map(|n| (f64::from(n) * CELLS_A_STEP) as usize);
        let is_free = |[x, y]: [usize; 2]| x < self.size[0] && y < self.size[1] && self.free[y * self.size[0] + x];
        let all = (0..nodes_along(0)).flat_map(|i| (0..nodes_along(1)).map(move |k| [i, k]));
        let navigation = Navigation::new(all.filter(|&node| is_free(cell(node))).collect(), |a, b| {
            let [[ax, ay], [bx, by]] = [cell(a), cell(b)];
            (ax.min(bx)..=ax.max(bx)).all(|x| (ay.min(by)..=ay.max(by)).all(|y| is_free([x, y])))
        });
        let (distances, nodes) = (navigation.distances(), navigation.nodes());
        let count = nodes.len() as u32;
        let reached = |from: u32| (0..count).filter(|&to| distances.between(from, to).is_some()).count();
        let hub = (0..count).max_by_key(|&from| reached(from)).unwrap();
        let mut largest = 1.0_f64;
        for a in (0..count).filter(|&a| distances.between(hub, a).is_some()) {
            for b in 0..a {
                let Some(steps) = distances.between(a, b) else { continue };
                let [p, q] = [a, b].map(|n| cell(nodes[n as usize]).map(|c| c as f64));
                let straight = (p[0] - q[0]).hypot(p[1] - q[1]) * CELL / UNITS_PER_METRE;
                largest = largest.max(f64::from(steps) * STEP / straight);
            }
        }
        largest
    }
}

fn bresenham([[mut x, mut y], [to_x, to_y]]: [[i64; 2]; 2]) -> Vec<[i64; 2]> {
    let (dx, dy) = ((to_x - x).abs(), -(to_y - y).abs());
    let mut error = dx + dy;
    let mut cells = vec![[x, y]];
    while [x, y] != [to_x, to_y] {
        let twice = 2 * error;
        if twice >= dy {
            error += dy;
            x += (to_x - x).signum();
        }
        if twice <= dx {
            error += dx;
            y += (to_y - y).signum();
        }
        cells.push([x, y]);
    }
    cells
}
