//! OBJ files: triangles and, when asked for, their colours from vertices, MTL materials and images.
//!
//! Polygons of any shape become triangles. Points, lines, curves, normals and names are left out.

use super::appearance::{Appearance, Image, Paint};
use super::image::ImageError;
use super::mtl::{self, Map};
use super::polygon::{MAX_CORNERS, triangulate};
use super::{Mesh, MeshError};
use glam::{Vec2, Vec3};
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::{fs, io};

/// Faces that name no colour, in a file that has some.
pub const GREY: [u8; 3] = [204; 3];

/// Files larger than this are not read as materials or images, bytes.
const MAX_BESIDE: u64 = 256 << 20;

/// Why an OBJ file, or a file that it names, could not be used.
#[derive(Debug, thiserror::Error)]
pub enum ObjError {
    /// The file system says no.
    #[error("cannot read {path}: {source}")]
    Read {
        /// What was to be read.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// A statement that cannot be understood.
    #[error("{path}, line {line}: {reason}")]
    Line {
        /// The OBJ or MTL file.
        path: PathBuf,
        /// From 1.
        line: usize,
        /// What was expected and what was found.
        reason: String,
    },
    /// A texture that is not there.
    #[error(
        "{path}, line {line}: there is no image {image:?} beside it: put it there, or load the scene without colours"
    )]
    NoImage {
        /// The MTL file.
        path: PathBuf,
        /// From 1.
        line: usize,
        /// As written.
        image: String,
    },
    /// A texture that cannot be used.
    #[error("cannot use the image {path}: {source}")]
    Image {
        /// The image.
        path: PathBuf,
        /// Why.
        source: ImageError,
    },
    /// A mesh that cannot be used.
    #[error("{path}: {source}")]
    Mesh {
        /// The OBJ file.
        path: PathBuf,
        /// Why.
        source: MeshError,
    },
}

/// What an OBJ file holds, in its own units.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Obj {
    /// All vertices, used or not.
    pub vertices: Vec<Vec3>,
    /// Corner indices, in the order of the faces.
    pub triangles: Vec<[u32; 3]>,
    /// Colours, where they were asked for and the file has any.
    pub appearance: Option<Appearance>,
    /// What a user should hear about, one sentence each.
    pub notes: Vec<String>,
}

impl Obj {
    /// Reads a file; with `colour`, also the materials and images that it names.
    ///
    /// A texture counts for faces with texture coordinates, then colours of vertices (`v x y z r g b`), then `Kd`, then
    /// [`GREY`]. A material file that is not there leaves its faces without a material and a note; one that is there must
    /// be right, and so must the images of materials in use.
    ///
    /// # Errors
    /// Naming the file, the line and the reason.
    pub fn read(path: &Path, colour: bool) -> Result<Self, ObjError> {
        let bytes = fs::read(path).map_err(|source| ObjError::Read { path: path.into(), source })?;
        Self::parse(path, &bytes, colour)
    }

    /// The same from the bytes of a file. The path is for messages and for the files named beside it.
    ///
    /// # Errors
    /// As [`Obj::read`].
    pub fn parse(path: &Path, bytes: &[u8], colour: bool) -> Result<Self, ObjError> {
        Statements::parse(path, bytes, colour)?.build(path, colour)
    }

    /// The mesh, in metres.
    ///
    /// # Errors
    /// When it has no triangle with an area.
    pub fn into_mesh(self, path: &Path, metres_per_unit: f32) -> Result<Mesh, ObjError> {
        let vertices = self.vertices.into_iter().map(|v| v * metres_per_unit).collect();
        let mesh = match self.appearance {
            None => Mesh::new(vertices, self.triangles),
            Some(appearance) => Mesh::painted(vertices, self.triangles, appearance),
        };
        mesh.map_err(|source| ObjError::Mesh { path: path.into(), source })
    }
}

/// An index from 1, or from the end if negative, made from 0: checked when all vertices are known.
type Corner = (usize, Option<usize>);

struct Face {
    line: usize,
    /// The first of its corners; they end where those of the next face begin.
    first: usize,
    material: Option<u32>,
}

