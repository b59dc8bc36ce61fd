//! A scene from above at the height of the camera: what pictures of episodes are drawn on.

use glam::{Vec2, Vec3};
use nbp_env::Scene;
use nbp_env::scene::slice::ObstacleGrid;
use nbp_env::window::WindowSize;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// What is at a place of the camera plane.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tile {
    /// Not in the building, or inside of what fills it.
    Outside,
    /// Air of the building.
    Free,
    /// A surface passes within 0.2 m.
    Wall,
}

/// A raster of the camera plane.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FloorPlan {
    /// Corner with the smallest `x` and `z`, metres: the outer corner of tile 0.
    pub low: [f32; 2],
    /// Side of a tile, metres.
    pub metres_per_pixel: f32,
    /// Tiles along `x`.
    pub width: usize,
    /// Tiles along `z`.
    pub height: usize,
    /// `height` rows of `width`, `x` running fastest: the tile of `(x, z)` is number `z · width + x`.
    #[serde(with = "runs")]
    pub tiles: Vec<Tile>,
}

/// Side of a tile, metres.
const PIXEL: f32 = 0.25;
/// Longest side of a plan, tiles: larger scenes get larger tiles.
const LONGEST: f32 = 1000.0;
/// Room around the walls, metres.
const MARGIN: f32 = 0.5;

impl FloorPlan {
    /// Of a scene. The number of threads does not matter.
    pub fn of(scene: &Scene) -> Self {
        let ends = scene.walls().iter().flatten();
        let start = Vec2::new(scene.lattice().origin.x, scene.lattice().origin.z);
        let [low, high] = ends.fold([start; 2], |[low, high], &p| [low.min(p), high.max(p)]);
        let pixel = PIXEL.max((high - low).max_element() / LONGEST);
        // On the grid of pixels that walls are drawn on.
        let first = ((low - MARGIN) / pixel).floor();
        let shape = ((high + MARGIN) / pixel).ceil() - first;
        let (width, height) = (shape.x as usize, shape.y as usize);
        let walls = ObstacleGrid::draw(scene.walls(), WindowSize { pixels: 1, metres: pixel });
        let tile = |at: usize| {
            let [x, z] = [first.x as i32 + (at % width) as i32, first.y as i32 + (at / width) as i32];
            let middle = (Vec2::new(x as f32, z as f32) + 0.5) * pixel;
            let place = Vec3::new(middle.x, scene.lattice().origin.y, middle.y);
            match walls.is_blocked([x, z]) {
                true => Tile::Wall,
                false if scene.graph().interior().contains(scene.rays(), place) => Tile::Free,
                false => Tile::Outside,
            }
        };
        let tiles = (0..width * height).into_par_iter().map(tile).collect();
        Self { low: (first * pixel).to_array(), metres_per_pixel: pixel, width, height, tiles }
    }

    /// The tile at a position in metres; outside of the raster there is nothing.
    pub fn at(&self, [x, z]: [f32; 2]) -> Tile {
        let index = |v: f32, low: f32| ((v - low) / self.metres_per_pixel).floor();
        let (x, z) = (index(x, self.low[0]), index(z, self.low[1]));
        let is_in = (0.0..self.width as f32).contains(&x) && (0.0..self.height as f32).contains(&z);
        let tile = is_in.then(|| self.tiles.get(z as usize * self.width + x as usize)).flatten();
        tile.copied().unwrap_or(Tile::Outside)
    }
}

/// Tiles as text: how many of which, `12.3#40 9#`.
mod runs {
    use super::Tile;
    use serde::{Deserialize as _, Deserializer, Serializer, de::Error as _};
    use std::fmt::Write as _;

    /// More tiles than any plan has.
    const MOST: usize = 4_000_000;

    const LETTERS: [(Tile, char); 3] = [(Tile::Outside, '.'), (Tile::Free, ' '), (Tile::Wall, '#')];

    pub(super) fn serialize<S: Serializer>(tiles: &[Tile], to: S) -> Result<S::Ok, S::Error> {
        let mut text = String::new();
        for run in tiles.chunk_by(|a, b| a == b) {
            let letter = LETTERS.iter().find(|(tile, _)| *tile == run[0]).map_or('.', |(_, letter)| *letter);
            let _ = write!(text, "{}{letter}", run.len());
        }
        to.serialize_str(&text)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<Tile>, D::Error> {
        let text = String::deserialize(from)?;
        let mut tiles = Vec::new();
        for run in text.split_inclusive(|c: char| !c.is_ascii_digit()) {
            let found = LETTERS.iter().find_map(|(tile, letter)| Some((*tile, run.strip_suffix(*letter)?)));
            let run = found.and_then(|(tile, count)| Some((tile, count.parse::<usize>().ok()?)));
            match run.filter(|(_, count)| tiles.len().saturating_add(*count) <= MOST) {
                Some((tile, count)) => tiles.resize(tiles.len() + count, tile),
                None => return Err(D::Error::custom("not a run of tiles")),
            }
        }
        Ok(tiles)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plan_has_the_walls_and_the_air_of_its_scene_and_comes_back_from_text() {
        let scene = Scene::two_rooms();
        let plan = FloorPlan::of(&scene);
        for &node in scene.graph().largest_component() {
            let place = scene.lattice().position(node);
            assert_eq!(plan.at([place.x, place.z]), Tile::Free, "{place}");
        }
        assert_eq!([plan.at([0.0, 4.0]), plan.at([6.0, 1.0]), plan.at([8.5, 6.3])], [Tile::Wall; 3]);
        assert_eq!([plan.at([-0.4, 4.0]), plan.at([1e9, 4.0]), plan.at([f32::NAN, 0.0])], [Tile::Outside; 3]);
        assert_eq!(plan.tiles.len(), plan.width * plan.height);
        let text = serde_json::to_string(&plan).unwrap();
        assert_eq!(serde_json::from_str::<FloorPlan>(&text).unwrap(), plan);
        for wrong in ["12", "x#", "9999999999#", "-3#", "3?"] {
            let text = text.replace(text.split("\"tiles\":\"").nth(1).unwrap().split('"').next().unwrap(), wrong);
            assert!(serde_json::from_str::<FloorPlan>(&text).is_err(), "{wrong}");
        }
    }
}
