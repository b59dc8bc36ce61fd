//! What the network saw and answered: its input, its value map with the path that was made of it, its obstacle map
//! against the truth. For logs during training and for a closer look at a rollout.

use super::{Rgb, beside, colour};
use glam::Vec2;
use nbp_env::policy::Plan;
use nbp_env::window::{VALUE_STRIDE, Window};
use nbp_env::{EncoderInput, Heading, Lattice, LatticePose, ObstacleMap, Prediction, ValueMap, World};

/// Side of a window's picture to aim at, pixels.
const TARGET: usize = 512;
/// Height of the strip under a map for its legend.
const LEGEND: usize = 30;

/// Picture pixels for each input pixel.
fn scale_of(pixels: usize) -> usize {
    (TARGET / pixels.max(1)).max(1)
}

/// `S·scale` squared, each input pixel in the colour that `ink` gives for `(row, col)`.
fn draw(pixels: usize, scale: usize, strip: usize, ink: impl Fn(usize, usize) -> [u8; 3]) -> Rgb {
    let mut image = Rgb::filled(pixels * scale, pixels * scale + strip, colour::BACKGROUND);
    for row in 0..pixels {
        for col in 0..pixels {
            let colour = ink(row, col);
            for y in row * scale..(row + 1) * scale {
                for x in col * scale..(col + 1) * scale {
                    image.set(x, y, colour);
                }
            }
        }
    }
    image
}

/// The network's input, one picture for each channel: layers from low to high, then the trajectory.
pub fn encoder_layers(input: &EncoderInput) -> Rgb {
    let side = input.size();
    let scale = (scale_of(side) / 2).max(1);
    let layer = |channel: usize| {
        let counts = input.channel(channel);
        let most = counts.iter().copied().max().unwrap_or(0).max(1);
        let tone = |count: u16| f32::from(count).ln_1p() / f32::from(most).ln_1p();
        let ink = |row: usize, col: usize| match counts[row * side + col] {
            0 => colour::FREE,
            count => colour::heat(0.3 + 0.7 * tone(count)),
        };
        let mut image = draw(side, scale, 0, ink);
        if channel + 1 == input.channels {
            // Visited pixels lie a step apart: as single pixels they are easily overlooked.
            for at in (0..counts.len()).filter(|&at| counts[at] > 0) {
                let middle = (Vec2::new((at % side) as f32, (at / side) as f32) + 0.5) * scale as f32;
                image.disc(middle, 2.2, colour::heat(0.5 + 0.5 * tone(counts[at])), 1.0);
            }
        }
        image
    };
    let names: Vec<String> =
        (1..input.channels).map(|n| format!("layer {n}")).chain(["trajectory".to_owned()]).collect();
    let pictures: Vec<(&str, Rgb)> = names.iter().enumerate().map(|(n, name)| (name.as_str(), layer(n))).collect();
    beside(&pictures)
}

/// The value map, the best heading of each cell, as heat; on it the true walls (`S · S`, 0 free, or empty for none) and
/// the path that starts at the agent, in the middle.
pub fn value_map(window: &Window, value: &ValueMap, walls: &[u8], lattice: &Lattice, path: &[LatticePose]) -> Rgb {
    let (side, scale) = (window.size.pixels, scale_of(window.size.pixels));
    let best = |row: usize, col: usize| {
        Heading::all().map(|heading| value.at(heading, row, col)).fold(f32::NEG_INFINITY, f32::max)
    };
    let cells: Vec<f32> = (0..value.size * value.size).map(|at| best(at / value.size, at % value.size)).collect();
    let [low, high] = cells.iter().fold([f32::INFINITY, f32::NEG_INFINITY], |[l, h], &v| [l.min(v), h.max(v)]);
    let tone = |v: f32| (v - low) / (high - low).max(1e-6);
    let ink = |row: usize, col: usize| {
        let heat = colour::heat(tone(cells[row / VALUE_STRIDE * value.size + col / VALUE_STRIDE]));
        let is_wall = walls.get(row * side + col).is_some_and(|&v| v != 0);
        if is_wall { colour::mix(heat, colour::SEEN, 0.35) } else { heat }
    };
    let mut image = draw(side, scale, LEGEND, ink);

    let at = |row: usize, col: usize| (Vec2::new(col as f32, row as f32) + 0.5) * scale as f32;
    let agent = at(side / 2, side / 2);
    let mut from = agent;
    for pose in path {
        let Some((row, col)) = window.pixel(lattice.position(pose.node)) else { break };
        let to = at(row, col);
        image.line(from, to, 5.0, [0; 3], 0.5);
        image.line(from, to, 2.6, colour::PLAN, 1.0);
        from = to;
    }
    image.disc(agent, 6.0, [255; 3], 1.0);
    image.disc(agent, 4.2, [30, 120, 220], 1.0);
    if let Some(goal) = path.last() {
        let azimuth = goal.heading.azimuth();
        image.ring(from, 8.0, 2.6, colour::PLAN);
        image.line(from, from + 17.0 * Vec2::new(-azimuth.sin(), -azimuth.cos()), 2.6, colour::PLAN, 1.0);
    }
    let line = (side * scale) as f32;
    image.block(Vec2::new(0.0, line), Vec2::new(line, line + LEGEND as f32), 0.0, colour::BACKGROUND, 1.0);
    let text = format!("gain {low:.2} to {high:.2} %  ·  {} m", window.size.metres);
    image.text(&text, Vec2::new(2.0, line + 11.0), 10.0, colour::FAINT);
    image
}

