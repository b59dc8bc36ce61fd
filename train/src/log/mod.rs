//! What a run tells: `metrics.jsonl` is the record, TensorBoard a view of it, bars and lines are for who watches.

pub mod bars;
pub mod tensorboard;

pub use bars::Bars;

use nbp_infer::picture::Rgb;
use nbp_model::weights;
use serde_json::{Map, Value, json};
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::Path;
use tensorboard::TensorBoard;

/// The log of one run.
pub struct Log {
    record: File,
    board: TensorBoard,
    /// Progress bars.
    pub bars: Bars,
}

impl Log {
    /// Opens the log of a run folder. A resumed run goes on in the same record, without the lines of steps after `step`,
    /// which it will make again.
    ///
    /// # Errors
    /// When the record cannot be opened.
    pub fn open(run: &Path, step: usize, bars: Bars) -> std::io::Result<Self> {
        let path = run.join("metrics.jsonl");
        if let Ok(text) = std::fs::read_to_string(&path) {
            let is_kept = |line: &&str| {
                let parsed: Option<Value> = serde_json::from_str(line).ok();
                parsed.and_then(|value| value["step"].as_u64()).is_some_and(|at| at <= step as u64)
            };
            let kept: String = text.lines().filter(is_kept).map(|line| format!("{line}\n")).collect();
            if kept != text {
                weights::write_atomic(&path, kept.as_bytes())?;
            }
        }
        let record = OpenOptions::new().create(true).append(true).open(path)?;
        Ok(Self { record, board: TensorBoard::start(&run.join("tb")), bars })
    }

    /// Numbers of one moment; `step` counts optimiser steps. A name with a slash is grouped by TensorBoard.
    pub fn scalars(&mut self, step: usize, values: &[(String, f64)]) {
        let mut line = Map::from_iter([("step".to_string(), json!(step))]);
        for (name, value) in values {
            line.insert(name.clone(), json!(value));
            self.board.scalar(name, *value as f32, step);
        }
        let text = Value::Object(line).to_string();
        if let Err(error) = writeln!(self.record, "{text}") {
            tracing::warn!("metrics.jsonl cannot be written: {error}");
        }
    }

    /// A picture of one moment.
    pub fn image(&mut self, step: usize, name: &str, picture: &Rgb) {
        self.board.image(name, picture, step);
    }

    /// Forces out what TensorBoard has not written yet.
    pub fn flush(&mut self) {
        self.board.flush();
    }
}
