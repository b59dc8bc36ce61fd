//! A Doom map becomes a scene: a closed mesh in metres and its settings.
//!
//! `DoomMap → label → open → relief → solid → paint → Mesh + Settings`. World axes: `x = -x_doom`, `z = y_doom`, `y` is height, so that a
//! map seen from above with `+z` up and `+x` left looks as it does in a map editor. The modal floor lies at `y = 0`, and
//! the middle of the scene's plan at `x = z = 0` (rounded to map units).

mod error;
mod label;
mod open;
mod paint;
mod pattern;
mod relief;
mod solid;

pub use error::ConvertError;
pub use label::{Conflict, LabelledPlan, label};
pub use open::{OpenHeights, open_heights};

use crate::doom_map::{DoomMap, HEIGHT_UNITS_PER_METRE, LATTICE_UNITS, UNITS_PER_METRE};
use crate::wad::Textures;
use glam::{Vec2, Vec3};
use nbp_env::pose::{CAMERA_HEIGHT, Lattice};
use nbp_env::scene::settings::LATTICE_STEP;
use nbp_env::scene::{Appearance, LatticeGraph, Mesh, MeshError, RayIndex, Settings};
use nbp_env::seed::SeedTree;
use paint::{Site, paint};
use solid::{Air, Faces};

/// Lattice nodes lie at these map units modulo 75. Fractions keep them, and the vertical rays through them, off the edges
/// of the mesh, whose corners are whole numbers.
pub const LATTICE_PHASE: [f64; 2] = [37.25, 37.375];

/// Map units in which the camera passes, with some to spare; the lowest doors of the game are as high.
pub(crate) const HEAD_ROOM: i32 = 72;

/// Start positions in a scene (the paper tests five a scene).
const STARTS: usize = 5;

/// Area in conflict from which a map is refused, square metres.
const MAX_CONFLICT: f64 = 1.0;

/// How to convert.
#[derive(Debug, Clone, Copy, Default)]
pub struct ConvertOptions<'a> {
    /// Convert maps whose sectors contradict each other over more than 1 m².
    pub force: bool,
    /// Scale walkable floors towards their median, into ± 40 map units, for maps with floors at many heights.
    pub relief: bool,
    /// Textures that the map names; without them, drawn tiles stand in.
    pub textures: Option<&'a Textures>,
}

/// What the conversion found, areas in m² of plan.
#[derive(Debug, Clone, PartialEq)]
pub struct ConvertReport {
    /// Floor of the map, unreachable parts included.
    pub map_area: f64,
    /// Floor of the scene: the largest connected part.
    pub floor_area: f64,
    /// Area connected in the camera plane.
    pub plane_area: f64,
    /// Area whose borders name more than one sector.
    pub conflict_area: f64,
    /// Modal floor, map units: `y = 0` of the scene.
    pub modal_floor: i32,
    /// Factor on the relief of the walkable floors; 1 where it was not to be compressed, or needed none.
    pub relief: f64,
    /// Sectors opened as doors.
    pub doors: usize,
    /// Sectors lowered as lifts or floors.
    pub lifts: usize,
    /// Map units `[x, y]` at the origin of the scene.
    pub origin: [i32; 2],
    /// Triangles of the mesh.
    pub triangles: usize,
    /// Connected lattice positions.
    pub nodes: usize,
    /// What was wrong with textures; drawn tiles stand in for them.
    pub texture_problems: Vec<String>,
}

/// A scene that can be written, or used from memory.
#[derive(Debug, Clone)]
pub struct SceneBundle {
    /// Name of the scene.
    pub name: String,
    /// Metres, `y` up, normals towards the free space.
    pub mesh: Mesh,
    /// In metres unless asked otherwise, with start positions.
    pub settings: Settings,
    /// What the conversion found.
    pub report: ConvertReport,
}

impl SceneBundle {
    /// Camera positions of the scene.
    pub fn lattice(&self) -> Lattice {
        let camera = &self.settings.camera;
        Lattice {
            origin: self.settings.scene.metres_per_unit * Vec3::from(camera.x_min) + CAMERA_HEIGHT * Vec3::Y,
            spacing: LATTICE_STEP,
            size: [camera.pose_l, camera.pose_h],
        }
    }
}

