//! The images of a mesh on one sheet, for formats that know one texture.
//!
//! `Mesh + Appearance → cut → pack → Baked`. Images that repeat are repeated on the sheet as often as their largest face
//! needs, up to [`MAX_BLOCK`]; faces that span more are cut at tile borders, and those that span absurdly many tiles show the
//! mean of their image. A border of wrapped texels around each block
//! keeps interpolation off its neighbours.

mod cut;
mod pack;

use cut::{Corner, Cutter, range};
use glam::{Vec2, Vec3};
use nbp_env::scene::{Appearance, Image, Mesh, Paint};
use pack::{Sheet, pack};
use std::borrow::Cow;
use std::collections::HashMap;

/// Texels to which an image is repeated at most; one that is larger is there once.
const MAX_BLOCK: usize = 512;

/// Resolutions tried: 8192 texels become one.
const MAX_HALVINGS: u32 = 13;

/// Wrapped texels on each side of a block.
const GUTTER: usize = 2;

/// Pieces into which a face is cut at most.
const MAX_PIECES: f64 = 4096.0;

/// Cuts in a mesh at most.
const MAX_CUTS: f64 = (1 << 20) as f64;

/// Largest texture coordinate, tiles: beyond it `f32` hardly tells the texels of a tile apart.
const MAX_UV: f64 = 1e6;

/// Texels that do not count when the extent of a face is measured.
const SLACK: f64 = 0.1;

/// Tiles needed of an image that no face shows.
const UNUSED: f64 = -1.0;

/// A mesh with a single image.
#[derive(Debug, Clone)]
pub(crate) struct Baked {
    /// Metres; the mesh's own corners and those of cuts.
    pub(crate) vertices: Vec<Vec3>,
    /// Corners of each triangle.
    pub(crate) triangles: Vec<[u32; 3]>,
    /// Texture coordinates of the corners, as in OBJ files, from 0 to 1.
    pub(crate) uvs: Vec<[Vec2; 3]>,
    pub(crate) sheet: Image,
    /// How often the resolution was halved for a sheet of at most 8192 texels a side.
    pub(crate) halvings: u32,
}

/// A face, the number of its block, and the lower left tile border that becomes the block's.
struct Face {
    corners: Vec<Corner>,
    block: usize,
    origin: [f64; 2],
}

/// Part of the sheet that shows one image, or colours at three of its texels.
struct Block<'a> {
    look: Look<'a>,
    /// Texels in a tile.
    tile: [usize; 2],
    /// Texels, border excluded.
    size: [usize; 2],
}

enum Look<'a> {
    Image(Cow<'a, Image>),
    Colours([[u8; 3]; 3]),
}

