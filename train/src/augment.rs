//! Flips and quarter turns of a sample, headings included: the world has no preferred direction.
//!
//! A mirrored window has the agent's pixel at `S/2 − 1` instead of `S/2`: inputs and targets move alike.
//!
//! The released code defines such an augmentation and never calls it; the paper does not mention one.

use nbp_env::label::{Sample, ValueLabel};
use nbp_env::window::VALUE_STRIDE;
use nbp_env::{EncoderInput, Heading};

/// One of the eight symmetries of the square.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Symmetry {
    flip_cols: bool,
    flip_rows: bool,
    transpose: bool,
}

impl Symmetry {
    /// Symmetry `n` modulo 8; 0 changes nothing.
    pub fn new(n: usize) -> Self {
        Self { flip_cols: n & 1 != 0, flip_rows: n & 2 != 0, transpose: n & 4 != 0 }
    }

    /// Where `(row, col)` of an image of side `side` goes.
    fn cell(self, row: usize, col: usize, side: usize) -> (usize, usize) {
        let col = if self.flip_cols { side - 1 - col } else { col };
        let row = if self.flip_rows { side - 1 - row } else { row };
        if self.transpose { (col, row) } else { (row, col) }
    }

    /// Where a heading goes. Columns run along `-x` and rows along `-z`, azimuths from `+z` to `+x`.
    fn heading(self, heading: Heading) -> Heading {
        let k = heading.index();
        let k = if self.flip_cols { 8 - k } else { k };
        let k = if self.flip_rows { 12 - k } else { k };
        Heading::new(if self.transpose { 18 - k } else { k })
    }

    fn image<T: Copy + Default>(self, image: &[T], side: usize) -> Vec<T> {
        let mut out = vec![T::default(); image.len()];
        for (at, &value) in image.iter().enumerate() {
            let (row, col) = self.cell(at / side, at % side, side);
            out[row * side + col] = value;
        }
        out
    }

    /// The sample as it would be in a world turned or mirrored so. Its window keeps naming the world as it was.
    pub fn apply(self, sample: &Sample) -> Sample {
        let side = sample.input.size();
        let channels = (0..sample.input.channels).flat_map(|channel| self.image(sample.input.channel(channel), side));
        let labels = sample.labels.iter().map(|label| {
            let (row, col) = self.cell(label.row, label.col, side / VALUE_STRIDE);
            ValueLabel { heading: self.heading(label.heading), row, col, ..*label }
        });
        Sample {
            input: EncoderInput { counts: channels.collect(), ..sample.input },
            step: sample.step,
            labels: labels.collect(),
            obstacles: self.image(&sample.obstacles, side),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nbp_env::window::{Window, WindowSize};

    /// A sample with one point, one wall and one label, all in the direction of the label's heading.
    fn pointing(heading: Heading) -> Sample {
        let side = 64;
        let (sin, cos) = heading.azimuth().sin_cos();
        let along = |side: usize, reach: f32| {
            let middle = (side as f32 - 1.0) / 2.0;
            ((middle - cos * reach).round() as usize, (middle - sin * reach).round() as usize)
        };
        let (row, col) = along(side, 20.0);
        let mut counts = vec![0; side * side];
        counts[row * side + col] = 3;
        let obstacles = counts.iter().map(|&c| u8::from(c > 0)).collect();
        let window = Window { size: WindowSize { pixels: side, metres: 40.0 }, centre: [0, 0], height: 1.65 };
        let (row, col) = along(side / 4, 5.0);
        let labels = vec![ValueLabel { heading, row, col, gain: 1.0 }];
        Sample { input: EncoderInput { window, channels: 1, counts }, step: 3, labels, obstacles }
    }

    /// The heading in which a cell lies, seen from the middle of an image.
    fn towards((row, col): (usize, usize), side: usize) -> Heading {
        let middle = (side as f32 - 1.0) / 2.0;
        Heading::towards(middle - col as f32, middle - row as f32)
    }

    #[test]
    fn what_lies_ahead_still_lies_ahead() {
        let cell_of = |at: usize| (at / 64, at % 64);
        for heading in Heading::all() {
            for n in 0..8 {
                let turned = Symmetry::new(n).apply(&pointing(heading));
                let label = turned.labels[0];
                assert_eq!(towards((label.row, label.col), 16), label.heading, "symmetry {n}, heading {heading:?}");
                let point = turned.input.counts.iter().position(|&count| count == 3).map(cell_of).unwrap();
                let wall = turned.obstacles.iter().position(|&wall| wall == 1).map(cell_of).unwrap();
                assert_eq!((towards(point, 64), point), (label.heading, wall), "symmetry {n}, heading {heading:?}");
            }
        }
    }

    #[test]
    fn there_are_eight() {
        let sample = pointing(Heading::new(1));
        let off_axis = ValueLabel { heading: Heading::new(1), row: 2, col: 7, gain: 1.0 };
        let sample = Sample { labels: vec![off_axis], ..sample };
        let all: std::collections::BTreeSet<String> =
            (0..8).map(|n| format!("{:?}", Symmetry::new(n).apply(&sample).labels)).collect();
        assert_eq!(all.len(), 8);
        assert_eq!(Symmetry::new(0).apply(&sample), sample);
    }
}
