//! Every reader of files from outside, from bytes to what is done with the result. `Err` is a refusal as users see it.

#![allow(unreachable_pub)] // `fuzz/` includes this file

use nbp_dataset::import::{Format, ImportOptions, import, parse};
use nbp_dataset::wad::{Textures, Wad};
use nbp_dataset::write::Model;
use nbp_dataset::{ConvertOptions, convert, to_scene};
use nbp_env::Scene;
use nbp_env::scene::load::LoadOptions;
use nbp_env::scene::slice::ObstacleGrid;
use nbp_env::scene::{Image, surface};
use nbp_env::sensor::{Camera, DepthCamera, Frame, Sensor as _};
use nbp_env::window::WindowSize;
use std::path::Path;
use std::sync::Arc;

/// Reads one damaged file; the folder is for it and for what lies beside it.
pub type Read = fn(&Path, &[u8]) -> Result<(), String>;

/// A WAD, its first map as a scene. Odd lengths force what contradicts itself.
pub fn wad(_: &Path, bytes: &[u8]) -> Result<(), String> {
    let wad = Arc::new(Wad::parse(bytes.to_vec()).map_err(told)?);
    let maps = wad.maps();
    let map = wad.map(maps.first().copied().unwrap_or("MAP01")).map_err(told)?;
    let textures = Textures::read(std::slice::from_ref(&wad)).map_err(told)?;
    let options =
        ConvertOptions { force: bytes.len() % 2 == 1, relief: bytes.len() % 3 == 1, textures: textures.as_ref() };
    let bundle = convert(&map, options).map_err(told)?;
    use_scene(&to_scene(bundle).map_err(told)?);
    Ok(())
}

/// `scene.obj` beside whole materials and a whole image.
pub fn obj(folder: &Path, bytes: &[u8]) -> Result<(), String> {
    load(folder, "scene.obj", bytes)
}

/// `scene.mtl` beside a whole mesh and image.
pub fn mtl(folder: &Path, bytes: &[u8]) -> Result<(), String> {
    load(folder, "scene.mtl", bytes)
}

/// `settings.json` beside a whole mesh.
pub fn settings(folder: &Path, bytes: &[u8]) -> Result<(), String> {
    load(folder, "settings.json", bytes)
}

/// An image.
pub fn image(_: &Path, bytes: &[u8]) -> Result<(), String> {
    let image = Image::decode(bytes).map_err(told)?;
    assert_eq!(image.pixels.len(), image.width * image.height);
    Ok(())
}

/// A scan in PLY.
pub fn ply(_: &Path, bytes: &[u8]) -> Result<(), String> {
    scan(bytes, Format::Ply)
}

/// A scan in glTF or GLB.
pub fn gltf(_: &Path, bytes: &[u8]) -> Result<(), String> {
    scan(bytes, Format::Gltf)
}

fn scan(bytes: &[u8], format: Format) -> Result<(), String> {
    let scan = parse(bytes, format).map_err(told)?;
    let scale = (bytes.len() % 2 == 1).then_some(1.0);
    let (scenes, _) =
        import(scan, format, "scan", &ImportOptions { scale, ..ImportOptions::default() }).map_err(told)?;
    for imported in scenes {
        use_scene(&Scene::new(imported.name, imported.mesh, &imported.settings).map_err(told)?);
    }
    Ok(())
}

fn load(folder: &Path, file: &str, bytes: &[u8]) -> Result<(), String> {
    let path = folder.join(file);
    std::fs::write(&path, bytes).map_err(told)?;
    let scene = Scene::load_with(folder, LoadOptions { colour: true }).map_err(told);
    use_scene(&scene?);
    Ok(())
}

/// What programs do with a scene first.
fn use_scene(scene: &Scene) {
    let start = scene.starts()[0];
    let mut frame = Frame::default();
    DepthCamera(Camera { width: 64, height: 36, ..Camera::default() }).capture(
        scene,
        &scene.lattice().pose(start),
        &mut frame,
    );
    assert!(frame.depth.iter().all(|depth| (0.0..=Camera::default().range).contains(depth)));
    assert!(surface::sample(scene, 100).iter().all(|point| point.is_finite()));
    ObstacleGrid::draw(scene.walls(), WindowSize { pixels: 256, metres: 40.0 });
    // Refused only where the colours do not fit on a sheet.
    if let Ok(model) = Model::of(scene.name(), scene.mesh(), 1.0) {
        assert!(model.obj.contains("\nf "));
    }
}

fn told(error: impl std::fmt::Display) -> String {
    error.to_string()
}
