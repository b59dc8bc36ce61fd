//! Colours of a depth image: for each pixel, what the triangle that it shows looks like at that place.
//!
//! The rasteriser says which triangle each pixel shows. The ray through the pixel's middle meets that triangle's plane at
//! a point with barycentric coordinates, in exact perspective, and there its paint is looked up. Both faces look alike,
//! and nothing is lit. Depths have the same bits with and without colours.

use super::raster::{InstructionSet, nearest_whole, render_marked};
use super::{Camera, Frame, NO_TRIANGLE, Sensor};
use crate::pose::Pose;
use crate::scene::{Appearance, Image, Mesh, Paint, Scene};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::cell::RefCell;

/// Whether images have colours, and how textures are sampled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Colour {
    /// Depth only, at no cost.
    #[default]
    Off,
    /// The texel that a pixel's middle falls in.
    Nearest,
    /// The four nearest texels, blended as the bytes they are, without a detour through linear light: what the released
    /// code's renderer (PyTorch3D) does.
    Bilinear,
}

impl Colour {
    /// Whether scenes must be loaded with their colours.
    pub fn is_on(self) -> bool {
        self != Self::Off
    }
}

/// The rasterising camera with colours, for scenes whose mesh has an appearance; of others it takes depths only.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RgbdCamera {
    /// Size, field of view and range.
    pub camera: Camera,
    /// Whether there are colours.
    pub colour: Colour,
}

thread_local! {
    static TRIANGLES: RefCell<Vec<u32>> = RefCell::default();
}

impl Sensor for RgbdCamera {
    fn camera(&self) -> &Camera {
        &self.camera
    }

    fn capture(&self, scene: &Scene, pose: &Pose, out: &mut Frame) {
        match scene.mesh().appearance() {
            Some(appearance) if self.colour.is_on() => TRIANGLES.with_borrow_mut(|triangles| {
                render_marked(scene.raster(), &self.camera, pose, out, triangles);
                let (mesh, camera, colour) = (scene.mesh(), &self.camera, self.colour);
                Painting { mesh, appearance, camera, pose, colour }.paint(triangles, &mut out.colour);
            }),
            _ => super::render(scene.raster(), &self.camera, pose, out),
        }
    }
}

/// A mesh with colours, seen from somewhere.
#[derive(Clone, Copy, Debug)]
pub struct Painting<'a> {
    /// The triangles.
    pub mesh: &'a Mesh,
    /// Their colours.
    pub appearance: &'a Appearance,
    /// Size and field of view.
    pub camera: &'a Camera,
    /// Where from.
    pub pose: &'a Pose,
    /// How textures are sampled.
    pub colour: Colour,
}

impl Painting<'_> {
    /// Writes the colours of an image whose pixels show the given triangles, [`NO_TRIANGLE`] for none.
    pub fn paint(&self, triangles: &[u32], out: &mut Vec<[u8; 3]>) {
        self.paint_with(InstructionSet::best(), triangles, out);
    }

    /// The same by a chosen instruction set: the same bits, at another speed.
    fn paint_with(&self, set: InstructionSet, triangles: &[u32], out: &mut Vec<[u8; 3]>) {
        out.clear();
        out.resize(triangles.len(), [0; 3]);
        set.paint(self, triangles, out);
    }

    /// The body, compiled for each instruction set: run by run of pixels that show one triangle.
    #[inline(always)]
    pub(super) fn paint_runs(&self, triangles: &[u32], out: &mut [[u8; 3]]) {
        let (eye, width) = (Eye::new(self.camera, self.pose), self.camera.width);
        let (mut last, mut surface) = (NO_TRIANGLE, Surface::default());
        for (row, (line, out)) in triangles.chunks_exact(width).zip(out.chunks_exact_mut(width)).enumerate() {
            let mut from = 0;
            while from < width {
                let triangle = line[from];
                let most = &line[from..width.min(from + LANES)];
                let count = most.iter().take_while(|&&other| other == triangle).count();
                if triangle != NO_TRIANGLE {
                    if triangle != last {
                        (last, surface) = (triangle, Surface::new(self.mesh, self.appearance, &eye, triangle as usize));
                    }
                    let values = surface.at(self.camera.offsets(from, row));
                    let out = &mut out[from..from + count];
                    match surface.image {
                        None => channels(&values, out),
                        Some(image) if self.colour == Colour::Nearest => nearest(image, &values, out),
                        Some(image) => bilinear(image, &values, out),
                    }
                }
                from += count;
            }
        }
    }
}

/// Pixels computed at once.
const LANES: usize = 8;