/// Puts all that a mesh shows on one sheet; `None` where no sheet holds it.
pub(crate) fn bake(mesh: &Mesh, appearance: &Appearance) -> Option<Baked> {
    let images = &appearance.images;
    let (vertices, triangles) = weld(mesh);
    let mut cutter = Cutter::new(vertices);
    let mut faces = Vec::with_capacity(triangles.len());
    let mut colours: Vec<[[u8; 3]; 3]> = Vec::new();
    let (mut number_of, mut means, mut cuts) = (HashMap::new(), HashMap::new(), 0.0);
    for (&triangle, paint) in triangles.iter().zip(&appearance.paints) {
        let face = |uv: [[f64; 2]; 3]| [0, 1, 2].map(|n| Corner { vertex: triangle[n], uv: uv[n] }).to_vec();
        let corner_colours = match *paint {
            Paint::Corners(corners) => corners,
            Paint::Image { image, corners } => {
                let (number, image) = (image as usize, &images[image as usize]);
                let corners = face(corners.map(|uv| uv.to_array().map(f64::from)));
                let more = pieces(&corners, image) - 1.0;
                if more < MAX_PIECES && cuts + more <= MAX_CUTS {
                    cuts += more;
                    cut(&mut cutter, corners, number, image, &mut faces);
                    continue;
                }
                [*means.entry(number).or_insert_with(|| mean(image)); 3]
            }
        };
        let number = *number_of.entry(corner_colours).or_insert(colours.len());
        if number == colours.len() {
            colours.push(corner_colours);
        }
        let corners = face([[0.5, 0.5], [1.5, 0.5], [0.5, 1.5]]);
        faces.push(Face { corners, block: images.len() + number, origin: [0.0; 2] });
    }
    // Tiles that each image needs along each axis.
    let mut needs = vec![[UNUSED; 2]; images.len()];
    for face in faces.iter().filter(|face| face.block < images.len()) {
        for (axis, need) in needs[face.block].iter_mut().enumerate() {
            *need = need.max(range(&face.corners, axis)[1] - face.origin[axis]);
        }
    }
    let (blocks, sheet, halvings) = (0..=MAX_HALVINGS).find_map(|halvings| {
        let blocks: Vec<Block<'_>> = blocks(images, &needs, &colours, halvings);
        let sheet = pack(&blocks.iter().map(|block| block.size.map(|side| side + 2 * GUTTER)).collect::<Vec<_>>())?;
        Some((blocks, sheet, halvings))
    })?;
    let mut baked =
        Baked { vertices: Vec::new(), triangles: Vec::new(), uvs: Vec::new(), sheet: draw(&blocks, &sheet), halvings };
    let mut parts = Vec::new();
    for face in &faces {
        parts.clear();
        cutter.triangulate(&face.corners, &mut parts);
        let (block, corner) = (&blocks[face.block], sheet.corners[face.block]);
        let place = |at: &Corner| {
            let [u, v] = [0, 1].map(|axis| (at.uv[axis] - face.origin[axis]) * block.tile[axis] as f64);
            let column = (corner[0] + GUTTER) as f64 + u;
            let row = (corner[1] + GUTTER + block.size[1]) as f64 - v;
            Vec2::new((column / sheet.size[0] as f64) as f32, (1.0 - row / sheet.size[1] as f64) as f32)
        };
        baked.triangles.extend(parts.iter().map(|part| part.map(|corner| corner.vertex)));
        baked.uvs.extend(parts.iter().map(|part| [0, 1, 2].map(|n| place(&part[n]))));
    }
    baked.vertices = cutter.vertices;
    Some(baked)
}

/// One vertex for each position: faces that touch then share edges.
fn weld(mesh: &Mesh) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let (mut vertices, mut number_of) = (Vec::new(), HashMap::new());
    let numbers: Vec<u32> = mesh
        .vertices()
        .iter()
        .map(|&v| {
            // Adding zero turns -0 into 0.
            *number_of.entry((v + 0.0).to_array().map(f32::to_bits)).or_insert_with(|| {
                vertices.push(v + 0.0);
                vertices.len() as u32 - 1
            })
        })
        .collect();
    (vertices, mesh.triangles().iter().map(|t| t.map(|v| numbers[v as usize])).collect())
}

/// Pieces that [`cut`] makes of a face at most; infinitely many where its coordinates are too large to tell.
fn pieces(face: &[Corner], image: &Image) -> f64 {
    let along = |(axis, side)| {
        let [low, high] = range(face, axis);
        if low < -MAX_UV || high > MAX_UV { f64::INFINITY } else { ((high - low) / period(side)).ceil() + 1.0 }
    };
    match [(0, image.width), (1, image.height)].map(along) {
        [columns, rows] if columns <= 2.0 && rows <= 2.0 => 1.0,
        [columns, rows] => columns * rows,
    }
}

/// Tiles of a side of so many texels that a block holds.
fn period(side: usize) -> f64 {
    (MAX_BLOCK / side).max(1) as f64
}

/// Tiles of a side of so many texels that do not count.
fn slack(side: usize) -> f64 {
    (SLACK / side as f64).max(cut::SLACK)
}

