//! A scene from above: floors by height or in their colours, walls at the camera plane, lattice, start positions.
//!
//! `+z` is up and `+x` left, as in every image of the project; a Doom map looks as it does in a map editor.

use crate::draw::Rgb;
use crate::stats::is_floor;
use glam::{Vec2, Vec3};
use nbp_env::Scene;
use nbp_env::scene::{Appearance, Paint};

/// A picture and where it lies in the plan.
#[derive(Debug, Clone)]
pub struct Picture {
    /// The image.
    pub image: Rgb,
    low: Vec2,
    pixel: f32,
}

/// Behind everything.
pub const BACKGROUND: [u8; 3] = [17, 20, 26];
const WALL: [u8; 3] = [235, 120, 40];
const NODE: [u8; 3] = [40, 90, 160];
const START: [u8; 3] = [200, 30, 30];

/// Pixels around the scene.
const MARGIN: usize = 4;

/// Pixels are drawn in this many parts a side and averaged.
const PARTS: usize = 3;

impl Picture {
    /// Draws floors and walls with pixels of a size in metres; at most 4096 pixels a side.
    pub fn of(scene: &Scene, pixel: f32) -> Self {
        let [low, high] = scene.mesh().bounds();
        let pixel = pixel.max((high - low).max_element() / 4000.0);
        let size = [high.x - low.x, high.z - low.z].map(|side| (side / pixel).ceil() as usize + 2 * MARGIN);
        let low = Vec2::new(low.x, low.z) - MARGIN as f32 * pixel;
        let [width, height] = size.map(|side| PARTS * side);
        let mut fine = Self { image: Rgb::filled(width, height, BACKGROUND), low, pixel: pixel / PARTS as f32 };
        let appearance = scene.mesh().appearance();
        for (triangle, corners) in scene.mesh().iter_corners().enumerate() {
            if !is_floor(scene, corners) {
                continue;
            }
            let paint = appearance.and_then(|a| Some((a, a.paints.get(triangle)?)));
            fine.floor(corners, |weights, height| match paint {
                Some((appearance, paint)) => colour(appearance, paint, weights),
                None => [(150.0 + 45.0 * height).clamp(70.0, 250.0) as u8; 3],
            });
        }
        for &[a, b] in scene.walls() {
            let [a, b] = [a, b].map(|p| fine.at(p));
            fine.image.line(a, b, 1.5 * PARTS as f32, WALL, 1.0);
        }
        Self { image: fine.image.shrunk(PARTS), low, pixel }
    }

    /// Adds lattice positions and starts.
    #[must_use]
    pub fn with_positions(mut self, scene: &Scene) -> Self {
        for &node in scene.graph().largest_component() {
            self.disc(scene.lattice().position(node), 0.7, NODE);
        }
        for start in scene.starts() {
            self.disc(scene.lattice().position(start.node), 3.0, START);
        }
        self
    }

    /// Column and row of a position, perhaps outside.
    fn at(&self, p: Vec2) -> Vec2 {
        let size = Vec2::new(self.image.width as f32, self.image.height as f32);
        size - (p - self.low) / self.pixel
    }

    fn disc(&mut self, p: Vec3, radius: f32, colour: [u8; 3]) {
        self.image.disc(self.at(Vec2::new(p.x, p.z)), radius, colour, 1.0);
    }

    /// Fills a face; `shade` gives the colour by barycentric weights and height.
    fn floor(&mut self, corners: [Vec3; 3], shade: impl Fn([f32; 3], f32) -> [u8; 3]) {
        let [a, b, c] = corners.map(|v| self.at(Vec2::new(v.x, v.z)));
        let area = (b - a).perp_dot(c - a);
        let (low, high) = (a.min(b).min(c).floor().max(Vec2::ZERO), a.max(b).max(c).ceil());
        let rows = low.y as usize..(high.y.max(0.0) as usize).min(self.image.height);
        for row in rows {
            for column in low.x as usize..(high.x.max(0.0) as usize).min(self.image.width) {
                // Middles of pixels, so that neighbouring triangles share none.
                let at = Vec2::new(column as f32, row as f32) + 0.5;
                let weights = [(b, c), (c, a), (a, b)].map(|(p, q)| (q - p).perp_dot(at - p) / area);
                if weights.iter().all(|&w| w >= 0.0) {
                    let height = corners.iter().zip(weights).map(|(corner, w)| corner.y * w).sum();
                    self.image.set(column, row, shade(weights, height));
                }
            }
        }
    }
}

/// Colour of a point of a painted triangle.
fn colour(appearance: &Appearance, paint: &Paint, weights: [f32; 3]) -> [u8; 3] {
    match paint {
        Paint::Corners(corners) => [0, 1, 2].map(|channel| {
            let mixed: f32 = corners.iter().zip(weights).map(|(corner, w)| w * f32::from(corner[channel])).sum();
            mixed.round() as u8
        }),
        Paint::Image { image, corners } => {
            let uv: Vec2 = corners.iter().zip(weights).map(|(&corner, w)| w * corner).sum();
            appearance.images.get(*image as usize).map_or([0; 3], |image| {
                let [column, up] = [(uv.x, image.width), (uv.y, image.height)]
                    .map(|(share, side)| (share.rem_euclid(1.0) * side as f32) as usize % side.max(1));
                image.pixels.get((image.height - 1 - up) * image.width + column).copied().unwrap_or_default()
            })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nbp_env::scene::Image;

    #[test]
    fn plus_z_is_up_and_plus_x_is_left() {
        let scene = Scene::two_rooms();
        let picture = Picture::of(&scene, 0.1).with_positions(&scene);
        let colour = |x: f32, z: f32| {
            let [column, row] = picture.at(Vec2::new(x, z)).to_array().map(|v| v as usize);
            let at = 3 * (row * picture.image.width + column);
            [picture.image.data[at], picture.image.data[at + 1], picture.image.data[at + 2]]
        };
        assert!(picture.at(Vec2::new(1.0, 8.0)).y < picture.at(Vec2::new(1.0, 1.0)).y);
        assert!(picture.at(Vec2::new(8.0, 1.0)).x < picture.at(Vec2::new(1.0, 1.0)).x);
        let [red, green, blue] = colour(0.0, 4.45);
        assert!(red > 100 && green < red && blue < green, "a wall at the edge: {red} {green} {blue}");
        assert_eq!(colour(2.0, 3.0), [150; 3], "floor");
        let [red, _, blue] = colour(0.75, 0.75);
        assert!(blue > red, "a position");
    }

    #[test]
    fn floors_show_their_paint() {
        let pixels = vec![[1, 0, 0], [2, 0, 0], [3, 0, 0], [4, 0, 0]];
        let appearance = Appearance { images: vec![Image { width: 2, height: 2, pixels }], paints: Vec::new() };
        let corners = [Vec2::ZERO, Vec2::new(1.0, 0.0), Vec2::new(0.0, 1.0)];
        let paint = Paint::Image { image: 0, corners };
        assert_eq!(colour(&appearance, &paint, [1.0, 0.0, 0.0]), [3, 0, 0], "v grows upwards");
        assert_eq!(colour(&appearance, &paint, [0.1, 0.8, 0.1]), [4, 0, 0]);
        assert_eq!(colour(&appearance, &Paint::Corners([[90, 0, 0], [0; 3], [0; 3]]), [0.5, 0.5, 0.0]), [45, 0, 0]);
    }
}
