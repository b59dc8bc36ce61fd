//! Milliseconds for a depth image: by each instruction set of this machine, and by one ray at a time, of obvhs as it comes and
//! of our watertight test over it.

use crate::clock::{Effort, Times, cpu_seconds, seconds};
use crate::house::House;
use crate::plain_rays::PlainRays;
use nbp_env::Pose;
use nbp_env::sensor::raster::{InstructionSet, RasterIndex, render, render_with};
use nbp_env::sensor::trace::trace;
use nbp_env::sensor::{Camera, Frame};
use serde_json::{Map, Value, json};
use std::error::Error;

/// Frames from each pose in a repeat of the rasteriser: one is short for the clock of a busy machine.
const ROUNDS: usize = 8;

pub(crate) fn measure(houses: &[House], effort: Effort) -> Result<Vec<Value>, Box<dyn Error>> {
    let sets: Vec<InstructionSet> = InstructionSet::available().collect();
    println!("depth image of 456x256, one thread, ms per frame, median of {} repeats;", effort.repeats);
    println!(
        "least and ratios for {}, which is used here; apart: pixels that obvhs puts 1 mm or more",
        InstructionSet::best().name()
    );
    println!("beside ours, of all poses\n");
    print!("{:>10}", "triangles");
    sets.iter().for_each(|set| print!("{:>10}", set.name()));
    println!(
        "{:>10}{:>12}{:>7}{:>8}{:>17}{:>7}{:>10}",
        "(least)", "obvhs rays", "apart", "ratio", "watertight rays", "ratio", "index, s"
    );
    let row = |house: &House| {
        let mut drawn: Vec<Times> = sets.iter().map(|_| Times::default()).collect();
        let (mut plain, mut shot, mut built) = (Times::default(), Times::default(), Times::default());
        let obvhs = PlainRays::build(house.world.scene().mesh());
        let apart = pixels_apart(house, &obvhs);
        for repeat in 0..effort.repeats {
            sets.iter().zip(&mut drawn).for_each(|(&set, times)| times.push(by_rasteriser(house, set, ROUNDS)));
            if repeat % 3 == 0 {
                plain.push(by_plain_rays(house, &obvhs));
                shot.push(by_watertight_rays(house));
                built.push(seconds(|| RasterIndex::build(house.world.scene().mesh())));
            }
        }
        print!("{:>10}", house.triangles());
        drawn.iter().for_each(|times| print!("{:>10.3}", times.median()));
        let best = sets.iter().position(|&set| set == InstructionSet::best()).unwrap_or_default();
        let (ms, least) = (drawn[best].median(), drawn[best].least());
        print!("{:>10.3}{:>12.2}{apart:>7}{:>7.0}x", least, plain.median(), plain.median() / ms);
        println!("{:>17.2}{:>6.0}x{:>10.2}", shot.median(), shot.median() / ms, built.median());
        let drawn: Map<String, Value> =
            sets.iter().zip(&drawn).map(|(set, times)| (set.name().into(), times.json())).collect();
        json!({
            "raster_ms": drawn, "obvhs_rays_ms": plain.json(), "obvhs_pixels_apart": apart,
            "watertight_rays_ms": shot.json(), "index_build_s": built.json(),
        })
    };
    Ok(houses.iter().map(row).collect())
}

/// Milliseconds for one frame by the rasteriser, over `rounds` of all poses.
pub(crate) fn by_rasteriser(house: &House, set: InstructionSet, rounds: usize) -> f64 {
    let (index, camera, mut frame) = (house.world.scene().raster(), Camera::default(), Frame::default());
    per_frame(&house.poses, rounds, |pose| render_with(set, index, &camera, pose, &mut frame))
}

/// Milliseconds for one frame by one ray of obvhs for each pixel, over all poses.
pub(crate) fn by_plain_rays(house: &House, obvhs: &PlainRays) -> f64 {
    let (camera, mut depth) = (Camera::default(), Vec::new());
    per_frame(&house.poses, 1, |pose| obvhs.draw(&camera, pose, &mut depth))
}

/// Pixels that obvhs draws more than 1 mm beside ours, over all poses.
fn pixels_apart(house: &House, obvhs: &PlainRays) -> usize {
    let (index, camera, mut frame, mut depth) =
        (house.world.scene().raster(), Camera::default(), Frame::default(), Vec::new());
    let mut count = |pose: &Pose| {
        render(index, &camera, pose, &mut frame);
        obvhs.draw(&camera, pose, &mut depth);
        depth.iter().zip(&frame.depth).filter(|&(theirs, ours)| (theirs - ours).abs() > 1e-3).count()
    };
    house.poses.iter().map(&mut count).sum()
}

/// Milliseconds for one frame by one watertight ray for each pixel, over all poses.
pub(crate) fn by_watertight_rays(house: &House) -> f64 {
    let (rays, camera, mut frame) = (house.world.scene().rays(), Camera::default(), Frame::default());
    per_frame(&house.poses, 1, |pose| trace(rays, &camera, pose, &mut frame))
}

/// Milliseconds of the processor for one frame, over `rounds` of all poses after one that is not timed.
pub(crate) fn per_frame(poses: &[Pose], rounds: usize, mut capture: impl FnMut(&Pose)) -> f64 {
    poses.iter().for_each(&mut capture);
    1e3 * cpu_seconds(|| (0..rounds).for_each(|_| poses.iter().for_each(&mut capture))) / (rounds * poses.len()) as f64
}
