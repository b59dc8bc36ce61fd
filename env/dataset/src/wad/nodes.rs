//! The tree by which the game draws a map from front to back, and finds the sector under a point.
//!
//! Binary space partitioning (Fuchs, Kedem and Naylor, "On visible surface generation by a priori tree structures",
//! SIGGRAPH 1980): sides of lines become segs, a seg's line cuts the rest in two, until every part is convex. Segs are cut
//! exactly and rounded to whole units only when they are written.

use super::NO_SIDE;
use crate::doom_map::DoomMap;
use std::collections::BTreeMap;

/// Points nearer to a line than this lie on it, map units.
const ON_LINE: f64 = 0.1;

/// A cut seg weighs as much as this many segs of imbalance between the halves.
const CUT_WEIGHT: usize = 8;

/// Lines that are tried at a node; more are not worth their time.
const CANDIDATES: usize = 64;

/// The game reads most numbers as signed.
const MOST: usize = i16::MAX as usize;

/// Marks a child that is a subsector.
const SUBSECTOR: u16 = 0x8000;

/// Tree and segs as lumps, and the vertices that cuts have added.
pub(super) struct Tree {
    pub(super) segs: Vec<u8>,
    pub(super) subsectors: Vec<u8>,
    pub(super) nodes: Vec<u8>,
    pub(super) added: Vec<[i32; 2]>,
}

/// A directed line; its right is its front.
#[derive(Clone, Copy)]
struct Line {
    from: [f64; 2],
    along: [f64; 2],
    length: f64,
}

impl Line {
    /// Distance of a point, positive to the left.
    fn distance(&self, p: [f64; 2]) -> f64 {
        let [x, y] = [0, 1].map(|axis| p[axis] - self.from[axis]);
        (self.along[0] * y - self.along[1] * x) / self.length
    }
}

/// A piece of one side of a linedef, with that side to its right.
#[derive(Clone, Copy)]
struct Seg {
    ends: [[f64; 2]; 2],
    /// The whole side.
    line: Line,
    linedef: u16,
    is_back: bool,
}

enum Side {
    Right,
    Left,
    /// The pieces to the right and to the left.
    Both(Seg, Seg),
}

struct Node {
    line: Line,
    /// Of the right and the left child: top, bottom, left, right.
    boxes: [[i32; 4]; 2],
    children: [Child; 2],
}

#[derive(Clone, Copy)]
enum Child {
    Node(usize),
    Subsector(usize),
}

/// Builds the tree of a map, or says which limit of the format it passes.
pub(super) fn build(map: &DoomMap) -> Result<Tree, String> {
    let segs = sides(map);
    if segs.is_empty() {
        return Err("no line has a side".into());
    }
    let (mut nodes, mut leaves): (Vec<Node>, Vec<Vec<Seg>>) = (Vec::new(), Vec::new());
    let mut open = vec![(segs, None)];
    while let Some((segs, parent)) = open.pop() {
        let child = match best_line(&segs) {
            None => {
                leaves.push(segs);
                Child::Subsector(leaves.len() - 1)
            }
            Some(line) => {
                let halves = divide(&segs, &line);
                let children = [Child::Node(0); 2];
                nodes.push(Node { line, boxes: [bounds(&halves[0]), bounds(&halves[1])], children });
                let node = nodes.len() - 1;
                open.extend(halves.into_iter().enumerate().map(|(half, segs)| (segs, Some((node, half)))));
                Child::Node(node)
            }
        };
        if let Some((node, half)) = parent {
            nodes[node].children[half] = child;
        }
        if nodes.len() > MOST || leaves.len() > MOST {
            return Err(format!("its tree has more than {MOST} nodes"));
        }
    }
    write(map, &nodes, &leaves)
}

