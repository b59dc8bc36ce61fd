//! Pictures one after the other as a GIF: one palette for all of them, and of each only what has changed.

use super::{Rgb, colour};
use std::borrow::Cow;

/// Frames that have no GIF form.
#[derive(Debug, thiserror::Error)]
pub enum GifError {
    /// GIF counts pixels in 16 bits.
    #[error("a GIF cannot be {width} × {height} pixels: both must be 1 to 65535")]
    Size {
        /// Pixels from left to right.
        width: usize,
        /// Pixels from top to bottom.
        height: usize,
    },
    /// The encoder refused.
    #[error("cannot encode a GIF: {0}")]
    Encoding(#[from] gif::EncodingError),
}

/// A GIF that grows frame by frame. The same pictures give the same bytes.
pub struct Gif {
    encoder: gif::Encoder<Vec<u8>>,
    palette: Palette,
    /// The last frame in numbers of colours, and its time in hundredths of a second.
    last: Vec<u8>,
    size: [usize; 2],
}

impl Gif {
    /// For pictures of `width · height` pixels.
    ///
    /// # Errors
    /// When a side is 0 or above 65535.
    pub fn new(width: usize, height: usize) -> Result<Self, GifError> {
        let refuse = || GifError::Size { width, height };
        let side = |pixels: usize| u16::try_from(pixels).ok().filter(|&side| side > 0).ok_or_else(refuse);
        let (columns, rows) = (side(width)?, side(height)?);
        let palette = Palette::new();
        let mut encoder = gif::Encoder::new(Vec::new(), columns, rows, &palette.colours.concat())?;
        encoder.set_repeat(gif::Repeat::Infinite)?;
        Ok(Self { encoder, palette, last: Vec::new(), size: [width, height] })
    }

    /// Shows a picture for a time, hundredths of a second. What hangs over is cut off.
    ///
    /// # Errors
    /// When the encoder refuses.
    pub fn push(&mut self, picture: &Rgb, time: u16) -> Result<(), GifError> {
        let [width, height] = self.size;
        let mut whole = Rgb::filled(width, height, colour::BACKGROUND);
        whole.paste(picture, 0, 0);
        let numbers: Vec<u8> = whole.data.chunks_exact(3).map(|c| self.palette.nearest([c[0], c[1], c[2]])).collect();
        let changed = |at: usize| self.last.get(at) != Some(&numbers[at]);
        let rows = (0..height).filter(|&y| (0..width).any(|x| changed(y * width + x)));
        let (top, bottom) = rows.fold((height, 0), |(top, bottom), y| (top.min(y), bottom.max(y + 1)));
        let columns = (0..width).filter(|&x| (top..bottom).any(|y| changed(y * width + x)));
        let (left, right) = columns.fold((width, 0), |(left, right), x| (left.min(x), right.max(x + 1)));
        // A picture like the one before still takes its time: one pixel of it.
        let (left, right, top, bottom) = if left < right { (left, right, top, bottom) } else { (0, 1, 0, 1) };
        let number = |at: usize| if changed(at) { numbers[at] } else { CLEAR };
        let pixels = (top..bottom).flat_map(|y| (left..right).map(move |x| y * width + x)).map(number).collect();
        self.encoder.write_frame(&gif::Frame {
            delay: time,
            dispose: gif::DisposalMethod::Keep,
            transparent: Some(CLEAR),
            left: left as u16,
            top: top as u16,
            width: (right - left) as u16,
            height: (bottom - top) as u16,
            buffer: Cow::Owned(pixels),
            ..gif::Frame::default()
        })?;
        self.last = numbers;
        Ok(())
    }

    /// The bytes of the file.
    ///
    /// # Errors
    /// When the encoder refuses.
    pub fn finish(self) -> Result<Vec<u8>, GifError> {
        Ok(self.encoder.into_inner()?)
    }
}

/// Number of the colour that lets the frame before show through.
const CLEAR: u8 = 255;

/// The pictures' own colours rather than those of one picture: no frame has to wait for the last.
struct Palette {
    colours: Vec<[u8; 3]>,
    /// By the upper six bits of red, green and blue, what was already looked up.
    known: Vec<Option<u8>>,
}

impl Palette {
    fn new() -> Self {
        let ramp = |count: usize, of: &dyn Fn(f32) -> [u8; 3]| -> Vec<[u8; 3]> {
            (0..count).map(|n| of(n as f32 / (count - 1) as f32)).collect()
        };
        let between = |from, to| move |t| colour::mix(from, to, t);
        let ramps = [
            ramp(64, &between(colour::BACKGROUND, colour::TEXT)),
            ramp(8, &between(colour::BACKGROUND, colour::FREE)),
            ramp(40, &colour::density),
            ramp(10, &between(colour::BACKGROUND, colour::UNSEEN)),
            ramp(6, &between(colour::FREE, colour::UNSEEN)),
            ramp(28, &colour::time),
            ramp(10, &|t| colour::mix(colour::BACKGROUND, colour::time(t), 0.5)),
            ramp(64, &colour::heat),
            ramp(14, &between(colour::BACKGROUND, colour::PLAN)),
            ramp(11, &between(colour::heat(0.4), colour::PLAN)),
        ];
        let mut colours = ramps.concat();
        colours.resize(256, colour::BACKGROUND);
        Self { colours, known: vec![None; 1 << 18] }
    }

