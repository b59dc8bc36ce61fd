//! One image of many scenes, seen from above on the same scale, each with its name and figures.

use crate::draw::{Rgb, text_width};
use crate::picture::{BACKGROUND, Picture};
use glam::Vec2;
use nbp_env::Scene;

const TITLE: [u8; 3] = [222, 227, 236];
const FAINT: [u8; 3] = [138, 147, 163];
const CARD: [u8; 3] = [25, 29, 37];

/// Around and between cards, pixels.
const GAP: usize = 14;

/// Height of a card's caption, pixels.
const CAPTION: usize = 52;

/// Height of the foot with the scale bar, pixels.
const FOOT: usize = 44;

/// Pixels between a card's edge and what it shows.
const PAD: usize = 10;

/// A scene's place on the sheet.
#[derive(Debug, Clone)]
pub struct Tile {
    /// The scene from above.
    pub picture: Picture,
    /// In larger letters.
    pub name: String,
    /// In smaller letters.
    pub facts: String,
}

/// The largest side of a scene's plan, metres.
pub fn extent(scene: &Scene) -> f32 {
    let [low, high] = scene.mesh().bounds();
    (high.x - low.x).max(high.z - low.z)
}

/// Size of a pixel, metres, at which scenes fit on cards of a side in pixels.
pub fn pixel_for(scenes: impl Iterator<Item = f32>, side: usize) -> f32 {
    scenes.fold(1.0, f32::max) / side.saturating_sub(2 * PAD + 8).max(1) as f32
}

/// Puts tiles on a sheet, row by row; cards have a side in pixels.
pub fn sheet(tiles: &[Tile], side: usize, columns: usize, pixel: f32) -> Rgb {
    let columns = columns.clamp(1, tiles.len().max(1));
    let rows = tiles.len().div_ceil(columns);
    let (across, down) = (side + GAP, side + CAPTION + GAP);
    let mut image = Rgb::filled(columns * across + GAP, rows * down + GAP + FOOT, BACKGROUND);
    for (number, tile) in tiles.iter().enumerate() {
        let (x, y) = (GAP + number % columns * across, GAP + number / columns * down);
        let at = Vec2::new(x as f32, y as f32);
        image.block(at, at + Vec2::new(side as f32, (side + CAPTION) as f32), 8.0, CARD, 1.0);
        let view = &tile.picture.image;
        let middle = |length: usize| side.saturating_sub(length) / 2;
        image.paste_but(view, x + middle(view.width), y + middle(view.height), BACKGROUND);
        let room = side as f32 - 2.0 * PAD as f32;
        let caption = at + Vec2::new(PAD as f32, (side + 6) as f32);
        image.text(&fitted(&tile.name, 12.0, room), caption, 12.0, TITLE);
        image.text(&fitted(&tile.facts, 10.0, room), caption + Vec2::new(0.0, 22.0), 10.0, FAINT);
    }
    scale_bar(&mut image, pixel);
    image
}

/// The text, or as much of its beginning as fits into a width.
fn fitted(text: &str, size: f32, width: f32) -> String {
    let mut end = text.len();
    while end > 0 && text_width(&text[..end], size) > width {
        end = (0..end).rev().find(|&at| text.is_char_boundary(at)).unwrap_or(0);
    }
    text[..end].into()
}

/// A bar of 1, 2 or 5 times a power of ten metres, about a hundred pixels long.
fn scale_bar(image: &mut Rgb, pixel: f32) {
    let aim = 100.0 * pixel;
    let power = 10.0_f32.powf(aim.log10().floor());
    let metres = [5.0, 2.0, 1.0].into_iter().map(|n| n * power).find(|&m| m <= aim).unwrap_or(power);
    let (left, y) = (GAP as f32, image.height as f32 - FOOT as f32 / 2.0);
    let right = left + metres / pixel;
    image.line(Vec2::new(left, y), Vec2::new(right, y), 3.0, FAINT, 1.0);
    image.text(&format!("{metres} m"), Vec2::new(right + 10.0, y - 5.0), 10.0, FAINT);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_scene_has_its_card() {
        let scene = Scene::two_rooms();
        let pixel = pixel_for([extent(&scene)].into_iter(), 200);
        let tile =
            |n: usize| Tile { picture: Picture::of(&scene, pixel), name: format!("room {n}"), facts: "m²".into() };
        let image = sheet(&[tile(0), tile(1), tile(2)], 200, 2, pixel);
        assert_eq!((image.width, image.height), (2 * 214 + 14, 2 * 266 + 14 + 44));
        let colour = |x: usize, y: usize| {
            let at = 3 * (y * image.width + x);
            [image.data[at], image.data[at + 1], image.data[at + 2]]
        };
        assert_eq!(colour(GAP + 60, GAP + 100), [150; 3], "floor in the middle of a card");
        assert_eq!(colour(GAP + 214 + 100, GAP + 266 + 100), BACKGROUND, "three scenes, four places");
        assert_eq!(fitted("a long name", 12.0, 1e6), "a long name");
        assert!(text_width(&fitted("a very long name", 12.0, 50.0), 12.0) <= 50.0);
    }
}
