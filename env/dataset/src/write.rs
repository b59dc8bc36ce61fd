//! Scene folders in the published layout: `<scene>/<scene>.obj`, `.mtl`, `settings.json`, `new_texture.png`.
//!
//! Lengths are in the unit of the settings, metres if not asked otherwise, and `y` is up. A folder appears complete or not at all: it is written
//! under a temporary name and renamed.

use crate::atlas::bake;
use crate::convert::SceneBundle;
use glam::Vec3;
use nbp_env::scene::{Appearance, Image, Mesh, Paint, Settings};
use std::collections::HashMap;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::{fs, io};

/// Why a scene cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// The scene is there already.
    #[error("{0} exists already: choose another --out, or replace it with --replace")]
    Exists(PathBuf),
    /// Something else lies in the folder that is to be replaced.
    #[error(
        "{folder} holds {file:?}, which is no part of a scene: nothing was replaced; move it, or choose another --out"
    )]
    Foreign {
        /// The folder.
        folder: PathBuf,
        /// What would be lost.
        file: String,
    },
    /// A name that is no folder name.
    #[error("scene name {0:?} cannot be a folder: use letters, digits, '-', '_' and '.'")]
    Name(String),
    /// The file system refused.
    #[error("cannot write {path}: {source}; choose a folder that can be written, on a disk with space left")]
    Io {
        /// File or folder.
        path: PathBuf,
        /// The system's word.
        source: io::Error,
    },
    /// Settings that are not JSON.
    #[error("the settings of {scene} have no JSON form: {source}")]
    Json {
        /// Scene.
        scene: String,
        /// The serializer's word.
        source: serde_json::Error,
    },
    /// An image that is not PNG.
    #[error("the image of {scene} has no PNG form: {source}")]
    Png {
        /// Scene.
        scene: String,
        /// The encoder's word.
        source: png::EncodingError,
    },
    /// More colours than texels.
    #[error("the colours of {0} do not fit on an image of 8192 x 8192 texels: give its mesh fewer painted triangles")]
    Sheet(String),
}

/// Writes a scene as a folder of its name in `parent`, which is made if need be, and returns the folder.
///
/// # Errors
/// When the folder exists and `replace` is false, or the file system refuses.
pub fn write_scene(scene: &SceneBundle, parent: &Path, replace: bool) -> Result<PathBuf, WriteError> {
    write_scene_with(scene, &[], parent, replace)
}

/// The same with further files in the folder, given by name and content.
///
/// # Errors
/// As [`write_scene`].
pub fn write_scene_with(
    scene: &SceneBundle,
    extra: &[(String, Vec<u8>)],
    parent: &Path,
    replace: bool,
) -> Result<PathBuf, WriteError> {
    write_mesh(&scene.name, &scene.mesh, &scene.settings, extra, parent, replace).map(|written| written.folder)
}

/// What was written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Written {
    /// The scene's folder.
    pub folder: PathBuf,
    /// How often the images were halved to fit on one of 8192 × 8192 texels.
    pub halvings: u32,
}

/// Writes a scene of any origin: [`write_scene_with`] for a mesh and settings in metres.
///
/// # Errors
/// When the folder exists and `replace` is false, or the file system refuses.
pub fn write_mesh(
    name: &str,
    mesh: &Mesh,
    settings: &Settings,
    extra: &[(String, Vec<u8>)],
    parent: &Path,
    replace: bool,
) -> Result<Written, WriteError> {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
    if name.is_empty() || name.starts_with('.') || !name.chars().all(is_plain) {
        return Err(WriteError::Name(name.into()));
    }
    let folder = parent.join(name);
    if folder.exists() && !replace {
        return Err(WriteError::Exists(folder));
    }
    if let Some(file) = foreign(name, &folder) {
        return Err(WriteError::Foreign { folder, file });
    }
    let fail = |path: &Path| {
        let path = path.to_path_buf();
        move |source| WriteError::Io { path, source }
    };
    let partial = parent.join(format!(".{name}.partial-{}", std::process::id()));
    if partial.exists() {
        fs::remove_dir_all(&partial).map_err(fail(&partial))?;
    }
    fs::create_dir_all(&partial).map_err(fail(&folder))?;
    let extra = || extra.iter().try_for_each(|(file, bytes)| write_file(&partial.join(file), bytes));
    let written = extra().and_then(|()| write_files(name, mesh, settings, &partial)).and_then(|halvings| {
        put(&partial, &folder, &parent.join(format!(".{name}.old-{}", std::process::id()))).map_err(fail(&folder))?;
        Ok(halvings)
    });
    match written {
        Ok(halvings) => Ok(Written { folder, halvings }),
        Err(error) => {
            // Best effort: the first error is the one to tell.
            drop(fs::remove_dir_all(&partial));
            Err(error)
        }
    }
}