    fn nearest(&mut self, [r, g, b]: [u8; 3]) -> u8 {
        let at = usize::from(r >> 2) << 12 | usize::from(g >> 2) << 6 | usize::from(b >> 2);
        if let Some(number) = self.known[at] {
            return number;
        }
        // Of the middle of its box, so that the first one asked for does not decide for the others.
        let middle = [r, g, b].map(|v| i32::from(v & !3) + 2);
        let distance = |colour: &[u8; 3]| -> i32 {
            // Eyes are better at green.
            (0..3).map(|n| [3, 6, 2][n] * (i32::from(colour[n]) - middle[n]).pow(2)).sum()
        };
        let colours = self.colours[..usize::from(CLEAR)].iter().enumerate();
        let number = colours.min_by_key(|(_, colour)| distance(colour)).map_or(0, |(number, _)| number as u8);
        self.known[at] = Some(number);
        number
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec2;

    /// What a viewer shows after each frame.
    fn shown(bytes: &[u8]) -> Vec<(Vec<u8>, u16)> {
        let mut options = gif::DecodeOptions::new();
        options.set_color_output(gif::ColorOutput::Indexed);
        let mut decoder = options.read_info(bytes).unwrap();
        let palette = decoder.global_palette().unwrap().to_vec();
        let width = usize::from(decoder.width());
        let mut canvas = vec![0; width * usize::from(decoder.height()) * 3];
        let mut all = Vec::new();
        while let Some(frame) = decoder.read_next_frame().unwrap() {
            for (n, &number) in
                frame.buffer.iter().enumerate().filter(|(_, number)| Some(**number) != frame.transparent)
            {
                let (x, y) = (n % usize::from(frame.width), n / usize::from(frame.width));
                let at = ((y + usize::from(frame.top)) * width + x + usize::from(frame.left)) * 3;
                canvas[at..at + 3].copy_from_slice(&palette[usize::from(number) * 3..][..3]);
            }
            all.push((canvas.clone(), frame.delay));
        }
        all
    }

    #[test]
    fn frames_come_back_nearly_as_they_were_and_cost_what_changes() {
        let mut pictures = vec![Rgb::filled(120, 80, colour::BACKGROUND)];
        for n in 0..3 {
            let mut next = pictures[n].clone();
            next.disc(Vec2::new(30.0 + 20.0 * n as f32, 40.0), 9.0, colour::time(n as f32 / 3.0), 1.0);
            next.text("step 1", Vec2::new(4.0, 4.0 + 12.0 * n as f32), 8.0, colour::TEXT);
            pictures.push(next);
        }
        pictures.push(pictures[3].clone());
        let encode = |pictures: &[Rgb]| {
            let mut gif = Gif::new(120, 80).unwrap();
            pictures.iter().enumerate().for_each(|(n, picture)| gif.push(picture, 5 + n as u16).unwrap());
            gif.finish().unwrap()
        };
        let bytes = encode(&pictures);
        assert_eq!(bytes, encode(&pictures));
        let frames = shown(&bytes);
        assert_eq!(frames.iter().map(|(_, delay)| *delay).collect::<Vec<_>>(), [5, 6, 7, 8, 9]);
        for ((found, _), picture) in frames.iter().zip(&pictures) {
            let off: Vec<u8> = found.iter().zip(&picture.data).map(|(a, b)| a.abs_diff(*b)).collect();
            let mean = off.iter().map(|&off| f64::from(off)).sum::<f64>() / off.len() as f64;
            // Soft edges between colours that never meet in these pictures are the worst of it.
            assert!(mean < 2.0 && off.iter().all(|&off| off < 64), "{mean} {:?}", off.iter().max());
        }
        let twice = encode(&[&pictures[..], &pictures[4..]].concat());
        assert!(twice.len() - bytes.len() < 40, "a frame in which nothing changes costs next to nothing");
        assert!(matches!(Gif::new(0, 5), Err(GifError::Size { .. })) && Gif::new(5, 70_000).is_err());
    }
}
