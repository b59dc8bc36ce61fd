//! What one wants to know of a scene of one's own before a policy runs in it.

use super::{Escape, Fault};
use crate::config::SimConfig;
use crate::pose::Lattice;
use crate::scene::Scene;
use crate::visible::visible_share;
use glam::{Vec2, Vec3};

/// Share of the free lattice poses that should be connected.
const CONNECTED: f64 = 0.5;

/// Share of the surface that should be visible.
const VISIBLE: f64 = 0.75;

/// Height of most rooms, metres: from a cellar to a hall. A factor of three either way falls outside.
pub(super) const ROOM_HEIGHT: [f32; 2] = [1.8, 14.0];

/// Share of the mesh's area that may lie outside the scene's box.
const OUTSIDE: f64 = 0.05;

/// Slack around that box, metres.
const SLACK: f32 = 0.1;

/// What is wrong with a scene; empty if nothing. The visible surface takes a second or, in a large scene, half a minute.
pub fn check_scene(scene: &Scene) -> Vec<Fault> {
    let mut faults = check_geometry(scene);
    let share = visible_share(scene, &SimConfig::default());
    faults.extend((share < VISIBLE).then_some(Fault::Hidden { share }));
    faults
}

/// The same but for what can be seen, which takes most of the time.
pub fn check_geometry(scene: &Scene) -> Vec<Fault> {
    let mut faults: Vec<Fault> = scene.notes().iter().cloned().map(Fault::Noted).collect();
    faults.extend(
        [starts(scene), poses(scene), escapes(scene), scale(scene), bounds(scene), lattice(scene)]
            .into_iter()
            .flatten(),
    );
    faults
}

fn starts(scene: &Scene) -> Option<Fault> {
    let largest = scene.graph().largest_component();
    let mut cut_off = scene.starts().iter().map(|start| start.node).filter(|node| largest.binary_search(node).is_err());
    let first = cut_off.next()?;
    Some(Fault::StartsCutOff { count: 1 + cut_off.count(), of: scene.starts().len(), first })
}

fn poses(scene: &Scene) -> Option<Fault> {
    let (graph, lattice) = (scene.graph(), scene.lattice());
    let free = (0..lattice.len()).filter(|&index| graph.is_free(lattice.node(index))).count();
    let connected = graph.largest_component().len();
    ((connected as f64) < CONNECTED * free as f64).then_some(Fault::Scattered { connected, free })
}

fn escapes(scene: &Scene) -> Option<Fault> {
    let Escape { rays, escaped, first } = Escape::of(scene);
    first.map(|[origin, direction]| Fault::Escapes { escaped, rays, origin, direction })
}

fn scale(scene: &Scene) -> Option<Fault> {
    let nodes = scene.graph().largest_component();
    let height = |eye: Vec3| {
        let reach = |direction| scene.rays().nearest(eye, direction, f32::INFINITY).map(|hit| hit.t);
        Some(reach(Vec3::Y)? + reach(Vec3::NEG_Y)?)
    };
    let mut heights: Vec<f32> = nodes.iter().filter_map(|&node| height(scene.lattice().position(node))).collect();
    heights.sort_unstable_by(f32::total_cmp);
    let height = *heights.get(heights.len() / 2)?;
    // Under an open sky little is known.
    let is_known = 2 * heights.len() > nodes.len();
    (is_known && !(ROOM_HEIGHT[0]..=ROOM_HEIGHT[1]).contains(&height)).then_some(Fault::Scale { height })
}

fn bounds(scene: &Scene) -> Option<Fault> {
    let [low, high] = scene.bounds();
    let is_inside = |v: &Vec3| v.cmpge(low - SLACK).all() && v.cmple(high + SLACK).all();
    let area = |[a, b, c]: [Vec3; 3]| f64::from((b - a).cross(c - a).length());
    let (mut outside, mut all) = (0.0, 0.0);
    for corners in scene.mesh().iter_corners() {
        all += area(corners);
        outside += if corners.iter().all(is_inside) { 0.0 } else { area(corners) };
    }
    (outside > OUTSIDE * all).then_some(Fault::OutsideBox { share: outside / all, low, high })
}