/// Cuts a face where it spans more tiles than its image's block will hold.
fn cut(cutter: &mut Cutter, face: Vec<Corner>, block: usize, image: &Image, faces: &mut Vec<Face>) {
    let sides = [image.width, image.height];
    let mut parts = vec![face];
    for (axis, side) in sides.into_iter().enumerate() {
        let period = period(side);
        let fits = |face: &[Corner]| {
            let [low, high] = range(face, axis);
            high - first_tile(low, side) <= period + slack(side)
        };
        let cut = |face: Vec<Corner>| if fits(&face) { vec![face] } else { cutter.cut(face, axis, period) };
        parts = parts.into_iter().flat_map(cut).collect();
    }
    faces.extend(parts.into_iter().map(|corners| {
        let origin = [0, 1].map(|axis| first_tile(range(&corners, axis)[0], sides[axis]));
        Face { corners, block, origin }
    }));
}

fn first_tile(low: f64, side: usize) -> f64 {
    (low + slack(side)).floor()
}

/// Mean colour.
fn mean(image: &Image) -> [u8; 3] {
    let sum =
        image.pixels.iter().fold([0; 3], |sum: [usize; 3], texel| [0, 1, 2].map(|n| sum[n] + usize::from(texel[n])));
    sum.map(|channel| (channel / image.pixels.len().max(1)) as u8)
}

fn blocks<'a>(images: &'a [Image], needs: &[[f64; 2]], colours: &[[[u8; 3]; 3]], halvings: u32) -> Vec<Block<'a>> {
    let of_image = |(image, need): (&'a Image, &[f64; 2])| {
        let image = if halvings == 0 { Cow::Borrowed(image) } else { Cow::Owned(shrink(image, 1 << halvings)) };
        let tile = [image.width, image.height];
        let size = [0, 1].map(|axis| (need[axis] * tile[axis] as f64 - SLACK).ceil().max(0.0) as usize);
        // Images that no face shows keep an empty block, so that numbers stay.
        let size = if need[0] > UNUSED { size.map(|side| side.max(1)) } else { [0; 2] };
        Block { look: Look::Image(image), tile, size }
    };
    let of_colours = |&corners: &[[u8; 3]; 3]| Block { look: Look::Colours(corners), tile: [1; 2], size: [2; 2] };
    images.iter().zip(needs).map(of_image).chain(colours.iter().map(of_colours)).collect()
}

/// Box-filtered to a `factor`-th of its size.
fn shrink(image: &Image, factor: usize) -> Image {
    let [width, height] = [image.width, image.height].map(|side| side.div_ceil(factor));
    let mean = |at: usize| {
        let part = |at: usize, new: usize, old: usize| at * old / new..((at + 1) * old).div_ceil(new);
        let rows = part(at / width, height, image.height);
        let texels =
            rows.flat_map(|row| part(at % width, width, image.width).map(move |column| row * image.width + column));
        let (sum, count) = texels.fold(([0; 3], 0), |(sum, count), texel| {
            let texel = image.pixels[texel];
            ([0, 1, 2].map(|n| sum[n] + usize::from(texel[n])), count + 1)
        });
        sum.map(|channel| ((channel + count / 2) / count) as u8)
    };
    Image { width, height, pixels: (0..width * height).map(mean).collect() }
}

