//! TensorBoard events, written by a thread of their own: a full disk ends the view, never the training.

use nbp_infer::picture::Rgb;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use tensorboard_rs::summary_writer::SummaryWriter;

enum Event {
    Scalar(String, f32, usize),
    Image(String, Vec<u8>, usize, usize),
    Flush,
}

/// A handle to the writing thread.
pub struct TensorBoard {
    events: Option<Sender<Event>>,
    thread: Option<JoinHandle<()>>,
}

impl TensorBoard {
    /// Starts writing into `folder`.
    pub fn start(folder: &Path) -> Self {
        if let Err(error) = std::fs::create_dir_all(folder) {
            tracing::warn!("no TensorBoard events: {} cannot be created: {error}", folder.display());
            return Self { events: None, thread: None };
        }
        let (events, receiver) = channel();
        let folder = folder.to_path_buf();
        let thread = std::thread::Builder::new().name("tensorboard".into()).spawn(move || write(&folder, &receiver));
        Self { events: Some(events), thread: thread.ok() }
    }

    /// A number.
    pub fn scalar(&mut self, name: &str, value: f32, step: usize) {
        self.send(Event::Scalar(name.into(), value, step));
    }

    /// A picture.
    pub fn image(&mut self, name: &str, picture: &Rgb, step: usize) {
        // Square, because tensorboard-rs exchanges width and height in what it tells TensorBoard.
        let side = picture.width.max(picture.height);
        let mut square = Rgb::filled(side, side, [0; 3]);
        square.paste(picture, 0, 0);
        self.send(Event::Image(name.into(), square.data, side, step));
    }

    /// Forces out what is pending.
    pub fn flush(&mut self) {
        self.send(Event::Flush);
    }

    fn send(&mut self, event: Event) {
        if self.events.as_ref().is_some_and(|events| events.send(event).is_err()) {
            tracing::warn!("TensorBoard events stopped: the disk may be full; metrics.jsonl goes on");
            self.events = None;
        }
    }
}

impl Drop for TensorBoard {
    fn drop(&mut self) {
        self.events = None;
        // The writer flushes on its way out; if it panicked there is nothing left to wait for.
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn write(folder: &PathBuf, events: &Receiver<Event>) {
    let mut writer = SummaryWriter::new(folder);
    for event in events {
        match event {
            Event::Scalar(name, value, step) => writer.add_scalar(&name, value, step),
            Event::Image(name, data, side, step) => writer.add_image(&name, &data, &[3, side, side], step),
            Event::Flush => writer.flush(),
        }
    }
    writer.flush();
}
