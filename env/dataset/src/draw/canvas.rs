//! Antialiased shapes: every shape is a signed distance, and a pixel takes as much colour as it lies inside.

use super::Rgb;
use glam::Vec2;

/// Length of the part that two intervals share with the pixels `0..size`.
fn clip(low: f32, high: f32, size: usize) -> std::ops::Range<usize> {
    let end = (high + 1.0).clamp(0.0, size as f32) as usize;
    (low - 1.0).clamp(0.0, size as f32) as usize..end
}

impl Rgb {
    /// Mixes a share of a colour into a pixel.
    pub fn blend(&mut self, x: usize, y: usize, colour: [u8; 3], share: f32) {
        let at = (y * self.width + x) * 3;
        for (old, new) in self.data[at..at + 3].iter_mut().zip(colour) {
            *old = (f32::from(*old) + (f32::from(new) - f32::from(*old)) * share).round() as u8;
        }
    }

    /// Fills the inside of a shape that lies between `low` and `high`, given its signed distance in pixels.
    fn fill(&mut self, low: Vec2, high: Vec2, colour: [u8; 3], alpha: f32, distance: impl Fn(Vec2) -> f32) {
        for y in clip(low.y, high.y, self.height) {
            for x in clip(low.x, high.x, self.width) {
                let inside = 0.5 - distance(Vec2::new(x as f32 + 0.5, y as f32 + 0.5));
                if inside > 0.0 {
                    self.blend(x, y, colour, alpha * inside.min(1.0));
                }
            }
        }
    }

    /// A stroke with round ends, `width` pixels wide.
    pub fn line(&mut self, a: Vec2, b: Vec2, width: f32, colour: [u8; 3], alpha: f32) {
        let radius = width / 2.0;
        let along = b - a;
        self.fill(a.min(b) - radius, a.max(b) + radius, colour, alpha, |p| {
            let t = ((p - a).dot(along) / along.length_squared().max(1e-9)).clamp(0.0, 1.0);
            p.distance(a + t * along) - radius
        });
    }

    /// A disc.
    pub fn disc(&mut self, middle: Vec2, radius: f32, colour: [u8; 3], alpha: f32) {
        self.fill(middle - radius, middle + radius, colour, alpha, |p| p.distance(middle) - radius);
    }

    /// A circle's outline.
    pub fn ring(&mut self, middle: Vec2, radius: f32, width: f32, colour: [u8; 3]) {
        let reach = radius + width / 2.0;
        let distance = |p: Vec2| (p.distance(middle) - radius).abs() - width / 2.0;
        self.fill(middle - reach, middle + reach, colour, 1.0, distance);
    }

    /// A triangle, corners in either order.
    pub fn triangle(&mut self, corners: [Vec2; 3], colour: [u8; 3], alpha: f32) {
        let [a, b, c] = corners;
        let turn = (b - a).perp_dot(c - a).signum();
        let edge = |p: Vec2, from: Vec2, to: Vec2| -turn * (to - from).normalize_or_zero().perp_dot(p - from);
        let distance = |p| edge(p, a, b).max(edge(p, b, c)).max(edge(p, c, a));
        self.fill(a.min(b).min(c), a.max(b).max(c), colour, alpha, distance);
    }

    /// A rectangle with rounded corners.
    pub fn block(&mut self, low: Vec2, high: Vec2, radius: f32, colour: [u8; 3], alpha: f32) {
        let (middle, half) = ((low + high) / 2.0, (high - low) / 2.0 - radius);
        self.fill(low, high, colour, alpha, |p| {
            let outside = (p - middle).abs() - half;
            outside.max(Vec2::ZERO).length() + outside.max_element().min(0.0) - radius
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ink(image: &Rgb) -> f32 {
        image.data.iter().step_by(3).map(|&v| f32::from(v) / 255.0).sum()
    }

    #[test]
    fn shapes_have_their_area() {
        let blank = || Rgb::filled(64, 64, [0; 3]);
        let white = [255; 3];
        let close = |image: &Rgb, area: f32| assert!((ink(image) - area).abs() < 0.03 * area, "{} {area}", ink(image));
        let mut image = blank();
        image.disc(Vec2::splat(30.3), 12.0, white, 1.0);
        close(&image, std::f32::consts::PI * 144.0);
        let mut image = blank();
        image.line(Vec2::new(10.0, 12.0), Vec2::new(40.0, 52.0), 4.0, white, 1.0);
        close(&image, 50.0 * 4.0 + std::f32::consts::PI * 4.0);
        let mut image = blank();
        image.triangle([Vec2::new(5.0, 5.0), Vec2::new(50.0, 5.0), Vec2::new(5.0, 45.0)], white, 1.0);
        close(&image, 900.0);
        let mut image = blank();
        image.block(Vec2::new(10.0, 20.0), Vec2::new(50.0, 40.0), 0.0, white, 0.5);
        close(&image, 400.0);
    }

    #[test]
    fn what_lies_outside_is_cut_off() {
        let mut image = Rgb::filled(8, 8, [0; 3]);
        image.line(Vec2::splat(-100.0), Vec2::splat(200.0), 3.0, [9; 3], 1.0);
        image.disc(Vec2::new(1e6, -1e6), 5.0, [9; 3], 1.0);
        assert_eq!(image.data.len(), 8 * 8 * 3);
        assert_eq!(image.data[0], 9);
    }
}