fn draw(blocks: &[Block<'_>], sheet: &Sheet) -> Image {
    let [width, height] = sheet.size;
    let used = || blocks.iter().zip(&sheet.corners).filter(|(block, _)| block.size[0] > 0);
    // What lies between blocks takes a colour that is there already: palettes are short.
    let between = used().next().map_or([0; 3], |(block, _)| block.texel(0, 0));
    let mut pixels = vec![between; width * height];
    for (block, corner) in used() {
        for row in 0..block.size[1] + 2 * GUTTER {
            let start = (corner[1] + row) * width + corner[0];
            let line = &mut pixels[start..start + block.size[0] + 2 * GUTTER];
            // Texels above the block's lower border, which is a tile's.
            let up = (block.size[1] + GUTTER) as i64 - 1 - row as i64;
            for (texel, column) in line.iter_mut().zip(-(GUTTER as i64)..) {
                *texel = block.texel(column, up);
            }
        }
    }
    Image { width, height, pixels }
}

impl Block<'_> {
    fn texel(&self, right: i64, up: i64) -> [u8; 3] {
        match &self.look {
            Look::Image(image) => {
                let column = right.rem_euclid(image.width as i64) as usize;
                let row = image.height - 1 - up.rem_euclid(image.height as i64) as usize;
                image.pixels[row * image.width + column]
            }
            // The fourth texel makes interpolation between four exact on the triangle of the first three.
            Look::Colours([a, b, c]) => match (right > 0, up > 0) {
                (false, false) => *a,
                (true, false) => *b,
                (false, true) => *c,
                (true, true) => {
                    [0, 1, 2].map(|n| (i16::from(b[n]) + i16::from(c[n]) - i16::from(a[n])).clamp(0, 255) as u8)
                }
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows of letters, told apart by their colours.
    fn image(width: usize, height: usize, red: u8) -> Image {
        let pixels = (0..width * height).map(|n| [red, (n % width) as u8, (n / width) as u8]).collect();
        Image { width, height, pixels }
    }

    /// Colour that OBJ-style coordinates name.
    fn lookup(image: &Image, uv: [f64; 2]) -> [u8; 3] {
        let column = (uv[0] * image.width as f64).floor().rem_euclid(image.width as f64) as usize;
        let row = ((1.0 - uv[1]) * image.height as f64).floor().rem_euclid(image.height as f64) as usize;
        image.pixels[row * image.width + column]
    }

    /// A floor in two triangles, one spanning 20 tiles of the first image and one 2 by 3 tiles of the second, and a coloured
    /// triangle.
    fn scene() -> Mesh {
        let at = |x: f32, z: f32| Vec3::new(x, 0.0, z);
        let vertices = vec![at(0.0, 0.0), at(20.0, 0.0), at(20.0, 30.0), at(0.0, 30.0), at(-5.0, 5.0)];
        let uv =
            |scale: f32, n: [usize; 3]| n.map(|n| Vec2::new(vertices[n].x * scale + 0.3, vertices[n].z * scale - 2.6));
        let paints = vec![
            Paint::Image { image: 0, corners: uv(1.0, [0, 1, 2]) },
            Paint::Image { image: 2, corners: uv(0.1, [0, 2, 3]) },
            Paint::Corners([[0, 10, 20], [255, 0, 0], [0, 0, 200]]),
        ];
        let images = vec![image(64, 100, 1), image(8, 8, 2), image(40, 30, 3)];
        let triangles = vec![[0, 1, 2], [0, 2, 3], [0, 3, 4]];
        Mesh::painted(vertices, triangles, Appearance { images, paints }).unwrap()
    }

    #[test]
    fn every_point_keeps_its_colour() {
        let mesh = scene();
        let appearance = mesh.appearance().unwrap();
        let baked = bake(&mesh, appearance).unwrap();
        assert_eq!(baked.halvings, 0);
        assert!(baked.triangles.len() > 20, "20 tiles of 64 texels are cut, {} triangles", baked.triangles.len());
        let area = |corners: [Vec3; 3]| (corners[1] - corners[0]).cross(corners[2] - corners[0]).length() / 2.0;
        let total: f32 = baked.triangles.iter().map(|t| area(t.map(|v| baked.vertices[v as usize]))).sum();
        assert!((total - 675.0).abs() < 1e-2, "{total}");
        let mut compared = 0;
        for (triangle, uvs) in baked.triangles.iter().zip(&baked.uvs) {
            let corners = triangle.map(|v| baked.vertices[v as usize]);
            for weights in [[0.4, 0.3, 0.3], [0.8, 0.15, 0.05], [0.1, 0.05, 0.85]] {
                let mix = |values: [f32; 3]| (0..3).map(|n| values[n] * weights[n]).sum::<f32>();
                let at = Vec2::new(mix(corners.map(|c| c.x)), mix(corners.map(|c| c.z)));
                let found = lookup(&baked.sheet, [mix(uvs.map(|c| c.x)), mix(uvs.map(|c| c.y))].map(f64::from));
                let (image, scale) = match at {
                    at if at.x < 0.0 => continue,
                    at if at.y < 1.5 * at.x => (0, 1.0),
                    _ => (2, 0.1),
                };
                let want = [at.x * scale + 0.3, at.y * scale - 2.6].map(f64::from);
                // On a border of two texels either is right.
                let near = [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]].map(|step| {
                    let image = &appearance.images[image];
                    lookup(
                        image,
                        [want[0] + step[0] * 0.02 / image.width as f64, want[1] + step[1] * 0.02 / image.height as f64],
                    )
                });
                assert!(near.contains(&found), "{at}: {found:?}, not {near:?}");
                compared += 1;
            }
        }
        assert!(compared > 60);
        let coloured = baked.uvs.last().unwrap().map(|uv| lookup(&baked.sheet, uv.to_array().map(f64::from)));
        assert_eq!(coloured, [[0, 10, 20], [255, 0, 0], [0, 0, 200]]);
    }

    #[test]
    fn faces_of_absurdly_many_tiles_show_the_mean() {
        let appearance = |u: [f32; 3]| Appearance {
            images: vec![Image { width: 2, height: 512, pixels: [[0, 40, 0], [200, 0, 0]].repeat(512) }],
            paints: vec![Paint::Image { image: 0, corners: [0, 1, 2].map(|n| Vec2::new(0.3 * n as f32, u[n])) }],
        };
        let baked = |u: [f32; 3]| {
            let corners = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
            let mesh = Mesh::painted(corners, vec![[0, 1, 2]], appearance(u)).unwrap();
            bake(&mesh, mesh.appearance().unwrap()).unwrap()
        };
        for absurd in [[1e17, 1e17, 2e17], [0.0, 1e8, 0.0], [0.0, 5000.0, 0.0], [f32::MAX, f32::MIN, 0.0]] {
            let baked = baked(absurd);
            assert_eq!((baked.triangles.len(), baked.sheet.pixels[0]), (1, [100, 20, 0]), "{absurd:?}");
        }
        assert!(baked([0.0, 1000.0, 0.0]).triangles.len() >= 1000);
    }

    /// A side of 4000 texels has less than 1e-4 tiles to a tenth of a texel: cuts and blocks must agree on what counts.
    #[test]
    fn a_hair_before_a_tile_makes_no_larger_block() {
        let [low, high] = [1.0 - 0.6e-4, 1.5].map(|u| Vec2::new(u, 0.0));
        let appearance = Appearance {
            images: vec![Image { width: 4000, height: 1, pixels: vec![[7; 3]; 4000] }],
            paints: vec![Paint::Image { image: 0, corners: [low, high, low.with_y(0.5)] }],
        };
        let mesh = Mesh::painted(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![[0, 1, 2]], appearance).unwrap();
        let baked = bake(&mesh, mesh.appearance().unwrap()).unwrap();
        assert_eq!((baked.triangles.len(), baked.halvings), (1, 0));
        assert!(baked.sheet.width < 4200, "{}", baked.sheet.width);
    }

    #[test]
    fn sheets_that_are_too_large_are_halved() {
        let corners = [Vec2::ZERO, Vec2::X, Vec2::ONE];
        let appearance = Appearance {
            images: vec![Image { width: 9000, height: 3, pixels: vec![[7; 3]; 27_000] }],
            paints: vec![Paint::Image { image: 0, corners }],
        };
        let mesh = Mesh::painted(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![[0, 1, 2]], appearance).unwrap();
        let baked = bake(&mesh, mesh.appearance().unwrap()).unwrap();
        assert_eq!((baked.halvings, baked.sheet.width), (1, 8192));
        assert_eq!(baked.sheet.pixels[GUTTER], [7; 3]);
    }
}
