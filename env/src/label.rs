//! Training samples: the coverage gain of every sub-path of an executed path (paper, section 4.3), or of a look from anywhere.

use crate::pose::{Heading, Lattice, LatticePose, Node};
use crate::predict::EncoderInput;
use crate::visibility::PointSet;
use crate::window::Window;
use crate::world::World;
use serde::{Deserialize, Serialize};

/// True gain of walking from the sample's pose to a pose of its path, or of a look from a pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ValueLabel {
    /// Heading at the end of the walk.
    pub heading: Heading,
    /// Cell of the value map.
    pub row: usize,
    /// Cell of the value map.
    pub col: usize,
    /// Percent points of the ground-truth surface; of looks, the square root of ares of it.
    pub gain: f32,
}

/// One pose of an executed path.
#[derive(Clone, Debug)]
pub struct Waypoint {
    /// Where.
    pub pose: LatticePose,
    /// What the network saw there.
    pub input: EncoderInput,
    /// Episode step at which it was reached.
    pub step: usize,
    /// Covered points after its frame.
    pub covered: usize,
    /// Covered points before its frame.
    pub covered_before: usize,
}

/// One training sample.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    /// What the network saw.
    pub input: EncoderInput,
    /// Episode step, for the curriculum.
    pub step: usize,
    /// Sparse targets of the value map.
    pub labels: Vec<ValueLabel>,
    /// Target of the obstacle map, `S · S` of 0 and 1.
    pub obstacles: Vec<u8>,
}

/// Which pairs of poses on a path become labels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LabelKind {
    /// All that follow, the goal included (paper, section 4.3: `0 ≤ i < j ≤ m`).
    #[default]
    SubPaths,
    /// The goal alone: no augmentation by sub-paths.
    Goals,
    /// All that follow but the goal, by what was covered before their frames (released code).
    AsReleased,
    /// No path: every pose of the window within sight ([`MapView::is_within_sight`](crate::map::MapView::is_within_sight)), by what a look
    /// from there would add now, see [`look_labels`].
    Looks,
}

/// Labels of waypoint `i` of a path: `100 · (covered_j − covered_i) / surface` at pose `j`, for every `j > i` of `kind` that
/// its window shows.
pub fn value_labels(
    path: &[Waypoint],
    i: usize,
    kind: LabelKind,
    lattice: &Lattice,
    surface: usize,
) -> Vec<ValueLabel> {
    let goal = path.len().saturating_sub(1);
    let is_label = |j: usize| match kind {
        LabelKind::SubPaths => true,
        LabelKind::Goals => j == goal,
        LabelKind::AsReleased => j < goal,
        LabelKind::Looks => false,
    };
    let covered = |j: usize| match kind {
        LabelKind::AsReleased => path[j].covered_before,
        _ => path[j].covered,
    };
    (i + 1..path.len())
        .filter(|&j| is_label(j))
        .filter_map(|j| {
            let (from, to) = (&path[i], &path[j]);
            let (row, col) = from.input.window.value_cell(lattice.position(to.pose.node))?;
            let gain = 100.0 * covered(j).saturating_sub(covered(i)) as f32 / surface.max(1) as f32;
            Some(ValueLabel { heading: to.pose.heading, row, col, gain })
        })
        .collect()
}

