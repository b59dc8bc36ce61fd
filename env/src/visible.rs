//! How much of a scene's surface can be seen at all: the most that any policy can cover, and a second denominator for
//! those who want one.

use crate::config::SimConfig;
use crate::coverage::{Coverage, Surface};
use crate::pose::{Heading, LatticePose};
use crate::scene::Scene;
use crate::sensor::{Camera, DepthCamera, Frame, Sensor as _};
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
            points.clear();
            points.extend(frame.points(camera.at(&pose)));
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