/// The statements of a file.
#[derive(Default)]
struct Statements {
    vertices: Vec<Vec3>,
    /// Empty, or one for each vertex; NaN where it has none.
    colours: Vec<Vec3>,
    texture: Vec<Vec2>,
    corners: Vec<Corner>,
    faces: Vec<Face>,
    /// Materials in use by name, numbered in order of appearance.
    materials: BTreeMap<String, u32>,
    libraries: BTreeSet<String>,
}

impl Statements {
    fn parse(path: &Path, bytes: &[u8], colour: bool) -> Result<Self, ObjError> {
        let mut found = Self::default();
        let mut material = None;
        let mut carried = String::new();
        for (number, line) in bytes.split(|&b| b == b'\n').enumerate() {
            let line = String::from_utf8_lossy(line);
            // A backslash at its end continues a line.
            if let Some(part) = line.trim_end().strip_suffix('\\') {
                carried.push_str(part);
                carried.push(' ');
                continue;
            }
            let whole = if carried.is_empty() { line } else { Cow::Owned(std::mem::take(&mut carried) + &line) };
            let (key, rest) = whole.trim().split_once(char::is_whitespace).unwrap_or((whole.trim(), ""));
            let refuse = |reason: String| ObjError::Line { path: path.into(), line: number + 1, reason };
            match key {
                "v" => found.vertex(rest, colour).map_err(refuse)?,
                "vt" if colour => {
                    let [u, v] = numbers::<2>(rest, 1).ok_or_else(|| {
                        refuse(format!("a texture coordinate needs finite numbers, found {:?}", excerpt(rest)))
                    })?;
                    found.texture.push(Vec2::new(u, v));
                }
                "f" => found.face(rest, number + 1, material, colour).map_err(refuse)?,
                "usemtl" if colour => {
                    let next = found.materials.len() as u32;
                    material = Some(*found.materials.entry(rest.trim().into()).or_insert(next));
                }
                "mtllib" if colour => {
                    found.libraries.insert(rest.trim().into());
                }
                _ => {}
            }
        }
        Ok(found)
    }

    fn vertex(&mut self, text: &str, colour: bool) -> Result<(), String> {
        let refuse = || format!("a vertex needs three finite numbers, found {:?}", excerpt(text));
        self.vertices.push(numbers::<3>(text, 3).ok_or_else(refuse)?.into());
        if colour && (text.split_whitespace().nth(5).is_some() || !self.colours.is_empty()) {
            self.colours.resize(self.vertices.len() - 1, Vec3::NAN);
            self.colours.push(numbers::<6>(text, 6).map_or(Vec3::NAN, |[.., r, g, b]| Vec3::new(r, g, b)));
        }
        Ok(())
    }

    fn face(&mut self, text: &str, line: usize, material: Option<u32>, colour: bool) -> Result<(), String> {
        let first = self.corners.len();
        // Room for a comment behind the corners.
        for word in text.split_whitespace().take_while(|word| !word.starts_with('#')) {
            let mut parts = word.split('/');
            let position = parts.next().and_then(|part| index(part, self.vertices.len()));
            let position =
                position.ok_or_else(|| format!("a face has the corner {:?}, which is no index", excerpt(word)))?;
            let texture = match parts.next().filter(|part| colour && !part.is_empty()) {
                None => None,
                Some(part) => Some(index(part, self.texture.len()).ok_or_else(|| {
                    format!("a face has the corner {:?}, whose texture coordinate is no index", excerpt(word))
                })?),
            };
            self.corners.push((position, texture));
        }
        if self.corners.len() - first > MAX_CORNERS {
            return Err(format!("a face has more than {MAX_CORNERS} corners: cut it up"));
        }
        self.faces.push(Face { line, first, material });
        Ok(())
    }