/// What lies in a folder that no scene of this name would have: a file of the user's, or a scene inside.
fn foreign(name: &str, folder: &Path) -> Option<String> {
    let own = ["obj", "mtl", "wad"].map(|extension| format!("{name}.{extension}"));
    let ours =
        |file: &str| own.iter().any(|own| own == file) || [TEXTURE, "settings.json", "import.json"].contains(&file);
    let mut names: Vec<String> =
        fs::read_dir(folder).ok()?.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names.into_iter().find(|file| !ours(file))
}

/// Renames a folder to its place. What was there waits under the name `old` until then: whoever is killed in between finds it.
fn put(new: &Path, place: &Path, old: &Path) -> io::Result<()> {
    if !place.exists() {
        return fs::rename(new, place);
    }
    if old.exists() {
        fs::remove_dir_all(old)?;
    }
    fs::rename(place, old)?;
    if let Err(error) = fs::rename(new, place) {
        // Best effort: the first error is the one to tell.
        drop(fs::rename(old, place));
        return Err(error);
    }
    fs::remove_dir_all(old)
}

fn write_files(name: &str, mesh: &Mesh, settings: &Settings, folder: &Path) -> Result<u32, WriteError> {
    let model = Model::of(name, mesh, settings.scene.metres_per_unit)?;
    let settings =
        serde_json::to_string_pretty(settings).map_err(|source| WriteError::Json { scene: name.into(), source })?;
    if let Some(png) = &model.png {
        write_file(&folder.join(TEXTURE), png)?;
    }
    // The OBJ comes last: what an interrupted run leaves behind is not taken for a scene.
    for (file, text) in [("settings.json".into(), settings), (format!("{name}.mtl"), model.mtl)] {
        write_file(&folder.join(file), text.as_bytes())?;
    }
    let (partial, path) = (folder.join("mesh.partial"), folder.join(format!("{name}.obj")));
    write_file(&partial, model.obj.as_bytes())?;
    fs::rename(&partial, &path).map_err(|source| WriteError::Io { path, source })?;
    Ok(model.halvings)
}

fn write_file(path: &Path, bytes: &[u8]) -> Result<(), WriteError> {
    let write = || {
        let mut file = fs::File::create(path)?;
        file.write_all(bytes)?;
        file.sync_all()
    };
    write().map_err(|source| WriteError::Io { path: path.into(), source })
}

/// Name of the image, as in the published scenes.
const TEXTURE: &str = "new_texture.png";

/// A mesh as the text of an OBJ file, of its MTL file, and as the bytes of its image where it has one.
///
/// Numbers are the shortest decimals that read back as the same `f32`, so the same scene has the same bytes. A mesh whose
/// triangles all have corner colours has them at its vertices (`v x y z r g b`) and no image.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Model {
    /// Text of the OBJ file.
    pub obj: String,
    /// Text of the MTL file.
    pub mtl: String,
    /// The image that the MTL names.
    pub png: Option<Vec<u8>>,
    /// How often the images were halved to fit on one of 8192 × 8192 texels.
    pub halvings: u32,
}

