//! What every lattice pose sees: memory of the whole map, and nanoseconds for a question, asked in no order.

use crate::clock::{Effort, Times, seconds};
use crate::house::House;
use crate::scenes::Dice;
use nbp_env::visibility::PointSet;
use nbp_env::{Heading, LatticePose};
use serde_json::{Value, json};
use std::error::Error;

/// What one pose in so many sees is known when gains are asked for.
const KNOWN_STRIDE: usize = 50;

pub(crate) fn measure(houses: &[House], effort: Effort) -> Result<Vec<Value>, Box<dyn Error>> {
    println!("visibility cache of 20,000 surface points; one in {} nodes\n", effort.nodes_stride);
    println!("{:>10}{:>8}{:>14}{:>10}{:>14}", "triangles", "poses", "ms per pose", "MB", "ns per gain");
    Ok(houses.iter().map(|house| row(house, effort)).collect())
}

fn row(house: &House, effort: Effort) -> Value {
    let (visibility, nodes) = (house.world.visibility(), house.world.scene().graph().largest_component());
    let headings = |&node| Heading::all().map(move |heading| LatticePose { node, heading });
    let mut poses: Vec<LatticePose> = nodes.iter().step_by(effort.nodes_stride).flat_map(headings).collect();
    let mut dice = Dice(5);
    (1..poses.len()).for_each(|n| poses.swap(n, dice.between(0.0, (n + 1) as f32) as usize));
    let mut known = visibility.nothing();
    let ask = |known: &PointSet| poses.iter().map(|&pose| visibility.gain(pose, known)).sum::<usize>();
    let look = seconds(|| ask(&known));
    for &pose in poses.iter().step_by(KNOWN_STRIDE) {
        visibility.cover(pose, &mut known);
    }
    let mut gains = Times::default();
    for _ in 0..effort.repeats {
        gains.push(1e9 * seconds(|| ask(&known)) / poses.len() as f64);
    }
    let (ms, megabytes) = (1e3 * look / poses.len() as f64, visibility.bytes() as f64 / 1e6);
    println!("{:>10}{:>8}{ms:>14.2}{megabytes:>10.2}{:>14.0}", house.triangles(), poses.len(), gains.median());
    json!({ "poses": poses.len(), "ms_per_pose": ms, "bytes": visibility.bytes(), "gain_ns": gains.json() })
}
