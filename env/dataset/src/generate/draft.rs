//! A map under construction: polygons of air in layers, and the raster of what they leave free at the camera plane.

use super::raster::{Cover, Polygon, Raster, Rect};
use super::rooms::{BLOCK, Site};
use crate::doom_map::CAMERA_UNITS;

/// A polygon and the air above it; later pieces replace earlier ones.
#[derive(Clone, Debug)]
pub(crate) struct Piece {
    /// Outline.
    pub(crate) polygon: Polygon,
    /// Floor and ceiling, map units; `None` is solid.
    pub(crate) air: Option<(i32, i32)>,
}

impl Piece {
    /// What the camera meets here.
    fn cover(&self) -> Cover {
        let is_free =
            self.air.is_some_and(|(low, high)| f64::from(low) < CAMERA_UNITS && CAMERA_UNITS < f64::from(high));
        if is_free { Cover::Free } else { Cover::Blocked }
    }
}

/// A map under construction.
#[derive(Clone, Debug)]
pub(crate) struct Draft {
    /// Rooms and who has which lattice cell.
    pub(crate) site: Site,
    /// Doors, windows and corridors. They lie under the rooms, so they may reach into them.
    pub(crate) passages: Vec<Piece>,
    /// Boxes of the passages, kept free of furniture.
    pub(crate) mouths: Vec<Rect>,
    /// Pillars, crates, steps. They lie on the rooms.
    pub(crate) details: Vec<Piece>,
    /// What is free at the camera plane.
    pub(crate) raster: Raster,
}

impl Draft {
    /// Draws the rooms of a site.
    pub(crate) fn new(site: Site) -> Self {
        let mut raster = Raster::new(site.size[0] * BLOCK, site.size[1] * BLOCK);
        site.rooms.iter().for_each(|room| raster.fill(&room.polygon, Cover::Free));
        Self { site, passages: Vec::new(), mouths: Vec::new(), details: Vec::new(), raster }
    }

    /// Carves a passage.
    pub(crate) fn carve(&mut self, rect: Rect, floor: i32, ceiling: i32) {
        self.raster.fill(&rect.polygon(), Cover::Free);
        self.mouths.push(rect);
        self.passages.push(Piece { polygon: rect.polygon(), air: Some((floor, ceiling)) });
    }

    /// Places furniture on what is there.
    pub(crate) fn place(&mut self, polygon: Polygon, air: Option<(i32, i32)>) {
        let piece = Piece { polygon, air };
        self.raster.fill(&piece.polygon, piece.cover());
        self.details.push(piece);
    }

    /// All pieces, from the lowest layer to the highest.
    pub(crate) fn pieces(&self) -> Vec<Piece> {
        let room_piece =
            |room: &super::rooms::Room| Piece { polygon: room.polygon.clone(), air: Some((room.floor, room.ceiling)) };
        let rooms = self.site.rooms.iter().map(room_piece);
        self.passages.iter().cloned().chain(rooms).chain(self.details.iter().cloned()).collect()
    }

    /// The rectangle of a passage through the wall at `middle` along an axis (0 is `x`), from free space to free space
    /// over its whole width; `None` when furniture is in the way or the wall is thicker than `reach` on a side.
    pub(crate) fn bridge(&self, middle: [i32; 2], axis: usize, width: i32, reach: i32) -> Option<Rect> {
        let low = middle[axis] - self.free_ahead(middle, axis, -1, width, reach)?;
        let high = middle[axis] + self.free_ahead(middle, axis, 1, width, reach)?;
        let mut rect = Rect::around(middle, [width; 2]);
        (rect.low[axis], rect.high[axis]) = (low, high);
        Some(rect)
    }

    /// Distance from `from` in a direction to where a slab of the given width is free, that slab included.
    pub(crate) fn free_ahead(&self, from: [i32; 2], axis: usize, sign: i32, width: i32, reach: i32) -> Option<i32> {
        const STEP: i32 = super::raster::CELL;
        for distance in (0..=reach).step_by(STEP as usize) {
            let mut slab = Rect::around(from, [width; 2]);
            let near = from[axis] + sign * distance;
            (slab.low[axis], slab.high[axis]) = (near.min(near + sign * STEP), near.max(near + sign * STEP));
            if self.raster.all(slab, |cover| cover == Cover::Free) {
                return Some(distance + STEP);
            }
            if !self.raster.all(slab, |cover| cover != Cover::Blocked) {
                return None;
            }
        }
        None
    }
}
