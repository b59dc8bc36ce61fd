//! The mesh as the rasteriser wants it: boxes in groups of eight, triangles in packets of sixteen.
//!
//! obvhs BVH2s with big leaves decide what lies together, one for each of the six directions that triangles mostly face.
//! So a packet is a patch of one wall, not of its two faces or of a wall and the floor before it, and what is behind the
//! patch that is drawn first lies in other packets, which are skipped: measured, half as many triangles are drawn.
//!
//! The nodes are regrouped eight to a node, so that one pass over arrays of eight culls all children, and each leaf is
//! written out as packets whose corners lie in arrays of sixteen. All loops over these arrays have fixed lengths: the
//! compiler turns them into SIMD code for any target.

use crate::scene::Mesh;
use crate::scene::rays::unlike;
use glam::{DVec3, Vec3};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::bvh2::builder::build_bvh2;
use std::hint::black_box;
use std::time::Duration;

/// Children of a node.
pub(super) const WIDE: usize = 8;

/// Triangles of a packet.
pub(super) const LANES: usize = 16;

/// Leaves that fill a packet: large ones cost little, because their triangles are tested side by side.
const BUILD: BvhBuildParams =
    BvhBuildParams { max_prims_per_leaf: 16, collapse_traversal_cost: 64.0, ..BvhBuildParams::slow_build() };

/// Share of the scene's size by which boxes are grown at most, to be [`unlike`] each other.
const HAIR: f32 = 4e-6;

/// Up to eight boxes.
#[derive(Clone, Debug)]
pub(super) struct Wide {
    /// `low[axis][child]`, metres. Unused children are at the origin.
    pub(super) low: [[f32; WIDE]; 3],
    /// `high[axis][child]`.
    pub(super) high: [[f32; WIDE]; 3],
    /// What is in each box.
    pub(super) child: [Child; WIDE],
    /// Children in use.
    pub(super) len: usize,
}

/// What is in a box.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Child {
    /// First packet, or the node.
    pub(super) first: u32,
    /// Number of packets; 0 for a node.
    pub(super) packets: u32,
}

/// Sixteen triangles.
#[derive(Clone, Debug)]
pub(super) struct Packet {
    /// `corner[k][axis][triangle]`, metres. Unused places repeat the last triangle.
    pub(super) corner: [[[f32; LANES]; 3]; 3],
    /// `normal[axis][triangle]`, unit length up to rounding.
    pub(super) normal: [[f32; LANES]; 3],
    /// `normal · corner`: in `f64`, because a camera 1 cm from a wall 30 m long sees the difference.
    pub(super) offset: [f64; LANES],
    /// Triangles in use.
    pub(super) len: usize,
}

/// The rasteriser's index of a mesh.
#[derive(Clone)]
pub struct RasterIndex {
    pub(super) nodes: Vec<Wide>,
    pub(super) packets: Vec<Packet>,
    /// For each packet, the triangles' numbers in the mesh; apart, because depth does not ask for them.
    pub(super) numbers: Vec<[u32; LANES]>,
}

impl RasterIndex {
    /// Sorts the triangles of a mesh; the same mesh gives the same index.
    pub fn build(mesh: &Mesh) -> Self {
        let mut facing: [Vec<u32>; 6] = Default::default();
        for (id, [a, b, c]) in (0..).zip(mesh.iter_corners()) {
            let normal = (b - a).cross(c - a);
            let axis = normal.abs().max_position();
            facing[2 * axis + usize::from(normal[axis] > 0.0)].push(id);
        }
        let [low, high] = mesh.bounds();
        let hair = low.abs().max(high.abs()).max_element() * HAIR;
        let mut index = Self { nodes: vec![Wide::EMPTY], packets: Vec::new(), numbers: Vec::new() };
        // The root has room for eight: one for each direction.
        for ids in facing.iter().filter(|ids| !ids.is_empty()) {
            let boxes: Vec<Aabb> = ids
                .iter()
                .map(|&id| {
                    let [a, b, c] = mesh.corners(id as usize);
                    let pad = Vec3::splat(hair * unlike(id));
                    Aabb::new((a.min(b).min(c) - pad).into(), (a.max(b).max(c) + pad).into())
                })
                .collect();
            let bvh = build_bvh2(&boxes, BUILD, &mut Duration::default());
            let child = Child { first: index.regroup(mesh, ids, &bvh, 0), packets: 0 };
            index.nodes[0].add(bvh.nodes[0].aabb(), child);
        }
        index
    }

    /// Brings a box's contents from memory while something else is computed: reads that nobody waits for.
    #[inline(always)]
    pub(super) fn fetch(&self, child: Child) {
        if child.packets == 0 {
            let node = &self.nodes[child.first as usize];
            for k in 0..3 {
                black_box(node.low[k][0]);
                black_box(node.high[k][0]);
            }
        } else {
            let packet = &self.packets[child.first as usize];
            for k in 0..3 {
                for axis in 0..3 {
                    black_box(packet.corner[k][axis][0]);
                }
                black_box(packet.normal[k][0]);
            }
            black_box(packet.offset[0]);
        }
    }

