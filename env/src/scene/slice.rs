//! The mesh cut by the camera plane, as segments and as a grid of pixels: the ground truth of the obstacle map (paper,
//! section 4.3).

use crate::scene::Mesh;
use crate::window::{Window, WindowSize};
use glam::{Vec2, Vec3};

/// Half the drawn width of a wall, metres: the released maps show outlines 0.3–0.45 m wide.
const WALL_HALF_WIDTH: f32 = 0.2;

/// Segments, in `(x, z)`, along which a mesh crosses the plane `y = height`.
///
/// A vertex exactly on the plane counts as above it, so that neighbouring triangles agree.
pub fn slice_at(mesh: &Mesh, height: f32) -> Vec<[Vec2; 2]> {
    let crossing = |a: Vec3, b: Vec3| {
        ((a.y >= height) != (b.y >= height)).then(|| {
            // From the lower end whichever way the edge is named: both its triangles get the same point.
            let (a, b) = if a.y < b.y { (a, b) } else { (b, a) };
            let p = a.lerp(b, (height - a.y) / (b.y - a.y));
            Vec2::new(p.x, p.z)
        })
    };
    mesh.iter_corners()
        .filter_map(|[a, b, c]| {
            let mut ends = [crossing(a, b), crossing(b, c), crossing(c, a)].into_iter().flatten();
            Some([ends.next()?, ends.next()?])
        })
        .filter(|[a, b]| a != b)
        .collect()
}

/// The slice drawn on the world's pixel grid.
#[derive(Debug, Clone)]
pub struct ObstacleGrid {
    size: WindowSize,
    low: [i32; 2],
    shape: [usize; 2],
    blocked: Vec<bool>,
}

impl ObstacleGrid {
    /// Draws segments on the pixels of windows of `size`: a pixel is blocked when its middle is within 0.2 m of a
    /// segment, or within 0.71 pixels where that is more, so that a drawn wall has no gaps.
    pub fn draw(walls: &[[Vec2; 2]], size: WindowSize) -> Self {
        let pixel = size.pixel();
        let reach = WALL_HALF_WIDTH.max(0.71 * pixel);
        let [mut low, mut high] = [[i32::MAX; 2], [i32::MIN; 2]];
        let index = |v: f32| (v / pixel).floor() as i32;
        for p in walls.iter().flatten() {
            for (axis, v) in p.to_array().into_iter().enumerate() {
                low[axis] = low[axis].min(index(v - reach));
                high[axis] = high[axis].max(index(v + reach));
            }
        }
        let extent = |axis: usize| if walls.is_empty() { 0 } else { (high[axis] - low[axis] + 1) as usize };
        let shape = [extent(0), extent(1)];
        let mut grid = Self { size, low, shape, blocked: vec![false; shape[0] * shape[1]] };
        for &[a, b] in walls {
            let (from, to) = (a.min(b) - reach, a.max(b) + reach);
            for x in index(from.x)..=index(to.x) {
                for z in index(from.y)..=index(to.y) {
                    let middle = (Vec2::new(x as f32, z as f32) + 0.5) * pixel;
                    if distance_to_segment(middle, a, b) <= reach
                        && let Some(at) = grid.index([x, z])
                    {
                        grid.blocked[at] = true;
                    }
                }
            }
        }
        grid
    }

    /// Whether a world pixel is an obstacle.
    pub fn is_blocked(&self, world: [i32; 2]) -> bool {
        self.index(world).is_some_and(|at| self.blocked[at])
    }

    /// The window's obstacle map, row-major `S · S` of 0 and 1. The window must be of the size that was drawn.
    pub fn crop(&self, window: &Window) -> Vec<u8> {
        debug_assert_eq!(window.size, self.size);
        let side = window.size.pixels;
        (0..side * side).map(|at| u8::from(self.is_blocked(window.world_pixel(at / side, at % side)))).collect()
    }

    fn index(&self, [x, z]: [i32; 2]) -> Option<usize> {
        let column = usize::try_from(x.checked_sub(self.low[0])?).ok()?;
        let row = usize::try_from(z.checked_sub(self.low[1])?).ok()?;
        (column < self.shape[0] && row < self.shape[1]).then_some(column * self.shape[1] + row)
    }
}

fn distance_to_segment(p: Vec2, a: Vec2, b: Vec2) -> f32 {
    let along = b - a;
    let t = ((p - a).dot(along) / along.length_squared().max(f32::MIN_POSITIVE)).clamp(0.0, 1.0);
    p.distance(a + t * along)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Scene;

    #[test]
    fn the_slice_of_two_rooms_has_its_walls_and_its_door() {
        let scene = Scene::two_rooms();
        let size = WindowSize { pixels: 256, metres: 40.0 };
        let grid = ObstacleGrid::draw(scene.walls(), size);
        let blocked = |x, z| grid.is_blocked(size.world_pixel(Vec3::new(x, 0.0, z)));
        assert!(blocked(0.0, 4.0) && blocked(12.0, 4.0) && blocked(6.0, 1.0) && blocked(8.5, 6.3));
        assert!(!blocked(6.0, 4.0), "the door is open");
        assert!(!blocked(3.0, 4.0) && !blocked(20.0, 4.0));
    }

    #[test]
    fn crops_of_shifted_windows_show_the_same_walls() {
        let scene = Scene::two_rooms();
        let size = WindowSize { pixels: 64, metres: 40.0 };
        let grid = ObstacleGrid::draw(scene.walls(), size);
        let [a, b] = [Vec3::new(3.0, 1.65, 4.0), Vec3::new(9.3, 1.65, 2.0)].map(|p| size.around(p));
        let (crop_a, crop_b) = (grid.crop(&a), grid.crop(&b));
        for row in 0..64 {
            for col in 0..64 {
                if let Some((r, c)) = b.pixel_of(a.world_pixel(row, col)) {
                    assert_eq!(crop_a[row * 64 + col], crop_b[r * 64 + c]);
                }
            }
        }
        assert!(crop_a.contains(&1));
    }
}
