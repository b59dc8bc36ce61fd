//! A scene: an immutable checked mesh, what is derived from it once, and where the agent may stand.

pub mod appearance;
pub mod clearance;
pub mod graph;
pub mod image;
pub mod interior;
pub mod load;
pub mod mesh;
mod mtl;
pub mod obj;
pub mod polygon;
pub mod rays;
pub mod settings;
pub mod slice;
pub mod surface;

pub use appearance::{Appearance, Image, Paint};
pub use graph::LatticeGraph;
pub use image::ImageError;
pub use interior::Interior;
pub use load::{LoadError, LoadOptions};
pub use mesh::{Mesh, MeshError};
pub use obj::{Obj, ObjError};
pub use rays::RayIndex;
pub use settings::Settings;

use crate::pose::{CAMERA_HEIGHT, HEADINGS, Heading, Lattice, LatticePose, Node};
use crate::seed::SeedTree;
use crate::sensor::raster::RasterIndex;
use glam::{Vec2, Vec3};
use settings::{LATTICE_STEP, UNITS, WANT_UNIT};
use slice::slice_at;

/// Why a mesh and its settings do not make a scene.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// A number in the settings cannot be.
    #[error("scene {scene}: settings {field} is {value}: {want}")]
    Settings {
        /// Scene name.
        scene: String,
        /// Key in `settings.json`.
        field: &'static str,
        /// As read.
        value: String,
        /// What it should be.
        want: &'static str,
    },
    /// Larger than any building, or too far away for `f32`.
    #[error(
        "scene {scene}: the mesh is {size:e} m across and reaches {distance:e} m from the origin, and {MAX_EXTENT} and \
         {MAX_DISTANCE} m are the most: check the unit of its lengths (scene.metres_per_unit in settings.json)"
    )]
    Extent {
        /// Scene name.
        scene: String,
        /// Largest side of its box, metres.
        size: f32,
        /// Largest coordinate, metres.
        distance: f32,
    },
    /// Too many positions, or none.
    #[error(
        "scene {scene}: a lattice every {spacing} m has {nodes} nodes, and it needs 1 to {MAX_NODES}: take another positive step"
    )]
    Nodes {
        /// Scene name.
        scene: String,
        /// Distance of neighbours, metres.
        spacing: f32,
        /// Their number.
        nodes: i64,
    },
    /// The settings do not belong to the mesh.
    #[error(
        "scene {scene}: the lattice, from {:.1} to {:.1} m, lies beside the mesh, from {:.1} to {:.1} m: settings.json belongs to \
         another mesh, or the lengths are in another unit (scene.metres_per_unit)", lattice[0], lattice[1], mesh[0], mesh[1]
    )]
    Apart {
        /// Scene name.
        scene: String,
        /// First and last node of the lattice, metres.
        lattice: [Vec3; 2],
        /// Lower and upper corner of the mesh, metres.
        mesh: [Vec3; 2],
    },
    /// Nowhere to stand.
    #[error(
        "scene {scene}: no free lattice pose at height {height} m among {nodes}: the camera plane must cut the interior; it \
         lies above the floor, which camera.x_min[1] in settings.json names, by 1.65 m or agent.camera_height (in scans, at \
         most 2.65 m); a smaller agent.radius or agent.lattice_step finds narrower ways"
    )]
    NoFreePose {
        /// Scene name.
        scene: String,
        /// Camera plane.
        height: f32,
        /// Lattice nodes tried.
        nodes: usize,
    },
}

/// Largest lattice that is accepted, a second's work; the largest map that Doom can hold has three quarters of it. A larger
/// one means that the settings' units are wrong.
const MAX_NODES: i64 = 1_000_000;

/// A start that moves farther to a new lattice is worth a note, metres.
const NOTABLE_MOVE: f32 = 1.0;

/// Largest side of a mesh's box, metres. The largest map that Doom can hold has 1311.
const MAX_EXTENT: f32 = 2000.0;

/// Farthest coordinate, metres: `f32` still tells millimetres apart.
const MAX_DISTANCE: f32 = 10_000.0;

/// Everything that the simulator knows and the agent does not.
#[derive(Debug)]
pub struct Scene {
    name: String,
    mesh: Mesh,
    bounds: [Vec3; 2],
    lattice: Lattice,
    camera_height: f32,
    starts: Vec<LatticePose>,
    notes: Vec<String>,
    rays: RayIndex,
    raster: RasterIndex,
    graph: LatticeGraph,
    walls: Vec<[Vec2; 2]>,
}

