//! From the agent's map to the network's input: `K` density layers and the trajectory (paper, section 4.1, appendix B).

use crate::map::{Layers, MapView};
use crate::predict::EncoderInput;
use crate::window::WindowSize;
use serde::{Deserialize, Serialize};

/// What the input shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EncodeConfig {
    /// Size and range (paper: 256 pixels, 40 m).
    pub window: WindowSize,
    /// Side of the square that the input shows, metres, on as many pixels; that of the window if left out. The answers keep
    /// the window's range (paper, appendix, crop size).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub input_metres: Option<f32>,
    /// Horizontal layers of the density.
    pub layers: Layers,
    /// Show the carved plane, too: two more images that count its free and its occupied cells. Off in the paper, whose network
    /// has to see from thin points where nothing was seen yet.
    pub occupancy: bool,
    /// Which positions the trajectory image counts.
    pub trajectory: Trajectory,
}

/// Which positions the trajectory image counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Trajectory {
    /// Poses at the end of earlier steps (paper, appendix B: `k < t`).
    #[default]
    KeyPoses,
    /// Also the captures between them, and the current pose (released code).
    Captures,
}

impl EncodeConfig {
    /// Channels of the input, `K + 1`, or `K + 3` with the carved plane.
    pub fn channels(&self) -> usize {
        self.layers.count + if self.occupancy { 2 } else { 0 } + 1
    }

    /// Size and range of the input.
    pub fn input(&self) -> WindowSize {
        WindowSize { metres: self.input_metres.unwrap_or(self.window.metres), ..self.window }
    }
}

/// Captures for each step in the released code's trajectory image.
const CAPTURES_PER_STEP: u32 = 4;

/// The input around the agent. Its `window` is that of the answers.
pub fn encode(view: &MapView<'_>) -> EncoderInput {
    let (density, config) = (view.density(), view.encode_config());
    let window = density.window_size().around(view.position());
    let answers = view.window_size().around(view.position());
    let area = window.size.pixels.pow(2);
    let mut counts = vec![0_u16; config.channels() * area];
    let (layers, rest) = counts.split_at_mut(density.layer_count() * area);
    density.crop(&window, layers);
    let (plane, visits) = rest.split_at_mut(rest.len() - area);
    if let Some((free, occupied)) = plane.split_at_mut_checked(area).filter(|_| config.occupancy) {
        view.occupancy().crop(&window, free, occupied);
    }
    let mut visit = |position| {
        if let Some((row, col)) = window.pixel(position) {
            let count = &mut visits[row * window.size.pixels + col];
            *count = count.saturating_add(1);
        }
    };
    let positions = view.history().iter().map(|pose| view.lattice().position(pose.node));
    match config.trajectory {
        Trajectory::KeyPoses => positions.take(view.history().len().saturating_sub(1)).for_each(visit),
        Trajectory::Captures => {
            let mut last = None;
            for position in positions {
                let from = *last.get_or_insert(position);
                for n in 1..=CAPTURES_PER_STEP {
                    visit(from.lerp(position, n as f32 / CAPTURES_PER_STEP as f32));
                }
                last = Some(position);
            }
        }
    }
    EncoderInput { window: answers, channels: config.channels(), counts }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::SimConfig;
    use crate::episode::{Action, Episode};
    use crate::map::{Cell, OccupancyGrid};
    use crate::pose::{Heading, LatticePose, Node};
    use crate::scene::Scene;
    use crate::seed::SeedTree;
    use crate::world::World;
    use std::sync::Arc;

    #[test]
    fn the_carved_plane_is_two_more_images() {
        let window = WindowSize { pixels: 64, metres: 14.0 };
        let encode = EncodeConfig { window, occupancy: true, ..EncodeConfig::default() };
        let mut config = SimConfig { encode, ..SimConfig::default() };
        let input_of = |config: &SimConfig| {
            let world = Arc::new(World::new(Scene::two_rooms(), config).unwrap());
            let start = LatticePose { node: Node { i: 1, k: 1 }, heading: Heading::new(1) };
            let mut episode = Episode::new(world, start, 4, SeedTree::new(1)).unwrap();
            episode.step(Action { direction: None, heading: Heading::new(4) });
            episode
        };
        let episode = input_of(&config);
        let (input, view) = (episode.encode(), episode.view());
        assert_eq!((input.channels, config.encode.channels()), (7, 7));
        let (mut free, mut occupied) = (vec![0; 64 * 64], vec![0; 64 * 64]);
        let (low, shape) = view.occupancy().extent();
        for x in low[0]..low[0] + shape[0] as i32 {
            for z in low[1]..low[1] + shape[1] as i32 {
                let Some((row, col)) = input.window.pixel(OccupancyGrid::middle([x, z])) else { continue };
                match view.occupancy().get([x, z]) {
                    Cell::Unknown => (),
                    Cell::Free => free[row * 64 + col] += 1,
                    Cell::Occupied => occupied[row * 64 + col] += 1,
                }
            }
        }
        assert!(free.iter().sum::<u16>() > 500 && occupied.iter().sum::<u16>() > 50);
        assert_eq!((input.channel(4), input.channel(5)), (&free[..], &occupied[..]));

        config.encode.occupancy = false;
        let without = input_of(&config).encode();
        assert_eq!(without.channels, 5);
        assert!((0..4).all(|layer| without.channel(layer) == input.channel(layer)));
        assert_eq!(without.channel(4), input.channel(6), "the trajectory is last");
    }
}
