//! The rasteriser against rays.

use super::*;
use crate::scene::{Mesh, RayIndex};
use crate::sensor::NO_TRIANGLE;
use crate::sensor::test_scenes::{CEILING, Dice, Soup, crate_box, rooms, terrain};
use crate::sensor::trace::{trace, trace_marked};
use glam::Vec3;
use std::f32::consts::TAU;

struct Twin {
    raster: RasterIndex,
    rays: RayIndex,
}

fn twin((vertices, triangles): Soup) -> Twin {
    let mesh = Mesh::new(vertices, triangles).unwrap();
    Twin { raster: RasterIndex::build(&mesh), rays: RayIndex::build(&mesh) }
}

/// Pixels of which one camera says that there is a surface and the other does not, or not at the same depth.
fn differing(twin: &Twin, camera: &Camera, pose: &Pose) -> usize {
    let [mut drawn, mut shot] = [Frame::default(), Frame::default()];
    render(&twin.raster, camera, pose, &mut drawn);
    trace(&twin.rays, camera, pose, &mut shot);
    assert_eq!((drawn.width, drawn.height, drawn.depth.len()), (camera.width, camera.height, shot.depth.len()));
    let differs = |(&a, &b): (&f32, &f32)| (a > 0.0) != (b > 0.0) || (a - b).abs() > 1e-3 * b + 1e-3;
    drawn.depth.iter().zip(&shot.depth).filter(|&pair| differs(pair)).count()
}

/// Poses inside a box, most of them with headings off the lattice.
fn poses(count: usize, low: Vec3, high: Vec3, seed: u64) -> Vec<Pose> {
    let mut dice = Dice(seed);
    let mut pose = |i: usize| Pose {
        position: dice.point(low, high),
        azimuth: if i.is_multiple_of(3) { (i % 8) as f32 * TAU / 8.0 } else { dice.between(0.0, TAU) },
    };
    (0..count).map(&mut pose).collect()
}

/// At most one pixel in 100,000.
fn assert_twins(twin: &Twin, camera: &Camera, poses: &[Pose]) {
    let differing: usize = poses.iter().map(|pose| differing(twin, camera, pose)).sum();
    let pixels = poses.len() * camera.width * camera.height;
    assert!(differing * 100_000 <= pixels, "{differing} of {pixels} pixels differ");
}

#[test]
fn rooms_of_4k_triangles_look_as_rays_see_them() {
    let poses = poses(8, Vec3::new(0.5, 1.65, 0.5), Vec3::new(35.5, 1.65, 35.5), 11);
    assert_twins(&twin(rooms(36.0, 2.2, 7)), &Camera::default(), &poses);
}

#[test]
fn rooms_of_64k_triangles_look_as_rays_see_them() {
    let poses = poses(6, Vec3::new(0.5, 0.2, 0.5), Vec3::new(35.5, 3.0, 35.5), 12);
    assert_twins(&twin(rooms(36.0, 0.48, 8)), &Camera::default(), &poses);
}

#[test]
fn slanted_shards_under_an_open_sky_look_as_rays_see_them() {
    let poses = poses(6, Vec3::new(2.0, 1.0, 2.0), Vec3::new(28.0, 2.0, 28.0), 13);
    assert_twins(&twin(terrain(30.0, 0.5, 4000, 9)), &Camera::default(), &poses);
}

#[test]
fn a_wall_before_the_lens_looks_as_rays_see_it() {
    let mut soup = Soup::default();
    crate_box(&mut soup, Vec3::ZERO, Vec3::new(40.0, CEILING, 40.0), 50.0, true);
    let twin = twin(soup);
    let mut close = Vec::new();
    for gap in [0.05, 0.01, 0.002] {
        for k in 0..16 {
            close.push(Pose { position: Vec3::new(gap, 1.65, 13.0), azimuth: k as f32 * TAU / 16.0 });
        }
    }
    assert_twins(&twin, &Camera { width: 228, height: 128, ..Camera::default() }, &close);
}

#[test]
fn images_of_any_size_look_as_rays_see_them() {
    let twin = twin(terrain(30.0, 2.0, 500, 4));
    for (width, height, hfov_degrees) in [(61, 45, 60.0), (5, 3, 90.0), (1, 1, 90.0), (8, 100, 40.0), (131, 9, 120.0)] {
        let camera = Camera { width, height, hfov_degrees, range: 20.0 };
        let poses = poses(20, Vec3::new(2.0, 1.0, 2.0), Vec3::new(28.0, 2.0, 28.0), 15);
        let differing: usize = poses.iter().map(|pose| differing(&twin, &camera, pose)).sum();
        assert!(differing <= 1, "{width}x{height}: {differing}");
    }
}

