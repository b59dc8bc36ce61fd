//! The agent's map: counts that do not depend on when they were counted, and a plane that is carved up to the hits.

use super::{MANY, for_all, point};
use glam::{Vec2, Vec3};
use nbp_env::map::occupancy::{CELL, Cell, OccupancyGrid};
use nbp_env::map::{DensityGrid, Layers};
use nbp_env::sensor::{Camera, Frame};
use nbp_env::window::{Window, WindowSize};
use nbp_env::{Pose, Rng};
use rand::RngExt as _;
use rand::seq::SliceRandom as _;

const SIZE: WindowSize = WindowSize { pixels: 16, metres: 5.0 };

fn crop(grid: &DensityGrid, window: &Window) -> Vec<u16> {
    let mut out = vec![7; grid.layer_count() * SIZE.pixels * SIZE.pixels];
    grid.crop(window, &mut out);
    out
}

#[test]
fn counts_do_not_depend_on_when_they_were_counted() {
    for_all("counts_do_not_depend_on_when_they_were_counted", MANY, |rng| {
        let layers = Layers { count: rng.random_range(1..6), ..Layers::default() };
        let floor = rng.random_range(-2.0..4.0_f32);
        // On both sides of the origin, or far from it.
        let offset = if rng.random_bool(0.5) { Vec3::ZERO } else { point(rng, 900.0) * Vec3::new(1.0, 0.0, 1.0) };
        let frames: Vec<Vec<Vec3>> = (0..rng.random_range(1..6))
            .map(|_| (0..rng.random_range(0..40)).map(|_| offset + floor * Vec3::Y + point(rng, 6.0)).collect())
            .collect();
        let new = || DensityGrid::new(SIZE, layers, floor);
        let (mut step_by_step, mut at_once, mut backwards) = (new(), new(), new());
        frames.iter().for_each(|frame| step_by_step.add(frame));
        at_once.add(&frames.concat());
        frames.iter().rev().for_each(|frame| backwards.add(frame));

        let shift = Vec3::new(rng.random_range(-9.0..9.0), 0.0, rng.random_range(-9.0..9.0));
        let window = SIZE.around(offset + floor * Vec3::Y + shift);
        let image = crop(&step_by_step, &window);
        assert_eq!(image, crop(&at_once, &window));
        assert_eq!(image, crop(&backwards, &window));

        // Against the definition, point by point and pixel by pixel.
        let mut expected = vec![0; image.len()];
        for &p in frames.iter().flatten() {
            if let (Some(layer), Some((row, col))) = (layers.layer(p.y, floor), window.pixel(p)) {
                expected[(layer * SIZE.pixels + row) * SIZE.pixels + col] += 1;
            }
        }
        assert_eq!(image, expected);
        for (row, col) in (0..SIZE.pixels).flat_map(|row| (0..SIZE.pixels).map(move |col| (row, col))) {
            let in_layers = (0..layers.count).map(|k| u32::from(image[(k * SIZE.pixels + row) * SIZE.pixels + col]));
            assert_eq!(step_by_step.total(window.world_pixel(row, col)), in_layers.sum::<u32>());
        }

        // A window that lies some pixels further shows the same, moved by so many pixels.
        let [dx, dz] = [(); 2].map(|()| rng.random_range(-20..=20_i32));
        let moved = Window { centre: [window.centre[0] + dx, window.centre[1] + dz], ..window };
        let other = crop(&step_by_step, &moved);
        for (row, col) in (0..SIZE.pixels).flat_map(|row| (0..SIZE.pixels).map(move |col| (row, col))) {
            if let Some((r, c)) = moved.pixel_of(window.world_pixel(row, col)) {
                for k in 0..layers.count {
                    let at = |row: usize, col: usize| (k * SIZE.pixels + row) * SIZE.pixels + col;
                    assert_eq!(image[at(row, col)], other[at(r, c)]);
                }
            }
        }
    });
}

