//! Images from PNG and JPEG files: how textures enter, whatever file names them.
//!
//! Sizes are checked against the header before anything is decoded, so a small file cannot ask for much memory.

use super::appearance::Image;
use png::{BitDepth, ColorType, Decoder, Limits, Transformations};
use std::io::Cursor;
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// Images of more pixels are refused: 4096 × 4096, four times the published texture.
const MAX_PIXELS: usize = 1 << 24;

/// Pixels that the images of one mesh may have together: eight of the largest.
pub const MAX_TOTAL: usize = 8 * MAX_PIXELS;

/// Most bytes that one byte of a deflate stream stands for, from the format's definition (RFC 1951).
const DEFLATE_RATIO: usize = 1032;

/// Why an image could not be read.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ImageError {
    /// Neither PNG nor JPEG.
    #[error("it is neither a PNG nor a JPEG file: convert it to one of them")]
    Format,
    /// No pixels, or more than are accepted.
    #[error("it has {width} x {height} pixels: from 1 to {MAX_PIXELS} are accepted (4096 x 4096); scale it down")]
    Size {
        /// From its header.
        width: usize,
        /// From its header.
        height: usize,
    },
    /// More pixels than a mesh may have.
    #[error("the images of the mesh have more than {MAX_TOTAL} pixels together: scale them down")]
    Total,
    /// More pixels than the file can hold.
    #[error(
        "its header says {width} x {height} pixels, more than its {bytes} bytes can hold: the file is cut off or broken"
    )]
    Cut {
        /// From its header.
        width: usize,
        /// From its header.
        height: usize,
        /// Length of the file.
        bytes: usize,
    },
    /// The decoder's reason.
    #[error("it is a broken {format} file: {reason}")]
    Broken {
        /// PNG or JPEG.
        format: &'static str,
        /// As the decoder says.
        reason: String,
    },
}

impl Image {
    /// Reads a PNG or JPEG file; its first bytes say which. Transparency is left out, grey and palettes become colours,
    /// 16 bits become 8.
    ///
    /// # Errors
    /// When the bytes are no such file, or too large an image.
    pub fn decode(bytes: &[u8]) -> Result<Self, ImageError> {
        if bytes.starts_with(b"\x89PNG") {
            decode_png(bytes)
        } else if bytes.starts_with(&[0xff, 0xd8]) {
            decode_jpeg(bytes)
        } else {
            Err(ImageError::Format)
        }
    }

    /// The same for one of several images: `used` counts their pixels, and past [`MAX_TOTAL`] nothing is decoded any more.
    ///
    /// # Errors
    /// As [`Self::decode`], and [`ImageError::Total`].
    pub fn decode_counted(bytes: &[u8], used: &mut usize) -> Result<Self, ImageError> {
        if *used <= MAX_TOTAL {
            let image = Self::decode(bytes)?;
            *used += image.pixels.len();
            if *used <= MAX_TOTAL {
                return Ok(image);
            }
        }
        Err(ImageError::Total)
    }

    fn of(width: usize, height: usize, pixels: Vec<[u8; 3]>) -> Self {
        Self { width, height, pixels }
    }
}

fn check_size(width: usize, height: usize) -> Result<(), ImageError> {
    match width.checked_mul(height) {
        Some(1..=MAX_PIXELS) => Ok(()),
        _ => Err(ImageError::Size { width, height }),
    }
}

fn decode_png(bytes: &[u8]) -> Result<Image, ImageError> {
    let broken = |reason: png::DecodingError| ImageError::Broken { format: "PNG", reason: reason.to_string() };
    let mut decoder = Decoder::new_with_limits(Cursor::new(bytes), Limits { bytes: 16 << 20 });
    decoder.set_transformations(Transformations::normalize_to_color8());
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    let header = decoder.read_header_info().map_err(broken)?;
    let (width, height) = (header.width as usize, header.height as usize);
    check_size(width, height)?;
    if header.raw_bytes() / DEFLATE_RATIO > bytes.len() {
        return Err(ImageError::Cut { width, height, bytes: bytes.len() });
    }
    let mut reader = decoder.read_info().map_err(broken)?;
    let (colour, depth) = reader.output_color_type();
    let samples = colour.samples();
    let size = reader.output_buffer_size().filter(|_| depth == BitDepth::Eight && colour != ColorType::Indexed);
    let mut buffer = vec![0; size.ok_or(ImageError::Size { width, height })?];
    reader.next_frame(&mut buffer).map_err(broken)?;
    let pixel = |p: &[u8]| if samples < 3 { [p[0]; 3] } else { [p[0], p[1], p[2]] };
    Ok(Image::of(width, height, buffer.chunks_exact(samples).map(pixel).collect()))
}

