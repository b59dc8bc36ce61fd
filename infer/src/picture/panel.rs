//! Pictures side by side, each under its name.

use super::{Rgb, colour};
use glam::Vec2;

const GAP: usize = 18;
const HEAD: usize = 34;

/// Puts pictures in a row, tops aligned, each with a caption above.
pub fn beside(pictures: &[(&str, Rgb)]) -> Rgb {
    let width = GAP + pictures.iter().map(|(_, picture)| picture.width + GAP).sum::<usize>();
    let height = HEAD + pictures.iter().map(|(_, picture)| picture.height).max().unwrap_or(0) + GAP;
    let mut row = Rgb::filled(width, height, colour::BACKGROUND);
    let mut x = GAP;
    for (caption, picture) in pictures {
        row.text(caption, Vec2::new(x as f32, 12.0), 11.0, colour::TEXT);
        row.paste(picture, x, HEAD);
        x += picture.width + GAP;
    }
    row
}
