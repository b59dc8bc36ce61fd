//! Where players of a generated map begin.

use crate::convert::SceneBundle;
use crate::doom_map::{DoomMap, Thing, UNITS_PER_METRE};
use nbp_env::pose::Node;
use nbp_env::scene::{LatticeGraph, RayIndex};

/// Free distance around a start, map units: a player is a square of 32.
const CLEARANCE: f64 = 24.0;

/// Players of one game have starts of these kinds; the last is for players against each other, at least four of them.
const KINDS: [u16; 9] = [1, 2, 3, 4, DEATHMATCH, DEATHMATCH, DEATHMATCH, DEATHMATCH, DEATHMATCH];
const DEATHMATCH: u16 = 11;

/// On all difficulties.
const ALWAYS: u16 = 7;

/// Starts for four players together and five against each other, on lattice positions of the scene with air around them:
/// the first near the scene's first start position, the latter near all of them. Each looks along the longest free line.
pub fn starts(map: &DoomMap, scene: &SceneBundle) -> Vec<Thing> {
    let lattice = scene.lattice();
    let graph = LatticeGraph::build(lattice, &RayIndex::build(&scene.mesh));
    let corner = |v: u32| map.vertices.get(v as usize).map_or([0.0; 2], |v| [f64::from(v.x), f64::from(v.y)]);
    let lines: Vec<_> = map.linedefs.iter().map(|line| [corner(line.from), corner(line.to)]).collect();
    let place = |node: Node| {
        let at = lattice.position(node);
        let [x, y] = [-f64::from(at.x), f64::from(at.z)];
        [0, 1].map(|axis| ([x, y][axis] * UNITS_PER_METRE).round() + f64::from(scene.report.origin[axis]))
    };
    let has_air = |node: &Node| lines.iter().all(|&line| distance(place(*node), line) >= CLEARANCE);
    let mut free: Vec<Node> = graph.largest_component().iter().copied().filter(has_air).collect();
    let wanted = scene.settings.camera.start_positions.iter().map(|p| Node { i: p[0], k: p[2] });
    let Some(first) = wanted.clone().next() else { return Vec::new() };
    let mut things = Vec::new();
    for (kind, near) in KINDS.into_iter().zip([first; 4].into_iter().chain(wanted)) {
        let apart = |n: &Node| (i64::from(n.i - near.i)).pow(2) + (i64::from(n.k - near.k)).pow(2);
        let Some(nearest) = (0..free.len()).min_by_key(|&n| apart(&free[n])) else { break };
        let node = free.remove(nearest);
        let at = place(node);
        let view = |eighth: u16| {
            let (sin, cos) = (f64::from(eighth) * std::f64::consts::FRAC_PI_4).sin_cos();
            lines.iter().filter_map(|&line| hit(at, [cos, sin], line)).fold(f64::INFINITY, f64::min)
        };
        let eighth = (0..8).rev().max_by(|&a, &b| view(a).total_cmp(&view(b))).unwrap_or(0);
        let [x, y] = at.map(|c| c as i32);
        things.push(Thing { x, y, angle: 45 * eighth, kind, flags: ALWAYS });
    }
    things
}

fn distance(p: [f64; 2], [a, b]: [[f64; 2]; 2]) -> f64 {
    let along = [b[0] - a[0], b[1] - a[1]];
    let square = along[0] * along[0] + along[1] * along[1];
    let t = ((p[0] - a[0]) * along[0] + (p[1] - a[1]) * along[1]) / square.max(f64::MIN_POSITIVE);
    let t = t.clamp(0.0, 1.0);
    (p[0] - a[0] - t * along[0]).hypot(p[1] - a[1] - t * along[1])
}

/// Distance at which a ray of unit length meets a line.
fn hit(p: [f64; 2], ray: [f64; 2], [a, b]: [[f64; 2]; 2]) -> Option<f64> {
    let (along, to) = ([b[0] - a[0], b[1] - a[1]], [a[0] - p[0], a[1] - p[1]]);
    let cross = |u: [f64; 2], v: [f64; 2]| u[0] * v[1] - u[1] * v[0];
    let turn = cross(ray, along);
    let (t, s) = (cross(to, along) / turn, cross(to, ray) / turn);
    (t > 0.0 && (0.0..=1.0).contains(&s)).then_some(t)
}