impl Scene {
    /// Builds the scene of a mesh in metres.
    ///
    /// # Errors
    /// When the settings contradict themselves or no lattice pose is free.
    pub fn new(name: impl Into<String>, mesh: Mesh, settings: &Settings) -> Result<Self, SceneError> {
        let name = name.into();
        let lattice = lattice_of(&name, settings)?;
        let [low, high] = mesh.bounds();
        let (size, distance) = ((high - low).max_element(), low.abs().max(high.abs()).max_element());
        if size > MAX_EXTENT || distance > MAX_DISTANCE {
            return Err(SceneError::Extent { scene: name, size, distance });
        }
        let scale = settings.scene.metres_per_unit;
        let rays = RayIndex::build(&mesh);
        let interior = if settings.scene.open { Interior::Open } else { Interior::Closed };
        let graph = LatticeGraph::inside(interior, lattice, &rays);
        if graph.largest_component().is_empty() {
            let nodes = [lattice.origin, lattice.position(lattice.node(lattice.len() - 1))];
            // Beside a single wall, too, there are nodes, but no farther than a step.
            let step = lattice.spacing;
            if [0, 2].iter().any(|&axis| nodes[0][axis] > high[axis] + step || nodes[1][axis] < low[axis] - step) {
                return Err(SceneError::Apart { scene: name, lattice: nodes, mesh: [low, high] });
            }
            return Err(SceneError::NoFreePose { scene: name, height: lattice.origin.y, nodes: lattice.len() });
        }
        let mut notes = Vec::new();
        let mut starts = start_poses(&name, settings, &graph, &mut notes)?;
        if starts.is_empty() {
            starts = graph.spread_poses(5, SeedTree::new(0).child("starts", 0));
        }
        Ok(Self {
            bounds: [scale * Vec3::from(settings.scene.x_min), scale * Vec3::from(settings.scene.x_max)],
            raster: RasterIndex::build(&mesh),
            walls: slice_at(&mesh, lattice.origin.y),
            name,
            mesh,
            lattice,
            camera_height: CAMERA_HEIGHT,
            starts,
            notes,
            rays,
            graph,
        })
    }

    /// Name, as in tables and file names.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The same scene under another name.
    #[must_use]
    pub fn with_name(self, name: impl Into<String>) -> Self {
        Self { name: name.into(), ..self }
    }

    /// The same scene for a robot whose camera is elsewhere: lattice, graph, walls and starts for a camera `height` metres
    /// above the floor, nodes every `spacing` metres, and moves that keep `clearance` metres from every surface.
    ///
    /// The new lattice fills the area of the old one and has a node where the old one has its first; starts move to the
    /// nearest node from which a move is possible.
    ///
    /// # Errors
    /// When there would be too many nodes, or none is free.
    pub fn for_robot(mut self, height: f32, spacing: f32, clearance: f32) -> Result<Self, SceneError> {
        let old = self.lattice;
        // Nodes that fit before the first and after it, half an old step beyond the outermost included.
        let before = (0.5 * old.spacing / spacing).floor();
        let after = |count: i32| ((count as f32 - 0.5) * old.spacing / spacing).floor();
        let size = old.size.map(|count| (before + 1.0 + after(count)) as i32);
        let nodes = i64::from(size[0]) * i64::from(size[1]);
        if !(spacing > 0.0 && (1..=MAX_NODES).contains(&nodes)) {
            return Err(SceneError::Nodes { scene: self.name, spacing, nodes });
        }
        let shift = Vec3::new(before * spacing, 0.0, before * spacing);
        let origin = (old.origin - shift).with_y(self.floor() + height);
        self.lattice = Lattice { origin, spacing, size };
        self.camera_height = height;
        self.graph = LatticeGraph::with_clearance(self.graph.interior(), self.lattice, &self.rays, clearance);
        self.walls = slice_at(&self.mesh, origin.y);
        if self.graph.largest_component().len() < 2 {
            return Err(SceneError::NoFreePose { scene: self.name, height: origin.y, nodes: self.lattice.len() });
        }
        let mut starts = Vec::with_capacity(self.starts.len());
        for start in &self.starts {
            let place = old.position(start.node);
            let distance = |&node: &Node| self.lattice.position(node).with_y(place.y).distance_squared(place);
            let open = (0..self.lattice.len()).map(|index| self.lattice.node(index));
            let open = open.filter(|&node| self.graph.neighbours(node).next().is_some());
            let nearest = open.min_by(|a, b| distance(a).total_cmp(&distance(b)));
            let Some(node) = nearest else { continue };
            let moved = distance(&node).sqrt();
            if moved > NOTABLE_MOVE {
                self.notes
                    .push(format!("scene {}: a start moves {moved:.1} m to a node of the new lattice", self.name));
            }
            starts.push(LatticePose { node, heading: start.heading });
        }
        self.starts = starts;
        Ok(self)
    }

