//! The other half of `env/benches/peers/measure.py`: the same houses, poses and walks for other programs, and our own times
//! whenever it asks, so that all are measured in turns.

use crate::clock::cpu_seconds;
use crate::frames::{by_plain_rays, by_rasteriser, by_watertight_rays};
use crate::house::House;
use crate::plain_rays::PlainRays;
use crate::steps::step;
use nbp_env::sensor::raster::InstructionSet;
use nbp_env::sensor::{Camera, Frame, render};
use nbp_env::{Action, Pose};
use serde_json::{Value, json};
use std::error::Error;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;

/// Steps of the walk that is exported and measured.
const STEPS: usize = 60;

/// Writes for each house `N.obj` (metres, y up), `N.json` (camera, poses, the captures of a walk), `N.depth.f32` (our depths
/// from the poses, row-major) and `N.surface.f32` (the ground-truth points).
pub(crate) fn export(houses: &[House], folder: &Path) -> Result<(), Box<dyn Error>> {
    std::fs::create_dir_all(folder)?;
    for (number, house) in houses.iter().enumerate() {
        let (scene, camera) = (house.world.scene(), Camera::default());
        let mut obj = String::new();
        scene.mesh().vertices().iter().try_for_each(|v| writeln!(obj, "v {} {} {}", v.x, v.y, v.z))?;
        scene.mesh().triangles().iter().try_for_each(|[a, b, c]| writeln!(obj, "f {} {} {}", a + 1, b + 1, c + 1))?;
        std::fs::write(folder.join(format!("{number}.obj")), obj)?;
        let walk = house.captures(house.start(0), &walk(house));
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

/// Where the peers go, and we.
fn walk(house: &House) -> Vec<Action> {
    house.walk(house.start(0), STEPS, 0)
}

/// Forward, right and position: what makes a ray of a pixel.
fn poses(poses: &[Pose]) -> Vec<Value> {
    let pose = |pose: &Pose| json!({ "position": pose.position, "forward": pose.forward(), "right": pose.right() });
    poses.iter().map(pose).collect()
}

/// Answers questions on standard input until it ends.
pub(crate) fn answer(houses: &[House]) -> Result<(), Box<dyn Error>> {
    let obvhs: Vec<PlainRays> = houses.iter().map(|house| PlainRays::build(house.world.scene().mesh())).collect();
    for line in std::io::stdin().lines() {
        let line = line?;
        let words: Vec<&str> = line.split_whitespace().collect();
        let number: usize = words.get(1).ok_or("say `frame 0`, for house 0")?.parse()?;
        let house = houses.get(number).ok_or_else(|| format!("`{line}`: there are {} houses", houses.len()))?;
        let milliseconds = match words[..] {
            ["frame", _] => by_rasteriser(house, InstructionSet::best(), 1),
            ["obvhs", _] => by_plain_rays(house, &obvhs[number]),
            ["rays", _] => by_watertight_rays(house),
            ["step", _, step] => one_step(house, step.parse()?)?,
            _ => {
                return Err(
                    format!("`{line}`: say frame, obvhs or rays and a house, or step, a house and a step").into()
                );
            }
        };
        println!("{milliseconds}");
        std::io::stdout().flush()?;
    }
    Ok(())
}

/// Milliseconds of the processor for one step of the walk with its input, in an episode that has come there.
fn one_step(house: &House, number: usize) -> Result<f64, Box<dyn Error>> {
    let mut episode = house.episode(house.start(0), STEPS)?;
    let walk = walk(house);
    let &action = walk.get(number).ok_or_else(|| format!("the walk has {STEPS} steps"))?;
    for &before in &walk[..number] {
        step(&mut episode, before);
    }
    Ok(1e3 * cpu_seconds(|| step(&mut episode, action)))
}
