//! Poses: where the camera may stand and look.
//!
//! Axes: `x`, `z` span the ground, `y` is up, metres. Azimuth is measured from `+z` towards `+x`, so heading `k` of 8
//! looks along `(sin 45°k, 0, cos 45°k)`: 0 is `+z`, 2 is `+x`. The camera never pitches or rolls (paper, section 5.1).

use glam::Vec3;
use serde::{Deserialize, Serialize};
use std::f32::consts::TAU;

/// Number of headings of the lattice agent.
pub const HEADINGS: usize = 8;

/// Height of the camera above the floor, metres.
pub const CAMERA_HEIGHT: f32 = 1.65;

/// One of eight horizontal viewing directions, 45° apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Heading(u8);

impl Heading {
    /// Heading `k` modulo 8.
    pub fn new(k: usize) -> Self {
        Self((k % HEADINGS) as u8)
    }

    /// All eight, in order.
    pub fn all() -> impl Iterator<Item = Self> {
        (0..HEADINGS).map(Self::new)
    }

    /// Index in `0..8`, the channel of the value map.
    pub fn index(self) -> usize {
        usize::from(self.0) % HEADINGS
    }

    /// Azimuth in radians, `[0, 2π)`.
    pub fn azimuth(self) -> f32 {
        self.index() as f32 * TAU / HEADINGS as f32
    }

    /// The heading nearest to the direction `(dx, dz)`.
    pub fn towards(dx: f32, dz: f32) -> Self {
        let turns = dx.atan2(dz) / TAU * HEADINGS as f32;
        Self::new(turns.round().rem_euclid(HEADINGS as f32) as usize)
    }
}

/// A node of the lattice: column `i` along `x`, row `k` along `z`. May lie outside the lattice.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Node {
    /// Steps along `x` from the lattice origin.
    pub i: i32,
    /// Steps along `z` from the lattice origin.
    pub k: i32,
}

impl Node {
    /// The neighbour one step away.
    pub fn step(self, direction: Direction) -> Self {
        let (di, dk) = direction.delta();
        Self { i: self.i + di, k: self.k + dk }
    }
}

/// One of the four moves of the lattice agent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Direction {
    /// Towards `+z`.
    PlusZ,
    /// Towards `+x`.
    PlusX,
    /// Towards `-z`.
    MinusZ,
    /// Towards `-x`.
    MinusX,
}

impl Direction {
    /// The four moves in a fixed order.
    pub const ALL: [Self; 4] = [Self::PlusZ, Self::PlusX, Self::MinusZ, Self::MinusX];

    /// Change of `(i, k)`.
    pub fn delta(self) -> (i32, i32) {
        match self {
            Self::PlusZ => (0, 1),
            Self::PlusX => (1, 0),
            Self::MinusZ => (0, -1),
            Self::MinusX => (-1, 0),
        }
    }

    /// The move from `a` to `b`, if they are neighbours.
    pub fn between(a: Node, b: Node) -> Option<Self> {
        Self::ALL.into_iter().find(|&d| a.step(d) == b)
    }
}

/// A node and a heading: what the agent chooses among.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct LatticePose {
    /// Where.
    pub node: Node,
    /// Looking where.
    pub heading: Heading,
}

/// A camera pose: position in metres, azimuth in radians.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// Camera centre.
    pub position: Vec3,
    /// From `+z` towards `+x`.
    pub azimuth: f32,
}

impl Pose {
    /// Unit viewing direction.
    pub fn forward(&self) -> Vec3 {
        Vec3::new(self.azimuth.sin(), 0.0, self.azimuth.cos())
    }

    /// Unit vector towards the right edge of the image.
    pub fn right(&self) -> Vec3 {
        Vec3::new(-self.azimuth.cos(), 0.0, self.azimuth.sin())
    }

    /// The pose a share `t` of the way to `other`: linear in position, along the shorter arc in azimuth.
    pub fn interpolate(&self, other: &Self, t: f32) -> Self {
        let arc = shorter_arc(other.azimuth - self.azimuth);
        Self { position: self.position.lerp(other.position, t), azimuth: (self.azimuth + arc * t).rem_euclid(TAU) }
    }
}

/// The same angle from -π to π, radians.
pub(crate) fn shorter_arc(angle: f32) -> f32 {
    (angle + TAU / 2.0).rem_euclid(TAU) - TAU / 2.0
}

/// The horizontal square lattice of camera positions of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Lattice {
    /// Position of node `(0, 0)`; its `y` is the camera plane.
    pub origin: Vec3,
    /// Distance of neighbours, metres.
    pub spacing: f32,
    /// Number of nodes along `x` and `z`.
    pub size: [i32; 2],
}

impl Lattice {
    /// Whether `node` belongs to the lattice.
    pub fn contains(&self, node: Node) -> bool {
        (0..self.size[0]).contains(&node.i) && (0..self.size[1]).contains(&node.k)
    }

    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.size[0].max(0) as usize * self.size[1].max(0) as usize
    }

    /// True for a lattice without nodes.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Index of a node of the lattice in `0..len()`; `None` outside.
    pub fn index(&self, node: Node) -> Option<usize> {
        self.contains(node).then(|| node.i as usize * self.size[1] as usize + node.k as usize)
    }

    /// The node of an index below `len()`.
    pub fn node(&self, index: usize) -> Node {
        let rows = self.size[1].max(1) as usize;
        Node { i: (index / rows) as i32, k: (index % rows) as i32 }
    }

    /// Position of a node in the camera plane.
    pub fn position(&self, node: Node) -> Vec3 {
        self.origin + self.spacing * Vec3::new(node.i as f32, 0.0, node.k as f32)
    }

    /// Camera pose of a lattice pose.
    pub fn pose(&self, pose: LatticePose) -> Pose {
        Pose { position: self.position(pose.node), azimuth: pose.heading.azimuth() }
    }

    /// The node nearest to a position (its height is ignored); may lie outside the lattice.
    pub fn nearest(&self, position: Vec3) -> Node {
        let d = (position - self.origin) / self.spacing;
        Node { i: d.x.round() as i32, k: d.z.round() as i32 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headings_turn_from_z_to_x() {
        let looks = |k| Pose { position: Vec3::ZERO, azimuth: Heading::new(k).azimuth() };
        assert!(looks(0).forward().abs_diff_eq(Vec3::Z, 1e-6));
        assert!(looks(2).forward().abs_diff_eq(Vec3::X, 1e-6));
        assert!(looks(0).right().abs_diff_eq(Vec3::NEG_X, 1e-6));
        for h in Heading::all() {
            let f = Pose { position: Vec3::ZERO, azimuth: h.azimuth() }.forward();
            assert_eq!(Heading::towards(f.x, f.z), h);
        }
    }

    #[test]
    fn interpolation_takes_the_shorter_arc() {
        let at = |k| Pose { position: Vec3::ZERO, azimuth: Heading::new(k).azimuth() };
        let middle = at(7).interpolate(&at(1), 0.5);
        assert!(middle.azimuth < 1e-5 || TAU - middle.azimuth < 1e-5, "{}", middle.azimuth);
    }

    #[test]
    fn lattice_indices_round_trip() {
        let lattice = Lattice { origin: Vec3::new(1.0, 2.0, 3.0), spacing: 1.5, size: [4, 7] };
        for index in 0..lattice.len() {
            let node = lattice.node(index);
            assert_eq!(lattice.index(node), Some(index));
            assert_eq!(lattice.nearest(lattice.position(node)), node);
        }
        assert_eq!(lattice.index(Node { i: 4, k: 0 }), None);
    }
}
