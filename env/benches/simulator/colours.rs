//! What colours add to a depth image: a texture of 1024² texels on 20 m, about as fine as those of Doom.

use crate::clock::{Effort, Times};
use crate::frames::per_frame;
use crate::house::House;
use glam::{Vec2, Vec3};
use nbp_env::scene::{Appearance, Image, Mesh, Paint};
use nbp_env::sensor::colour::{Colour, Painting};
use nbp_env::sensor::raster::{RasterIndex, render, render_marked};
use nbp_env::sensor::{Camera, Frame};
use serde_json::{Value, json};
use std::error::Error;

pub(crate) fn measure(houses: &[House], effort: Effort) -> Result<Vec<Value>, Box<dyn Error>> {
    println!("with colours, us per frame beyond the depth image, least of {} repeats\n", effort.repeats);
    println!("{:>10}{:>10}{:>10}{:>10}", "triangles", "marks", "nearest", "bilinear");
    houses.iter().map(|house| row(house, effort)).collect()
}

fn row(house: &House, effort: Effort) -> Result<Value, Box<dyn Error>> {
    let plain = house.world.scene().mesh();
    let appearance = painted(plain);
    let mesh = Mesh::painted(plain.vertices().to_vec(), plain.triangles().to_vec(), appearance.clone())?;
    let (raster, camera) = (RasterIndex::build(&mesh), Camera::default());
    let (mut frame, mut marks) = (Frame::default(), Vec::new());
    let mut times = [const { Vec::new() }; 4].map(|_: Vec<f64>| Times::default());
    for _ in 0..effort.repeats {
        times[0].push(per_frame(&house.poses, 4, |pose| render(&raster, &camera, pose, &mut frame)));
        times[1].push(per_frame(&house.poses, 4, |pose| render_marked(&raster, &camera, pose, &mut frame, &mut marks)));
        for (colour, times) in [Colour::Nearest, Colour::Bilinear].into_iter().zip(&mut times[2..]) {
            times.push(per_frame(&house.poses, 4, |pose| {
                render_marked(&raster, &camera, pose, &mut frame, &mut marks);
                Painting { mesh: &mesh, appearance: &appearance, camera: &camera, pose, colour }
                    .paint(&marks, &mut frame.colour);
            }));
        }
    }
    let [depth, beyond @ ..] = times.map(|times| 1e3 * times.least());
    let [marks, nearest, bilinear] = beyond.map(|time| time - depth);
    println!("{:>10}{marks:>10.0}{nearest:>10.0}{bilinear:>10.0}", house.triangles());
    Ok(json!({ "marks_us": marks, "nearest_us": nearest, "bilinear_us": bilinear }))
}

/// Upright on walls, along x and z on floors.
fn painted(mesh: &Mesh) -> Appearance {
    let texel = |n: usize| [(n % 251) as u8, (n / 1024 % 241) as u8, (n % 17) as u8 * 15];
    let paint = |[a, b, c]: [Vec3; 3]| {
        let place = |v: Vec3| match (b - a).cross(c - a).abs().max_position() {
            0 => Vec2::new(v.z, v.y) / 20.0,
            1 => Vec2::new(v.x, v.z) / 20.0,
            _ => Vec2::new(v.x, v.y) / 20.0,
        };
        Paint::Image { image: 0, corners: [a, b, c].map(place) }
    };
    let image = Image { width: 1024, height: 1024, pixels: (0..1024 * 1024).map(texel).collect() };
    Appearance { images: vec![image], paints: mesh.iter_corners().map(paint).collect() }
}