    /// The triangles.
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    /// Lower and upper corner of the box whose surface counts, metres.
    pub fn bounds(&self) -> [Vec3; 2] {
        self.bounds
    }

    /// Camera positions.
    pub fn lattice(&self) -> &Lattice {
        &self.lattice
    }

    /// Height of the camera above the floor, metres.
    pub fn camera_height(&self) -> f32 {
        self.camera_height
    }

    /// Height of the floor that the camera plane is measured from, metres.
    pub fn floor(&self) -> f32 {
        self.lattice.origin.y - self.camera_height
    }

    /// What a user should hear about how the scene was read, one sentence each; most scenes have nothing to say.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Starts of the evaluation trajectories: those of the settings that are free, or some spread over the largest
    /// component where the settings name none.
    pub fn starts(&self) -> &[LatticePose] {
        &self.starts
    }

    /// Rays against the mesh.
    pub fn rays(&self) -> &RayIndex {
        &self.rays
    }

    /// The rasteriser's index of the mesh.
    pub fn raster(&self) -> &RasterIndex {
        &self.raster
    }

    /// Which lattice nodes are free and which moves are possible.
    pub fn graph(&self) -> &LatticeGraph {
        &self.graph
    }

    /// The mesh cut at the camera plane: segments in `(x, z)`, metres.
    pub fn walls(&self) -> &[[Vec2; 2]] {
        &self.walls
    }

    /// [`Scene::two_rooms`] with a brown floor, a white ceiling, and on each wall a picture with a corner of its own
    /// colour, repeated every 3 m.
    #[cfg(test)]
    pub(crate) fn painted_rooms() -> Self {
        let (mesh, settings) = two_rooms();
        let side = 32_usize;
        let texel = |at: usize| match (at % side, at / side) {
            (x, y) if x < side / 4 && y < side / 4 => [220, 30, 30],
            (x, y) if x.abs_diff(side / 2) < 2 || y == side - 1 || x + y == side => [30, 60, 200],
            (x, y) => [200 - 40 * ((x / 4 + y / 4) % 2) as u8; 3],
        };
        let image = Image { width: side, height: side, pixels: (0..side * side).map(texel).collect() };
        let paint = |corners: [Vec3; 3]| {
            let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize();
            match (normal.y.abs() > 0.5, corners[0].y < 1.0) {
                (true, true) => Paint::Corners([[90, 70, 50]; 3]),
                (true, false) => Paint::Corners([[255; 3]; 3]),
                // Upright and readable from the side where the room is: from inside the outer walls.
                _ => Paint::Image {
                    image: 0,
                    corners: corners.map(|v| {
                        let right = if normal.x.abs() > 0.5 {
                            if v.x < 6.0 { -v.z } else { v.z }
                        } else if v.z < 4.5 {
                            v.x
                        } else {
                            -v.x
                        };
                        Vec2::new(right, v.y) / 3.0
                    }),
                },
            }
        };
        let appearance = Appearance { images: vec![image], paints: mesh.iter_corners().map(paint).collect() };
        let mesh = Mesh::painted(mesh.vertices().to_vec(), mesh.triangles().to_vec(), appearance);
        match mesh.map(|mesh| Self::new("painted_rooms", mesh, &settings)) {
            Ok(Ok(scene)) => scene,
            error => unreachable!("the built-in scene is valid: {error:?}"),
        }
    }