/// Converts a map.
///
/// # Errors
/// When the map has no free space or no room for the camera, or its sectors contradict each other.
pub fn convert(map: &DoomMap, options: ConvertOptions<'_>) -> Result<SceneBundle, ConvertError> {
    let name = || map.name.clone();
    let labelled = label(map).map_err(|source| ConvertError::Triangulate { map: name(), source })?;
    let square_metres = |area: f64| area / (UNITS_PER_METRE * UNITS_PER_METRE);
    let conflict_area = square_metres(labelled.conflict_area);
    if let (Some(worst), false) = (labelled.worst_conflict, options.force || conflict_area <= MAX_CONFLICT) {
        return Err(ConvertError::Conflict {
            map: name(),
            area: conflict_area,
            worst: square_metres(worst.area),
            x: worst.at[0],
            y: worst.at[1],
            sector: worst.sector.map_or("none".into(), |s| s.to_string()),
        });
    }
    let mut open = open_heights(map);
    let relief = if options.relief { relief::compress(&labelled, &map.sectors, &mut open.heights) } else { 1.0 };
    let height = |sector: u32| open.heights.get(sector as usize).copied().filter(|(floor, ceiling)| ceiling > floor);
    let air: Vec<Air> = labelled.sector.iter().map(|sector| height((*sector)?)).collect();
    let no_space = || ConvertError::NoSpace { map: name(), linedefs: map.linedefs.len(), sectors: map.sectors.len() };
    let kept = solid::keep_largest(&labelled.plan, &air).ok_or_else(no_space)?;
    let faces = solid::faces(&labelled.plan, &kept.air).ok_or_else(|| ConvertError::TooManyFaces { map: name() })?;
    let site = Site { map, labelled: &labelled, heights: &open.heights, air: &kept.air };
    let (appearance, texture_problems) = paint(&site, &faces, options.textures);
    let origin = middle(&faces);
    let mesh = to_world(&faces, appearance, origin, kept.modal_floor)
        .map_err(|source| ConvertError::Mesh { map: name(), source })?;
    let report = ConvertReport {
        map_area: square_metres(kept.all_area),
        floor_area: square_metres(kept.area),
        plane_area: square_metres(kept.plane_area),
        conflict_area,
        modal_floor: kept.modal_floor,
        relief,
        doors: open.doors,
        lifts: open.lifts,
        origin,
        triangles: mesh.triangles().len(),
        nodes: 0,
        texture_problems,
    };
    let settings = settings(&mesh, origin);
    let mut scene = SceneBundle { name: name(), mesh, settings, report };
    add_starts(&mut scene)?;
    Ok(scene)
}

/// Middle of the plan, rounded to map units so that recentring moves the lattice by whole units.
fn middle(faces: &Faces) -> [i32; 2] {
    [0, 1].map(|axis| {
        let range = faces
            .vertices
            .iter()
            .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v[axis]), high.max(v[axis])]);
        ((range[0] + range[1]) / 2.0).round() as i32
    })
}

fn to_world(faces: &Faces, appearance: Appearance, origin: [i32; 2], floor: i32) -> Result<Mesh, MeshError> {
    let position = |&[x, y, height]: &[f64; 3]| {
        Vec3::new(
            ((f64::from(origin[0]) - x) / UNITS_PER_METRE) as f32,
            ((height - f64::from(floor)) / HEIGHT_UNITS_PER_METRE) as f32,
            ((y - f64::from(origin[1])) / UNITS_PER_METRE) as f32,
        )
    };
    Mesh::painted(faces.vertices.iter().map(position).collect(), faces.triangles.clone(), appearance)
}

/// Settings of the scene without start positions.
fn settings(mesh: &Mesh, origin: [i32; 2]) -> Settings {
    let bounds = mesh.bounds();
    // World x grows against Doom's, so a node at the phase lies at `origin - phase`, modulo the step.
    let phase = [f64::from(origin[0]) - LATTICE_PHASE[0], LATTICE_PHASE[1] - f64::from(origin[1])];
    let first = [(phase[0], bounds[0].x), (phase[1], bounds[0].z)].map(|(phase, low)| {
        ((phase - f64::from(low) * UNITS_PER_METRE).rem_euclid(LATTICE_UNITS) / UNITS_PER_METRE) as f32
    });
    Settings::for_box(bounds, 0.0, Vec2::from(first))
}