/// A frame, and where its horizon hits: the depth image needs no scene.
fn scan(rng: &mut Rng, offset: Vec3) -> (Camera, Pose, Frame) {
    let camera = Camera {
        width: rng.random_range(1..24),
        height: rng.random_range(1..4),
        hfov_degrees: rng.random_range(30.0..150.0),
        range: 35.0,
    };
    let pose = Pose { position: offset + point(rng, 3.0), azimuth: rng.random_range(-7.0..7.0) };
    let depth = |rng: &mut Rng| if rng.random_bool(0.2) { 0.0 } else { rng.random_range(0.01..6.0) };
    let depth = (0..camera.width * camera.height).map(|_| depth(rng)).collect();
    (camera, pose, Frame { width: camera.width, height: camera.height, depth, ..Frame::default() })
}

#[test]
fn the_plane_is_carved_up_to_the_hits() {
    for_all("the_plane_is_carved_up_to_the_hits", MANY, |rng| {
        let offset = if rng.random_bool(0.5) { Vec3::ZERO } else { point(rng, 500.0) };
        let mut scans: Vec<_> = (0..rng.random_range(1..4)).map(|_| scan(rng, offset)).collect();
        let carved = |scans: &[(Camera, Pose, Frame)]| {
            let mut grid = OccupancyGrid::default();
            scans.iter().for_each(|(camera, pose, frame)| grid.carve(camera, pose, frame));
            grid
        };
        let grid = carved(&scans);
        let flat = |p: Vec3| Vec2::new(p.x, p.z);
        // The way of each ray from the camera to its hit, and where the hit is filed: a surface on the border of two cells
        // belongs to the farther one.
        let mut ways: Vec<[Vec2; 2]> = Vec::new();
        for (camera, pose, frame) in &scans {
            for col in 0..frame.width {
                let row = frame.height / 2;
                if let Some(depth) = frame.at(col, row) {
                    let hit = camera.at(pose).unproject(col, row, depth);
                    let hit = hit + 0.02 * (hit - pose.position).normalize();
                    ways.push([flat(pose.position), flat(hit)]);
                }
            }
        }
        let cell_of = |p: Vec2| OccupancyGrid::cell_of(Vec3::new(p.x, 0.0, p.y));
        let middle = |cell: [i32; 2]| flat(OccupancyGrid::middle(cell));
        // Rounding may file what lies within a hair of a border on either side.
        let hair = 1e-3 + 4e-7 * offset.length();
        let is_clear = |p: Vec2| (p - middle(cell_of(p))).abs().max_element() < CELL / 2.0 - hair;
        let distance = |p: Vec2, [a, b]: [Vec2; 2]| {
            let t = ((p - a).dot(b - a) / (b - a).length_squared().max(1e-12)).clamp(0.0, 1.0);
            p.distance(a.lerp(b, t))
        };
        for way in &ways {
            assert!(!is_clear(way[1]) || grid.get(cell_of(way[1])) == Cell::Occupied, "a hit at {}", way[1]);
            for n in 0..8 {
                let on_the_way = way[0].lerp(way[1], n as f32 / 8.0);
                assert!(!is_clear(on_the_way) || grid.get(cell_of(on_the_way)) != Cell::Unknown, "{on_the_way}");
            }
        }
        let (low, shape) = grid.extent();
        let reach = CELL * std::f32::consts::FRAC_1_SQRT_2 + hair;
        for cell in (0..shape[0] as i32).flat_map(|x| (0..shape[1] as i32).map(move |z| [low[0] + x, low[1] + z])) {
            let at = middle(cell);
            match grid.get(cell) {
                Cell::Unknown => {}
                Cell::Free => assert!(ways.iter().any(|&way| distance(at, way) < reach), "free behind the hits: {at}"),
                Cell::Occupied => {
                    let is_hit = |way: &[Vec2; 2]| (at - way[1]).abs().max_element() < CELL / 2.0 + hair;
                    assert!(ways.iter().any(is_hit), "occupied without a hit: {at}");
                }
            }
        }
        scans.shuffle(rng);
        let other = carved(&scans);
        for cell in (0..shape[0] as i32).flat_map(|x| (0..shape[1] as i32).map(move |z| [low[0] + x, low[1] + z])) {
            assert_eq!(grid.get(cell), other.get(cell), "the order of frames");
        }
    });
}