    fn build(self, path: &Path, colour: bool) -> Result<Obj, ObjError> {
        let mut obj = Obj::default();
        let mut palette = Palette::default();
        if colour {
            palette = Palette::read(path, &self, &mut obj.notes)?;
        }
        let is_coloured = colour && (!self.colours.is_empty() || palette.slots.iter().any(Option::is_some));
        let colour_scale = if self.colours.iter().any(|c| c.max_element() > 1.0) { 1.0 } else { 255.0 };
        let mut paints = Vec::new();
        let mut polygon = Vec::new();
        for (number, face) in self.faces.iter().enumerate() {
            let end = self.faces.get(number + 1).map_or(self.corners.len(), |next| next.first);
            let corners = &self.corners[face.first..end];
            polygon.clear();
            for &(position, texture) in corners {
                let found = self.vertices.get(position).filter(|_| texture.is_none_or(|t| t < self.texture.len()));
                polygon.push(*found.ok_or_else(|| {
                    let reason = format!(
                        "a face uses vertex {}{}, but the file has {} vertices and {} texture coordinates",
                        position + 1,
                        texture.map_or(String::new(), |t| format!("/{}", t + 1)),
                        self.vertices.len(),
                        self.texture.len()
                    );
                    ObjError::Line { path: path.into(), line: face.line, reason }
                })?);
            }
            for triangle in triangulate(&polygon) {
                let corners = triangle.map(|k| corners[k]);
                obj.triangles.push(corners.map(|(position, _)| position as u32));
                if is_coloured {
                    paints.push(self.paint(corners, palette.slot(face.material), colour_scale));
                }
            }
        }
        obj.appearance = is_coloured.then_some(Appearance { images: palette.images, paints });
        obj.vertices = self.vertices;
        Ok(obj)
    }

    fn paint(&self, corners: [Corner; 3], slot: Option<&Slot>, scale: f32) -> Paint {
        let image = slot.and_then(|slot| slot.image);
        if let (Some((image, [times, plus])), [(_, Some(a)), (_, Some(b)), (_, Some(c))]) = (image, corners) {
            return Paint::Image { image, corners: [a, b, c].map(|t| self.texture[t] * times + plus) };
        }
        let colours = corners.map(|(position, _)| self.colours.get(position).filter(|c| c.is_finite()));
        if let [Some(a), Some(b), Some(c)] = colours {
            return Paint::Corners([a, b, c].map(|c| (*c * scale).to_array().map(|v| v.round() as u8)));
        }
        Paint::Corners([slot.and_then(|slot| slot.colour).unwrap_or(GREY); 3])
    }
}

/// A material with its image.
struct Slot {
    colour: Option<[u8; 3]>,
    /// Index into the images; factor and summand of texture coordinates.
    image: Option<(u32, [Vec2; 2])>,
}

/// The materials in use.
#[derive(Default)]
struct Palette {
    images: Vec<Image>,
    /// By the material's number; `None` where nothing defines it.
    slots: Vec<Option<Slot>>,
}

impl Palette {
    fn slot(&self, material: Option<u32>) -> Option<&Slot> {
        self.slots.get(material? as usize)?.as_ref()
    }

    fn read(obj: &Path, statements: &Statements, notes: &mut Vec<String>) -> Result<Self, ObjError> {
        let (mut known, mut missing) = (BTreeMap::new(), Vec::new());
        for library in &statements.libraries {
            // One name with spaces in it, or several names.
            let several = || library.split_whitespace().filter_map(|name| beside(obj, name)).collect();
            let paths: Vec<PathBuf> = beside(obj, library).map_or_else(several, |path| vec![path]);
            if paths.is_empty() {
                missing.push(library);
            }
            for path in paths {
                let materials = mtl::parse(&read(&path)?).map_err(|(line, reason)| ObjError::Line {
                    path: path.clone(),
                    line,
                    reason,
                })?;
                for material in materials {
                    known.entry(material.name.clone()).or_insert((path.clone(), material));
                }
            }
        }
        if let Some(first) = missing.first() {
            notes.push(format!(
                "{} names {} material files that are not there: {first:?}",
                obj.display(),
                missing.len()
            ));
        }
        let (mut palette, mut numbers, mut undefined) = (Self::default(), BTreeMap::new(), Vec::new());
        palette.slots.resize_with(statements.materials.len(), || None);
        for (name, &number) in &statements.materials {
            match known.get(name) {
                Some((mtl, material)) => {
                    let map = material.map.as_ref();
                    let image = map.map(|map| palette.image(mtl, map, &mut numbers)).transpose()?;
                    palette.slots[number as usize] = Some(Slot { colour: material.colour, image });
                }
                None => undefined.push(name),
            }
        }
        if let Some(first) = undefined.first() {
            let count = undefined.len();
            notes.push(format!("{} uses {count} materials that no file defines: {first:?}", obj.display()));
        }
        Ok(palette)
    }