    /// Two rooms of 6×9 m joined by a door, with a pillar: a closed mesh for tests and examples.
    pub fn two_rooms() -> Self {
        let (mesh, settings) = two_rooms();
        match Self::new("two_rooms", mesh, &settings) {
            Ok(scene) => scene,
            Err(error) => unreachable!("the built-in scene is valid: {error}"),
        }
    }
}

fn lattice_of(scene: &str, settings: &Settings) -> Result<Lattice, SceneError> {
    let camera = &settings.camera;
    let refuse = |field, value: String, want| Err(SceneError::Settings { scene: scene.into(), field, value, want });
    let scale = settings.scene.metres_per_unit;
    if !UNITS.contains(&scale) {
        return refuse("scene.metres_per_unit", format!("{scale:e}"), WANT_UNIT);
    }
    let corners = [camera.x_min, camera.x_max, settings.scene.x_min, settings.scene.x_max];
    if corners.iter().flatten().any(|c| !(c * scale).is_finite()) {
        return refuse("x_min / x_max", format!("{corners:?}"), "finite numbers");
    }
    if camera.pose_l < 1 || camera.pose_h < 1 || i64::from(camera.pose_l) * i64::from(camera.pose_h) > MAX_NODES {
        let value = format!("{} x {}", camera.pose_l, camera.pose_h);
        return refuse("camera.pose_l x pose_h", value, "from 1 to 1,000,000 lattice nodes");
    }
    if camera.pose_n_azim != HEADINGS as i32 {
        return refuse("camera.pose_n_azim", camera.pose_n_azim.to_string(), "8 headings");
    }
    let [x, y, z] = camera.x_min.map(|c| c * scale);
    Ok(Lattice {
        origin: Vec3::new(x, y + CAMERA_HEIGHT, z),
        spacing: LATTICE_STEP,
        size: [camera.pose_l, camera.pose_h],
    })
}

/// The settings' start positions that are free. Some in a wall are left out with a note, so that the others still serve;
/// where all are, the settings belong to another mesh.
fn start_poses(
    scene: &str,
    settings: &Settings,
    graph: &LatticeGraph,
    notes: &mut Vec<String>,
) -> Result<Vec<LatticePose>, SceneError> {
    let refuse = |value: String, want| {
        Err(SceneError::Settings { scene: scene.into(), field: "camera.start_positions", value, want })
    };
    let positions = &settings.camera.start_positions;
    let (mut free, mut blocked) = (Vec::new(), Vec::new());
    for &[i, _, k, _, azimuth] in positions {
        let node = Node { i, k };
        if !graph.lattice().contains(node) || !(0..HEADINGS as i32).contains(&azimuth) {
            return refuse(format!("{:?}", [i, k, azimuth]), "[l, w, h, theta, azimuth] inside the lattice");
        }
        match graph.is_free(node) {
            true => free.push(LatticePose { node, heading: Heading::new(azimuth as usize) }),
            false => blocked.push([i, k]),
        }
    }
    if free.is_empty() && !positions.is_empty() {
        return refuse(format!("{blocked:?} (l, h)"), "at least one position that is not in a wall or outside");
    }
    if !blocked.is_empty() {
        notes.push(format!(
            "scene {scene}: {} of {} start positions are in a wall or outside and left out: {blocked:?} (l, h)",
            blocked.len(),
            positions.len()
        ));
    }
    Ok(free)
}

