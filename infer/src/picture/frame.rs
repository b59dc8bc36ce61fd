//! What stands around a map: title and figures above, scale bar and legend below, all larger where the map is.

use super::{Rgb, colour};
use glam::Vec2;
use nbp_dataset::draw::text_width;

const HEAD: f32 = 84.0;
const FOOT: f32 = 70.0;
const SIDE: f32 = 28.0;
/// Room for the legend in one line.
const NARROWEST: f32 = 800.0;
/// A picture of this side is drawn with lengths as they are written here.
const PLAIN: f32 = 1000.0;
const TEXT: f32 = 11.0;

/// The space around a map of a given size.
pub(super) struct Frame {
    map: Vec2,
    width: f32,
    /// Pixels for each length written here.
    pub(super) unit: f32,
}

impl Frame {
    /// For a map of `map` pixels.
    pub(super) fn around(map: Vec2) -> Self {
        let unit = (map.max_element() / PLAIN).clamp(1.0, 6.0);
        let width = (map.x + 2.0 * SIDE * unit).max(NARROWEST * unit);
        Self { map, width, unit }
    }

    /// Where the map's upper left corner goes.
    pub(super) fn corner(&self) -> Vec2 {
        Vec2::new((self.width - self.map.x) / 2.0, HEAD * self.unit).round()
    }

    pub(super) fn blank(&self) -> Rgb {
        let height = self.map.y + (HEAD + FOOT) * self.unit;
        Rgb::filled(self.width as usize, height as usize, colour::BACKGROUND)
    }

    pub(super) fn head(&self, image: &mut Rgb, title: &str, facts: &str) {
        let unit = self.unit;
        image.text(title, Vec2::new(SIDE, 20.0) * unit, 15.0 * unit, colour::TEXT);
        image.text(facts, Vec2::new(SIDE, 48.0) * unit, 10.5 * unit, colour::FAINT);
    }

    /// A bar of a round number of metres, both kinds of walls, and the colours of `steps` steps.
    pub(super) fn foot(&self, image: &mut Rgb, pixels_per_metre: f32, steps: usize) {
        let unit = self.unit;
        let text = TEXT * unit;
        let up = Vec2::new(0.0, 5.0 * unit);
        let line = image.height as f32 - FOOT / 2.0 * unit;
        let (left, right) = (SIDE * unit, image.width as f32 - SIDE * unit);
        let (names, bars) = (line - 13.0 * unit, line + 8.0 * unit);

        let lengths = [1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0];
        let long_enough = |metres: &f32| metres * pixels_per_metre >= 90.0 * unit;
        let metres = lengths.into_iter().find(long_enough).unwrap_or(1000.0);
        let ends = [left, left + metres * pixels_per_metre].map(|x| Vec2::new(x, bars));
        image.line(ends[0], ends[1], 2.4 * unit, colour::TEXT, 1.0);
        ends.into_iter().for_each(|end| image.line(end - up, end + up, 2.4 * unit, colour::TEXT, 1.0));
        let name = format!("{metres} m");
        let middle = (ends[0].x + ends[1].x - text_width(&name, text)) / 2.0;
        image.text(&name, Vec2::new(middle, names), text, colour::TEXT);

        let wide = 200.0 * unit;
        for x in 0..wide as usize {
            let at = Vec2::new(right - wide + x as f32 + 0.5, bars);
            image.line(at - up, at + up, 1.6, colour::time(x as f32 / wide), 1.0);
        }
        let last = steps.to_string();
        image.text("step 0", Vec2::new(right - wide, names), text, colour::TEXT);
        image.text(&last, Vec2::new(right - text_width(&last, text), names), text, colour::TEXT);

        let mut pen = right - wide - 28.0 * unit;
        for (name, ink) in [("wall not seen", colour::UNSEEN), ("wall seen", colour::SEEN)] {
            pen -= text_width(name, text);
            image.text(name, Vec2::new(pen, line), text, colour::TEXT);
            let from = Vec2::new(pen - 34.0 * unit, line + 5.0 * unit);
            image.line(from, from + Vec2::new(24.0 * unit, 0.0), 3.0 * unit, ink, 1.0);
            pen = from.x - 28.0 * unit;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn maps_of_all_sizes_fit_with_their_legend() {
        for size in [Vec2::new(100.0, 900.0), Vec2::new(1000.0, 300.0), Vec2::new(6000.0, 5000.0)] {
            let frame = Frame::around(size);
            let mut image = frame.blank();
            let free = Vec2::new(image.width as f32, image.height as f32) - frame.corner() - size;
            assert!(free.min_element() >= 20.0, "{size} {free}");
            let before = image.clone();
            frame.head(&mut image, "title", "facts");
            frame.foot(&mut image, 20.0, 100);
            assert_ne!(image, before);
            // The lines at the left end and at the right end are inside.
            assert_eq!(image.data[..3], before.data[..3]);
        }
    }
}
