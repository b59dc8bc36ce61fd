//! Images and what is drawn on them, without a graphics library: shapes with soft edges, and lettering.

mod canvas;
mod font;

pub use font::text_width;

/// An image, 8 bits for each of red, green and blue.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Rgb {
    /// Pixels from left to right.
    pub width: usize,
    /// Pixels from top to bottom.
    pub height: usize,
    /// `height · width · 3` bytes, rows from the top.
    pub data: Vec<u8>,
}

/// An image that has no PNG form.
#[derive(Debug, thiserror::Error)]
#[error("cannot encode a picture of {width} × {height} pixels: {source}")]
pub struct PictureError {
    width: usize,
    height: usize,
    source: png::EncodingError,
}

impl Rgb {
    /// One colour.
    pub fn filled(width: usize, height: usize, colour: [u8; 3]) -> Self {
        Self { width, height, data: colour.repeat(width * height) }
    }

    /// The bytes of a PNG file.
    ///
    /// # Errors
    /// When it has no pixels or too many.
    pub fn png(&self) -> Result<Vec<u8>, PictureError> {
        let refuse = |source| PictureError { width: self.width, height: self.height, source };
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width as u32, self.height as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        let mut writer = encoder.write_header().map_err(refuse)?;
        writer.write_image_data(&self.data).map_err(refuse)?;
        writer.finish().map_err(refuse)?;
        Ok(bytes)
    }

    /// Puts `other` on top, its upper left corner at `(x, y)`; what hangs over is cut off.
    pub fn paste(&mut self, other: &Self, x: usize, y: usize) {
        let columns = other.width.min(self.width.saturating_sub(x));
        for row in 0..other.height.min(self.height.saturating_sub(y)) {
            let (to, from) = (((y + row) * self.width + x) * 3, row * other.width * 3);
            self.data[to..to + columns * 3].copy_from_slice(&other.data[from..from + columns * 3]);
        }
    }

    /// The same for a smaller image that fits, but for pixels of one colour, which let the ground show through.
    pub fn paste_but(&mut self, other: &Self, x: usize, y: usize, clear: [u8; 3]) {
        for (row, column) in (0..other.height).flat_map(|row| (0..other.width).map(move |column| (row, column))) {
            let from = (row * other.width + column) * 3;
            let inside = x + column < self.width && y + row < self.height;
            if inside && other.data[from..from + 3] != clear {
                let to = ((y + row) * self.width + x + column) * 3;
                self.data[to..to + 3].copy_from_slice(&other.data[from..from + 3]);
            }
        }
    }

    /// The image at a size `1 / parts` of its own, each pixel the mean of `parts²`; what is left over at the right and the
    /// bottom is dropped.
    #[must_use]
    pub fn shrunk(&self, parts: usize) -> Self {
        let [width, height] = [self.width, self.height].map(|side| side / parts);
        let mean = |at: usize| {
            let (pixel, channel) = (at / 3, at % 3);
            let (x, y) = (pixel % width * parts, pixel / width * parts);
            let of = |n: usize| usize::from(self.data[((y + n / parts) * self.width + x + n % parts) * 3 + channel]);
            ((0..parts * parts).map(of).sum::<usize>() / (parts * parts)) as u8
        };
        Self { width, height, data: (0..3 * width * height).map(mean).collect() }
    }

    /// Colours a pixel of the image.
    pub fn set(&mut self, x: usize, y: usize, colour: [u8; 3]) {
        let at = (y * self.width + x) * 3;
        self.data[at..at + 3].copy_from_slice(&colour);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_png_comes_back_as_it_was() {
        let mut image = Rgb::filled(5, 3, [10, 20, 30]);
        image.paste(&Rgb::filled(4, 4, [200, 100, 0]), 3, 1);
        image.set(0, 0, [1, 2, 3]);
        let bytes = image.png().unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
        let mut data = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut data).unwrap();
        assert_eq!((info.width, info.height), (5, 3));
        assert_eq!(data, image.data);
        assert_eq!(data[(5 + 3) * 3..][..3], [200, 100, 0]);
        assert!(Rgb::filled(0, 0, [0; 3]).png().is_err());
    }

    #[test]
    fn a_shrunk_image_has_the_mean_colours() {
        let mut image = Rgb::filled(5, 4, [0; 3]);
        image.set(2, 1, [100, 40, 0]);
        image.set(3, 0, [100, 0, 8]);
        let small = image.shrunk(2);
        assert_eq!((small.width, small.height), (2, 2));
        assert_eq!(small.data[3..6], [50, 10, 2]);
        assert_eq!(small.data.iter().map(|&v| u32::from(v)).sum::<u32>(), 62);
    }
}
