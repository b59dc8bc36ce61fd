//! The other half of `env/benches/peers/measure.py`: the same houses, poses and walks for other programs, and our own times
//! whenever it asks, so that all are measured in turns.

use crate::frames::{by_rasteriser, by_single_rays};
use crate::house::House;
use crate::steps::one_episode;
use nbp_env::Pose;
use nbp_env::sensor::raster::InstructionSet;
use nbp_env::sensor::{Camera, Frame, render};
use serde_json::{Value, json};
use std::error::Error;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;

/// Steps of an episode that is measured or exported.
const STEPS: usize = 60;

/// Writes for each house `N.obj` (metres, y up), `N.json` (camera, poses, the captures of a walk), `N.depth.f32` (our depths
/// from the poses, row-major) and `N.surface.f32` (the ground-truth points).
pub(crate) fn export(houses: &[House], folder: &Path) -> Result<(), Box<dyn Error>> {
    std::fs::create_dir_all(folder)?;
    for (number, house) in houses.iter().enumerate() {
        let (scene, camera, start) = (house.world.scene(), Camera::default(), house.start(0));
        let mut obj = String::new();
        scene.mesh().vertices().iter().try_for_each(|v| writeln!(obj, "v {} {} {}", v.x, v.y, v.z))?;
        scene.mesh().triangles().iter().try_for_each(|[a, b, c]| writeln!(obj, "f {} {} {}", a + 1, b + 1, c + 1))?;
        std::fs::write(folder.join(format!("{number}.obj")), obj)?;
        let walk = house.captures(start, &house.walk(start, STEPS, 0));
        let about = json!({
            "camera": camera, "poses": poses(&house.poses),
            "walk": walk.iter().map(|captures| poses(captures)).collect::<Vec<_>>(),
        });
        std::fs::write(folder.join(format!("{number}.json")), about.to_string())?;
        let (mut depths, mut frame) = (Vec::new(), Frame::default());
        for pose in &house.poses {
            render(scene.raster(), &camera, pose, &mut frame);
            depths.extend(frame.depth.iter().flat_map(|depth| depth.to_le_bytes()));
        }
        std::fs::write(folder.join(format!("{number}.depth.f32")), depths)?;
        let points = house.world.surface().points().iter().flat_map(|p| p.to_array());
        std::fs::write(
            folder.join(format!("{number}.surface.f32")),
            points.flat_map(f32::to_le_bytes).collect::<Vec<_>>(),
        )?;
    }
    Ok(())
}

/// Forward, right and position: what makes a ray of a pixel.
fn poses(poses: &[Pose]) -> Vec<Value> {
    let pose = |pose: &Pose| json!({ "position": pose.position, "forward": pose.forward(), "right": pose.right() });
    poses.iter().map(pose).collect()
}

/// Answers questions on standard input until it ends.
pub(crate) fn answer(houses: &[House]) -> Result<(), Box<dyn Error>> {
    for (repeat, line) in std::io::stdin().lines().enumerate() {
        let line = line?;
        let (what, number) = line.trim().split_once(' ').unwrap_or((&line, ""));
        let house = number.parse::<usize>().ok().and_then(|number| houses.get(number));
        let house = house.ok_or_else(|| format!("`{line}`: say `frame 0`, for one of {} houses", houses.len()))?;
        let milliseconds = match what {
            "frame" => by_rasteriser(house, InstructionSet::best()),
            "rays" => by_single_rays(house),
            "step" => 1e3 * one_episode(house, repeat, STEPS)?[0],
            _ => return Err(format!("`{line}`: say frame, rays or step, and the number of a house").into()),
        };
        println!("{milliseconds}");
        std::io::stdout().flush()?;
    }
    Ok(())
}
