//! Scenes made up from numbers, for the tests of the sensor and for the benchmark.
//!
//! Plain vertices and triangles, so that this file can be compiled into the library's tests as well as into the bench.

use glam::Vec3;

/// Vertices in metres, `y` up, and corner indices.
pub(crate) type Soup = (Vec<Vec3>, Vec<[u32; 3]>);

/// Height of the ceiling of [`rooms`], metres.
pub(crate) const CEILING: f32 = 3.2;

/// A generator good enough to place walls (SplitMix64).
pub(crate) struct Dice(pub(crate) u64);

impl Dice {
    /// Uniform in `[low, high)`.
    pub(crate) fn between(&mut self, low: f32, high: f32) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        low + (high - low) * ((z ^ (z >> 31)) >> 40) as f32 / (1u64 << 24) as f32
    }

    /// Uniform in a box.
    pub(crate) fn point(&mut self, low: Vec3, high: Vec3) -> Vec3 {
        Vec3::new(self.between(low.x, high.x), self.between(low.y, high.y), self.between(low.z, high.z))
    }
}

/// The parallelogram `corner, corner + u, corner + u + v, corner + v`, cut into cells of at most `cell` metres.
fn panel(soup: &mut Soup, corner: Vec3, u: Vec3, v: Vec3, cell: f32) {
    let cuts = |side: Vec3| ((side.length() / cell).ceil() as u32).max(1);
    let (columns, rows, first) = (cuts(u), cuts(v), soup.0.len() as u32);
    for row in 0..=rows {
        for column in 0..=columns {
            let point = corner + u * (column as f32 / columns as f32) + v * (row as f32 / rows as f32);
            // Snapped, so that neighbouring panels meet in the same bits and the box is closed.
            soup.0.push((point * 4096.0).round() / 4096.0);
        }
    }
    for row in 0..rows {
        for column in 0..columns {
            let a = first + row * (columns + 1) + column;
            let c = a + columns + 1;
            soup.1.extend([[a, a + 1, c + 1], [a, c + 1, c]]);
        }
    }
}

/// The side faces of a box and, if asked for, its lid and bottom.
pub(crate) fn crate_box(soup: &mut Soup, low: Vec3, high: Vec3, cell: f32, lids: bool) {
    let d = high - low;
    let (x, y, z) = (Vec3::X * d.x, Vec3::Y * d.y, Vec3::Z * d.z);
    for (corner, u) in [(low, x), (low + x, z), (low + x + z, -x), (low + z, -z)] {
        panel(soup, corner, u, y, cell);
    }
    if lids {
        panel(soup, low, x, z, cell);
        panel(soup, low + y, x, z, cell);
    }
}

/// A closed house of `side / 6` by `side / 6` rooms with thick walls, doors and pillars; the longest edge of a triangle
/// is about `cell` metres.
pub(crate) fn rooms(side: f32, cell: f32, seed: u64) -> Soup {
    const ROOM: f32 = 6.0;
    const DOOR: f32 = 1.3;
    const LINTEL: f32 = 2.2;
    let (mut soup, mut dice) = (Soup::default(), Dice(seed));
    crate_box(&mut soup, Vec3::ZERO, Vec3::new(side, CEILING, side), cell, true);
    let lines = (side / ROOM).round() as usize;
    for axis in 0..2 {
        // `at(along, up, across)` puts walls of both directions through one piece of code.
        let at = |a: f32, y: f32, b: f32| if axis == 0 { Vec3::new(a, y, b) } else { Vec3::new(b, y, a) };
        for line in 1..lines {
            for room in 0..lines {
                let (start, end, across) = (room as f32 * ROOM, (room + 1) as f32 * ROOM, line as f32 * ROOM);
                if dice.between(0.0, 1.0) < 0.15 {
                    continue;
                }
                let door = dice.between(start + 0.6, end - 0.6 - DOOR);
                let half = dice.between(0.05, 0.15);
                let mut wall = |a: f32, b: f32, low: f32| {
                    let (p, q) = (at(a, low, across - half), at(b, CEILING, across + half));
                    crate_box(&mut soup, p, q, cell, low > 0.0);
                };
                wall(start, door, 0.0);
                wall(door, door + DOOR, LINTEL);
                wall(door + DOOR, end, 0.0);
            }
        }
    }
    for i in 0..lines * lines {
        let corner = Vec3::new((i % lines) as f32 * ROOM, 0.0, (i / lines) as f32 * ROOM);
        let base = corner + dice.point(Vec3::new(1.0, 0.0, 1.0), Vec3::new(4.5, 0.0, 4.5));
        let size = dice.point(Vec3::new(0.2, 0.5, 0.2), Vec3::new(0.8, CEILING, 0.8));
        crate_box(&mut soup, base, base + size, cell, true);
    }
    soup
}

/// Rolling ground, open to the sky, under `shards` slanted triangles of all sizes and some needles.
pub(crate) fn terrain(side: f32, cell: f32, shards: usize, seed: u64) -> Soup {
    let (mut soup, mut dice) = (Soup::default(), Dice(seed));
    panel(&mut soup, Vec3::ZERO, Vec3::X * side, Vec3::Z * side, cell);
    for v in &mut soup.0 {
        v.y = 0.5 * (v.x * 0.7).sin() * (v.z * 0.4).cos() + 0.2 * (v.x * 2.9 + v.z * 3.7).sin();
    }
    for _ in 0..shards {
        let size = dice.between(0.3, 1.4).powi(4);
        let first = soup.0.len() as u32;
        let corner = dice.point(Vec3::ZERO, Vec3::new(side, 4.0, side));
        let edge = dice.point(Vec3::splat(-size), Vec3::splat(size));
        let narrow = if dice.between(0.0, 1.0) < 0.2 { 0.02 } else { 1.0 };
        let other = dice.point(Vec3::splat(-size), Vec3::splat(size)) * narrow;
        soup.0.extend([corner, corner + edge, corner + edge * 0.5 + other]);
        soup.1.push([first, first + 1, first + 2]);
    }
    soup
}

/// A ball of `4 · rings · (rings - 1)` triangles, closed, every vertex shared. `radius` is asked for each vertex anew.
pub(crate) fn ball(centre: Vec3, rings: u32, mut radius: impl FnMut() -> f32) -> Soup {
    let mut soup = Soup::default();
    let columns = 2 * rings;
    soup.0.push(centre + Vec3::Y * radius());
    for ring in 1..rings {
        let polar = ring as f32 / rings as f32 * std::f32::consts::PI;
        for column in 0..columns {
            let turn = column as f32 / columns as f32 * std::f32::consts::TAU;
            let ground = Vec3::new(turn.sin(), 0.0, turn.cos()) * polar.sin();
            soup.0.push(centre + radius() * (ground + Vec3::Y * polar.cos()));
        }
    }
    soup.0.push(centre - Vec3::Y * radius());
    let last = soup.0.len() as u32 - 1;
    let at = |ring: u32, column: u32| match ring {
        0 => 0,
        r if r == rings => last,
        r => 1 + (r - 1) * columns + column % columns,
    };
    for ring in 0..rings {
        for column in 0..columns {
            let [a, b] = [at(ring, column), at(ring, column + 1)];
            let [c, d] = [at(ring + 1, column), at(ring + 1, column + 1)];
            soup.1.extend([[a, c, d], [a, d, b]].into_iter().filter(|t| t[0] != t[1] && t[1] != t[2] && t[2] != t[0]));
        }
    }
    soup
}
