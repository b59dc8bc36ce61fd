//! How long the simulator takes, on one thread: `cargo bench -p env`.
//!
//! Milliseconds for a 456×256 depth image in synthetic houses of three sizes, by the rasteriser with each instruction
//! set of this machine and by one ray at a time. Repeats of the methods are interleaved, so that a busy machine disturbs
//! all alike; medians are reported, with the least for the widest instruction set beside them. Then what colours add,
//! and whole steps.

#[allow(dead_code)]
mod scenes;

use glam::{Vec2, Vec3};
use nbp_env::policy::random::Random;
use nbp_env::pose::Pose;
use nbp_env::scene::load::infer_settings;
use nbp_env::scene::{Appearance, Image, Mesh, Paint, RayIndex};
use nbp_env::sensor::colour::{Colour, Painting};
use nbp_env::sensor::raster::{InstructionSet, RasterIndex, render, render_marked, render_with};
use nbp_env::sensor::trace::trace;
use nbp_env::sensor::{Camera, Frame};
use nbp_env::{Episode, Policy as _, Scene, SeedTree, SimConfig, World};
use std::sync::Arc;
use std::time::Instant;

/// Side of the houses, metres.
const SIDE: f32 = 36.0;

/// Longest edges that give about 4 k, 64 k and 500 k triangles, metres.
const CELLS: [f32; 3] = [2.2, 0.43, 0.147];

const POSES: usize = 16;
const REPEATS: usize = 9;

/// Steps of a measured episode.
const STEPS: usize = 60;

fn main() {
    depth_images();
    colours();
    episodes();
}

/// Whole steps of the random walk: four captures, map, coverage and the encoder's input.
fn episodes() {
    println!("\nepisodes of {STEPS} steps, one thread, 20,000 surface points, median of {REPEATS}\n");
    println!("{:>10}{:>10}{:>12}{:>16}", "triangles", "steps/s", "ms per step", "input of it, ms");
    for cell in CELLS {
        let (vertices, triangles) = scenes::rooms(SIDE, cell, 7);
        let mesh = match Mesh::new(vertices, triangles) {
            Ok(mesh) => mesh,
            Err(error) => panic!("a made-up scene is a mesh: {error}"),
        };
        let (count, settings) = (mesh.triangles().len(), infer_settings(&mesh));
        let world = match Scene::new("house", mesh, &settings).map(|scene| World::new(scene, &SimConfig::default())) {
            Ok(Ok(world)) => Arc::new(world),
            _ => panic!("a made-up house has free poses"),
        };
        let (mut steps, mut inputs) = (Vec::new(), Vec::new());
        for repeat in 0..REPEATS {
            let start = world.scene().starts()[repeat % world.scene().starts().len()];
            let Ok(mut episode) = Episode::new(Arc::clone(&world), start, STEPS, SeedTree::new(repeat as u64)) else {
                panic!("a scene's starts are free");
            };
            let (mut policy, mut rng) = (Random, SeedTree::new(9).rng());
            let (begun, mut encoding) = (Instant::now(), 0.0);
            while !episode.is_over() {
                let Ok(action) = policy.act(&episode.view(), &mut rng) else { break };
                episode.step(action);
                let encode = Instant::now();
                std::hint::black_box(episode.encode());
                encoding += encode.elapsed().as_secs_f64();
            }
            steps.push(begun.elapsed().as_secs_f64() / STEPS as f64);
            inputs.push(1e3 * encoding / STEPS as f64);
        }
        let seconds = median(steps);
        println!("{count:>10}{:>10.0}{:>12.2}{:>16.3}", 1.0 / seconds, 1e3 * seconds, median(inputs));
    }
}

fn depth_images() {
    let sets: Vec<InstructionSet> = InstructionSet::available().collect();
    println!("456x256 depth image, one thread, ms per frame, median of {REPEATS} repeats of {POSES} poses\n");
    print!("{:>10}", "triangles");
    for set in &sets {
        print!("{:>10}", set.name());
    }
    println!("{:>10}{:>12}{:>8}{:>12}", "(least)", "single rays", "ratio", "index build");
    for cell in CELLS {
        let (vertices, triangles) = scenes::rooms(SIDE, cell, 7);
        let mesh = match Mesh::new(vertices, triangles) {
            Ok(mesh) => mesh,
            Err(error) => panic!("a made-up scene is a mesh: {error}"),
        };
        let start = Instant::now();
        let raster = RasterIndex::build(&mesh);
        let build = start.elapsed().as_secs_f64();
        let rays = RayIndex::build(&mesh);
        let (camera, mut frame) = (Camera::default(), Frame::default());
        let poses = free_poses(&rays);
        let (mut drawn, mut shot) = (vec![Vec::new(); sets.len()], Vec::new());
        for repeat in 0..REPEATS {
            for (set, times) in sets.iter().zip(&mut drawn) {
                // Many frames a measurement: one is too short for the clock and for the caches to settle.
                times.push(per_frame(&poses, 8, |pose| render_with(*set, &raster, &camera, pose, &mut frame)));
            }
            if repeat % 3 == 0 {
                shot.push(per_frame(&poses, 1, |pose| trace(&rays, &camera, pose, &mut frame)));
            }
        }
        let least = drawn.last().map_or(f64::NAN, |times| times.iter().copied().fold(f64::INFINITY, f64::min));
        print!("{:>10}", mesh.triangles().len());
        let drawn: Vec<f64> = drawn.into_iter().map(median).collect();
        for time in &drawn {
            print!("{time:>10.3}");
        }
        let (shot, widest) = (median(shot), drawn.last().copied().unwrap_or(f64::NAN));
        println!("{least:>10.3}{shot:>12.2}{:>7.0}x{build:>10.2} s", shot / widest);
    }
}

