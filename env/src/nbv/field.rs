//! Points in the scene's box that remember how they were looked at.

use super::harmonics::view_bin;
use crate::pose::Pose;
use crate::seed::Rng;
use crate::sensor::{Camera, Frame};
use glam::Vec3;
use rand::RngExt as _;

/// A point counts as solid while at least this share of the frames that had it in view did not see through it.
const SOLID_SHARE: f32 = 0.95;

/// What is remembered of one point.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sight {
    /// Directions from the point to cameras that looked at it, as bits of [`view_bin`].
    pub views: u128,
    /// Frames that had it in view, in front of a surface or behind.
    pub inside: u32,
    /// Of these, how many did not see through it.
    pub behind: u32,
}

impl Sight {
    /// Whether it was in view yet.
    pub fn is_in_field(&self) -> bool {
        self.inside > 0
    }

    /// Whether it may be solid for all that was seen: what MACARONS learns from instead of the truth.
    pub fn is_solid(&self) -> bool {
        self.behind as f32 >= SOLID_SHARE * self.inside as f32
    }
}

/// Points and how they were looked at.
#[derive(Clone, Debug)]
pub struct Field {
    points: Vec<Vec3>,
    sights: Vec<Sight>,
    spacing: f32,
}

impl Field {
    /// Points that were not looked at yet, about `spacing` metres from each other.
    pub fn new(points: Vec<Vec3>, spacing: f32) -> Self {
        Self { sights: vec![Sight::default(); points.len()], points, spacing }
    }

    /// `count` points drawn in a box. Their spacing is the side of the cube that each has for itself.
    pub fn uniform([low, high]: [Vec3; 2], count: usize, rng: &mut Rng) -> Self {
        let size = (high - low).max(Vec3::ZERO);
        let points = (0..count).map(|_| low + size * Vec3::from_array([(); 3].map(|()| rng.random::<f32>())));
        Self::new(points.collect(), (size.element_product() / count.max(1) as f32).cbrt())
    }

    /// The points, metres.
    pub fn points(&self) -> &[Vec3] {
        &self.points
    }

    /// What is remembered of each.
    pub fn sights(&self) -> &[Sight] {
        &self.sights
    }

    /// How far apart they are, metres.
    pub fn spacing(&self) -> f32 {
        self.spacing
    }

    /// Takes in a frame: points that lie more than `carving` metres in front of what it shows are seen through; those at
    /// most three spacings behind it are looked at.
    pub fn observe(&mut self, camera: &Camera, pose: &Pose, frame: &Frame, carving: f32) {
        let eye = camera.at(pose);
        for (&point, sight) in self.points.iter().zip(&mut self.sights) {
            let Some([col, row, depth]) = eye.project(point) else { continue };
            let (col, row) = ((col as usize).min(frame.width - 1), (row as usize).min(frame.height - 1));
            // Where nothing was measured, nothing is within range.
            let beyond = depth - frame.at(col, row).unwrap_or(camera.range);
            sight.inside += 1;
            sight.behind += u32::from(beyond >= -carving);
            if beyond < 3.0 * self.spacing {
                sight.views |= 1 << view_bin(pose.position - point);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::{Heading, LatticePose, Node};
    use crate::scene::Scene;
    use crate::seed::SeedTree;
    use crate::sensor::{DepthCamera, Sensor};

    #[test]
    fn what_rays_say_of_a_point_is_what_the_frames_leave_of_it() {
        let scene = Scene::two_rooms();
        let camera = Camera { width: 228, height: 128, ..Camera::default() };
        let [low, high] = scene.bounds();
        let mut field = Field::uniform([low - 0.5, high + 0.5], 3000, &mut SeedTree::new(1).rng());
        assert!((field.spacing() - (13.0_f32 * 4.0 * 10.0 / 3000.0).cbrt()).abs() < 1e-4);
        let poses = [(1, 2, 0), (1, 2, 2), (3, 2, 2), (6, 4, 5)];
        let poses = poses.map(|(i, k, h)| LatticePose { node: Node { i, k }, heading: Heading::new(h) });
        let poses = poses.map(|pose| scene.lattice().pose(pose));
        for pose in &poses {
            let mut frame = Frame::default();
            DepthCamera(camera).capture(&scene, pose, &mut frame);
            field.observe(&camera, pose, &frame, 0.25);
        }
        let (mut wrong, mut carved) = (0, 0);
        for (&point, sight) in field.points().iter().zip(field.sights()) {
            let (mut inside, mut behind, mut views) = (0, 0, 0_u128);
            for pose in &poses {
                // By angles and a ray through the point itself, with no image in between.
                let (away, forward) = (point - pose.position, pose.forward());
                let depth = away.dot(forward);
                let (right, up) = (away.dot(pose.right()) / depth, away.y / depth);
                if depth <= 0.0 || right.abs() >= 1.0 || up.abs() >= 128.0 / 228.0 {
                    continue;
                }
                let surface = scene.rays().nearest(pose.position, away / depth, 35.0).map_or(35.0, |hit| hit.t);
                inside += 1;
                behind += u32::from(depth - surface >= -0.25);
                views |= u128::from(depth - surface < 3.0 * field.spacing()) << view_bin(-away);
            }
            let expected = Sight { views, inside, behind };
            assert_eq!(sight.inside, expected.inside, "{point}");
            wrong += usize::from(*sight != expected);
            carved += usize::from(!sight.is_solid());
        }
        // A pixel shows the surface at its middle: at edges and at grazing angles a point may fall to the other side.
        assert!(wrong < 60, "{wrong}");
        assert!(carved > 800, "{carved}");
    }
}
