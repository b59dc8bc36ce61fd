//! `infer predict`: tensors in, tensors out.

use super::output::Output;
use super::talk::Talk;
use anyhow::{Context, Result, bail};
use nbp_env::explain::show;
use nbp_infer::checkpoint;
use nbp_model::DeviceChoice;
use safetensors::SafeTensors;
use safetensors::tensor::{Dtype, TensorView, serialize};
use std::path::{Path, PathBuf};

/// Options of `infer predict`.
#[derive(clap::Args)]
pub(super) struct Args {
    /// Checkpoint folder, or its model.safetensors
    #[arg(long, value_name = "DIR|FILE")]
    checkpoint: PathBuf,
    /// File with a tensor `x` [N, channels, S, S]: counts of points and visits
    #[arg(long, value_name = "IN.safetensors")]
    input: PathBuf,
    /// File for `value` [N, 8, S/4, S/4] and `obstacle` [N, 1, S, S], the latter as probabilities
    #[arg(long, value_name = "OUT.safetensors")]
    out: PathBuf,
}

pub(super) fn run(args: &Args, device: DeviceChoice, talk: Talk) -> Result<()> {
    let (out, name) = Output::for_file(&args.out)?;
    let (x, shape) = read(&args.input)?;
    let loaded = checkpoint::load(&args.checkpoint, device).context("cannot use the checkpoint")?;
    talk.say(format!("x {shape:?} on {}", loaded.device));
    let maps =
        loaded.predictor.answer(&x, shape).with_context(|| format!("{}: tensor x {shape:?}", args.input.display()))?;

    let [n, _, side, _] = shape;
    let net = loaded.config.net;
    let shapes = [("value", vec![n, net.headings, side / 4, side / 4]), ("obstacle", vec![n, 1, side, side])];
    let bytes = [&maps.value, &maps.obstacle].map(|map| map.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>());
    let mut views = Vec::new();
    for ((name, shape), bytes) in shapes.iter().zip(&bytes) {
        views.push((*name, TensorView::new(Dtype::F32, shape.clone(), bytes)?));
    }
    out.write(&name, serialize(views, None)?)?;
    for ((name, shape), map) in shapes.iter().zip([&maps.value, &maps.obstacle]) {
        let [low, high] = map.iter().fold([f32::INFINITY, f32::NEG_INFINITY], |[l, h], &v| [l.min(v), h.max(v)]);
        show(format_args!("{name} {shape:?} from {low} to {high}"))?;
    }
    Ok(())
}

/// The tensor `x` of a file as `f32`, with its shape.
fn read(path: &Path) -> Result<(Vec<f32>, [usize; 4])> {
    let shown = path.display();
    let bytes = std::fs::read(path).with_context(|| format!("cannot read {shown}"))?;
    let file = SafeTensors::deserialize(&bytes).with_context(|| format!("{shown} is not a safetensors file"))?;
    let mut names = file.names();
    names.sort_unstable();
    let Ok(x) = file.tensor("x") else {
        bail!("{shown} has no tensor `x`; it has {}", if names.is_empty() { "none".into() } else { names.join(", ") });
    };
    let Ok(shape) = <[usize; 4]>::try_from(x.shape()) else {
        bail!("{shown}: tensor x has the shape {:?}, but [N, channels, S, S] is needed", x.shape());
    };
    if shape.contains(&0) {
        bail!("{shown}: tensor x has the shape {shape:?}, so it is empty");
    }
    let numbers: Vec<f32> = match x.dtype() {
        Dtype::F32 => words(x.data(), f32::from_le_bytes),
        Dtype::F64 => words(x.data(), |b| f64::from_le_bytes(b) as f32),
        Dtype::U8 => words(x.data(), |[b]| f32::from(b)),
        Dtype::U16 => words(x.data(), |b| f32::from(u16::from_le_bytes(b))),
        Dtype::I32 => words(x.data(), |b| i32::from_le_bytes(b) as f32),
        Dtype::I64 => words(x.data(), |b| i64::from_le_bytes(b) as f32),
        other => bail!("{shown}: tensor x holds {other:?}; use F32, F64, U8, U16, I32 or I64"),
    };
    if let Some(at) = numbers.iter().position(|number| !number.is_finite()) {
        bail!("{shown}: number {at} of tensor x is {}", numbers[at]);
    }
    Ok((numbers, shape))
}

fn words<const N: usize>(bytes: &[u8], read: impl Fn([u8; N]) -> f32) -> Vec<f32> {
    bytes.chunks_exact(N).filter_map(|chunk| chunk.try_into().ok()).map(read).collect()
}