/// Five start positions in the largest connected component, far from each other. They depend on the map's name only.
fn add_starts(scene: &mut SceneBundle) -> Result<(), ConvertError> {
    let graph = LatticeGraph::build(scene.lattice(), &RayIndex::build(&scene.mesh));
    let nodes = graph.largest_component().len();
    scene.report.nodes = nodes;
    if nodes < STARTS {
        let (map, floor) = (scene.name.clone(), scene.report.modal_floor);
        return Err(ConvertError::NoRoom { map, floor, nodes, need: STARTS });
    }
    let seed = scene.name.bytes().fold(SeedTree::new(0), |tree, byte| tree.child("starts", u64::from(byte)));
    let poses = graph.spread_poses(STARTS, seed);
    scene.settings.camera.start_positions =
        poses.iter().map(|pose| [pose.node.i, 0, pose.node.k, 2, pose.heading.index() as i32]).collect();
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The rooms of [`DoomMap::with_door`], the door opened by its own special.
    fn opened() -> DoomMap {
        let (mut map, door) = DoomMap::with_door();
        map.sectors[door as usize].special = 14;
        map
    }

    #[test]
    fn a_map_becomes_metres_the_right_way_round() {
        let scene = convert(&opened(), ConvertOptions::default()).unwrap();
        let [low, high] = scene.mesh.bounds();
        let size = high - low;
        assert!((size - Vec3::new(832.0 / 50.0, 160.0 / 50.0 * 1.2, 8.0)).abs().max_element() < 1e-5, "{size}");
        assert_eq!(low.y, 0.0);
        // The higher room lies to the right on the map, hence at smaller x.
        let highest = scene.mesh.vertices().iter().filter(|v| v.y > 3.5);
        assert!(highest.clone().count() > 0 && highest.clone().all(|v| v.x < 0.0));
        let report = &scene.report;
        assert_eq!((report.doors, report.lifts, report.modal_floor), (1, 0, 0));
        assert!((report.floor_area - (2.0 * 64.0 + 1.28)).abs() < 1e-9);
        assert_eq!(report.plane_area, report.floor_area, "the door is open at the camera plane");
        assert!((scene.lattice().origin.y - 1.65).abs() < 1e-6);
        assert_eq!(scene.settings.scene.metres_per_unit, 1.0);
        assert_eq!(scene.settings.camera.start_positions.len(), 5);
        let phase = (scene.report.origin[0] as f32 / 50.0 - scene.lattice().origin.x).rem_euclid(1.5);
        assert!((phase - LATTICE_PHASE[0] as f32 / 50.0).abs() < 1e-4, "{phase}");
    }

    #[test]
    fn a_closed_door_leaves_one_room() {
        let (map, _) = DoomMap::with_door();
        let report = convert(&map, ConvertOptions::default()).unwrap().report;
        assert_eq!((report.map_area, report.floor_area), (128.0, 64.0));
    }

    #[test]
    fn refusals_name_the_map_and_the_place() {
        let empty = DoomMap { name: "empty".into(), ..DoomMap::default() };
        let text = convert(&empty, ConvertOptions::default()).unwrap_err().to_string();
        assert!(text.contains("map empty") && text.contains("0 linedefs"), "{text}");
        let mut low = opened();
        low.sectors.iter_mut().for_each(|s| s.ceiling = s.floor + 40);
        let text = convert(&low, ConvertOptions::default()).unwrap_err().to_string();
        assert!(text.contains("camera plane") && text.contains("0 connected"), "{text}");
        let mut leaking = opened();
        leaking.linedefs.retain(|line| line.back.is_none());
        let refused = convert(&leaking, ConvertOptions::default());
        assert!(matches!(refused, Err(ConvertError::Conflict { .. })), "{refused:?}");
        assert!(refused.unwrap_err().to_string().contains("--force"));
        assert!(convert(&leaking, ConvertOptions { force: true, ..ConvertOptions::default() }).is_ok());
    }
}
