//! OBJ files: triangles and, when asked for, their colours from vertices, MTL materials and images.
//!
//! `tobj` reads the statements; polygons of any shape become triangles here, and `explain` finds the line of a fault.
//! Points, lines, curves, normals and names are left out.

use super::appearance::{Appearance, Image, Paint};
use super::image::ImageError;
use super::mtl::{self, Map};
use super::polygon::{MAX_CORNERS, triangulate};
use super::{Mesh, MeshError};
use glam::{Vec2, Vec3};
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet, HashMap};
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
    /// A file that is refused as a whole.
    #[error("{path} is not a readable OBJ file: {reason}")]
    Format {
        /// The file.
        path: PathBuf,
        /// The reader's reason.
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
    /// Vertices in use, those on the border of two parts of the file once for each.
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
        build(path, &String::from_utf8_lossy(bytes), colour)
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

/// How `tobj` is to read: polygons are cut here, because it fans concave ones, too.
const OPTIONS: tobj::LoadOptions =
    tobj::LoadOptions { single_index: false, triangulate: false, ignore_points: true, ignore_lines: true };

/// Lines with their numbers from 1: a backslash at its end continues a line, `#` ends a statement of numbers.
fn statements(text: &str) -> impl Iterator<Item = (usize, Cow<'_, str>)> {
    let mut lines = text.split('\n').enumerate();
    std::iter::from_fn(move || {
        let (mut number, first) = lines.next()?;
        let mut whole = Cow::Borrowed(first.trim());
        while let Some(part) = whole.strip_suffix('\\') {
            let part = format!("{part} ");
            let Some((next, line)) = lines.next() else {
                whole = part.into();
                break;
            };
            (number, whole) = (next, (part + line.trim()).into());
        }
        let has_numbers = ["v", "vt", "f"].contains(&whole.split_whitespace().next().unwrap_or_default());
        if let (true, Some((statement, _))) = (has_numbers, whole.split_once('#')) {
            whole = statement.trim_end().to_owned().into();
        }
        Some((number + 1, whole))
    })
}

/// A file as `tobj` wants it.
struct Plain {
    text: String,
    /// For each face, whether all of its corners have texture coordinates: `tobj` invents those that are missing.
    is_textured: Vec<bool>,
}

impl Plain {
    /// Vertices have three numbers, all of them or none a colour as well (`tobj` counts colours apart from vertices), NaN
    /// where a vertex has none; weights, lines and points are left out; one library stands for all.
    fn of(text: &str, names: &Names, colour: bool) -> Self {
        let is_coloured = |line: &str| line.starts_with('v') && line.split_whitespace().nth(6).is_some();
        let has_colours = colour && statements(text).any(|(_, line)| is_coloured(&line));
        let mut plain = Self { text: String::with_capacity(text.len() + 16), is_textured: Vec::new() };
        if !names.materials.is_empty() {
            plain.text.push_str("mtllib all\n");
        }
        for (_, line) in statements(text) {
            let (key, rest) = line.split_once(char::is_whitespace).unwrap_or((&line, ""));
            let mut words = rest.split_whitespace();
            match key {
                "v" => {
                    plain.text.push('v');
                    words.by_ref().take(3).for_each(|word| plain.text.extend([" ", word]));
                    let colours: Vec<&str> = words.take(3).collect();
                    if has_colours {
                        let colours = if colours.len() == 3 { colours } else { vec!["nan"; 3] };
                        colours.into_iter().for_each(|word| plain.text.extend([" ", word]));
                    }
                    plain.text.push('\n');
                }
                "f" if words.clone().nth(2).is_some() => {
                    plain.is_textured.push(words.all(|word| word.split('/').nth(1).is_some_and(|vt| !vt.is_empty())));
                    plain.text.extend([&*line, "\n"]);
                }
                "usemtl" if !names.materials.is_empty() => plain.text.extend(["usemtl ", rest.trim(), "\n"]),
                "vt" | "vn" | "o" | "g" => plain.text.extend([&*line, "\n"]),
                _ => {}
            }
        }
        plain
    }
}

/// What a file names beside itself.
#[derive(Default)]
struct Names {
    /// Materials in use, numbered in order of appearance.
    materials: BTreeMap<String, u32>,
    libraries: BTreeSet<String>,
}

impl Names {
    fn of(text: &str) -> Self {
        let mut names = Self::default();
        for (_, line) in statements(text) {
            let (key, rest) = line.split_once(char::is_whitespace).unwrap_or((&line, ""));
            match key {
                "usemtl" => {
                    let next = names.materials.len() as u32;
                    names.materials.entry(rest.trim().into()).or_insert(next);
                }
                "mtllib" => drop(names.libraries.insert(rest.trim().into())),
                _ => {}
            }
        }
        names
    }

    /// What `tobj` needs to number the materials of faces as here.
    fn for_tobj(&self) -> (Vec<tobj::Material>, HashMap<String, usize>) {
        let materials = vec![tobj::Material::default(); self.materials.len()];
        (materials, self.materials.iter().map(|(name, &number)| (name.clone(), number as usize)).collect())
    }
}

fn build(path: &Path, text: &str, colour: bool) -> Result<Obj, ObjError> {
    let mut obj = Obj::default();
    let names = if colour { Names::of(text) } else { Names::default() };
    let palette = Palette::read(path, &names, &mut obj.notes)?;
    let plain = Plain::of(text, &names, colour);
    let models = match tobj::load_obj_buf(&mut plain.text.as_bytes(), &OPTIONS, |_| Ok(names.for_tobj())) {
        Ok((models, _)) => models,
        Err(error) => return Err(explain(path, text, error.to_string())),
    };
    let has_colours = models.iter().any(|model| !model.mesh.vertex_color.is_empty());
    let is_coloured = colour && (has_colours || palette.slots.iter().any(Option::is_some));
    let brightest = models.iter().flat_map(|model| &model.mesh.vertex_color).fold(0.0, |most: f32, &c| most.max(c));
    let colour_scale = if brightest > 1.0 { 1.0 } else { 255.0 };
    let mut paints = Vec::new();
    let mut polygon = Vec::new();
    let mut is_textured = plain.is_textured.into_iter();
    for model in &models {
        let mesh = &model.mesh;
        let slot = mesh.material_id.and_then(|number| palette.slots.get(number)?.as_ref());
        let base = obj.vertices.len() as u32;
        obj.vertices.extend(mesh.positions.as_chunks().0.iter().map(|&p| Vec3::from_array(p)));
        let mut first = 0;
        let triangles_only = std::iter::repeat_n(3, mesh.indices.len() / 3);
        let arities: Box<dyn Iterator<Item = usize>> = match mesh.face_arities.is_empty() {
            true => Box::new(triangles_only),
            false => Box::new(mesh.face_arities.iter().map(|&arity| arity as usize)),
        };
        for arity in arities {
            let range = first..first + arity;
            first += arity;
            let indices = &mesh.indices[range.clone()];
            let is_textured = is_textured.next().unwrap_or(false);
            let slot = slot.map(|slot| (slot, is_textured));
            polygon.clear();
            polygon.extend(indices.iter().map(|&index| obj.vertices[(base + index) as usize]));
            if arity > MAX_CORNERS || polygon.iter().any(|v| !v.is_finite()) {
                return Err(explain(path, text, "a face has too many corners or one that is not finite".into()));
            }
            for triangle in triangulate(&polygon) {
                obj.triangles.push(triangle.map(|k| base + indices[k]));
                if is_coloured {
                    paints.push(paint(mesh, triangle.map(|k| range.start + k), slot, colour_scale));
                }
            }
        }
    }
    let is_endless =
        |paint: &Paint| matches!(paint, Paint::Image { corners, .. } if !corners.iter().all(|c| c.is_finite()));
    if paints.iter().any(is_endless) {
        return Err(explain(path, text, "a texture coordinate is not finite".into()));
    }
    if obj.triangles.is_empty()
        && let fault @ ObjError::Line { .. } = explain(path, text, String::new())
    {
        return Err(fault);
    }
    obj.appearance = is_coloured.then_some(Appearance { images: palette.images, paints });
    Ok(obj)
}

/// The paint of a triangle, whose corners are places in the list of indices.
fn paint(mesh: &tobj::Mesh, corners: [usize; 3], slot: Option<(&Slot, bool)>, scale: f32) -> Paint {
    let texture = |corner: usize| {
        let at = 2 * *mesh.texcoord_indices.get(corner)? as usize;
        Some(Vec2::from_slice(mesh.texcoords.get(at..at + 2)?))
    };
    let image = slot.filter(|&(_, is_textured)| is_textured).and_then(|(slot, _)| slot.image);
    if let (Some((image, [times, plus])), [Some(a), Some(b), Some(c)]) = (image, corners.map(texture)) {
        return Paint::Image { image, corners: [a, b, c].map(|t| t * times + plus) };
    }
    let colour = |corner: usize| {
        let at = 3 * mesh.indices[corner] as usize;
        Some(Vec3::from_slice(mesh.vertex_color.get(at..at + 3)?)).filter(|c| c.is_finite())
    };
    if let [Some(a), Some(b), Some(c)] = corners.map(colour) {
        return Paint::Corners([a, b, c].map(|c| (c * scale).to_array().map(|v| v.round() as u8)));
    }
    Paint::Corners([slot.and_then(|(slot, _)| slot.colour).unwrap_or(GREY); 3])
}

/// The error of a file that `tobj` refuses, or whose numbers are no numbers: the line, which `tobj` does not tell.
fn explain(path: &Path, text: &str, reason: String) -> ObjError {
    let count = |key: &str| statements(text).filter(|(_, line)| line.split_whitespace().next() == Some(key)).count();
    let totals = [count("v"), count("vt"), count("vn")];
    let mut so_far = [0_usize; 3];
    for (line, statement) in statements(text) {
        let mut words = statement.split_whitespace();
        let key = words.next().unwrap_or_default();
        let words: Vec<&str> = words.collect();
        let kind = ["v", "vt", "vn"].iter().position(|&name| name == key);
        let fault = match (key, kind) {
            (_, Some(kind)) => {
                so_far[kind] += 1;
                let least = [3, 2, 3][kind];
                let numbers = words.iter().take(least).filter(|w| w.parse().is_ok_and(f32::is_finite)).count();
                (numbers < least).then(|| {
                    format!("{key} needs {least} finite numbers, found {:?}", excerpt(&words.join(" ")))
                })
            }
            ("f" | "l", _) if words.len() > MAX_CORNERS => {
                Some(format!("a face has more than {MAX_CORNERS} corners: cut it up"))
            }
            ("f" | "l", _) => words.iter().find(|word| !is_corner(word, so_far, totals)).map(|word| {
                let [v, vt, vn] = totals;
                format!(
                    "a face has the corner {:?}, but indices count from 1, or back from -1, and the file has {v} vertices, {vt} \
                     texture coordinates and {vn} normals",
                    excerpt(word)
                )
            }),
            ("usemtl", _) if words.is_empty() => Some("usemtl names no material".into()),
            _ => None,
        };
        if let Some(reason) = fault {
            return ObjError::Line { path: path.into(), line, reason };
        }
    }
    ObjError::Format { path: path.into(), reason }
}

/// Whether `v`, `v/vt`, `v//vn` or `v/vt/vn` names what there is: `so_far` for indices back from here, or in total.
fn is_corner(word: &str, so_far: [usize; 3], totals: [usize; 3]) -> bool {
    let parts: Vec<&str> = word.split('/').collect();
    let is_index = |(n, part): (usize, &&str)| match part.parse::<i64>() {
        Ok(back @ ..0) => back.unsigned_abs() <= so_far[n] as u64,
        Ok(0) => false,
        Ok(number) => number as u64 <= totals[n] as u64,
        Err(_) => n > 0 && part.is_empty(),
    };
    parts.len() <= 3 && parts.iter().enumerate().all(is_index)
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
    /// Of all images.
    pixels: usize,
    /// By the material's number; `None` where nothing defines it.
    slots: Vec<Option<Slot>>,
}

impl Palette {
    /// Reads nothing where no material is in use.
    fn read(obj: &Path, names: &Names, notes: &mut Vec<String>) -> Result<Self, ObjError> {
        let (mut known, mut missing) = (BTreeMap::new(), Vec::new());
        for library in &names.libraries {
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
        palette.slots.resize_with(names.materials.len(), || None);
        for (name, &number) in &names.materials {
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
        let path = fs::canonicalize(&path).unwrap_or(path);
        let number = match numbers.get(&path) {
            Some(&number) => number,
            None => {
                let image = Image::decode_counted(&read(&path)?, &mut self.pixels);
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
        let flat = |t: &[u32; 3]| t.map(|i| obj.vertices[i as usize].to_array().map(|c| c as i32));
        let [a, b, c, d] = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]];
        let high = [[0, 0, 5], [1, 0, 5], [1, 1, 5]];
        let found: Vec<_> = obj.triangles.iter().map(flat).collect();
        assert_eq!(found, [[a, b, c], [a, c, d], [a, b, c], high, [a, b, d]]);
        assert!(obj.notes.len() == 1 && obj.notes[0].contains("nowhere"), "{:?}", obj.notes);
    }

    #[test]
    fn libraries_and_bare_faces_are_told_apart() {
        let (folder, path) = folder(Some(LIBRARY), true);
        let text = "mtllib\tmy card.mtl\nmtllib my card.mtl\nmtllib none.mtl\nv\t0 0 0 2\nv 1 0 0\nv 1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\n\
            usemtl\tred\nf 1/1 2/2 3/3\nl 1 2 3\nusemtl photo\nf 1 2 3\nf 1/1 2/2 3/3\n";
        let obj = Obj::parse(&path, text.as_bytes(), true).unwrap();
        let paints = obj.appearance.unwrap().paints;
        assert_eq!(paints[..2], [Paint::Corners([[255, 0, 0]; 3]), Paint::Corners([[0; 3]; 3])]);
        assert!(matches!(paints[2], Paint::Image { image: 0, .. }) && paints.len() == 3);
        assert_eq!(Obj::parse(&path, text.as_bytes(), false).unwrap().triangles.len(), 3);
        assert!(obj.notes.len() == 1 && obj.notes[0].contains("none.mtl"), "{:?}", obj.notes);
        drop(folder);
    }

    #[test]
    fn images_are_read_once_whatever_the_spelling() {
        let (folder, path) = folder(Some(&LIBRARY.replace("Kd 1 0 0", "map_Kd sub/../tile.png")), true);
        fs::create_dir(folder.path().join("sub")).unwrap();
        assert_eq!(Obj::read(&path, true).unwrap().appearance.unwrap().images.len(), 1);
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
            ("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/2 3/1", 5),
            ("v 0 0 0\nv 1 inf 2\nv 0 1 0\nf 1 2 3", 2),
            ("\nv 1 nan 2", 2),
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
