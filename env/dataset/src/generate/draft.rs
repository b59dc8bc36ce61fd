//! A map under construction: polygons of air in layers, what is built on and under them, and the raster of what all that
//! leaves free at the camera plane.

use super::outline::Polygon;
use super::raster::{CELL, Cover, Raster, Rect};
use super::rooms::{BLOCK, Room, Site};
use super::theme::{Air, Surface, Theme};
use crate::doom_map::{CAMERA_UNITS, Name};

/// A polygon of air; later ones replace earlier ones.
#[derive(Clone, Debug)]
pub(crate) struct Space {
    /// Outline.
    pub(crate) polygon: Polygon,
    /// What is in it.
    pub(crate) air: Air,
}

/// Where details are built.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Host {
    /// In a door, window or corridor.
    Passage(usize),
    /// In a room.
    Room(usize),
}

/// What a detail changes.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Change {
    /// No air is left; the texture of its sides.
    Solid(Name),
    /// Another floor. The air ends where it reaches the ceiling.
    Floor(Surface),
    /// Another ceiling, and light added to the room's.
    Ceiling(Surface, i16),
}

/// A change of the air in a part of its host; the later of two changes of a kind counts.
#[derive(Clone, Debug)]
pub(crate) struct Detail {
    /// Outline; what lies outside of the host is left alone.
    pub(crate) polygon: Polygon,
    /// Where it is.
    pub(crate) host: Host,
    /// What it does.
    pub(crate) change: Change,
}

/// A map under construction.
#[derive(Clone, Debug)]
pub(crate) struct Draft {
    /// Rooms and who has which lattice cell.
    pub(crate) site: Site,
    /// Recesses of walls, under all else: they may reach into the space they open to.
    pub(crate) niches: Vec<Space>,
    /// Doors, windows and corridors. They lie under the rooms, so they may reach into them.
    pub(crate) passages: Vec<Space>,
    /// Boxes of doors, windows and corridors, kept free of furniture.
    pub(crate) mouths: Vec<Rect>,
    /// Pillars, crates, steps, lamps.
    pub(crate) details: Vec<Detail>,
    /// What is free at the camera plane.
    pub(crate) raster: Raster,
    /// Materials.
    pub(crate) theme: &'static Theme,
}

impl Draft {
    /// Draws the rooms of a site.
    pub(crate) fn new(site: Site, theme: &'static Theme) -> Self {
        let mut raster = Raster::new(site.size[0] * BLOCK, site.size[1] * BLOCK);
        site.rooms.iter().for_each(|room| raster.fill(&room.polygon, Cover::Free));
        Self { site, niches: Vec::new(), passages: Vec::new(), mouths: Vec::new(), details: Vec::new(), raster, theme }
    }

    /// The room with a number; callers only name rooms that exist.
    pub(crate) fn room(&self, number: usize) -> &Room {
        &self.site.rooms[number]
    }

    /// Carves a passage.
    pub(crate) fn carve(&mut self, rect: Rect, air: Air) {
        self.raster.fill(&rect.polygon(), Cover::Free);
        self.mouths.push(rect);
        self.passages.push(Space { polygon: rect.polygon(), air });
    }

    /// Builds something in a room that the camera may meet.
    pub(crate) fn furnish(&mut self, room: usize, polygon: Polygon, change: Change) {
        let is_met = match change {
            Change::Solid(_) => true,
            Change::Floor(top) => f64::from(top.height) > CAMERA_UNITS,
            Change::Ceiling(..) => false,
        };
        if is_met {
            self.raster.fill(&polygon, Cover::Blocked);
        }
        self.decorate(Host::Room(room), polygon, change);
    }

    /// Builds something that the camera does not meet.
    pub(crate) fn decorate(&mut self, host: Host, polygon: Polygon, change: Change) {
        self.details.push(Detail { polygon, host, change });
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
        for distance in (0..=reach).step_by(CELL as usize) {
            let mut slab = Rect::around(from, [width; 2]);
            let near = from[axis] + sign * distance;
            (slab.low[axis], slab.high[axis]) = (near.min(near + sign * CELL), near.max(near + sign * CELL));
            if self.raster.all(slab, |cover| cover == Cover::Free) {
                return Some(distance + CELL);
            }
            if !self.raster.all(slab, |cover| cover != Cover::Blocked) {
                return None;
            }
        }
        None
    }
}