/// Mesh and settings of [`Scene::two_rooms`].
pub(crate) fn two_rooms() -> (Mesh, Settings) {
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    let mut quad = |corners: [[f32; 3]; 4]| {
        let base = vertices.len() as u32;
        vertices.extend(corners.map(Vec3::from));
        triangles.extend([[base, base + 1, base + 2], [base, base + 2, base + 3]]);
    };
    let (height, door) = (3.0, 2.2);
    for (y, free) in [(0.0, 0.0), (height, 0.0)] {
        // The partition between the rooms is a sheet 0.2 m thick at x = 6; floor and ceiling run through its door only.
        quad([[free, y, 0.0], [5.9, y, 0.0], [5.9, y, 9.0], [free, y, 9.0]]);
        quad([[6.1, y, 0.0], [12.0, y, 0.0], [12.0, y, 9.0], [6.1, y, 9.0]]);
    }
    for y in [0.0, door] {
        quad([[5.9, y, 3.0], [6.1, y, 3.0], [6.1, y, 5.0], [5.9, y, 5.0]]);
    }
    let mut wall = |a: [f32; 2], b: [f32; 2], low: f32, high: f32| {
        quad([[a[0], low, a[1]], [b[0], low, b[1]], [b[0], high, b[1]], [a[0], high, a[1]]]);
    };
    for (x0, x1) in [(0.0, 5.9), (6.1, 12.0)] {
        wall([x0, 0.0], [x1, 0.0], 0.0, height);
        wall([x0, 9.0], [x1, 9.0], 0.0, height);
    }
    wall([0.0, 0.0], [0.0, 9.0], 0.0, height);
    wall([12.0, 0.0], [12.0, 9.0], 0.0, height);
    for x in [5.9, 6.1] {
        wall([x, 0.0], [x, 3.0], 0.0, height);
        wall([x, 5.0], [x, 9.0], 0.0, height);
        wall([x, 3.0], [x, 5.0], door, height);
    }
    for z in [3.0, 5.0] {
        wall([5.9, z], [6.1, z], 0.0, door);
    }
    for [a, b] in
        [[[8.5, 6.0], [9.1, 6.0]], [[9.1, 6.0], [9.1, 6.6]], [[9.1, 6.6], [8.5, 6.6]], [[8.5, 6.6], [8.5, 6.0]]]
    {
        wall(a, b, 0.0, height);
    }
    let mesh = match Mesh::new(vertices, triangles) {
        Ok(mesh) => mesh,
        Err(error) => unreachable!("the built-in mesh is valid: {error}"),
    };
    let settings = Settings::for_box([Vec3::ZERO, Vec3::new(12.0, 3.0, 9.0)], 0.0, Vec2::new(0.75, 0.75));
    (mesh, settings)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_rooms_are_connected_through_their_door() {
        let scene = Scene::two_rooms();
        assert_eq!(scene.lattice().size, [8, 6]);
        assert_eq!(scene.graph().largest_component().len(), 48);
        let through_the_wall = (Node { i: 3, k: 0 }, Node { i: 4, k: 0 });
        let through_the_door = (Node { i: 3, k: 2 }, Node { i: 4, k: 2 });
        assert!(!scene.graph().is_passable(through_the_wall.0, through_the_wall.1));
        assert!(scene.graph().is_passable(through_the_door.0, through_the_door.1));
        assert_eq!(scene.starts().len(), 5);
    }

    #[test]
    fn start_positions_that_are_not_free_are_left_out() {
        let (mesh, mut settings) = two_rooms();
        settings.camera.pose_l = 10;
        settings.camera.start_positions = vec![[9, 0, 0, 2, 0], [1, 0, 2, 2, 5]];
        let scene = Scene::new("some", mesh.clone(), &settings).unwrap();
        assert_eq!(scene.starts(), [LatticePose { node: Node { i: 1, k: 2 }, heading: Heading::new(5) }]);
        assert!(scene.notes()[0].contains("1 of 2 start positions"), "{:?}", scene.notes());
        settings.camera.start_positions.pop();
        let error = Scene::new("none", mesh, &settings).unwrap_err().to_string();
        assert!(error.contains("start_positions is [[9, 0]]"), "{error}");
    }

    #[test]
    fn settings_out_of_range_are_refused() {
        let (mesh, mut settings) = two_rooms();
        settings.camera.start_positions = vec![[99, 0, 0, 2, 0]];
        let error = Scene::new("bad", mesh.clone(), &settings).unwrap_err();
        assert!(error.to_string().contains("start_positions"), "{error}");
        settings.camera.start_positions.clear();
        settings.scene.metres_per_unit = 1e30;
        let error = Scene::new("bad", mesh.clone(), &settings).unwrap_err().to_string();
        assert!(error.contains("scene.metres_per_unit is 1e30"), "{error}");
        settings.scene.metres_per_unit = 1.0;
        let far = Mesh::new(vec![Vec3::ZERO, 5000.0 * Vec3::X, Vec3::Z], vec![[0, 1, 2]]).unwrap();
        let error = Scene::new("bad", far, &settings).unwrap_err().to_string();
        assert!(error.contains("5e3 m across") && error.contains("metres_per_unit"), "{error}");
        settings.camera.x_min[1] = 50.0;
        assert!(matches!(Scene::new("bad", mesh, &settings), Err(SceneError::NoFreePose { .. })));
    }
}
