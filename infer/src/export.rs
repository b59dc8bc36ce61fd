//! Files that other programs open: the reconstruction as PLY, the walk as JSON, coverage and episodes as CSV.

use crate::picture::height_colour;
use crate::rollout::EpisodeRecord;
use glam::Vec3;
use nbp_env::completion::Completion;
use nbp_env::{LatticePose, Pose, ply};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// A point cloud as PLY in the colours of its points, or by height where there are none.
pub fn cloud_ply(points: &[Vec3], colours: &[[u8; 3]]) -> Vec<u8> {
    if colours.len() == points.len() {
        return ply::cloud(points, |number| colours[number]);
    }
    let heights = points.iter().map(|p| p.y);
    let [low, high] = heights.fold([f32::INFINITY, f32::NEG_INFINITY], |[l, h], y| [l.min(y), h.max(y)]);
    ply::cloud(points, |number| height_colour((points[number].y - low) / (high - low).max(1e-6)))
}

/// One pose of `trajectory.json`.
#[derive(Serialize)]
struct Waypoint {
    step: usize,
    /// `[i, k]`, column along `x` and row along `z`.
    node: [i32; 2],
    /// 0 to 7, 45° apart, 0 along `+z`, 2 along `+x`.
    heading: usize,
    /// Camera centre, metres, `y` up.
    position: [f32; 3],
    /// From `+z` towards `+x`.
    azimuth_degrees: f32,
    coverage: f32,
}

#[derive(Serialize)]
struct Trajectory<'a> {
    scene: &'a str,
    policy: &'a str,
    start: usize,
    seed: u64,
    steps: usize,
    axes: &'static str,
    final_coverage: f64,
    auc: f64,
    bumps: usize,
    path_length_m: f32,
    decision_ms: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    completion: Option<Completion>,
    poses: Vec<Waypoint>,
}

/// An episode's poses with its figures, as JSON. `track` has the true camera pose of each.
///
/// # Errors
/// When a number is not finite.
pub fn trajectory_json(record: &EpisodeRecord, track: &[Pose]) -> Result<String, serde_json::Error> {
    let waypoint = |(step, ((&pose, camera), &coverage)): (usize, ((&LatticePose, &Pose), &f32))| Waypoint {
        step,
        node: [pose.node.i, pose.node.k],
        heading: pose.heading.index(),
        position: camera.position.to_array(),
        azimuth_degrees: camera.azimuth.to_degrees(),
        coverage,
    };
    let trajectory = Trajectory {
        scene: &record.scene,
        policy: &record.policy,
        start: record.start,
        seed: record.seed,
        steps: record.steps,
        axes: "metres; x and z span the ground, y is up; azimuth from +z towards +x",
        final_coverage: record.final_coverage,
        auc: record.auc,
        bumps: record.bumps,
        path_length_m: record.path_length,
        decision_ms: record.decision_ms,
        completion: record.completion,
        poses: record.poses.iter().zip(track).zip(&record.curve).enumerate().map(waypoint).collect(),
    };
    serde_json::to_string_pretty(&trajectory).map(|json| json + "\n")
}

/// `step,coverage`: the covered share, 0 to 1, at the start and after each step.
pub fn coverage_csv(curve: &[f32]) -> String {
    let mut csv = String::from("step,coverage\n");
    for (step, coverage) in curve.iter().enumerate() {
        let _ = writeln!(csv, "{step},{coverage:.6}");
    }
    csv
}

/// One line for each episode; with Comp. % and Comp. cm where they were measured.
pub fn episodes_csv(episodes: &[EpisodeRecord]) -> String {
    let mut csv = String::from("scene,policy,start,seed,steps,final_coverage,auc,bumps,path_length_m,decision_ms");
    let is_measured = episodes.iter().any(|record| record.completion.is_some());
    csv += if is_measured { ",completion_percent,completion_cm\n" } else { "\n" };
    for r in episodes {
        let (scene, policy) = (field(&r.scene), field(&r.policy));
        let _ = write!(
            csv,
            "{scene},{policy},{},{},{},{:.6},{:.6},{},{:.2},{:.3}",
            r.start, r.seed, r.steps, r.final_coverage, r.auc, r.bumps, r.path_length, r.decision_ms
        );
        let _ = match r.completion {
            Some(Completion { share, mean_distance }) => {
                writeln!(csv, ",{:.4},{:.4}", 100.0 * share, 100.0 * mean_distance)
            }
            None => writeln!(csv, "{}", if is_measured { ",," } else { "" }),
        };
    }
    csv
}

/// `scene,visible_share`: the share of the surface that can be seen at all, 0 to 1.
pub fn visible_csv(shares: &BTreeMap<String, f64>) -> String {
    let lines = shares.iter().map(|(scene, share)| format!("{},{share:.6}\n", field(scene)));
    std::iter::once("scene,visible_share\n".to_owned()).chain(lines).collect()
}

/// A CSV field, quoted where it has to be.
fn field(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_owned() }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use nbp_env::{Heading, Lattice, Node};

    pub(crate) fn record() -> EpisodeRecord {
        let pose = |i, heading| LatticePose { node: Node { i, k: 2 }, heading: Heading::new(heading) };
        EpisodeRecord {
            scene: "hall, small".into(),
            policy: "fbe".into(),
            start: 1,
            seed: 3,
            steps: 2,
            curve: vec![0.1, 0.2, 0.25],
            final_coverage: 0.25,
            auc: 0.1875,
            released_curve: None,
            released_final: None,
            released_auc: None,
            bumps: 1,
            path_length: 1.5,
            decision_ms: 0.5,
            completion: None,
            poses: vec![pose(0, 2), pose(1, 2), pose(1, 3)],
        }
    }

    #[test]
    fn a_cloud_has_its_own_colours_or_those_of_its_heights() {
        let points = [Vec3::new(1.0, 0.0, -2.5), Vec3::new(0.0, 3.0, 0.0)];
        assert!(cloud_ply(&points, &[[1, 2, 3], [4, 5, 6]]).ends_with(&[4, 5, 6]));
        assert!(cloud_ply(&points, &[]).ends_with(&height_colour(1.0)));
    }

    #[test]
    fn tables_and_trajectories_say_what_happened() {
        let csv = episodes_csv(&[record()]);
        assert_eq!(csv.lines().nth(1).unwrap(), "\"hall, small\",fbe,1,3,2,0.250000,0.187500,1,1.50,0.500");
        assert_eq!(coverage_csv(&record().curve).lines().last(), Some("2,0.250000"));
        let lattice = Lattice { origin: Vec3::new(1.0, 1.65, 0.0), spacing: 1.5, size: [4, 4] };
        let track: Vec<Pose> = record().poses.iter().map(|&pose| lattice.pose(pose)).collect();
        let json: serde_json::Value = serde_json::from_str(&trajectory_json(&record(), &track).unwrap()).unwrap();
        let last = &json["poses"][2];
        assert_eq!((last["step"].as_u64(), last["azimuth_degrees"].as_f64()), (Some(2), Some(135.0)));
        assert_eq!(last["position"][0].as_f64(), Some(2.5));
        let measured = EpisodeRecord { completion: Some(Completion { share: 0.5, mean_distance: 0.125 }), ..record() };
        let csv = episodes_csv(&[record(), measured]);
        assert!(csv.contains("0.500,,\n") && csv.ends_with("0.500,50.0000,12.5000\n"), "{csv}");
    }
}
