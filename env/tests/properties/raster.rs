//! The rasteriser and the rays against triangles in `f64`, pixel by pixel, and all instruction sets against each other.
//!
//! Both cameras round, so a pixel whose centre lies within a hair of a triangle's edge may show it or not. Nothing else is
//! forgiven.

use super::{MANY, for_all, point};
use glam::{DVec2, DVec3, Vec3};
use nbp_env::scene::{Mesh, RayIndex};
use nbp_env::sensor::raster::{InstructionSet, RasterIndex, render_marked_with, render_with};
use nbp_env::sensor::{Camera, Frame, trace};
use nbp_env::{Pose, Rng};
use rand::RngExt as _;
use std::f32::consts::TAU;

/// Within so many pixels of an edge, a pixel's centre may be on either side.
const HAIR: f64 = 1e-3;

/// Share of the coordinates by which the way from the camera to a corner may be off: a few roundings of `f32`.
const ROUNDING: f64 = 2.4e-7;

/// Share of a depth by which it may be off.
const DEPTH: f64 = 2e-4;

/// Triangles of all kinds around the origin.
fn soup(rng: &mut Rng, pose: &Pose) -> Mesh {
    let count = if rng.random_bool(0.1) { rng.random_range(1..200) } else { rng.random_range(1..24) };
    let (mut vertices, mut triangles): (Vec<Vec3>, Vec<[u32; 3]>) = Default::default();
    for _ in 0..count {
        let first = vertices.len() as u32;
        let (at, size) = (point(rng, 8.0), 10.0_f32.powf(rng.random_range(-1.5..1.5)));
        let corners = match rng.random_range(0..8) {
            // Slivers.
            0 => {
                let (along, aside) = (point(rng, size), point(rng, 1e-3 * size));
                [at, at + along, at + along * rng.random::<f32>() + aside]
            }
            // Before the lens, across the near plane and around the camera.
            1 => [(); 3].map(|()| pose.position + point(rng, 0.02)),
            2 => [pose.position + point(rng, 0.01), pose.position + point(rng, 3.0), at],
            // In one plane, where many others lie; corners on a grid.
            3 | 4 => [(); 3].map(|()| (point(rng, 6.0).round() * Vec3::new(1.0, 1.0, 0.0)).with_z(5.0)),
            // Two neighbours that share an edge with one that is there.
            5 if first >= 3 => {
                let other = triangles[rng.random_range(0..triangles.len())];
                vertices.push(at);
                triangles.extend([[other[0], other[1], first], [other[1], other[2], first]]);
                continue;
            }
            // The camera in the plane of the triangle.
            6 => {
                let (u, v) = (point(rng, size), point(rng, size));
                [pose.position + u, pose.position + v, pose.position - u * rng.random::<f32>()]
            }
            _ => [at, at + point(rng, size), at + point(rng, size)],
        };
        vertices.extend(corners);
        triangles.push([first, first + 1, first + 2]);
    }
    vertices.push(Vec3::splat(9.0));
    vertices.extend([Vec3::new(9.0, 9.5, 9.0), Vec3::new(9.5, 9.0, 9.0)]);
    let last = vertices.len() as u32 - 1;
    // One that has an area, whatever the others.
    triangles.push([last - 2, last - 1, last]);
    Mesh::new(vertices, triangles).unwrap()
}

/// What is known of a triangle at a pixel.
struct There {
    /// Its depth at the pixel's centre lies between these, if it covers it.
    depth: [f64; 2],
    /// It covers the centre whatever the rounding.
    is_sure: bool,
}

/// A triangle in `f64` as a camera sees it.
struct Projected {
    /// What lies before the near plane, in pixels from the image's middle.
    outline: Vec<DVec2>,
    /// `1 / depth = plane · (x, y, 1)`.
    plane: DVec3,
    /// Rounding in pixels, and of a depth as a share.
    hair: f64,
    coarse: f64,
}

impl Projected {
    fn new(camera: &Camera, pose: &Pose, corners: [Vec3; 3]) -> Option<Self> {
        let (forward, right, focal) = (pose.forward().as_dvec3(), pose.right().as_dvec3(), f64::from(camera.focal()));
        let local = corners.map(|c| {
            let offset = c.as_dvec3() - pose.position.as_dvec3();
            DVec3::new(focal * offset.dot(right), -focal * offset.y, offset.dot(forward))
        });
        let near = f64::from(Camera::NEAR);
        let mut outline = Vec::new();
        for n in 0..3 {
            let (a, b) = (local[n], local[(n + 1) % 3]);
            if a.z >= near {
                outline.push(a.truncate() / a.z);
            }
            if (a.z >= near) != (b.z >= near) {
                let c = a + (b - a) * ((near - a.z) / (b.z - a.z));
                outline.push(c.truncate() / near);
            }
        }
        let normal = (local[1] - local[0]).cross(local[2] - local[0]);
        let plane = normal / normal.dot(local[0]);
        let reach = corners.iter().fold(pose.position, |reach, c| reach.abs().max(c.abs())).max_element();
        let nearest = local.iter().map(|c| c.z).fold(f64::INFINITY, f64::min).max(near);
        let coarse = ROUNDING * f64::from(reach) / nearest;
        (outline.len() >= 3).then_some(Self { outline, plane, hair: HAIR + focal * coarse, coarse })
    }