fn lattice(scene: &Scene) -> Option<Fault> {
    let plan = |corner: Vec3| Vec2::new(corner.x, corner.z);
    let mesh = scene.mesh().bounds().map(plan);
    let Lattice { origin, spacing, size } = *scene.lattice();
    // A node stands for a square of one step around it.
    let first = plan(origin) - spacing / 2.0;
    let lattice = [first, first + spacing * Vec2::new(size[0] as f32, size[1] as f32)];
    let area = |[low, high]: [Vec2; 2]| (high - low).max(Vec2::ZERO).element_product();
    let shared = 2.0 * area([mesh[0].max(lattice[0]), mesh[1].min(lattice[1])]);
    (shared < area(mesh) || shared < area(lattice)).then_some(Fault::OtherLattice { lattice, mesh })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Mesh, Settings, two_rooms};

    /// What is found of the two rooms once their mesh and settings have been changed.
    fn found(change: impl Fn(&mut Vec<Vec3>, &mut Vec<[u32; 3]>, &mut Settings)) -> Vec<Fault> {
        let (mesh, mut settings) = two_rooms();
        let (mut vertices, mut triangles) = (mesh.vertices().to_vec(), mesh.triangles().to_vec());
        change(&mut vertices, &mut triangles, &mut settings);
        check_geometry(&Scene::new("rooms", Mesh::new(vertices, triangles).unwrap(), &settings).unwrap())
    }

    #[test]
    fn a_sound_scene_has_no_fault() {
        assert_eq!(check_scene(&Scene::two_rooms()), []);
    }

    #[test]
    fn every_fault_of_a_scene_is_found() {
        // The ceiling of the first room, but for the lintel.
        assert!(matches!(found(|_, t, _| drop(t.drain(4..6)))[..], [Fault::Escapes { rays: 64_000, .. }]));
        let higher = |v: &mut Vec<Vec3>, by: f32| v.iter_mut().for_each(|v| v.y *= by);
        assert!(matches!(
            found(|v, _, s| {
                higher(v, 5.0);
                s.scene.x_max[1] *= 5.0;
            })[..],
            [Fault::Scale { height: 15.0 }]
        ));
        assert!(matches!(found(|_, _, s| s.scene.x_max[0] = 6.05)[..], [Fault::OutsideBox { .. }]));
        assert!(matches!(found(|_, _, s| s.camera.pose_l = 3)[..], [Fault::OtherLattice { .. }]));
        assert!(matches!(
            found(|_, _, s| (s.camera.pose_l, s.camera.pose_h) = (40, 40))[..],
            [Fault::OtherLattice { .. }]
        ));
        let faults = found(|_, _, s| {
            s.camera.pose_l = 10;
            s.camera.start_positions = vec![[1, 0, 2, 2, 0], [9, 0, 2, 2, 0]];
        });
        assert!(matches!(&faults[..], [Fault::Noted(note)] if note.contains("1 of 2 start positions")), "{faults:?}");
    }

    #[test]
    fn a_closed_door_is_found() {
        // A sheet across the door, and a start in the smaller room; one more partition in the larger one.
        let faults = found(|v, t, s| {
            for x in [6.0, 10.6] {
                let base = v.len() as u32;
                let corner = |y, z| Vec3::new(x, y, z);
                v.extend([corner(0.0, 0.0), corner(3.0, 0.0), corner(3.0, 9.0), corner(0.0, 9.0)]);
                t.extend([[base, base + 1, base + 2], [base, base + 2, base + 3]]);
            }
            s.camera.start_positions = vec![[1, 0, 2, 2, 0], [7, 0, 2, 2, 0]];
        });
        let node = crate::pose::Node { i: 7, k: 2 };
        assert_eq!(faults, [Fault::StartsCutOff { count: 1, of: 2, first: node }]);
        let faults = found(|v, t, _| {
            for x in [1.4, 2.6, 4.6, 6.0, 7.6, 10.6] {
                let base = v.len() as u32;
                let corner = |y, z| Vec3::new(x, y, z);
                v.extend([corner(0.0, 0.0), corner(3.0, 0.0), corner(3.0, 9.0), corner(0.0, 9.0)]);
                t.extend([[base, base + 1, base + 2], [base, base + 2, base + 3]]);
            }
        });
        assert!(matches!(faults[..], [Fault::Scattered { connected: 12, free: 48 }]), "{faults:?}");
    }

    #[test]
    fn what_cannot_be_seen_is_found() {
        let (mesh, settings) = two_rooms();
        let (mut vertices, mut triangles) = (mesh.vertices().to_vec(), mesh.triangles().to_vec());
        // The same building once more under its own floor, with no way down.
        let count = vertices.len() as u32;
        vertices.extend(mesh.vertices().iter().map(|v| *v - 4.0 * Vec3::Y));
        triangles.extend(mesh.triangles().iter().map(|t| t.map(|index| index + count)));
        let mut settings = settings;
        settings.scene.x_min[1] = -4.0;
        let scene = Scene::new("cellar", Mesh::new(vertices, triangles).unwrap(), &settings).unwrap();
        assert!(matches!(check_scene(&scene)[..], [Fault::Hidden { share }] if (0.4..0.6).contains(&share)));
    }
}
