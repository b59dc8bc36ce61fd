//! Whole steps: four captures, map, coverage and the encoder's input; on one thread, on two, and late in an episode.

use crate::clock::{Effort, Times, cpu_seconds, seconds};
use crate::house::House;
use nbp_env::sensor::Frame;
use nbp_env::{Action, Episode};
use serde_json::{Value, json};
use std::error::Error;
use std::sync::Barrier;
use std::time::Instant;

/// Where "late" and "early" are, and how many steps around them are measured.
const LATE: usize = 500;
const EARLY: usize = 10;
const WINDOW: usize = 10;

pub(crate) fn measure(houses: &[House], effort: Effort) -> Result<Vec<Value>, Box<dyn Error>> {
    println!("steps with 4 captures, 20,000 surface points, episodes of {} steps, median of", effort.steps);
    println!("{} repeats; late: around step {LATE} over the same way around step {EARLY}\n", effort.repeats);
    print!("{:>10}{:>10}{:>10}{:>13}", "triangles", "steps/s", "(best)", "ms per step");
    println!("{:>12}{:>13}{:>13}", "input, us", "two threads", "late/early");
    houses.iter().map(|house| row(house, effort)).collect()
}

fn row(house: &House, effort: Effort) -> Result<Value, Box<dyn Error>> {
    let (mut steps, mut inputs, mut gains) = (Times::default(), Times::default(), Times::default());
    for repeat in 0..effort.repeats {
        let alone = [0, 1].map(|other| one_episode(house, repeat + other, effort.steps));
        let [[step, input], [other, _]] = [alone[0].as_ref(), alone[1].as_ref()].map(|r| *r.unwrap_or(&[f64::NAN; 2]));
        steps.push(1e3 * step);
        inputs.push(1e6 * input);
        gains.push((step + other) * effort.steps as f64 / two_episodes(house, repeat, effort.steps)?);
    }
    let mut ratios = Times::default();
    for repeat in 0..effort.slow_repeats {
        ratios.push(late_over_early(house, repeat)?);
    }
    let (ms, least) = (steps.median(), steps.least());
    print!("{:>10}{:>10.0}{:>10.0}{ms:>13.3}", house.triangles(), 1e3 / ms, 1e3 / least);
    println!("{:>12.1}{:>12.2}x{:>12.2}x", inputs.median(), gains.median(), ratios.median());
    Ok(json!({
        "steps_per_second": 1e3 / ms, "step_ms": steps.json(), "input_us": inputs.json(), "two_threads": gains.median(),
        "late_over_early": ratios.median(),
    }))
}

/// Seconds per step of an episode, and how many of them the encoder's input takes.
fn one_episode(house: &House, repeat: usize, steps: usize) -> Result<[f64; 2], Box<dyn Error>> {
    let start = house.start(repeat);
    let (mut episode, walk) = (house.episode(start, steps)?, house.walk(start, steps, repeat as u64));
    let mut inputs = 0.0;
    let all = seconds(|| walk.iter().for_each(|&action| inputs += step(&mut episode, action)));
    Ok([all, inputs].map(|time| time / steps as f64))
}

/// One step with its input; seconds that the input takes.
pub(crate) fn step(episode: &mut Episode, action: Action) -> f64 {
    episode.step(action);
    seconds(|| episode.encode())
}

/// Seconds until two episodes, each on a thread of its own, are both at their end.
fn two_episodes(house: &House, repeat: usize, steps: usize) -> Result<f64, Box<dyn Error>> {
    let mut ready = Vec::new();
    for other in [0, 1] {
        let start = house.start(repeat + other);
        ready.push((house.episode(start, steps)?, house.walk(start, steps, (repeat + other) as u64)));
    }
    let barrier = Barrier::new(2);
    let run = |(mut episode, walk): (Episode, Vec<Action>)| {
        // The rasteriser's memory is the thread's own: a first frame makes it.
        house.world.sensor().capture(house.world.scene(), &house.poses[0], &mut Frame::default());
        barrier.wait();
        let begun = Instant::now();
        for action in walk {
            step(&mut episode, action);
        }
        (begun, Instant::now())
    };
    let times: Vec<(Instant, Instant)> = std::thread::scope(|scope| {
        let threads: Vec<_> = ready.into_iter().map(|one| scope.spawn(|| run(one))).collect();
        threads.into_iter().filter_map(|thread| thread.join().ok()).collect()
    });
    let (begun, done) = (times.iter().map(|t| t.0).min(), times.iter().map(|t| t.1).max());
    match (begun, done, times.len()) {
        (Some(begun), Some(done), 2) => Ok((done - begun).as_secs_f64()),
        _ => Err("an episode broke off".into()),
    }
}

/// Time of the same moves from the same poses, late in an episode over early in another, in turns.
fn late_over_early(house: &House, repeat: usize) -> Result<f64, Box<dyn Error>> {
    let (from, to) = (LATE - WINDOW / 2, LATE + WINDOW / 2);
    let start = house.start(repeat);
    let walk = house.walk(start, to, repeat as u64);
    let mut late = house.episode(start, to)?;
    let (before, last) = walk.split_at(LATE - EARLY);
    for &action in before {
        step(&mut late, action);
    }
    let mut early = house.episode(late.pose(), to)?;
    let mut times = [0.0; 2];
    for (number, &action) in last.iter().enumerate() {
        // Which of them goes first changes, for the second finds the scene in the cache.
        let mut pair = [(&mut late, 0), (&mut early, 1)];
        if number % 2 == 1 {
            pair.reverse();
        }
        for (episode, place) in pair {
            let time = cpu_seconds(|| step(episode, action));
            times[place] += if LATE - EARLY + number >= from { time } else { 0.0 };
        }
    }
    Ok(times[0] / times[1])
}