fn sides(map: &DoomMap) -> Vec<Seg> {
    let mut segs = Vec::new();
    for (number, linedef) in map.linedefs.iter().enumerate().take(usize::from(NO_SIDE)) {
        let corner = |v: u32| map.vertices.get(v as usize).map(|v| [f64::from(v.x), f64::from(v.y)]);
        let (Some(from), Some(to)) = (corner(linedef.from), corner(linedef.to)) else { continue };
        for (side, is_back, ends) in [(linedef.front, false, [from, to]), (linedef.back, true, [to, from])] {
            if side.is_some() && from != to {
                let along = [0, 1].map(|axis| ends[1][axis] - ends[0][axis]);
                let line = Line { from: ends[0], along, length: along[0].hypot(along[1]) };
                segs.push(Seg { ends, line, linedef: number as u16, is_back });
            }
        }
    }
    segs
}

/// The line that cuts few segs and leaves halves of like size; `None` when all segs look at each other.
fn best_line(segs: &[Seg]) -> Option<Line> {
    let step = segs.len().div_ceil(CANDIDATES);
    let sampled = segs.iter().step_by(step).filter_map(|seg| Some((cost(segs, &seg.line)?, seg.line)));
    // Of equals the first.
    let best = sampled.min_by_key(|(cost, _)| *cost);
    let any = || segs.iter().find_map(|seg| Some((cost(segs, &seg.line)?, seg.line)));
    best.or_else(|| if step > 1 { any() } else { None }).map(|(_, line)| line)
}

/// `None` when nothing lies to the left, or the game cannot store the line.
fn cost(segs: &[Seg], line: &Line) -> Option<usize> {
    if line.along.iter().any(|c| c.abs() > MOST as f64) {
        return None;
    }
    let (mut right, mut left, mut cuts) = (0_usize, 0_usize, 0);
    for seg in segs {
        match side(seg, line) {
            Side::Right => right += 1,
            Side::Left => left += 1,
            Side::Both(..) => cuts += 1,
        }
    }
    (left + cuts > 0).then(|| CUT_WEIGHT * cuts + right.abs_diff(left))
}

fn divide(segs: &[Seg], line: &Line) -> [Vec<Seg>; 2] {
    let mut halves = [Vec::new(), Vec::new()];
    for seg in segs {
        match side(seg, line) {
            Side::Right => halves[0].push(*seg),
            Side::Left => halves[1].push(*seg),
            Side::Both(right, left) => {
                halves[0].push(right);
                halves[1].push(left);
            }
        }
    }
    halves
}

fn side(seg: &Seg, line: &Line) -> Side {
    let [a, b] = seg.ends.map(|end| Some(line.distance(end)).filter(|d| d.abs() > ON_LINE).unwrap_or(0.0));
    if a == 0.0 && b == 0.0 {
        let same_way = seg.line.along[0] * line.along[0] + seg.line.along[1] * line.along[1] > 0.0;
        return if same_way { Side::Right } else { Side::Left };
    }
    if a * b >= 0.0 {
        return if a + b < 0.0 { Side::Right } else { Side::Left };
    }
    let at = [0, 1].map(|axis| seg.ends[0][axis] + a / (a - b) * (seg.ends[1][axis] - seg.ends[0][axis]));
    let [first, second] = [[seg.ends[0], at], [at, seg.ends[1]]].map(|ends| Seg { ends, ..*seg });
    if a < 0.0 { Side::Both(first, second) } else { Side::Both(second, first) }
}

fn bounds(segs: &[Seg]) -> [i32; 4] {
    let ends = || segs.iter().flat_map(|seg| seg.ends);
    let low = |axis: usize| ends().fold(f64::INFINITY, |low, p| low.min(p[axis])).floor() as i32;
    let high = |axis: usize| ends().fold(f64::NEG_INFINITY, |high, p| high.max(p[axis])).ceil() as i32;
    [high(1), low(1), low(0), high(0)]
}

