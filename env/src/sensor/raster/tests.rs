//! The rasteriser against rays.

use super::*;
use crate::scene::{Mesh, RayIndex};
use crate::sensor::test_scenes::{CEILING, Dice, Soup, crate_box, rooms, terrain};
use crate::sensor::trace::trace;
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
        azimuth: if i % 3 == 0 { (i % 8) as f32 * TAU / 8.0 } else { dice.between(0.0, TAU) },
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