#[test]
fn every_pixel_on_a_corner_of_a_grid_is_covered() {
    // One vertex on the ray of every pixel: nothing but corners and edges is hit, in exact arithmetic.
    let camera = Camera { width: 64, height: 48, ..Camera::default() };
    let pose = Pose { position: Vec3::new(0.5, 1.0, -2.0), azimuth: 0.0 };
    let mut soup = Soup::default();
    for row in 0..48 {
        for col in 0..64 {
            soup.0.push(camera.at(&pose).unproject(col, row, 4.0));
        }
    }
    for a in (0..47).flat_map(|row| (0..63).map(move |col| row * 64 + col)) {
        soup.1.extend([[a, a + 1, a + 65], [a, a + 65, a + 64]]);
    }
    let twin = twin(soup);
    let mut frame = Frame::default();
    render(&twin.raster, &camera, &pose, &mut frame);
    let inside = (1..47).flat_map(|row| (1..63).map(move |col| (col, row)));
    for (col, row) in inside {
        let depth = frame.at(col, row);
        assert!(depth.is_some_and(|depth| (depth - 4.0).abs() < 1e-4), "{col} {row}: {depth:?}");
    }
}

#[test]
fn surfaces_behind_the_camera_or_beyond_the_range_are_not_seen() {
    let wall = |z: f32| {
        (vec![Vec3::new(-999.0, -999.0, z), Vec3::new(999.0, -999.0, z), Vec3::new(0.0, 999.0, z)], vec![[0, 1, 2]])
    };
    let pose = Pose { position: Vec3::ZERO, azimuth: 0.0 };
    for (z, seen) in [(34.9, true), (35.1, false), (-1.0, false), (0.002, true), (0.0005, false)] {
        let twin = twin(wall(z));
        let mut frame = Frame::default();
        render(&twin.raster, &Camera::default(), &pose, &mut frame);
        assert!(
            frame.depth.iter().all(|&depth| if seen { (depth / z - 1.0).abs() < 1e-4 } else { depth == 0.0 }),
            "{z}"
        );
        assert_eq!(differing(&twin, &Camera::default(), &pose), 0);
    }
}

#[test]
fn open_scenes_have_pixels_without_a_surface() {
    let twin = twin(terrain(30.0, 2.0, 0, 4));
    let pose = Pose { position: Vec3::new(15.0, 1.5, 15.0), azimuth: 1.0 };
    let mut frame = Frame::default();
    render(&twin.raster, &Camera::default(), &pose, &mut frame);
    assert_eq!(frame.at(228, 0), None);
    assert!(frame.at(228, 255).is_some_and(|depth| depth < 4.0));
}

#[test]
fn marking_triangles_changes_no_depth_and_agrees_with_rays() {
    let scenes = [rooms(36.0, 2.2, 7), rooms(36.0, 0.48, 8), terrain(30.0, 0.5, 4000, 9)].map(twin);
    let odd = Camera { width: 5, height: 61, ..Camera::default() };
    for (twin, camera) in scenes.iter().zip([Camera::default(); 3]).chain([(&scenes[2], odd)]) {
        let [mut plain, mut marked, mut shot] = [(); 3].map(|()| Frame::default());
        let (mut drawn_marks, mut shot_marks) = (Vec::new(), Vec::new());
        let (mut same, mut all) = (0, 0);
        for pose in poses(4, Vec3::new(2.0, 1.0, 2.0), Vec3::new(28.0, 2.0, 28.0), 21) {
            render(&twin.raster, &camera, &pose, &mut plain);
            trace_marked(&twin.rays, &camera, &pose, &mut shot, &mut shot_marks);
            for set in InstructionSet::available() {
                render_marked_with(set, &twin.raster, &camera, &pose, &mut marked, &mut drawn_marks);
                let bits = |frame: &Frame| frame.depth.iter().map(|d| d.to_bits()).collect::<Vec<_>>();
                assert!(bits(&plain) == bits(&marked));
                assert_eq!(drawn_marks.len(), camera.width * camera.height);
                assert!(marked.depth.iter().zip(&drawn_marks).all(|(&d, &m)| (d > 0.0) == (m != NO_TRIANGLE)));
                same += drawn_marks.iter().zip(&shot_marks).filter(|(a, b)| a == b).count();
                all += drawn_marks.len();
            }
        }
        assert!((all - same) * 1000 <= all, "{} of {all} differ", all - same);
    }
}

#[test]
fn all_instruction_sets_and_threads_give_the_same_bits() {
    let twin = twin(terrain(30.0, 0.8, 2000, 6));
    let poses = poses(8, Vec3::new(2.0, 0.5, 2.0), Vec3::new(28.0, 2.0, 28.0), 17);
    let bits = |set: InstructionSet, pose: &Pose| {
        let mut frame = Frame::default();
        render_with(set, &twin.raster, &Camera::default(), pose, &mut frame);
        frame.depth.into_iter().map(f32::to_bits).collect::<Vec<_>>()
    };
    let sets: Vec<_> = InstructionSet::available().collect();
    let expected: Vec<_> = poses.iter().map(|pose| bits(sets[0], pose)).collect();
    std::thread::scope(|scope| {
        for &set in &sets {
            for start in 0..2 {
                let (poses, bits, expected) = (&poses, &bits, &expected);
                scope.spawn(move || {
                    // Other poses first on the second thread: what an earlier frame leaves behind must not matter.
                    for i in (0..poses.len()).map(|i| (i + 3 * start) % poses.len()) {
                        assert!(bits(set, &poses[i]) == expected[i], "{} pose {i}", set.name());
                    }
                });
            }
        }
    });
}