    /// The number of the image that a material of the file `mtl` names, and how it is laid out. Each image is read once.
    fn image(
        &mut self,
        mtl: &Path,
        map: &Map,
        numbers: &mut BTreeMap<PathBuf, u32>,
    ) -> Result<(u32, [Vec2; 2]), ObjError> {
        let missing = || ObjError::NoImage { path: mtl.into(), line: map.line, image: map.file.clone() };
        let path = beside(mtl, &map.file).ok_or_else(missing)?;
        let number = match numbers.get(&path) {
            Some(&number) => number,
            None => {
                let image = Image::decode(&read(&path)?);
                self.images.push(image.map_err(|source| ObjError::Image { path: path.clone(), source })?);
                let number = self.images.len() as u32 - 1;
                numbers.insert(path, number);
                number
            }
        };
        Ok((number, [map.scale, map.offset]))
    }
}

/// The file that another names: as written, or by its last part, because exporters write paths of their own machine.
fn beside(file: &Path, name: &str) -> Option<PathBuf> {
    let folder = file.parent().unwrap_or(Path::new(""));
    let name = name.trim().trim_matches('"').replace('\\', "/");
    let last = name.rsplit('/').next().unwrap_or_default();
    [name.as_str(), last].into_iter().map(|name| folder.join(name)).find(|path| path.is_file())
}

fn read(path: &Path) -> Result<Vec<u8>, ObjError> {
    let read = || match fs::metadata(path)?.len() {
        0..=MAX_BESIDE => fs::read(path),
        length => Err(io::Error::other(format!("{length} bytes are more than the {MAX_BESIDE} accepted"))),
    };
    read().map_err(|source| ObjError::Read { path: path.into(), source })
}

/// Enough of a line for a message.
fn excerpt(text: &str) -> String {
    text.chars().take(60).collect()
}

/// The first `N` numbers, all finite; those after the first `least` may be absent and are 0 then.
fn numbers<const N: usize>(text: &str, least: usize) -> Option<[f32; N]> {
    let mut found = [0.0; N];
    let mut words = text.split_whitespace();
    for (n, number) in found.iter_mut().enumerate() {
        match words.next() {
            Some(word) => *number = word.parse().ok().filter(|value: &f32| value.is_finite())?,
            None if n >= least => break,
            None => return None,
        }
    }
    Some(found)
}

/// From 0, of an index from 1 or, if negative, back from the last of `count`.
fn index(text: &str, count: usize) -> Option<usize> {
    match text.parse::<i64>().ok()? {
        0 => None,
        back @ ..0 => count.checked_sub(usize::try_from(back.unsigned_abs()).ok()?),
        number => usize::try_from(number - 1).ok(),
    }
}

#[cfg(test)]
mod tests {
    use super::super::image::tests::png;
    use super::*;

    /// Two triangles of a textured square, one of a plain material, one with colours at its vertices, one of nothing.
    const CARD: &str = "mtllib my card.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 5 1 0 0\nv 1 0 5 0 1 0\nv 1 1 5 0 0 1\n\
        vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl photo\nf -7/1 -6/2 -5/3 -4/4\nusemtl red\nf 1/1 2/2 3/3\n\
        f 5 6 \\\n 7\nusemtl nowhere\nf 1//1 2//1 4//1 # done\n";
    const LIBRARY: &str = "newmtl photo\nKd 0 0 0\nmap_Kd -o 0.5 C:\\work\\tile.png\nnewmtl red\nKd 1 0 0\n";

