//! Microseconds to count the kept points of a frame, at the two densities that matter; the first frames, which meet open
//! surface wherever they look, also by themselves. Nothing else runs between them, so caches are warm.

use crate::clock::{Effort, Times, cpu_seconds};
use crate::house::House;
use glam::Vec3;
use nbp_env::SeedTree;
use nbp_env::coverage::{Coverage, CoverageConfig, Surface};
use nbp_env::map::Kept;
use nbp_env::sensor::Frame;
use serde_json::{Value, json};
use std::error::Error;

/// So many frames are the first ones.
const FIRST: usize = 20;

pub(crate) fn measure(houses: &[House], effort: Effort) -> Result<Vec<Value>, Box<dyn Error>> {
    println!("coverage, us per frame of {} steps, median of {} repeats\n", effort.steps, effort.repeats);
    print!("{:>10}{:>18}{:>12}", "triangles", "20,000 at 0.5 m", format!("first {FIRST}"));
    println!("{:>18}{:>12}{:>12}", "200,000 at 5 cm", format!("first {FIRST}"), "covered");
    Ok(houses.iter().map(|house| row(house, effort)).collect())
}

fn row(house: &House, effort: Effort) -> Value {
    let clouds = kept(house, effort.steps);
    let config = CoverageConfig::default();
    let fine = CoverageConfig { points: 200_000, epsilon: 0.05, ..config };
    let fine = Surface::of(house.world.scene(), &fine);
    let surfaces = [house.world.surface(), &fine];
    let (mut times, mut firsts, mut shares) =
        ([(); 2].map(|()| Times::default()), [(); 2].map(|()| Times::default()), [0.0; 2]);
    for _ in 0..effort.repeats {
        for (n, surface) in surfaces.iter().enumerate() {
            let mut coverage = Coverage::new(surface);
            let mut add =
                |clouds: &[Vec<Vec3>]| cpu_seconds(|| clouds.iter().for_each(|cloud| coverage.add(surface, cloud, 1)));
            let (early, late) = clouds.split_at(FIRST);
            let (first, rest) = (add(early), add(late));
            firsts[n].push(1e6 * first / early.len() as f64);
            times[n].push(1e6 * (first + rest) / clouds.len() as f64);
            shares[n] = coverage.share();
        }
    }
    print!("{:>10}", house.triangles());
    for (times, firsts) in times.iter().zip(&firsts) {
        print!("{:>18.0}{:>12.0}", times.median(), firsts.median());
    }
    println!("{:>6.2} {:>5.2}", shares[0], shares[1]);
    json!({
        "coarse_us": times[0].json(), "coarse_first_us": firsts[0].json(), "coarse_covered": shares[0],
        "fine_us": times[1].json(), "fine_first_us": firsts[1].json(), "fine_covered": shares[1],
    })
}

/// The points kept of the frames of a walk.
fn kept(house: &House, steps: usize) -> Vec<Vec<Vec3>> {
    let (world, start) = (&house.world, house.start(0));
    let (sensor, mut frame, mut pixels) = (world.sensor(), Frame::default(), SeedTree::new(11).rng());
    let mut points = |pose| {
        sensor.capture(world.scene(), &pose, &mut frame);
        Kept::draw(sensor.camera(), &pose, &frame, world.config().keep, &mut pixels).points
    };
    let poses = house.captures(start, &house.walk(start, steps, 0));
    poses.into_iter().flatten().map(&mut points).collect()
}
