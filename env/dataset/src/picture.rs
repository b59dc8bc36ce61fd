//! A scene from above as an image: floors by height, walls at the camera plane, lattice, start positions.
//!
//! `+z` is up and `+x` left, as in every image of the project; a Doom map looks as it does in a map editor.

use glam::{Vec2, Vec3};
use nbp_env::Scene;

/// An RGB image, rows from the top.
#[derive(Debug, Clone)]
pub struct Picture {
    /// Pixels along a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `3 · width · height` bytes.
    pub rgb: Vec<u8>,
    low: Vec2,
    pixel: f32,
}

const BACKGROUND: [u8; 3] = [28, 30, 34];
const WALL: [u8; 3] = [235, 120, 40];
const NODE: [u8; 3] = [40, 90, 160];
const START: [u8; 3] = [200, 30, 30];

impl Picture {
    /// Draws a scene with pixels of a size in metres; at most 4096 pixels a side.
    pub fn of(scene: &Scene, pixel: f32) -> Self {
        let [low, high] = scene.mesh().bounds();
        let pixel = pixel.max((high - low).max_element() / 4000.0);
        let [width, height] = [high.x - low.x, high.z - low.z].map(|side| (side / pixel).ceil() as usize + 8);
        let low = Vec2::new(low.x, low.z) - 4.0 * pixel;
        let mut picture = Self { width, height, rgb: BACKGROUND.repeat(width * height), low, pixel };
        for corners in scene.mesh().iter_corners() {
            picture.floor(corners);
        }
        for wall in scene.walls() {
            picture.line(wall[0], wall[1], WALL);
        }
        for &node in scene.graph().largest_component() {
            let p = scene.lattice().position(node);
            picture.dot(Vec2::new(p.x, p.z), NODE, 0);
        }
        for start in scene.starts() {
            let p = scene.lattice().position(start.node);
            picture.dot(Vec2::new(p.x, p.z), START, 2);
        }
        picture
    }

    /// Column and row of a position, perhaps outside.
    fn at(&self, p: Vec2) -> [i32; 2] {
        let q = (p - self.low) / self.pixel;
        [self.width as i32 - 1 - q.x as i32, self.height as i32 - 1 - q.y as i32]
    }

    fn set(&mut self, [column, row]: [i32; 2], colour: [u8; 3]) {
        let inside = (0..self.width as i32).contains(&column) && (0..self.height as i32).contains(&row);
        if inside {
            let at = 3 * (row as usize * self.width + column as usize);
            self.rgb[at..at + 3].copy_from_slice(&colour);
        }
    }

    fn floor(&mut self, [a, b, c]: [Vec3; 3]) {
        let normal = (b - a).cross(c - a);
        if normal.y <= 0.5 * normal.length() {
            return;
        }
        let shade = (150.0 + 45.0 * a.y).clamp(70.0, 250.0) as u8;
        let [a, b, c] = [a, b, c].map(|v| Vec2::new(v.x, v.z));
        let side = |p: Vec2, q: Vec2, at: Vec2| (q - p).perp_dot(at - p);
        let (low, high) = (a.min(b).min(c), a.max(b).max(c));
        let steps = ((high - low) / self.pixel).ceil();
        for (u, v) in (0..=steps.x as i32).flat_map(|u| (0..=steps.y as i32).map(move |v| (u, v))) {
            // Middles of pixels, so that neighbouring triangles share none.
            let middle = (((low - self.low) / self.pixel).floor() + Vec2::new(u as f32, v as f32) + 0.5) * self.pixel;
            let at = self.low + middle;
            // Seen from above with x to the left the order is clockwise.
            if side(a, b, at) <= 0.0 && side(b, c, at) <= 0.0 && side(c, a, at) <= 0.0 {
                self.set(self.at(at), [shade, shade, shade]);
            }
        }
    }

    fn line(&mut self, a: Vec2, b: Vec2, colour: [u8; 3]) {
        let steps = (a.distance(b) / self.pixel).ceil().max(1.0) as i32;
        for step in 0..=steps {
            self.set(self.at(a.lerp(b, step as f32 / steps as f32)), colour);
        }
    }

    fn dot(&mut self, p: Vec2, colour: [u8; 3], radius: i32) {
        let [column, row] = self.at(p);
        for (dx, dy) in (-radius..=radius).flat_map(|dx| (-radius..=radius).map(move |dy| (dx, dy))) {
            self.set([column + dx, row + dy], colour);
        }
    }

    /// The image as a PNG file.
    ///
    /// # Errors
    /// When the encoder refuses.
    pub fn png(&self) -> Result<Vec<u8>, png::EncodingError> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, self.width as u32, self.height as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        let mut writer = encoder.write_header()?;
        writer.write_image_data(&self.rgb)?;
        writer.finish()?;
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plus_z_is_up_and_plus_x_is_left() {
        let picture = Picture::of(&Scene::two_rooms(), 0.1);
        let colour = |x: f32, z: f32| {
            let [column, row] = picture.at(Vec2::new(x, z)).map(|v| v as usize);
            let at = 3 * (row * picture.width + column);
            [picture.rgb[at], picture.rgb[at + 1], picture.rgb[at + 2]]
        };
        assert!(picture.at(Vec2::new(1.0, 8.0))[1] < picture.at(Vec2::new(1.0, 1.0))[1]);
        assert!(picture.at(Vec2::new(8.0, 1.0))[0] < picture.at(Vec2::new(1.0, 1.0))[0]);
        assert_eq!(colour(0.0, 4.4), WALL);
        assert_eq!(colour(0.75, 0.75), NODE);
        assert!(picture.png().unwrap().starts_with(b"\x89PNG"));
    }
}