    fn folder(library: Option<&str>, image: bool) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("card.obj");
        fs::write(&path, CARD).unwrap();
        if let Some(text) = library {
            fs::write(folder.path().join("my card.mtl"), text).unwrap();
        }
        if image {
            fs::write(folder.path().join("tile.png"), png(2, 1, png::ColorType::Rgb, &[9, 8, 7, 6, 5, 4])).unwrap();
        }
        (folder, path)
    }

    #[test]
    fn each_face_gets_the_best_colours_that_it_has() {
        let (_folder, path) = folder(Some(LIBRARY), true);
        let obj = Obj::read(&path, true).unwrap();
        let appearance = obj.appearance.unwrap();
        assert_eq!(appearance.images, [Image { width: 2, height: 1, pixels: vec![[9, 8, 7], [6, 5, 4]] }]);
        let [(a, b), (c, d)] = [((0.5, 0.0), (1.5, 0.0)), ((1.5, 1.0), (0.5, 1.0))];
        let photo = |corners: [(f32, f32); 3]| Paint::Image { image: 0, corners: corners.map(Vec2::from) };
        let plain = |colour: [u8; 3]| Paint::Corners([colour; 3]);
        let mixed = Paint::Corners([[255, 0, 0], [0, 255, 0], [0, 0, 255]]);
        assert_eq!(appearance.paints, [photo([a, b, c]), photo([a, c, d]), plain([255, 0, 0]), mixed, plain(GREY)]);
        assert_eq!(obj.triangles, [[0, 1, 2], [0, 2, 3], [0, 1, 2], [4, 5, 6], [0, 1, 3]]);
        assert!(obj.notes.len() == 1 && obj.notes[0].contains("nowhere"), "{:?}", obj.notes);
    }

    #[test]
    fn without_colours_nothing_beside_the_file_is_opened() {
        let (_folder, path) = folder(Some("Kd nonsense"), false);
        let obj = Obj::read(&path, false).unwrap();
        assert_eq!((obj.triangles.len(), obj.appearance, obj.notes.len()), (5, None, 0));
    }

    #[test]
    fn what_is_missing_or_broken_is_named() {
        let message = |library, image| Obj::read(&folder(library, image).1, true).unwrap_err().to_string();
        let missing = message(Some(LIBRARY), false);
        assert!(missing.contains("my card.mtl, line 3") && missing.contains("tile.png"), "{missing}");
        assert!(message(Some("newmtl a\nKd nan"), true).contains("line 2"));
        let (_folder, path) = folder(Some(&LIBRARY.replace("tile.png", "card.obj")), true);
        let error = Obj::read(&path, true).unwrap_err().to_string();
        assert!(error.contains("card.obj") && error.contains("neither a PNG nor a JPEG"), "{error}");
        let (_folder, path) = folder(None, true);
        let obj = Obj::read(&path, true).unwrap();
        assert!(obj.notes[0].contains("my card.mtl"), "{:?}", obj.notes);
        assert_eq!(obj.appearance.map(|a| a.paints[0]), Some(Paint::Corners([GREY; 3])));
    }

    #[test]
    fn bad_statements_have_a_line() {
        let message = |text: &str| Obj::parse(Path::new("a.obj"), text.as_bytes(), true).unwrap_err().to_string();
        for (text, line) in [
            ("v 0 0 0\nf 1 2 9", 2),
            ("v 0 0 0\nv 1 0 0\nf -3 1 2", 3),
            ("f 0 1 2", 1),
            ("f 1/x 2 3", 1),
            ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1/1 2/1 3/1", 4),
            ("\nv 1 inf 2", 2),
            ("v 1 2", 1),
            ("vt nan", 1),
            (&format!("f{}", " 1".repeat(5000)), 1),
            ("f 18446744073709551616 1 1", 1),
        ] {
            assert!(message(text).starts_with(&format!("a.obj, line {line}: ")), "{}", message(text));
        }
        let obj = Obj::parse(Path::new("a.obj"), b"v 0 0 0\nv 1 0 0\nf 1 2\nf\nf 1\n\xff\nl 1 2\n", true).unwrap();
        assert!(obj.triangles.is_empty() && obj.appearance.is_none());
    }

    #[test]
    fn vertex_colours_may_be_bytes() {
        let text = b"v 0 0 0 255 0 0\nv 1 0 0 0 128 0\nv 0 1 0 0 0 1\nf 1 2 3";
        let obj = Obj::parse(Path::new("a.obj"), text, true).unwrap();
        assert_eq!(obj.appearance.unwrap().paints, [Paint::Corners([[255, 0, 0], [0, 128, 0], [0, 0, 1]])]);
    }
}
