//! Memory of an environment: what each episode holds, as the allocator counts it, and what all in one world share.

use crate::MEMORY;
use crate::clock::Effort;
use crate::house::House;
use nbp_env::Episode;
use serde_json::{Value, json};
use std::error::Error;

/// Steps of the paper's longest episodes.
const STEPS: usize = 500;

pub(crate) fn measure(houses: &[House], _: Effort) -> Result<Vec<Value>, Box<dyn Error>> {
    println!("memory, MB\n");
    println!("{:>10}{:>16}{:>20}{:>16}", "triangles", "new episode", "after 500 steps", "shared world");
    houses.iter().map(row).collect()
}

fn row(house: &House) -> Result<Value, Box<dyn Error>> {
    let start = house.start(0);
    let walk = house.walk(start, STEPS, 0);
    let before = MEMORY.current_usage();
    let mut episode = house.episode(start, STEPS)?;
    let held = || MEMORY.current_usage() - before + size_of::<Episode>();
    let new = held();
    for action in walk {
        episode.step(action);
    }
    let old = held();
    let megabytes = |bytes: usize| bytes as f64 / 1e6;
    print!("{:>10}{:>16.1}", house.triangles(), megabytes(new));
    println!("{:>20.1}{:>16.1}", megabytes(old), megabytes(house.bytes));
    Ok(json!({ "new_episode_bytes": new, "old_episode_bytes": old, "world_bytes": house.bytes }))
}