/// What a look from every lattice pose that a window shows, of nodes that are asked about, would add to `covered`: the square root
/// of ares (100 m²) of surface, so that little is told from nothing; nothing where nobody can stand. The gain of a next best view,
/// for all poses at once: a step gives hundreds of labels, where a walked path gives as many as it has poses.
pub fn look_labels(
    world: &World,
    covered: &PointSet,
    window: &Window,
    is_asked: impl Fn(Node) -> bool,
) -> Vec<ValueLabel> {
    let (scene, glimpses) = (world.scene(), world.glimpses());
    let (lattice, per_point) = (scene.lattice(), 0.01 * world.area() / world.surface().len().max(1) as f32);
    let nodes = (0..lattice.len()).map(|index| lattice.node(index)).filter(|&node| is_asked(node));
    let cells = nodes.filter_map(|node| Some((node, window.value_cell(lattice.position(node))?)));
    cells
        .flat_map(|(node, (row, col))| {
            let is_free = scene.graph().largest_component().binary_search(&node).is_ok();
            Heading::all().map(move |heading| {
                let gain = if is_free { glimpses.gain(LatticePose { node, heading }, covered) } else { 0 };
                ValueLabel { heading, row, col, gain: (per_point * gain as f32).sqrt() }
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::SimConfig;
    use crate::scene::Scene;
    use crate::sensor::Camera;
    use crate::window::WindowSize;
    use glam::Vec3;

    #[test]
    fn every_sub_path_is_labelled_and_the_goal_too() {
        let lattice = Lattice { origin: Vec3::new(0.0, 1.65, 0.0), spacing: 1.5, size: [10, 10] };
        let size = WindowSize { pixels: 64, metres: 40.0 };
        let path: Vec<Waypoint> = (0..4)
            .map(|n| {
                let pose = LatticePose { node: Node { i: 2, k: n }, heading: Heading::new(n as usize) };
                let window = size.around(lattice.position(pose.node));
                let input = EncoderInput { window, channels: 1, counts: vec![0; 64 * 64] };
                let covered = |n: i32| if n < 0 { 0 } else { 10 * (n * n + 1) as usize };
                Waypoint { pose, input, step: n as usize, covered: covered(n), covered_before: covered(n - 1) }
            })
            .collect();
        let labels: Vec<_> = (0..4).map(|i| value_labels(&path, i, LabelKind::SubPaths, &lattice, 1000)).collect();
        assert_eq!(labels.iter().map(Vec::len).collect::<Vec<_>>(), [3, 2, 1, 0]);
        let goal = labels[0][2];
        assert_eq!((goal.heading.index(), goal.gain), (3, 9.0));
        assert_eq!((goal.row, goal.col), (6, 8), "4.5 m up is 1.8 of 2.5 m cells");
        assert_eq!(labels[2][0].gain, 5.0);

        let of = |kind, i| value_labels(&path, i, kind, &lattice, 1000);
        assert_eq!(of(LabelKind::Goals, 0), [goal]);
        let released = of(LabelKind::AsReleased, 0);
        assert_eq!(released.iter().map(|label| label.gain).collect::<Vec<_>>(), [1.0, 2.0], "one frame behind");
        assert!(of(LabelKind::AsReleased, 2).is_empty() && of(LabelKind::Goals, 3).is_empty());
    }

    #[test]
    fn looks_from_everywhere_tell_what_is_left() {
        let camera = Camera { width: 112, height: 64, ..Camera::default() };
        let world = World::new(Scene::two_rooms(), &SimConfig { camera, ..SimConfig::default() }).unwrap();
        let (lattice, glimpses) = (*world.scene().lattice(), world.glimpses());
        let window = WindowSize { pixels: 64, metres: 40.0 }.around(lattice.position(Node { i: 1, k: 1 }));
        let mut covered = glimpses.nothing();
        let free = world.scene().graph().largest_component();
        let pose = LatticePose { node: free[0], heading: Heading::new(1) };
        let gain = glimpses.cover(pose, &mut covered.clone());
        let of_pose = |labels: &[ValueLabel]| {
            let (row, col) = window.value_cell(lattice.position(pose.node)).unwrap();
            let is_meant = |label: &&ValueLabel| (label.row, label.col, label.heading) == (row, col, pose.heading);
            labels.iter().find(is_meant).unwrap().gain
        };
        let labels = look_labels(&world, &covered, &window, |_| true);
        assert_eq!(labels.len(), 8 * lattice.len(), "the window shows both rooms");
        let ares = 0.01 * world.area() * gain as f32 / world.surface().len() as f32;
        assert!((of_pose(&labels).powi(2) - ares).abs() < 1e-5);
        let found = |labels: &[ValueLabel]| labels.iter().filter(|label| label.gain > 0.0).count();
        assert!(found(&labels) > 6 * free.len() && found(&labels) <= 8 * free.len(), "{}", found(&labels));
        glimpses.cover(pose, &mut covered);
        assert_eq!(of_pose(&look_labels(&world, &covered, &window, |_| true)), 0.0);
        for pose in free.iter().flat_map(|&node| Heading::all().map(move |heading| LatticePose { node, heading })) {
            glimpses.cover(pose, &mut covered);
        }
        assert_eq!(found(&look_labels(&world, &covered, &window, |_| true)), 0);
    }
}
