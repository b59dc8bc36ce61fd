//! How much of a scene's surface can be seen at all: the most that any policy can cover.

use glam::Vec3;
use nbp_env::coverage::{Coverage, Surface};
use nbp_env::pose::{Heading, LatticePose};
use nbp_env::sensor::{DepthCamera, Frame, Sensor as _};
use nbp_env::{Scene, SimConfig};

/// One column in four and one row in five of each image becomes points: one pixel in twenty, as in an episode.
const STRIDE: [usize; 2] = [4, 5];

/// Share of the ground-truth points that are covered by what the camera of the evaluation sees from every reachable
/// position under all eight headings, with the evaluation's range and tolerance.
pub fn visible_share(scene: &Scene) -> f64 {
    let config = SimConfig::default();
    let surface = Surface::of(scene, &config.coverage);
    let mut coverage = Coverage::new(&surface);
    let (sensor, mut frame) = (DepthCamera(config.camera), Frame::default());
    let mut points: Vec<Vec3> = Vec::new();
    let nodes = scene.graph().largest_component();
    for (number, pose) in nodes.iter().flat_map(|&node| Heading::all().map(move |h| (node, h))).enumerate() {
        let pose = scene.lattice().pose(LatticePose { node: pose.0, heading: pose.1 });
        sensor.capture(scene, &pose, &mut frame);
        points.clear();
        // The grid of pixels moves from image to image.
        let [first_col, first_row] = [number % STRIDE[0], number % STRIDE[1]];
        for row in (first_row..frame.height).step_by(STRIDE[1]) {
            for col in (first_col..frame.width).step_by(STRIDE[0]) {
                points.extend(frame.at(col, row).map(|depth| config.camera.at(&pose).unproject(col, row, depth)));
            }
        }
        coverage.add(&surface, &points, number as u32);
    }
    f64::from(coverage.share())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_rooms_can_be_seen() {
        // What stays unseen lies along the tops of the door and in front of the nearest walls.
        let share = visible_share(&Scene::two_rooms());
        assert!(share > 0.98, "{share}");
    }
}
