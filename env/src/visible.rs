//! How much of a scene's surface can be seen at all: the most that any policy can cover, and a second denominator for
//! those who want one.

use crate::config::SimConfig;
use crate::coverage::{Coverage, Surface};
use crate::pose::{Heading, LatticePose, Pose};
use crate::scene::Scene;
use crate::sensor::{Camera, DepthCamera, Frame, PosedCamera, Sensor as _};
use glam::Vec3;
use rayon::prelude::*;

/// The ground-truth points, by number and ascending, that are covered when the camera has looked from every node of the
/// largest connected component under all eight headings, with every pixel kept. The number of threads does not matter.
///
/// Frames between two nodes may cover a few more.
pub fn visible_points(scene: &Scene, surface: &Surface, camera: Camera) -> Vec<u32> {
    let nothing = || (Coverage::new(surface), Frame::default(), Vec::new());
    let look = |(mut coverage, mut frame, mut points): (Coverage, Frame, Vec<Vec3>), &node| {
        for heading in Heading::all() {
            let pose = scene.lattice().pose(LatticePose { node, heading });
            DepthCamera(camera).capture(scene, &pose, &mut frame);
            let is_open = |seen| !coverage.is_done_within(surface, seen, MAX_CELLS);
            find_open(&frame, camera.at(&pose), &pose, is_open, &mut points);
            coverage.add(surface, &points, 0);
        }
        (coverage, frame, points)
    };
    // Each thread forgets what it has seen before; which thread saw a point does not matter.
    let seen = scene.graph().largest_component().par_iter().fold(nothing, look);
    let either = |mut a: Vec<bool>, b: Vec<bool>| {
        a.iter_mut().zip(b).for_each(|(a, b)| *a |= b);
        a
    };
    let seen = seen
        .map(|(coverage, ..)| (0..surface.len()).map(|point| coverage.first_step(point).is_some()).collect())
        .reduce(|| vec![false; surface.len()], either);
    (0_u32..).zip(seen).filter_map(|(point, is_seen)| is_seen.then_some(point)).collect()
}

/// Side of the squares of pixels that are left out together once nothing new can be there.
const TILE: usize = 8;

/// Boxes of more cells cost more than they save.
const MAX_CELLS: usize = 512;

/// Leaves in `points` those of a frame that lie in squares of pixels whose box is open: late in the search, few.
fn find_open(
    frame: &Frame,
    eye: PosedCamera,
    pose: &Pose,
    mut is_open: impl FnMut([Vec3; 2]) -> bool,
    points: &mut Vec<Vec3>,
) {
    points.clear();
    let width = frame.width;
    let (mut near, mut far) = (vec![0.0_f32; width], vec![0.0_f32; width]);
    for (band, lines) in frame.depth.chunks((TILE * width).max(1)).enumerate() {
        near.fill(f32::INFINITY);
        far.fill(0.0);
        for line in lines.chunks_exact(width) {
            for ((near, far), &depth) in near.iter_mut().zip(&mut far).zip(line) {
                let surface = if depth > 0.0 { depth } else { f32::INFINITY };
                *near = if surface < *near { surface } else { *near };
                *far = if depth > *far { depth } else { *far };
            }
        }
        let rows = [band * TILE, band * TILE + lines.len() / width];
        for from in (0..width).step_by(TILE) {
            let cols = [from, width.min(from + TILE)];
            let near = near[from..cols[1]].iter().copied().fold(f32::INFINITY, f32::min);
            let far = far[from..cols[1]].iter().copied().fold(0.0, f32::max);
            if far > 0.0 && is_open(box_of(eye, pose, [cols, rows], [near, far])) {
                for (row, line) in (rows[0]..).zip(lines.chunks_exact(width)) {
                    let pixels = (from..).zip(&line[from..cols[1]]).filter(|&(_, &depth)| depth > 0.0);
                    points.extend(pixels.map(|(col, &depth)| eye.unproject(col, row, depth)));
                }
            }
        }
    }
}

/// Lower and upper corner of a box around all points that pixels of some columns and rows can show between two depths.
fn box_of(eye: PosedCamera, pose: &Pose, [cols, rows]: [[usize; 2]; 2], [near, far]: [f32; 2]) -> [Vec3; 2] {
    let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    // Points are linear in column, row and depth, so those of the corners are the outermost.
    for ray in cols.map(|col| rows.map(|row| eye.ray(col, row))).as_flattened() {
        for corner in [pose.position + near * ray, pose.position + far * ray] {
            (low, high) = (low.min(corner), high.max(corner));
        }
    }
    // Far more than what roundings move.
    let hair = 1e-5 * (pose.position.abs().max_element() + far);
    [low - hair, high + hair]
}

/// The share of the surface that is visible with the camera, the points and the tolerance of `config`, 0 to 1.
pub fn visible_share(scene: &Scene, config: &SimConfig) -> f64 {
    let surface = Surface::of(scene, &config.coverage);
    visible_points(scene, &surface, config.camera).len() as f64 / surface.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::World;

    #[test]
    fn what_is_visible_is_what_all_poses_see_on_any_number_of_threads() {
        let camera = Camera { width: 112, height: 64, ..Camera::default() };
        let config = SimConfig { camera, ..SimConfig::default() };
        let world = World::new(Scene::two_rooms(), &config).unwrap();
        let with_threads = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| visible_points(world.scene(), world.surface(), camera))
        };
        let points = with_threads(1);
        assert_eq!(points, with_threads(3));
        let visibility = world.visibility();
        let mut seen = visibility.nothing();
        for &node in world.scene().graph().largest_component() {
            for heading in Heading::all() {
                visibility.cover(LatticePose { node, heading }, &mut seen);
            }
        }
        assert_eq!(visibility.visible(), seen);
        assert_eq!((points.len(), visibility.points(&seen)), (seen.len(), points));
        // What stays unseen lies along the tops of the door and in front of the nearest walls.
        let share = visible_share(world.scene(), &config);
        assert!(share > 0.98 && share == seen.len() as f64 / world.surface().len() as f64, "{share}");
    }
}