impl Model {
    /// The model of a mesh in metres, with a unit of so many metres.
    ///
    /// # Errors
    /// When an image of 8192 × 8192 texels cannot hold all colours of the mesh.
    pub fn of(name: &str, mesh: &Mesh, metres_per_unit: f32) -> Result<Self, WriteError> {
        let mut obj = String::with_capacity(40 * mesh.vertices().len() + 48 * mesh.triangles().len());
        let unit = if metres_per_unit == 1.0 { "metres".into() } else { format!("units of {metres_per_unit} m") };
        // Writing to a string cannot fail.
        let _ = writeln!(
            obj,
            "# {unit}, y up, normals towards the free space\nmtllib {name}.mtl\no {name}\nusemtl {MATERIAL}"
        );
        let grey = |obj: String| Self { obj, mtl: mtl([0.7; 3], ""), png: None, halvings: 0 };
        let Some(appearance) = mesh.appearance() else {
            mesh.vertices().iter().for_each(|v| push_vertex(&mut obj, *v / metres_per_unit, ""));
            mesh.triangles().iter().for_each(|t| push_face(&mut obj, t.map(|v| v + 1), None));
            return Ok(grey(obj));
        };
        if appearance.paints.iter().all(|paint| matches!(paint, Paint::Corners(_))) {
            push_coloured(&mut obj, mesh, appearance, metres_per_unit);
            return Ok(Self { mtl: mtl([1.0; 3], ""), ..grey(obj) });
        }
        let baked = bake(mesh, appearance).ok_or_else(|| WriteError::Sheet(name.into()))?;
        baked.vertices.iter().for_each(|v| push_vertex(&mut obj, *v / metres_per_unit, ""));
        let mut numbers = HashMap::new();
        let uvs: Vec<[u32; 3]> = baked
            .uvs
            .iter()
            .map(|corners| {
                corners.map(|uv| {
                    let next = numbers.len() as u32 + 1;
                    *numbers.entry(uv.to_array().map(f32::to_bits)).or_insert_with(|| {
                        let _ = writeln!(obj, "vt {} {}", uv.x, uv.y);
                        next
                    })
                })
            })
            .collect();
        baked.triangles.iter().zip(uvs).for_each(|(t, uv)| push_face(&mut obj, t.map(|v| v + 1), Some(uv)));
        let png = encode(&baked.sheet).map_err(|source| WriteError::Png { scene: name.into(), source })?;
        let mtl = mtl([1.0; 3], &format!("map_Kd {TEXTURE}\n"));
        Ok(Self { obj, mtl, png: Some(png), halvings: baked.halvings })
    }
}

const MATERIAL: &str = "surface";

fn mtl([r, g, b]: [f32; 3], map: &str) -> String {
    format!("newmtl {MATERIAL}\nKa 0 0 0\nKd {r} {g} {b}\nKs 0 0 0\nillum 1\n{map}")
}

fn push_vertex(obj: &mut String, v: Vec3, colour: &str) {
    // Adding zero turns -0 into 0.
    let _ = writeln!(obj, "v {} {} {}{colour}", v.x + 0.0, v.y + 0.0, v.z + 0.0);
}

fn push_face(obj: &mut String, [a, b, c]: [u32; 3], uv: Option<[u32; 3]>) {
    let _ = match uv {
        None => writeln!(obj, "f {a} {b} {c}"),
        Some([s, t, u]) => writeln!(obj, "f {a}/{s} {b}/{t} {c}/{u}"),
    };
}

/// A vertex for every colour that its triangles have there.
fn push_coloured(obj: &mut String, mesh: &Mesh, appearance: &Appearance, metres_per_unit: f32) {
    let mut numbers = HashMap::new();
    let mut faces = Vec::with_capacity(mesh.triangles().len());
    for (triangle, paint) in mesh.triangles().iter().zip(&appearance.paints) {
        let Paint::Corners(colours) = paint else { continue };
        faces.push([0, 1, 2].map(|n| {
            let next = numbers.len() as u32 + 1;
            *numbers.entry((triangle[n], colours[n])).or_insert_with(|| {
                let [r, g, b] = colours[n].map(|channel| f32::from(channel) / 255.0);
                push_vertex(obj, mesh.vertices()[triangle[n] as usize] / metres_per_unit, &format!(" {r} {g} {b}"));
                next
            })
        }));
    }
    faces.into_iter().for_each(|face| push_face(obj, face, None));
}