    /// `None` where it surely is not.
    fn at(&self, pixel: DVec2, range: f64) -> Option<There> {
        let count = self.outline.len();
        let edges = (0..count).map(|n| (self.outline[n], self.outline[(n + 1) % count]));
        let distance = |(a, b): (DVec2, DVec2)| {
            let t = ((pixel - a).dot(b - a) / (b - a).length_squared().max(1e-300)).clamp(0.0, 1.0);
            pixel.distance(a.lerp(b, t))
        };
        let sides: Vec<f64> = edges.clone().map(|(a, b)| (b - a).perp_dot(pixel - a)).collect();
        let is_inside = sides.iter().all(|&s| s > 0.0) || sides.iter().all(|&s| s < 0.0);
        let border = edges.map(distance).fold(f64::INFINITY, f64::min);
        if !is_inside && border > self.hair {
            return None;
        }
        // Depth within a hair of the pixel's centre.
        let inverse = self.plane.dot(pixel.extend(1.0));
        let slope = self.hair * (self.plane.x.abs() + self.plane.y.abs());
        let share = DEPTH + self.coarse;
        let [near, far] = [inverse + slope, inverse - slope].map(|v| if v > 0.0 { 1.0 / v } else { f64::INFINITY });
        let depth =
            if inverse.is_finite() { [near * (1.0 - share), far * (1.0 + share)] } else { [0.0, f64::INFINITY] };
        let in_range = depth[0] > f64::from(Camera::NEAR) && depth[1] < range;
        Some(There { depth, is_sure: is_inside && border > self.hair && in_range })
    }
}

/// What a pixel shows wrongly, if anything.
fn fault(depth: f32, triangles: &[There]) -> Option<String> {
    let depth = f64::from(depth);
    let farthest = triangles.iter().filter(|t| t.is_sure).map(|t| t.depth[1]).fold(f64::INFINITY, f64::min);
    if depth == 0.0 {
        return farthest.is_finite().then(|| format!("nothing, and a surface lies at {farthest} m"));
    }
    if depth > farthest {
        return Some(format!("{depth} m, and a surface lies before it at {farthest} m"));
    }
    let is_there = triangles.iter().any(|t| t.depth[0] <= depth && depth <= t.depth[1]);
    (!is_there).then(|| {
        let near: Vec<[f64; 2]> = triangles.iter().map(|t| t.depth).collect();
        format!("{depth} m, where there is nothing but {near:?}")
    })
}

#[test]
fn images_show_what_is_there() {
    for_all("images_show_what_is_there", MANY, |rng| {
        let camera = Camera {
            width: rng.random_range(1..32),
            height: rng.random_range(1..24),
            hfov_degrees: [90.0, rng.random_range(10.0..150.0)][rng.random_range(0..2_usize)],
            range: [35.0, rng.random_range(0.5..20.0)][rng.random_range(0..2_usize)],
        };
        let azimuth =
            if rng.random_bool(0.4) { rng.random_range(0..8) as f32 * TAU / 8.0 } else { rng.random_range(0.0..TAU) };
        let position = if rng.random_bool(0.2) { point(rng, 4.0).round() } else { point(rng, 4.0) };
        let pose = Pose { position, azimuth };
        let mesh = soup(rng, &pose);
        let (index, rays) = (RasterIndex::build(&mesh), RayIndex::build(&mesh));
        let mut images = Vec::new();
        for set in InstructionSet::available() {
            let (mut frame, mut marked, mut marks) = (Frame::default(), Frame::default(), Vec::new());
            render_with(set, &index, &camera, &pose, &mut frame);
            render_marked_with(set, &index, &camera, &pose, &mut marked, &mut marks);
            let bits = |frame: &Frame| frame.depth.iter().map(|d| d.to_bits()).collect::<Vec<_>>();
            assert_eq!(bits(&frame), bits(&marked), "{}", set.name());
            images.push((bits(&frame), marks, frame));
        }
        assert!(images.iter().all(|image| image.0 == images[0].0 && image.1 == images[0].1), "instruction sets differ");
        let mut shot = Frame::default();
        trace(&rays, &camera, &pose, &mut shot);

        let projected: Vec<Projected> =
            mesh.iter_corners().filter_map(|corners| Projected::new(&camera, &pose, corners)).collect();
        for (n, (&drawn, &shot)) in images[0].2.depth.iter().zip(&shot.depth).enumerate() {
            let (col, row) = (n % camera.width, n / camera.width);
            let middle = DVec2::new(camera.width as f64, camera.height as f64) / 2.0;
            let pixel = DVec2::new(col as f64 + 0.5, row as f64 + 0.5) - middle;
            let there: Vec<There> =
                projected.iter().filter_map(|triangle| triangle.at(pixel, f64::from(camera.range))).collect();
            for (who, depth) in [("rasteriser", drawn), ("rays", shot)] {
                if let Some(fault) = fault(depth, &there) {
                    panic!(
                        "{who}: column {col}, row {row} shows {fault}; the other camera {drawn} / {shot}; {camera:?} {pose:?}"
                    );
                }
            }
        }
    });
}