    /// Nodes from the root to the farthest leaf.
    #[cfg(test)]
    pub(crate) fn depth(&self) -> usize {
        let mut depth = vec![1; self.nodes.len()];
        // Children come after their parents.
        for (place, node) in self.nodes.iter().enumerate() {
            for child in node.child[..node.len].iter().filter(|child| child.packets == 0) {
                depth[child.first as usize] = depth[place] + 1;
            }
        }
        depth.into_iter().max().unwrap_or(0)
    }

    /// Copies the subtree under `top`, whose primitives are places in `ids`, and returns the place of its node.
    fn regroup(&mut self, mesh: &Mesh, ids: &[u32], bvh: &Bvh2, top: usize) -> u32 {
        let place = self.nodes.len();
        self.nodes.push(Wide::EMPTY);
        for member in group(bvh, top) {
            let source = &bvh.nodes[member];
            let child = if source.is_leaf() {
                let first = self.packets.len() as u32;
                let range = source.first_index as usize..(source.first_index + source.prim_count) as usize;
                let leaf: Vec<u32> = bvh.primitive_indices[range].iter().map(|&i| ids[i as usize]).collect();
                self.packets.extend(leaf.chunks(LANES).map(|ids| Packet::new(mesh, ids)));
                let place = |ids: &[u32], lane: usize| ids[lane.min(ids.len() - 1)];
                self.numbers.extend(leaf.chunks(LANES).map(|ids| std::array::from_fn(|lane| place(ids, lane))));
                Child { first, packets: self.packets.len() as u32 - first }
            } else {
                Child { first: self.regroup(mesh, ids, bvh, member), packets: 0 }
            };
            self.nodes[place].add(source.aabb(), child);
        }
        place as u32
    }
}

impl Wide {
    const EMPTY: Self =
        Self { low: [[0.0; WIDE]; 3], high: [[0.0; WIDE]; 3], child: [Child { first: 0, packets: 0 }; WIDE], len: 0 };

    fn add(&mut self, bounds: &Aabb, child: Child) {
        for axis in 0..3 {
            self.low[axis][self.len] = bounds.min[axis];
            self.high[axis][self.len] = bounds.max[axis];
        }
        self.child[self.len] = child;
        self.len += 1;
    }
}

impl std::fmt::Debug for RasterIndex {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (nodes, packets) = (self.nodes.len(), self.packets.len());
        f.debug_struct("RasterIndex").field("nodes", &nodes).field("packets", &packets).finish_non_exhaustive()
    }
}

/// Up to eight descendants of `top` that together hold all that is in it: the largest is opened first.
fn group(bvh: &Bvh2, top: usize) -> Vec<usize> {
    let mut members = vec![top];
    while members.len() < WIDE {
        let area = |&place: &usize| bvh.nodes[members[place]].aabb().half_area();
        let inner = (0..members.len()).filter(|&place| !bvh.nodes[members[place]].is_leaf());
        let Some(place) = inner.max_by(|a, b| area(a).total_cmp(&area(b))) else { break };
        let first = bvh.nodes[members[place]].first_index as usize;
        members[place] = first;
        members.push(first + 1);
    }
    members
}

impl Packet {
    fn new(mesh: &Mesh, ids: &[u32]) -> Self {
        let mut packet =
            Self { corner: [[[0.0; LANES]; 3]; 3], normal: [[0.0; LANES]; 3], offset: [0.0; LANES], len: ids.len() };
        for lane in 0..LANES {
            let corners = mesh.corners(ids[lane.min(ids.len() - 1)] as usize);
            for (k, corner) in corners.iter().enumerate() {
                for axis in 0..3 {
                    packet.corner[k][axis][lane] = corner[axis];
                }
            }
            let [a, b, c] = corners.map(Vec3::as_dvec3);
            let normal = (b - a).cross(c - a).normalize_or_zero().as_vec3();
            // With the rounded normal, the plane through the middle is the one that errs least.
            packet.offset[lane] = normal.as_dvec3().dot((a + b + c) / DVec3::splat(3.0));
            for axis in 0..3 {
                packet.normal[axis][lane] = normal[axis];
            }
        }
        packet
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::test_scenes::{rooms, terrain};

    #[test]
    fn every_triangle_is_in_one_packet_and_its_box() {
        for soup in
            [rooms(12.0, 0.5, 3), terrain(10.0, 3.0, 3, 1), (vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![[0, 1, 2]])]
        {
            let mesh = Mesh::new(soup.0, soup.1).unwrap();
            let index = RasterIndex::build(&mesh);
            let mut seen = Vec::new();
            for node in &index.nodes {
                for lane in 0..node.len {
                    let child = node.child[lane];
                    for place in child.first as usize..(child.first + child.packets) as usize {
                        let (packet, numbers) = (&index.packets[place], &index.numbers[place]);
                        for (lane, &number) in numbers.iter().enumerate().take(packet.len) {
                            let corner = packet.corner[0].map(|axis| axis[lane]);
                            assert_eq!(corner, mesh.corners(number as usize)[0].to_array());
                            seen.push(number);
                        }
                        for k in 0..3 {
                            for axis in 0..3 {
                                let inside = node.low[axis][lane]..=node.high[axis][lane];
                                assert!(packet.corner[k][axis].iter().all(|c| inside.contains(c)));
                            }
                        }
                    }
                }
            }
            seen.sort_unstable();
            assert!(seen.into_iter().eq(0..mesh.triangles().len() as u32));
        }
    }
}