/// An image as a PNG file, with a palette where 256 colours will do.
fn encode(image: &Image) -> Result<Vec<u8>, png::EncodingError> {
    let mut colours: Vec<[u8; 3]> = image.pixels.clone();
    colours.dedup();
    colours.sort_unstable();
    colours.dedup();
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, image.width as u32, image.height as u32);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Balanced);
    let pixels = if colours.len() <= 256 {
        encoder.set_color(png::ColorType::Indexed);
        encoder.set_palette(colours.concat());
        let number_of: HashMap<[u8; 3], u8> = colours.iter().copied().zip(0..=u8::MAX).collect();
        image.pixels.iter().map(|pixel| number_of[pixel]).collect()
    } else {
        encoder.set_color(png::ColorType::Rgb);
        image.pixels.concat()
    };
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&pixels)?;
    writer.finish()?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generate::{Level, generate};
    use glam::Vec2;
    use nbp_env::Scene;

    #[test]
    fn a_written_scene_loads_as_it_was() {
        let scene = generate(Level::Simple, 5).unwrap().scene;
        let parent = tempfile::tempdir().unwrap();
        let folder = write_scene(&scene, parent.path(), false).unwrap();
        let loaded = Scene::load(&folder).unwrap();
        assert_eq!(loaded.name(), scene.name);
        let area = |mesh: &Mesh| mesh.iter_corners().map(|[a, b, c]| (b - a).cross(c - a).length()).sum::<f32>();
        assert!((area(loaded.mesh()) / area(&scene.mesh) - 1.0).abs() < 1e-4);
        assert_eq!(loaded.mesh().bounds(), scene.mesh.bounds());
        assert_eq!(*loaded.lattice(), scene.lattice());
        assert_eq!(loaded.starts().len(), 5);
        assert!(matches!(write_scene(&scene, parent.path(), false), Err(WriteError::Exists(_))));
        write_scene(&scene, parent.path(), true).unwrap();
        fs::write(folder.join("thesis.txt"), "").unwrap();
        let error = write_scene(&scene, parent.path(), true).unwrap_err().to_string();
        assert!(error.contains("thesis.txt") && folder.join("thesis.txt").exists(), "{error}");
        fs::remove_file(folder.join("thesis.txt")).unwrap();
        assert_eq!(fs::read_dir(parent.path()).unwrap().count(), 1, "no temporary folder is left");
    }

    #[test]
    fn what_was_there_comes_back_when_the_new_folder_does_not() {
        let parent = tempfile::tempdir().unwrap();
        let [new, place, old] = ["new", "place", ".old"].map(|name| parent.path().join(name));
        fs::create_dir(&place).unwrap();
        fs::write(place.join("mesh"), "first").unwrap();
        assert!(put(&new, &place, &old).is_err(), "there is nothing new");
        assert_eq!(fs::read(place.join("mesh")).unwrap(), b"first");
        fs::create_dir(&new).unwrap();
        put(&new, &place, &old).unwrap();
        assert!(!place.join("mesh").exists() && !old.exists());
    }

    /// Two triangles of a square with the given paints.
    fn square(paints: [Paint; 2], images: Vec<Image>) -> Mesh {
        let vertices = vec![Vec3::ZERO, Vec3::X, Vec3::X + Vec3::Y, Vec3::Y];
        let appearance = Appearance { images, paints: paints.to_vec() };
        Mesh::painted(vertices, vec![[0, 1, 2], [0, 2, 3]], appearance).unwrap()
    }

    #[test]
    fn corner_colours_stay_at_vertices() {
        let [red, blue] = [[255, 0, 0], [0, 0, 255]];
        let mesh = square([Paint::Corners([red; 3]), Paint::Corners([red, blue, blue])], Vec::new());
        let model = Model::of("square", &mesh, 1.0).unwrap();
        assert_eq!(model.png, None);
        assert!(model.obj.contains("v 1 1 0 1 0 0\n") && model.obj.contains("v 1 1 0 0 0 1\n"), "{}", model.obj);
        assert!(model.obj.ends_with("f 1 2 3\nf 1 4 5\n"), "{}", model.obj);
    }

    #[test]
    fn images_become_one_file() {
        let tile = |red: u8| Image { width: 2, height: 1, pixels: vec![[red, 0, 0], [red, 0, 9]] };
        let corners = [Vec2::ZERO, Vec2::X, Vec2::ONE];
        let paints = [0, 1].map(|image| Paint::Image { image, corners });
        let model = Model::of("square", &square(paints, vec![tile(1), tile(200)]), 1.0).unwrap();
        assert!(model.mtl.contains("map_Kd new_texture.png\n"));
        assert!(model.obj.contains("\nvt ") && model.obj.contains("\nf 1/1 2/2 3/3\nf 1/4 3/5 4/6\n"), "{}", model.obj);
        let png = model.png.unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(&png)).read_info().unwrap();
        assert_eq!(reader.info().palette.as_deref().map(<[u8]>::len), Some(12), "four colours");
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut pixels).unwrap();
        assert!((0..4).all(|index| pixels.contains(&index)));
    }

    #[test]
    fn refusals_name_the_path() {
        let mut scene = generate(Level::Simple, 5).unwrap().scene;
        let parent = tempfile::tempdir().unwrap();
        let file = parent.path().join("file");
        fs::write(&file, "").unwrap();
        let error = write_scene(&scene, &file, false).unwrap_err().to_string();
        assert!(error.contains("file") && error.contains("cannot write"), "{error}");
        scene.name = "../up".into();
        assert!(matches!(write_scene(&scene, parent.path(), false), Err(WriteError::Name(_))));
    }
}