/// Predicted obstacles against the true ones (`S · S`, 0 free, else wall): white where both agree, red what was missed,
/// blue what is not there. The shade of the ground is the probability.
pub fn obstacle_map(predicted: &ObstacleMap, truth: &[u8], threshold: f32) -> Rgb {
    let (side, scale) = (predicted.size, scale_of(predicted.size));
    let ink = |row: usize, col: usize| {
        let probability = predicted.at(row, col);
        let is_wall = truth.get(row * side + col).is_some_and(|&v| v != 0);
        match (probability >= threshold, is_wall) {
            (true, true) => colour::HIT,
            (true, false) => colour::FALSE_ALARM,
            (false, true) => colour::MISS,
            (false, false) => colour::mix(colour::FREE, colour::FALSE_ALARM, 0.6 * probability / threshold.max(1e-6)),
        }
    };
    let mut image = draw(side, scale, LEGEND, ink);
    let (mut pen, line) = (2.0, (side * scale) as f32 + 11.0);
    for (name, ink) in [("wall found", colour::HIT), ("missed", colour::MISS), ("false alarm", colour::FALSE_ALARM)] {
        image.block(Vec2::new(pen, line), Vec2::new(pen + 10.0, line + 10.0), 2.0, ink, 1.0);
        pen += 17.0 + image.text(name, Vec2::new(pen + 17.0, line), 10.0, colour::FAINT) + 20.0;
    }
    image
}

/// All of a plan: input, value map with the path, obstacle map. `None` for a policy without a network.
pub fn plan(plan: &Plan, world: &World, threshold: f32) -> Option<[Rgb; 2]> {
    let (input, Prediction { value, obstacle }) = plan.thought.as_ref()?;
    let truth = world.obstacles().crop(&input.window);
    let value = value_map(&input.window, value, &truth, world.scene().lattice(), &plan.path);
    let obstacle = obstacle_map(obstacle, &truth, threshold);
    let answer = beside(&[("value map and path", value), ("obstacle map", obstacle)]);
    Some([encoder_layers(input), answer])
}

#[cfg(test)]
mod tests {
    use super::*;
    use nbp_env::window::WindowSize;

    #[test]
    fn maps_show_their_pixels_where_they_are() {
        let window = WindowSize { pixels: 32, metres: 40.0 }.around(glam::Vec3::ZERO);
        let mut gain = vec![0.0; 8 * 64];
        gain[3 * 64 + 8 + 6] = 2.0;
        let lattice = Lattice { origin: glam::Vec3::ZERO, spacing: 1.5, size: [4, 4] };
        let value = value_map(&window, &ValueMap { size: 8, gain }, &[], &lattice, &[]);
        assert_eq!((value.width, value.height), (512, 512 + LEGEND));
        let at = |image: &Rgb, x: usize, y: usize| [0, 1, 2].map(|c| image.data[(y * image.width + x) * 3 + c]);
        assert_eq!(at(&value, 6 * 64 + 30, 64 + 30), colour::heat(1.0));
        assert_eq!(at(&value, 30, 30), colour::heat(0.0));

        let mut probability = vec![0.0; 32 * 32];
        (probability[0], probability[1]) = (0.9, 0.9);
        let mut truth = vec![0; 32 * 32];
        (truth[0], truth[2]) = (1, 1);
        let obstacle = obstacle_map(&ObstacleMap { size: 32, probability }, &truth, 0.5);
        let colours = [0, 1, 2, 3].map(|col| at(&obstacle, col * 16 + 8, 8));
        assert_eq!(colours, [colour::HIT, colour::FALSE_ALARM, colour::MISS, colour::FREE]);

        let input = EncoderInput { window, channels: 5, counts: vec![0; 5 * 32 * 32] };
        assert!(encoder_layers(&input).width > 5 * 256);
    }
}
