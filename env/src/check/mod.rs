//! Contracts that a scene, a sensor or a policy of one's own must keep.
//!
//! For tests of extensions: `assert_eq!(check_policy(&mut MyPolicy::new(), &world), [])`. Each fault says what was
//! expected and what was found.

mod escape;
mod policy;
mod scene;
mod sensor;

pub use escape::Escape;
pub use policy::check_policy;
pub use scene::{check_geometry, check_scene};
pub use sensor::check_sensor;

use crate::episode::Decision;
use crate::pose::{LatticePose, Node};
use glam::{Vec2, Vec3};
use scene::ROOM_HEIGHT;

/// Something that does not keep its contract.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Fault {
    /// A frame of another size than the camera says.
    #[error(
        "the frame says {} × {} pixels and has {depths} depths, but its camera takes {} × {} pixels",
        found[0], found[1], expected[0], expected[1]
    )]
    Size {
        /// Width and height of the camera.
        expected: [usize; 2],
        /// Width and height of the frame.
        found: [usize; 2],
        /// Depths in the frame.
        depths: usize,
    },
    /// A depth that is no distance.
    #[error("depth {depth} at column {col}, row {row}: it must be 0 (nothing) or from the near plane up to {range} m")]
    Depth {
        /// As found.
        depth: f32,
        /// Pixel.
        col: usize,
        /// Pixel.
        row: usize,
        /// Range of the camera.
        range: f32,
    },
    /// Two captures of one pose differ.
    #[error(
        "the same pose gives two different frames: draw noise from the pose or a seed, never from a clock or a thread"
    )]
    SensorVaries,
    /// Many depths are not those of the scene.
    #[error(
        "{share:.0} % of the depths are more than 20 % off the distance to the surface along the optical axis: check the \
         axes and the units"
    )]
    NotTheScene {
        /// Percent.
        share: f32,
    },
    /// Depths are distances from the camera's centre.
    #[error(
        "the depths are measured along the ray, {along:.3} m off on average, and not along the optical axis, {axial:.3} m \
         off: divide them by the length of PosedCamera::ray"
    )]
    AlongTheRay {
        /// Mean difference from the distance along the ray, metres.
        along: f64,
        /// Mean difference from the distance along the optical axis, metres.
        axial: f64,
    },
    /// Little of what is there has a depth.
    #[error(
        "only {share:.0} % of the pixels that show a surface have a depth: check the axes, the range and the units"
    )]
    Blind {
        /// Percent.
        share: f32,
    },
    /// A policy failed.
    #[error("step {step}: {reason}")]
    Failed {
        /// Step of the episode.
        step: usize,
        /// Its own word.
        reason: String,
    },
    /// A policy acts otherwise in a second episode that is the same.
    #[error(
        "step {step}: {second:?} where the same episode had {first:?} before: `begin` must forget everything, and chance \
         come from `rng` alone"
    )]
    PolicyVaries {
        /// Step of the episode.
        step: usize,
        /// Before.
        first: Decision,
        /// Now.
        second: Decision,
    },
    /// A policy runs into a wall again and again.
    #[error("{count} bumps into the edge from {pose:?}: ask `MapView::bumps` before a move")]
    RepeatedBumps {
        /// Where the agent stood.
        pose: LatticePose,
        /// Number of bumps.
        count: u32,
    },
    /// Said when a scene was read.
    #[error("{0}")]
    Noted(String),
    /// Starts from which little can be reached.
    #[error(
        "{count} of {of} starts are cut off from the largest connected part, the first at ({}, {}): move them there \
         (LatticeGraph::largest_component)", first.i, first.k
    )]
    StartsCutOff {
        /// Starts outside the largest connected component.
        count: usize,
        /// All starts.
        of: usize,
        /// The first such.
        first: Node,
    },
    /// Many poses that cannot be reached.
    #[error(
        "only {connected} of {free} free lattice poses are connected: a door is closed, or a way narrower than the lattice's \
         step; open it, or shift the lattice (camera.x_min)"
    )]
    Scattered {
        /// Nodes of the largest connected component.
        connected: usize,
        /// All free nodes.
        free: usize,
    },
    /// Rays from inside meet nothing.
    #[error(
        "the mesh is open: {escaped} of {rays} rays from inside escape, the first from {origin:.2} m towards {direction:.2}; \
         close the hole, or call the scene a scan (scene.open) if it is one"
    )]
    Escapes {
        /// Rays that met no surface.
        escaped: usize,
        /// Rays shot.
        rays: usize,
        /// Of the first of them, metres.
        origin: Vec3,
        /// Of the first of them.
        direction: Vec3,
    },
    /// Coverage stays low whatever a policy does.
    #[error(
        "only {:.0} % of the surface can be seen from reachable poses: look for outer faces, closed rooms and surfaces inside \
         walls", 100.0 * share
    )]
    Hidden {
        /// Visible share, 0 to 1.
        share: f64,
    },
    /// Wrong units, most likely.
    #[error(
        "rooms are {height:.2} m high, half of them more, half of them less, where {} to {} m are usual: check \
         scene.metres_per_unit", ROOM_HEIGHT[0], ROOM_HEIGHT[1]
    )]
    Scale {
        /// Median height of the ceiling over the floor, metres.
        height: f32,
    },
    /// The settings' box cuts the mesh.
    #[error(
        "{:.0} % of the mesh lies outside the scene's box ({low:.1} to {high:.1} m) and does not count: check scene.x_min and \
         scene.x_max", 100.0 * share
    )]
    OutsideBox {
        /// Share of the mesh's area, 0 to 1.
        share: f64,
        /// Lower corner of the box, metres.
        low: Vec3,
        /// Its upper corner.
        high: Vec3,
    },
    /// The settings' lattice lies elsewhere.
    #[error(
        "the lattice, in plan from {:.1} to {:.1} m, and the mesh, from {:.1} to {:.1} m, share less than half of either: check \
         camera.x_min, camera.pose_l and camera.pose_h", lattice[0], lattice[1], mesh[0], mesh[1]
    )]
    OtherLattice {
        /// Lower and upper corner of the lattice in `(x, z)`, metres.
        lattice: [Vec2; 2],
        /// The same of the mesh.
        mesh: [Vec2; 2],
    },
}

#[cfg(test)]
mod tests {
    use crate::sensor::Camera;

    pub(super) const SMALL: Camera = Camera { width: 112, height: 64, hfov_degrees: 90.0, range: 35.0 };
}