fn write(map: &DoomMap, nodes: &[Node], leaves: &[Vec<Seg>]) -> Result<Tree, String> {
    let mut tree = Tree { segs: Vec::new(), subsectors: Vec::new(), nodes: Vec::new(), added: Vec::new() };
    let mut numbers: BTreeMap<[i32; 2], usize> = BTreeMap::new();
    for (number, v) in map.vertices.iter().enumerate() {
        numbers.entry([v.x, v.y]).or_insert(number);
    }
    let mut vertex = |at: [f64; 2], added: &mut Vec<[i32; 2]>| {
        let at = at.map(|c| c.round() as i32);
        *numbers.entry(at).or_insert_with(|| {
            added.push(at);
            map.vertices.len() + added.len() - 1
        }) as u16
    };
    let mut count = 0;
    for segs in leaves {
        tree.subsectors.extend([segs.len(), count].map(|n| (n as u16).to_le_bytes()).concat());
        count += segs.len();
        for seg in segs {
            let [from, to] = seg.ends.map(|end| vertex(end, &mut tree.added));
            let turn = seg.line.along[1].atan2(seg.line.along[0]) / std::f64::consts::TAU;
            let angle = (turn * 65536.0).round() as i32 as u16;
            let [x, y] = [0, 1].map(|axis| seg.ends[0][axis] - seg.line.from[axis]);
            let record = [from, to, angle, seg.linedef, u16::from(seg.is_back), x.hypot(y).round() as u16];
            tree.segs.extend(record.map(u16::to_le_bytes).concat());
        }
    }
    let vertices = map.vertices.len() + tree.added.len();
    for (what, count) in [("vertices", vertices), ("segs", count), ("linedefs", map.linedefs.len())] {
        if count > MOST {
            return Err(format!("it has {count} {what}; the game reads at most {MOST}"));
        }
    }
    // Parents come before their children here and after them in the lump: the root is its last entry.
    let number = |child: Child| match child {
        Child::Node(node) => (nodes.len() - 1 - node) as u16,
        Child::Subsector(leaf) => SUBSECTOR | leaf as u16,
    };
    for node in nodes.iter().rev() {
        let line = [node.line.from, node.line.along].concat();
        let numbers = line.into_iter().map(|c| c as i16).chain(node.boxes.concat().into_iter().map(|c| c as i16));
        tree.nodes.extend(numbers.flat_map(i16::to_le_bytes));
        tree.nodes.extend(node.children.map(|child| number(child).to_le_bytes()).concat());
    }
    Ok(tree)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::convert::label;
    use crate::doom_map::Thing;
    use crate::generate::{Level, generate};
    use crate::wad::starts;

    fn words(lump: &[u8]) -> Vec<u16> {
        lump.chunks_exact(2).map(|b| u16::from_le_bytes([b[0], b[1]])).collect()
    }

    /// The game's own walk down the tree: the subsector under a point.
    fn subsector_at(nodes: &[u16], [x, y]: [f64; 2]) -> usize {
        let mut child = (nodes.len() / 14).wrapping_sub(1) as u16;
        while child & SUBSECTOR == 0 {
            let node = &nodes[14 * usize::from(child)..][..14];
            let [from_x, from_y, dx, dy] = [0, 1, 2, 3].map(|at| f64::from(node[at] as i16));
            let is_left = dx * (y - from_y) - dy * (x - from_x) > 0.0;
            child = node[12 + usize::from(is_left)];
        }
        usize::from(child & !SUBSECTOR)
    }

    /// Checks that all segs below a node lie in the boxes of its children, and returns their ends.
    fn check_boxes(nodes: &[u16], subsectors: &[u16], segs: &[[[i32; 2]; 2]], child: u16) -> Vec<[i32; 2]> {
        if child & SUBSECTOR != 0 {
            let at = 2 * usize::from(child & !SUBSECTOR);
            return segs[usize::from(subsectors[at + 1])..][..usize::from(subsectors[at])].concat();
        }
        let node = &nodes[14 * usize::from(child)..][..14];
        let halves = [0, 1].map(|half| {
            let ends = check_boxes(nodes, subsectors, segs, node[12 + half]);
            let [top, bottom, left, right] = [0, 1, 2, 3].map(|at| i32::from(node[4 + 4 * half + at] as i16));
            assert!(ends.iter().all(|&[x, y]| (left..=right).contains(&x) && (bottom..=top).contains(&y)));
            ends
        });
        halves.concat()
    }

    fn sector_at(map: &DoomMap, tree: &Tree, at: [f64; 2]) -> Option<u32> {
        let (segs, subsectors) = (words(&tree.segs), words(&tree.subsectors));
        let first = usize::from(subsectors[2 * subsector_at(&words(&tree.nodes), at) + 1]);
        let line = &map.linedefs[usize::from(segs[6 * first + 3])];
        map.sector_of(if segs[6 * first + 4] == 1 { line.back } else { line.front })
    }

    #[test]
    fn the_tree_finds_the_sector_under_every_point() {
        for (level, seed) in [(Level::Simple, 1), (Level::Simple, 2), (Level::Normal, 3), (Level::Insane, 4)] {
            let made = generate(level, seed).unwrap();
            let (map, tree) = (&made.map, build(&made.map).unwrap());
            let mut vertices: Vec<[i32; 2]> = map.vertices.iter().map(|v| [v.x, v.y]).collect();
            vertices.extend(&tree.added);
            let ends = |seg: &[u16]| [seg[0], seg[1]].map(|v| vertices[usize::from(v)]);
            let segs: Vec<_> = words(&tree.segs).chunks_exact(6).map(ends).collect();
            let root = (tree.nodes.len() / 28 - 1) as u16;
            assert_eq!(check_boxes(&words(&tree.nodes), &words(&tree.subsectors), &segs, root).len(), 2 * segs.len());
            let labelled = label(map).unwrap();
            let triangles = (0..labelled.sector.len()).filter(|&t| labelled.sector[t].is_some());
            for triangle in triangles {
                let at = labelled.plan.centroid(triangle);
                assert_eq!(sector_at(map, &tree, at), labelled.sector[triangle], "{level} {seed} {at:?}");
            }
            let starts = starts(map, &made.scene);
            assert_eq!(starts.len(), 9);
            for Thing { x, y, .. } in starts {
                let sector = sector_at(map, &tree, [f64::from(x), f64::from(y)]).unwrap();
                let sector = map.sectors[sector as usize];
                assert!(sector.ceiling - sector.floor >= 56, "no player fits at ({x}, {y}): {sector:?}");
            }
        }
    }

    #[test]
    fn segs_cover_every_side_and_subsectors_are_convex() {
        let map = generate(Level::Hard, 5).unwrap().map;
        let mut covered: BTreeMap<(u16, bool), f64> = BTreeMap::new();
        let whole = sides(&map);
        let mut open = vec![whole.clone()];
        while let Some(segs) = open.pop() {
            if let Some(line) = best_line(&segs) {
                open.extend(divide(&segs, &line));
                continue;
            }
            for seg in &segs {
                let [a, b] = seg.ends;
                *covered.entry((seg.linedef, seg.is_back)).or_default() += (b[0] - a[0]).hypot(b[1] - a[1]);
                let ends = segs.iter().flat_map(|other| other.ends);
                assert!(ends.clone().all(|end| seg.line.distance(end) <= ON_LINE));
            }
        }
        assert_eq!(covered.len(), whole.len());
        for seg in whole {
            assert!((covered[&(seg.linedef, seg.is_back)] - seg.line.length).abs() < 1e-6);
        }
    }

    #[test]
    fn limits_are_named() {
        assert!(build(&DoomMap::default()).is_err_and(|reason| reason.contains("no line")));
        let mut map = DoomMap::default();
        let room = map.sector(0, 128);
        map.walls(&[[0, 0], [400, 0], [400, 400], [0, 400], [0, 0]], room);
        let tree = build(&map).unwrap();
        assert_eq!((tree.nodes.len(), words(&tree.subsectors)), (0, vec![4, 0]), "one room is one subsector");
        map.linedefs = map.linedefs.iter().copied().cycle().take(MOST + 1).collect();
        assert!(build(&map).is_err_and(|reason| reason.contains("32768")));
    }
}
