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
    /// Channels of the input, `K + 1`.
    pub fn channels(&self) -> usize {
        self.layers.count + 1
    }

    /// Size and range of the input.
    pub fn input(&self) -> WindowSize {
        WindowSize { metres: self.input_metres.unwrap_or(self.window.metres), ..self.window }
    }
}

/// Captures for each step in the released code's trajectory image.
const CAPTURES_PER_STEP: u32 = 4;

/// The input around the agent. Its `window` is that of the answers.
pub fn encode(view: &MapView<'_>, trajectory: Trajectory) -> EncoderInput {
    let density = view.density();
    let window = density.window_size().around(view.position());
    let answers = view.window_size().around(view.position());
    let side = window.size.pixels;
    let layers = density.layer_count();
    let mut counts = vec![0_u16; (layers + 1) * side * side];
    let (images, visits) = counts.split_at_mut(layers * side * side);
    density.crop(&window, images);
    let mut visit = |position| {
        if let Some((row, col)) = window.pixel(position) {
            let count = &mut visits[row * side + col];
            *count = count.saturating_add(1);
        }
    };
    let positions = view.history().iter().map(|pose| view.lattice().position(pose.node));
    match trajectory {
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
    EncoderInput { window: answers, channels: layers + 1, counts }
}
