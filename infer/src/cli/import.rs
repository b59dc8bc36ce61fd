//! `infer import`: weights of the released code.

use super::output::Output;
use super::talk::Talk;
use anyhow::{Context, Result};
use nbp_env::explain::show;
use nbp_env::window::WindowSize;
use nbp_infer::checkpoint;
use nbp_model::{DeviceChoice, weights};
use std::path::PathBuf;

/// Options of `infer import`.
#[derive(clap::Args)]
pub(super) struct Args {
    /// PyTorch file with the state dict of the released network
    #[arg(value_name = "WEIGHTS.pth")]
    weights: PathBuf,
    /// Folder for model.safetensors and config.json
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Side of the window that it was trained with, pixels
    #[arg(long, default_value_t = 256, value_name = "N")]
    window_pixels: usize,
    /// Side of the window that it was trained with, metres
    #[arg(long, default_value_t = 40.0, value_name = "M")]
    window_metres: f32,
}

pub(super) fn run(args: &Args, talk: Talk) -> Result<()> {
    let out = Output::prepare(&args.out)?;
    let window = WindowSize { pixels: args.window_pixels, metres: args.window_metres };
    // Conversion needs no speed: the CPU always works.
    let device = DeviceChoice::Flex.resolve_for("infer")?;
    let mut imported = weights::import_pth(&args.weights, window, &device).context("cannot import the weights")?;
    let mut settings = checkpoint::released(&imported.config.net);
    settings.sim.encode.window = window;
    settings.sim.validate()?;
    checkpoint::remember(&mut imported.config, &settings)?;
    weights::save(out.folder(), &imported.net, &imported.config)?;
    let net = imported.config.net;
    show(format_args!(
        "{}: {} parameters, base width {}, {} input channels, window {} pixels over {} m",
        out.folder().display(),
        net.parameters(),
        net.base,
        net.in_channels,
        window.pixels,
        window.metres
    ))?;
    talk.detail(format!("settings: {}", serde_json::to_string(&settings)?));
    Ok(())
}
