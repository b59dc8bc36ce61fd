//! Where the cloud has points, seen from above: what the released planner asks besides the network.

use crate::map::MapView;
use crate::map::grid::WorldGrid;
use crate::window::WindowSize;

/// Half the thickness of the slice of the cloud that counts as walls, metres (released planner).
const SLICE: f32 = 0.05;

/// What the points of a pixel are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Seen {
    /// There are none.
    #[default]
    Nothing,
    /// None is at the height of the camera.
    Open,
    /// Some are.
    Wall,
}

/// The cloud on the pixels of the window, grown with it.
#[derive(Debug, Default)]
pub(super) struct Projection {
    size: WindowSize,
    frames: usize,
    pixels: WorldGrid<Seen>,
}

impl Projection {
    /// Takes in the frames since the last time.
    pub(super) fn update(&mut self, view: &MapView<'_>) {
        self.size = view.window_size();
        for point in view.cloud().of_frames(self.frames) {
            let pixel = self.size.world_pixel(point);
            self.pixels.include(pixel, pixel);
            if let Some(seen) = self.pixels.get_mut(pixel) {
                let is_wall = *seen == Seen::Wall || (point.y - view.position().y).abs() <= SLICE;
                *seen = if is_wall { Seen::Wall } else { Seen::Open };
            }
        }
        self.frames = view.cloud().frames();
    }

    /// What a world pixel shows.
    pub(super) fn get(&self, pixel: [i32; 2]) -> Seen {
        self.pixels.get(pixel)
    }

    /// Whether a pixel with a point lies within so many metres along each axis.
    pub(super) fn is_near(&self, pixel: [i32; 2], metres: f32) -> bool {
        let reach = (metres / self.size.pixel()).round() as i32;
        let (low, shape) = self.pixels.extent();
        let range = |axis: usize| {
            let end = low[axis] + shape[axis] as i32 - 1;
            low[axis].max(pixel[axis].saturating_sub(reach))..=end.min(pixel[axis].saturating_add(reach))
        };
        range(0).any(|x| range(1).any(|z| self.get([x, z]) != Seen::Nothing))
    }
}
