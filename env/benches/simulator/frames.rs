//! Milliseconds for a depth image: by each instruction set of this machine, and by one ray at a time.

use crate::clock::{Effort, Times, seconds};
use crate::house::House;
use nbp_env::Pose;
use nbp_env::sensor::raster::{InstructionSet, RasterIndex, render_with};
use nbp_env::sensor::trace::trace;
use nbp_env::sensor::{Camera, Frame};
use serde_json::{Map, Value, json};
use std::error::Error;

/// Frames from each pose in a repeat of the rasteriser: one is too short for the clock and for the caches to settle.
const ROUNDS: usize = 8;

pub(crate) fn measure(houses: &[House], effort: Effort) -> Result<Vec<Value>, Box<dyn Error>> {
    let sets: Vec<InstructionSet> = InstructionSet::available().collect();
    println!("depth image of 456x256, one thread, ms per frame, median of {} repeats;", effort.repeats);
    println!("least and ratio for {}, which is used here\n", InstructionSet::best().name());
    print!("{:>10}", "triangles");
    sets.iter().for_each(|set| print!("{:>10}", set.name()));
    println!("{:>10}{:>14}{:>8}{:>14}", "(least)", "single rays", "ratio", "index, s");
    let row = |house: &House| {
        let mut drawn: Vec<Times> = sets.iter().map(|_| Times::default()).collect();
        let (mut shot, mut built) = (Times::default(), Times::default());
        for repeat in 0..effort.repeats {
            sets.iter().zip(&mut drawn).for_each(|(&set, times)| times.push(by_rasteriser(house, set)));
            if repeat % 3 == 0 {
                shot.push(by_single_rays(house));
                built.push(seconds(|| RasterIndex::build(house.world.scene().mesh())));
            }
        }
        print!("{:>10}", house.triangles());
        drawn.iter().for_each(|times| print!("{:>10.3}", times.median()));
        let best = sets.iter().position(|&set| set == InstructionSet::best()).unwrap_or_default();
        let (ms, least) = (drawn[best].median(), drawn[best].least());
        println!("{:>10.3}{:>14.2}{:>7.0}x{:>14.2}", least, shot.median(), shot.median() / ms, built.median());
        let drawn: Map<String, Value> =
            sets.iter().zip(&drawn).map(|(set, times)| (set.name().into(), times.json())).collect();
        json!({ "raster_ms": drawn, "single_rays_ms": shot.json(), "index_build_s": built.json() })
    };
    Ok(houses.iter().map(row).collect())
}

/// Milliseconds for one frame by the rasteriser, over all poses.
pub(crate) fn by_rasteriser(house: &House, set: InstructionSet) -> f64 {
    let (index, camera, mut frame) = (house.world.scene().raster(), Camera::default(), Frame::default());
    per_frame(&house.poses, ROUNDS, |pose| render_with(set, index, &camera, pose, &mut frame))
}

/// Milliseconds for one frame by one ray for each pixel, over all poses.
pub(crate) fn by_single_rays(house: &House) -> f64 {
    let (rays, camera, mut frame) = (house.world.scene().rays(), Camera::default(), Frame::default());
    per_frame(&house.poses, 1, |pose| trace(rays, &camera, pose, &mut frame))
}

/// Milliseconds for one frame, over `rounds` of all poses.
pub(crate) fn per_frame(poses: &[Pose], rounds: usize, mut capture: impl FnMut(&Pose)) -> f64 {
    1e3 * seconds(|| (0..rounds).for_each(|_| poses.iter().for_each(&mut capture))) / (rounds * poses.len()) as f64
}