/// The same houses with a texture of 1024² texels on 20 m, about as fine as those of Doom.
fn colours() {
    println!("\nwith colours, microseconds per frame beyond the depth image, least of {REPEATS} repeats\n");
    println!("{:>10}{:>10}{:>10}{:>10}", "triangles", "marks", "nearest", "bilinear");
    for cell in CELLS {
        let (vertices, triangles) = scenes::rooms(SIDE, cell, 7);
        let texel = |n: usize| [(n % 251) as u8, (n / 1024 % 241) as u8, (n % 17) as u8 * 15];
        // Upright on walls, along x and z on floors.
        let corners = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|k| vertices[k as usize]);
            let place = |v: Vec3| match (b - a).cross(c - a).abs().max_position() {
                0 => Vec2::new(v.z, v.y) / 20.0,
                1 => Vec2::new(v.x, v.z) / 20.0,
                _ => Vec2::new(v.x, v.y) / 20.0,
            };
            Paint::Image { image: 0, corners: [a, b, c].map(place) }
        };
        let appearance = Appearance {
            images: vec![Image { width: 1024, height: 1024, pixels: (0..1024 * 1024).map(texel).collect() }],
            paints: triangles.iter().map(corners).collect(),
        };
        let mesh = match Mesh::painted(vertices.clone(), triangles.clone(), appearance.clone()) {
            Ok(mesh) => mesh,
            Err(error) => panic!("a made-up scene is a mesh: {error}"),
        };
        let (raster, poses) = (RasterIndex::build(&mesh), free_poses(&RayIndex::build(&mesh)));
        let (camera, mut frame, mut marks) = (Camera::default(), Frame::default(), Vec::new());
        let mut times = [const { Vec::new() }; 4];
        for _ in 0..REPEATS {
            times[0].push(per_frame(&poses, 4, |pose| render(&raster, &camera, pose, &mut frame)));
            times[1].push(per_frame(&poses, 4, |pose| render_marked(&raster, &camera, pose, &mut frame, &mut marks)));
            for (colour, times) in [Colour::Nearest, Colour::Bilinear].into_iter().zip(&mut times[2..]) {
                times.push(per_frame(&poses, 4, |pose| {
                    render_marked(&raster, &camera, pose, &mut frame, &mut marks);
                    Painting { mesh: &mesh, appearance: &appearance, camera: &camera, pose, colour }
                        .paint(&marks, &mut frame.colour);
                }));
            }
        }
        let least = |times: Vec<f64>| 1e3 * times.into_iter().fold(f64::INFINITY, f64::min);
        let [depth, marked, nearest, bilinear] = times.map(least);
        let beyond = [marked, nearest, bilinear].map(|time| time - depth);
        println!("{:>10}{:>10.0}{:>10.0}{:>10.0}", mesh.triangles().len(), beyond[0], beyond[1], beyond[2]);
    }
}

/// Poses at camera height that keep half a metre from every wall.
fn free_poses(rays: &RayIndex) -> Vec<Pose> {
    let mut dice = scenes::Dice(3);
    let mut poses = Vec::new();
    while poses.len() < POSES {
        let position = dice.point(Vec3::new(0.5, 1.65, 0.5), Vec3::new(SIDE - 0.5, 1.65, SIDE - 0.5));
        let azimuth = dice.between(0.0, std::f32::consts::TAU);
        let around = (0..16).map(|k| Pose { position, azimuth: k as f32 * std::f32::consts::TAU / 16.0 }.forward());
        if around.into_iter().all(|direction| rays.nearest(position, direction, 0.5).is_none()) {
            poses.push(Pose { position, azimuth });
        }
    }
    poses
}

/// Milliseconds for one frame, over `rounds` of all poses.
fn per_frame(poses: &[Pose], rounds: usize, mut capture: impl FnMut(&Pose)) -> f64 {
    let start = Instant::now();
    for _ in 0..rounds {
        poses.iter().for_each(&mut capture);
    }
    start.elapsed().as_secs_f64() * 1e3 / (rounds * poses.len()) as f64
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}