fn decode_jpeg(bytes: &[u8]) -> Result<Image, ImageError> {
    let broken = |reason: String| ImageError::Broken { format: "JPEG", reason };
    let side = usize::from(u16::MAX);
    let options = DecoderOptions::new_safe()
        .set_max_width(side)
        .set_max_height(side)
        .set_strict_mode(true)
        .jpeg_set_out_colorspace(ColorSpace::RGB);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    decoder.decode_headers().map_err(|e| broken(format!("{e:?}")))?;
    let info = decoder.info().ok_or_else(|| broken("it has no header".into()))?;
    let (width, height) = (usize::from(info.width), usize::from(info.height));
    check_size(width, height)?;
    let buffer = decoder.decode().map_err(|e| broken(format!("{e:?}")))?;
    let (pixels, rest) = buffer.as_chunks::<3>();
    if pixels.len() != width * height || !rest.is_empty() {
        return Err(broken(format!("it gives {} bytes for {width} x {height} pixels", buffer.len())));
    }
    Ok(Image::of(width, height, pixels.to_vec()))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Red on the left, blue on the right, 16 × 8 pixels.
    const JPEG: &[u8] = include_bytes!("fixtures/red_blue.jpg");

    /// A PNG file of one colour type.
    pub(in crate::scene) fn png(width: usize, height: usize, colour: ColorType, data: &[u8]) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, width as u32, height as u32);
        encoder.set_color(colour);
        encoder.set_depth(BitDepth::Eight);
        if colour == ColorType::Indexed {
            encoder.set_palette(vec![1, 2, 3, 40, 50, 60]);
        }
        let mut writer = encoder.write_header().unwrap();
        writer.write_image_data(data).unwrap();
        writer.finish().unwrap();
        bytes
    }

    #[test]
    fn the_images_of_a_mesh_have_a_limit() {
        let bytes = png(2, 1, ColorType::Rgb, &[9, 8, 7, 6, 5, 4]);
        let mut used = MAX_TOTAL - 3;
        assert!(Image::decode_counted(&bytes, &mut used).is_ok());
        assert_eq!(Image::decode_counted(&bytes, &mut used), Err(ImageError::Total));
        assert_eq!(Image::decode_counted(b"not even looked at", &mut used), Err(ImageError::Total));
    }

    #[test]
    fn every_colour_type_becomes_rows_of_rgb() {
        let expected = Image::of(2, 1, vec![[1, 2, 3], [40, 50, 60]]);
        assert_eq!(Image::decode(&png(2, 1, ColorType::Rgb, &[1, 2, 3, 40, 50, 60])), Ok(expected.clone()));
        assert_eq!(Image::decode(&png(2, 1, ColorType::Rgba, &[1, 2, 3, 0, 40, 50, 60, 255])), Ok(expected.clone()));
        assert_eq!(Image::decode(&png(2, 1, ColorType::Indexed, &[0, 1])), Ok(expected));
        let grey = Image::of(1, 2, vec![[7; 3], [9; 3]]);
        assert_eq!(Image::decode(&png(1, 2, ColorType::Grayscale, &[7, 9])), Ok(grey.clone()));
        assert_eq!(Image::decode(&png(1, 2, ColorType::GrayscaleAlpha, &[7, 0, 9, 8])), Ok(grey));
    }

    #[test]
    fn jpegs_are_read() {
        let image = Image::decode(JPEG).unwrap();
        assert_eq!((image.width, image.height), (16, 8));
        for (pixel, expected) in [(16, [200_u8, 30, 40]), (15 + 16, [20, 60, 220])] {
            let apart = |(a, b): (u8, u8)| a.abs_diff(b);
            let found = image.pixels[pixel];
            assert!(found.into_iter().zip(expected).map(apart).max() < Some(8), "{found:?}");
        }
    }

    #[test]
    fn broken_files_are_refused_whole_and_cut() {
        let good = png(3, 5, ColorType::Rgb, &[8; 45]);
        for file in [&good[..], JPEG] {
            let is_bad = |bytes: &[u8]| Image::decode(bytes).is_err();
            assert!(!is_bad(file));
            assert!((0..file.len() - 20).all(|length| is_bad(&file[..length])));
        }
        assert_eq!(Image::decode(b"GIF89a"), Err(ImageError::Format));
    }

    #[test]
    fn sizes_are_checked_before_pixels_are_made() {
        let resized = |file: &[u8], at: usize, side: &[u8]| {
            let mut file = file.to_vec();
            file[at..at + side.len()].copy_from_slice(side);
            file
        };
        let crc = |mut file: Vec<u8>| {
            let sum = crc32(&file[12..29]);
            file[29..33].copy_from_slice(&sum.to_be_bytes());
            file
        };
        let good = png(1, 1, ColorType::Rgb, &[8; 3]);
        let huge = crc(resized(&resized(&good, 16, &[0, 1, 0, 0]), 20, &[0, 1, 0, 0]));
        assert_eq!(Image::decode(&huge), Err(ImageError::Size { width: 65536, height: 65536 }));
        let large = crc(resized(&resized(&good, 16, &[0, 0, 8, 0]), 20, &[0, 0, 8, 0]));
        assert!(matches!(Image::decode(&large), Err(ImageError::Cut { width: 2048, .. })));
        let frame = JPEG.windows(2).position(|w| w == [0xff, 0xc0]).unwrap();
        let huge = resized(JPEG, frame + 5, &[0xff, 0xff, 0xff, 0xff]);
        assert_eq!(Image::decode(&huge), Err(ImageError::Size { width: 65535, height: 65535 }));
    }

    /// The checksum of PNG chunks.
    fn crc32(bytes: &[u8]) -> u32 {
        let step = |crc: u32, &byte: &u8| {
            (0..8).fold(crc ^ u32::from(byte), |c, _| if c & 1 == 1 { c >> 1 ^ 0xedb8_8320 } else { c >> 1 })
        };
        !bytes.iter().fold(!0, step)
    }
}