/// One number for each of them.
type Lanes = [f64; LANES];

/// The camera's place and axes, its rays being `right · x + down · y + forward` for a pixel's offsets `x` and `y`.
struct Eye {
    position: DVec3,
    axes: [DVec3; 3],
}

impl Eye {
    fn new(camera: &Camera, pose: &Pose) -> Self {
        let focal = f64::from(camera.focal());
        let axes = [pose.right().as_dvec3() / focal, DVec3::NEG_Y / focal, pose.forward().as_dvec3()];
        Self { position: pose.position.as_dvec3(), axes }
    }
}

/// `[x, y, 1]` times this is a number that is linear over the image.
type Linear = [f64; 3];

/// What one triangle looks like in the image: up to three values, each a quotient of linear functions.
#[derive(Default)]
struct Surface<'a> {
    /// Texture coordinates to the right and down, or a colour's channels.
    values: [Linear; 3],
    weight: Linear,
    image: Option<&'a Image>,
}

impl<'a> Surface<'a> {
    #[inline(always)]
    fn new(mesh: &Mesh, appearance: &'a Appearance, eye: &Eye, triangle: usize) -> Self {
        let [a, b, c] = mesh.corners(triangle);
        let [a, b, c] = [a.as_dvec3() - eye.position, b.as_dvec3() - eye.position, c.as_dvec3() - eye.position];
        // Along a ray, a corner's weight grows with the ray's side of the plane through the eye and the other two.
        let [bc, ca, ab] = [b.cross(c), c.cross(a), a.cross(b)];
        let mix = |[p, q, r]: [f64; 3]| {
            let normal = bc * p + ca * q + ab * r;
            [eye.axes[0].dot(normal), eye.axes[1].dot(normal), eye.axes[2].dot(normal)]
        };
        let (values, image) = match &appearance.paints[triangle] {
            Paint::Corners([a, b, c]) => {
                let channel = |n: usize| mix([a[n].into(), b[n].into(), c[n].into()]);
                ([channel(0), channel(1), channel(2)], None)
            }
            Paint::Image { image, corners: [a, b, c] } => {
                let right = mix([a.x.into(), b.x.into(), c.x.into()]);
                let down = mix([1.0 - f64::from(a.y), 1.0 - f64::from(b.y), 1.0 - f64::from(c.y)]);
                ([right, down, Linear::default()], appearance.images.get(*image as usize))
            }
        };
        Self { values, weight: mix([1.0; 3]), image }
    }

    /// The values at eight pixels from one on, given by its offsets from the optical axis.
    #[inline(always)]
    fn at(&self, offsets: [f32; 2]) -> [Lanes; 3] {
        let (first, y) = (f64::from(offsets[0]), f64::from(offsets[1]));
        let (mut share, mut out) = ([0.0; LANES], [[0.0; LANES]; 3]);
        let row = |linear: &Linear| linear[1] * y + linear[2];
        let weight = row(&self.weight);
        for (i, share) in share.iter_mut().enumerate() {
            *share = 1.0 / (self.weight[0] * (first + i as f64) + weight);
        }
        for (out, linear) in out.iter_mut().zip(&self.values) {
            let value = row(linear);
            for (i, out) in out.iter_mut().enumerate() {
                *out = (linear[0] * (first + i as f64) + value) * share[i];
            }
        }
        out
    }
}

#[inline(always)]
fn channels(values: &[Lanes; 3], out: &mut [[u8; 3]]) {
    for (i, pixel) in out.iter_mut().enumerate().take(LANES) {
        for (channel, values) in pixel.iter_mut().zip(values) {
            *channel = (values[i] + 0.5) as u8;
        }
    }
}

/// Image coordinates, which repeat, in texels of the first period: from 0 to `side`, both included.
#[inline(always)]
fn texels(at: &Lanes, side: usize) -> [f32; LANES] {
    let mut out = [0.0; LANES];
    for (out, at) in out.iter_mut().zip(at) {
        *out = ((at - at.floor()) * side as f64) as f32;
    }
    out
}

/// A whole number as an index; what is none, of a surface seen edge-on, becomes some index.
#[inline(always)]
fn index(whole: f32, last: i32) -> i32 {
    nearest_whole(whole).0.clamp(0, last)
}

/// The texel of each coordinate.
#[inline(always)]
fn cells(at: &Lanes, side: usize) -> [i32; LANES] {
    let mut cells = [0; LANES];
    for (cell, texel) in cells.iter_mut().zip(&texels(at, side)) {
        *cell = index(texel.floor(), side as i32 - 1);
    }
    cells
}

/// The texels before and after each coordinate, and the share of the latter in 1/256.
#[inline(always)]
fn neighbours(at: &Lanes, side: usize) -> [[i32; LANES]; 3] {
    let (last, mut before, mut after, mut share) = (side as i32 - 1, [0; LANES], [0; LANES], [0; LANES]);
    for (i, &texel) in texels(at, side).iter().enumerate() {
        // Texels have their colours in their middles: from half a texel on, the next one begins to show.
        let next = (texel + 0.5).floor();
        let whole = index(next, last + 1);
        before[i] = if whole == 0 { last } else { whole - 1 };
        after[i] = if whole > last { 0 } else { whole };
        share[i] = index((texel + 0.5 - next) * 256.0, 256);
    }
    [before, after, share]
}

/// The texels at image coordinates from the upper left corner.
#[inline(always)]
fn nearest(image: &Image, [right, down, _]: &[Lanes; 3], out: &mut [[u8; 3]]) {
    let (columns, rows) = (cells(right, image.width), cells(down, image.height));
    for (i, pixel) in out.iter_mut().enumerate().take(LANES) {
        *pixel = image.pixels[rows[i] as usize * image.width + columns[i] as usize];
    }
}

/// The same from the four texels around, by shares of 1/256 along each axis.
#[inline(always)]
fn bilinear(image: &Image, [right, down, _]: &[Lanes; 3], out: &mut [[u8; 3]]) {
    let ([x0, x1, x], [y0, y1, y]) = (neighbours(right, image.width), neighbours(down, image.height));
    for (i, pixel) in out.iter_mut().enumerate().take(LANES) {
        let (upper, lower) = (y0[i] as usize * image.width, y1[i] as usize * image.width);
        let (left, right) = (x0[i] as usize, x1[i] as usize);
        let [a, b] = [&image.pixels[upper + left], &image.pixels[upper + right]];
        let [c, d] = [&image.pixels[lower + left], &image.pixels[lower + right]];
        let (x, y) = (x[i] as u32, y[i] as u32);
        let [p, q, r, s] = [(256 - x) * (256 - y), x * (256 - y), (256 - x) * y, x * y];
        for (n, channel) in pixel.iter_mut().enumerate() {
            let sum = p * u32::from(a[n]) + q * u32::from(b[n]) + r * u32::from(c[n]) + s * u32::from(d[n]);
            *channel = ((sum + (1 << 15)) >> 16) as u8;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::test_scenes::{Dice, rooms};
    use super::super::{DepthCamera, trace::trace_marked};
    use super::*;
    use crate::scene::RayIndex;
    use crate::sensor::raster::RasterIndex;
    use glam::{Vec2, Vec3};

    /// A wall of 4 × 2 m, 2 m before the lens, that an image of `size` texels fills.
    fn wall(size: [usize; 2], lower_left: Vec2, upper_right: Vec2) -> (Mesh, Image) {
        let (l, h) = (lower_left, upper_right);
        // Looking along +z, +x is on the left.
        let vertices = [[2.0, -1.0], [-2.0, -1.0], [-2.0, 1.0], [2.0, 1.0]].map(|[x, y]| Vec3::new(x, y, 2.0));
        let uv = [l, Vec2::new(h.x, l.y), h, Vec2::new(l.x, h.y)];
        let triangles = vec![[0, 1, 2], [0, 2, 3]];
        let pixels = (0..size[0] * size[1]).map(|n| [n as u8 * 10, 200 - n as u8 * 10, 7]).collect();
        let image = Image { width: size[0], height: size[1], pixels };
        let paints = triangles.iter().map(|t: &[u32; 3]| Paint::Image { image: 0, corners: t.map(|k| uv[k as usize]) });
        let appearance = Appearance { images: vec![image.clone()], paints: paints.collect() };
        (Mesh::painted(vertices.to_vec(), triangles, appearance).unwrap(), image)
    }

    fn picture(mesh: &Mesh, camera: &Camera, pose: &Pose, colour: Colour) -> Vec<[u8; 3]> {
        let (mut frame, mut triangles) = (Frame::default(), Vec::new());
        render_marked(&RasterIndex::build(mesh), camera, pose, &mut frame, &mut triangles);
        Painting { mesh, appearance: mesh.appearance().unwrap(), camera, pose, colour }
            .paint(&triangles, &mut frame.colour);
        frame.colour
    }

    const EYE: Pose = Pose { position: Vec3::ZERO, azimuth: 0.0 };

    #[test]
    fn an_image_on_a_wall_is_upright_not_mirrored_and_repeats() {
        let camera = Camera { width: 8, height: 4, ..Camera::default() };
        let texels = |f: fn(usize, usize) -> usize| (0..32).map(|n| f(n % 8, n / 8)).collect::<Vec<_>>();
        for ([lower_left, upper_right], expected) in [
            ([Vec2::ZERO, Vec2::ONE], texels(|col, row| row / 2 * 4 + col / 2)),
            ([Vec2::ZERO, Vec2::new(2.0, 1.0)], texels(|col, row| row / 2 * 4 + col % 4)),
            ([Vec2::new(-3.0, -5.0), Vec2::new(-1.0, -3.0)], texels(|col, row| row % 2 * 4 + col % 4)),
            // Half an image to the right and up.
            ([Vec2::splat(0.5), Vec2::splat(1.5)], texels(|col, row| (1 - row / 2) * 4 + (col / 2 + 2) % 4)),
        ] {
            let (mesh, image) = wall([4, 2], lower_left, upper_right);
            let expected: Vec<_> = expected.into_iter().map(|texel| image.pixels[texel]).collect();
            assert_eq!(picture(&mesh, &camera, &EYE, Colour::Nearest), expected, "{lower_left}");
        }
        // From behind, mirrored.
        let (mesh, image) = wall([4, 2], Vec2::ZERO, Vec2::ONE);
        let behind = Pose { position: Vec3::Z * 4.0, azimuth: std::f32::consts::PI };
        assert_eq!(picture(&mesh, &camera, &behind, Colour::Nearest)[0], image.pixels[3]);
    }

    #[test]
    fn bilinear_blends_neighbours_also_around_the_border() {
        let camera = Camera { width: 8, height: 4, ..Camera::default() };
        let (mesh, image) = wall([4, 2], Vec2::ZERO, Vec2::ONE);
        let found = picture(&mesh, &camera, &EYE, Colour::Bilinear);
        // The middles of pixels are a quarter of a texel away from those of texels.
        let blend = |of: [usize; 4]| {
            let share = [9.0, 3.0, 3.0, 1.0].map(|sixteenths| sixteenths / 16.0);
            let sum = |n: usize| (0..4).map(|k| share[k] * f32::from(image.pixels[of[k]][n])).sum::<f32>();
            [0, 1, 2].map(|n| (sum(n) + 0.5) as u8)
        };
        assert_eq!(found[8 + 1], blend([0, 1, 4, 5]));
        assert_eq!(found[0], blend([0, 3, 4, 7]));
        let (mesh, image) = wall([1, 1], Vec2::ZERO, Vec2::ONE);
        assert_eq!(picture(&mesh, &camera, &EYE, Colour::Bilinear), [image.pixels[0]; 32]);
    }

    #[test]
    fn colours_are_interpolated_in_perspective() {
        // A floor seen at a slant: where a pixel's ray meets it is known, and red grows with z, green with x.
        let vertices = [[-8.0, 1.0], [8.0, 1.0], [8.0, 9.0], [-8.0, 9.0]].map(|[x, z]| Vec3::new(x, -1.0, z));
        let colour = |v: Vec3| [(25.0 * v.z) as u8, (10.0 * (v.x + 8.0)) as u8, 0];
        let triangles = vec![[0, 1, 2], [0, 2, 3]];
        let corners = |t: &[u32; 3]| Paint::Corners(t.map(|k| colour(vertices[k as usize])));
        let appearance = Appearance { images: Vec::new(), paints: triangles.iter().map(corners).collect() };
        let mesh = Mesh::painted(vertices.to_vec(), triangles, appearance).unwrap();
        let camera = Camera { width: 64, height: 64, ..Camera::default() };
        let found = picture(&mesh, &camera, &EYE, Colour::Nearest);
        for (col, row) in [(32, 40), (10, 50), (60, 37), (31, 60)] {
            let ray = camera.at(&EYE).ray(col, row);
            let expected = colour(ray / -ray.y);
            let apart = found[row * 64 + col].iter().zip(expected).map(|(a, b)| a.abs_diff(b)).max();
            assert!(apart <= Some(1), "{:?} {expected:?}", found[row * 64 + col]);
        }
        assert_eq!(found[0], [0; 3], "nothing is black");
    }

    #[test]
    fn rays_see_the_same_colours() {
        let (vertices, triangles) = rooms(36.0, 1.0, 7);
        let mut dice = Dice(1);
        let pixels = (0..64).map(|_| [0; 3].map(|_: u8| dice.between(0.0, 256.0) as u8)).collect();
        // Aslant, so that no wall lies on a border between texels.
        let place = |v: Vec3| Vec2::new(v.x + 0.37 * v.y + 0.11, v.z + 0.29 * v.y + 0.07);
        let on_floor = |t: &[u32; 3]| t.map(|k| place(vertices[k as usize]));
        let appearance = Appearance {
            images: vec![Image { width: 8, height: 8, pixels }],
            paints: triangles.iter().map(|t| Paint::Image { image: 0, corners: on_floor(t) }).collect(),
        };
        let mesh = Mesh::painted(vertices.clone(), triangles.clone(), appearance.clone()).unwrap();
        let (raster, rays, camera) = (RasterIndex::build(&mesh), RayIndex::build(&mesh), Camera::default());
        let [mut drawn, mut shot] = [Frame::default(), Frame::default()];
        let (mut drawn_marks, mut shot_marks) = (Vec::new(), Vec::new());
        let (mut same, mut off, mut all) = (0, 0, 0);
        for _ in 0..4 {
            let position = dice.point(Vec3::new(1.0, 1.65, 1.0), Vec3::new(35.0, 1.65, 35.0));
            let pose = Pose { position, azimuth: dice.between(0.0, 6.0) };
            render_marked(&raster, &camera, &pose, &mut drawn, &mut drawn_marks);
            trace_marked(&rays, &camera, &pose, &mut shot, &mut shot_marks);
            for (frame, marks) in [(&mut drawn, &drawn_marks), (&mut shot, &shot_marks)] {
                let (mesh, appearance, camera, pose) = (&mesh, &appearance, &camera, &pose);
                Painting { mesh, appearance, camera, pose, colour: Colour::Nearest }.paint(marks, &mut frame.colour);
            }
            for at in 0..drawn.depth.len() {
                all += 1;
                if drawn_marks[at] != shot_marks[at] {
                    continue;
                }
                assert_eq!(drawn.colour[at], shot.colour[at]);
                same += 1;
                // The texture lies on the world like a map: the point that the ray hits says which texel it is.
                let hit = camera.at(&pose).unproject(at % camera.width, at / camera.width, shot.depth[at]);
                let texel = |v: f32| (v.rem_euclid(1.0) * 8.0) as usize % 8;
                let uv = place(hit);
                let expected = appearance.images[0].pixels[(7 - texel(uv.y)) * 8 + texel(uv.x)];
                off += usize::from(drawn.colour[at] != expected);
            }
        }
        assert!((all - same) * 1000 <= all, "{same} of {all}");
        assert!(off * 500 <= all, "{off} of {all}");
    }

    #[test]
    fn all_instruction_sets_give_the_same_colours() {
        let scene = Scene::painted_rooms();
        let (mesh, camera) = (scene.mesh(), &Camera::default());
        let pose = &Pose { position: Vec3::new(1.1, 1.3, 2.0), azimuth: 1.0 };
        let (mut frame, mut triangles) = (Frame::default(), Vec::new());
        render_marked(scene.raster(), camera, pose, &mut frame, &mut triangles);
        for colour in [Colour::Nearest, Colour::Bilinear] {
            let painting = Painting { mesh, appearance: mesh.appearance().unwrap(), camera, pose, colour };
            let mut pictures = InstructionSet::available().map(|set| {
                let mut picture = Vec::new();
                painting.paint_with(set, &triangles, &mut picture);
                picture
            });
            let first = pictures.next().unwrap();
            assert!(first.contains(&[90, 70, 50]) && pictures.all(|picture| picture == first));
        }
    }

    #[test]
    fn depth_has_the_same_bits_with_and_without_colours() {
        let scene = Scene::painted_rooms();
        let camera = Camera::default();
        let [mut depth, mut colour] = [Frame::default(), Frame::default()];
        for &start in scene.starts() {
            let pose = scene.lattice().pose(start);
            DepthCamera(camera).capture(&scene, &pose, &mut depth);
            RgbdCamera { camera, colour: Colour::Bilinear }.capture(&scene, &pose, &mut colour);
            assert_eq!(depth.depth, colour.depth);
            assert!(depth.colour.is_empty() && colour.colour.len() == colour.depth.len());
            RgbdCamera { camera, colour: Colour::Off }.capture(&scene, &pose, &mut colour);
            assert_eq!(depth, colour);
        }
        let pose = scene.lattice().pose(scene.starts()[0]);
        RgbdCamera { camera, colour: Colour::Nearest }.capture(&Scene::two_rooms(), &pose, &mut colour);
        assert!(colour.colour.is_empty(), "a mesh without colours has none");
    }
}
