//! What cannot work is refused with what, where and what to do.

use glam::{Vec2, Vec3};
use nbp_env::scene::{Mesh, Settings};
use nbp_env::sensor::{Camera, DepthCamera, Frame, RayCamera, Sensor};
use nbp_env::{Agent, Episode, Heading, LatticePose, MotionConfig, Node, Pose, Scene, SeedTree, SimConfig, World};
use std::sync::Arc;

/// A room of 6 × 3 × 6 m.
fn room() -> Mesh {
    let corner = |n: u32| Vec3::new((n & 1) as f32 * 6.0, (n >> 1 & 1) as f32 * 3.0, (n >> 2) as f32 * 6.0);
    let quads = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
    let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    Mesh::new((0..8).map(corner).collect(), triangles).unwrap()
}

fn settings() -> Settings {
    Settings::for_box([Vec3::ZERO, Vec3::new(6.0, 3.0, 6.0)], 0.0, Vec2::splat(0.75))
}

/// That an error says all of `words`.
fn says(error: &dyn std::fmt::Display, words: &[&str]) {
    let message = error.to_string();
    words.iter().for_each(|word| assert!(message.contains(word), "no '{word}' in: {message}"));
}

#[test]
fn meshes() {
    let triangle = vec![Vec3::ZERO, Vec3::X, Vec3::Z];
    type Row<'a> = (Vec<Vec3>, Vec<[u32; 3]>, &'a [&'a str]);
    let table: [Row<'_>; 6] = [
        (Vec::new(), Vec::new(), &["no triangle"]),
        (triangle.clone(), Vec::new(), &["no triangle"]),
        (triangle.clone(), vec![[0, 1, 1]], &["no triangle with an area"]),
        (triangle.clone(), vec![[0, 1, 3]], &["triangle 0", "vertex 3", "only 3"]),
        (vec![Vec3::NAN, Vec3::X, Vec3::Z], vec![[0, 1, 2]], &["vertex 0", "not finite"]),
        (vec![Vec3::ZERO, Vec3::X * f32::INFINITY, Vec3::Z], vec![[0, 1, 2]], &["vertex 1", "not finite"]),
    ];
    for (vertices, triangles, words) in table {
        says(&Mesh::new(vertices, triangles).unwrap_err(), words);
    }
    let error = Scene::new("one", Mesh::new(triangle, vec![[0, 1, 2]]).unwrap(), &settings()).unwrap_err();
    says(&error, &["scene one", "no free lattice pose", "1.65 m", "must cut the interior"]);
}

#[test]
fn settings_of_another_mesh_or_of_none() {
    type Change = fn(&mut Settings);
    let table: [(Change, &[&str]); 15] = [
        (|s| s.scene.metres_per_unit = 0.0, &["scene.metres_per_unit", "0e0", "0.0001 to 10,000"]),
        (|s| s.scene.metres_per_unit = -1.0, &["scene.metres_per_unit"]),
        (|s| s.scene.metres_per_unit = f32::NAN, &["scene.metres_per_unit"]),
        (|s| s.scene.metres_per_unit = f32::INFINITY, &["scene.metres_per_unit"]),
        (|s| s.scene.metres_per_unit = 1e30, &["scene.metres_per_unit"]),
        (|s| s.camera.x_min[0] = 1e5, &["beside the mesh", "another mesh", "scene.metres_per_unit"]),
        (|s| s.camera.x_min = [-900.0, 0.0, 0.0], &["beside the mesh", "[-900"]),
        (|s| s.camera.x_min[1] = 40.0, &["no free lattice pose at height 41.65 m", "camera.x_min[1]"]),
        (|s| s.camera.x_min[1] = 2.0, &["no free lattice pose at height 3.65 m"]),
        (|s| s.camera.x_min[2] = f32::NAN, &["x_min", "finite"]),
        (|s| s.scene.x_max[2] = f32::INFINITY, &["x_max", "finite"]),
        (|s| s.camera.pose_l = 0, &["camera.pose_l", "from 1 to"]),
        (|s| (s.camera.pose_l, s.camera.pose_h) = (i32::MAX, i32::MAX), &["camera.pose_l", "1,000,000"]),
        (|s| s.camera.pose_n_azim = 7, &["camera.pose_n_azim", "8 headings"]),
        (|s| s.camera.start_positions = vec![[0, 0, 9, 2, 0]], &["start_positions", "[0, 9, 0]", "inside the lattice"]),
    ];
    for (change, words) in table {
        let mut settings = settings();
        change(&mut settings);
        let error = Scene::new("room", room(), &settings).err().unwrap_or_else(|| panic!("accepted: {words:?}"));
        says(&error, &["room"]);
        says(&error, words);
    }
    let mut far = settings();
    (far.scene.x_min, far.scene.x_max) = ([50.0; 3], [60.0; 3]);
    let scene = Scene::new("room", room(), &far).unwrap();
    says(
        &World::new(scene, &SimConfig::default()).unwrap_err(),
        &["scene room", "no triangle", "[50, 50, 50]", "scene.x_min"],
    );
}

#[test]
fn settings_files_name_the_key() {
    let folder = tempfile::tempdir().unwrap();
    let mut obj = String::new();
    room().vertices().iter().for_each(|v| obj += &format!("v {} {} {}\n", v.x, v.y, v.z));
    room().triangles().iter().for_each(|t| obj += &format!("f {} {} {}\n", t[0] + 1, t[1] + 1, t[2] + 1));
    std::fs::write(folder.path().join("room.obj"), obj).unwrap();
    let write = |value: &str| {
        let mut json = serde_json::to_value(settings()).unwrap();
        json["scene"]["metres_per_unit"] = serde_json::from_str(value).unwrap();
        std::fs::write(folder.path().join("settings.json"), json.to_string()).unwrap();
    };
    for value in ["0", "1e300", "-5", "1e30", "1e-9"] {
        write(value);
        let error = Scene::load(folder.path()).unwrap_err();
        says(&error, &["settings.json", "scene.metres_per_unit", "metres in one unit"]);
    }
    for value in ["null", "\"5\""] {
        write(value);
        says(&Scene::load(folder.path()).unwrap_err(), &["settings.json", "expected f32"]);
    }
    write("1.0");
    assert!(Scene::load(folder.path()).is_ok());
}

fn robot(change: fn(&mut MotionConfig)) -> Agent {
    let mut config = MotionConfig::default();
    change(&mut config);
    Agent::Continuous(config)
}

#[test]
fn lattices() {
    for spacing in [0.0, -0.5, f32::NAN, 1e-9] {
        let error = Scene::two_rooms().for_robot(1.25, spacing, 0.02).unwrap_err();
        says(&error, &["scene two_rooms", &format!("a lattice every {spacing} m"), "1 to 1000000", "positive step"]);
    }
    for height in [f32::NAN, f32::INFINITY, 50.0] {
        says(&Scene::two_rooms().for_robot(height, 0.5, 0.02).unwrap_err(), &["no free lattice pose at height"]);
    }
}

#[test]
fn cameras_that_are_nowhere_see_nothing() {
    let scene = Scene::two_rooms();
    let camera = Camera { width: 17, height: 9, ..Camera::default() };
    let (away, inside) = (Vec3::splat(1e30), Vec3::new(3.0, 1.65, 3.0));
    let places = [(away, 0.0), (Vec3::NAN, 0.0), (inside.with_x(f32::INFINITY), 1.0), (inside, f32::NAN)];
    for (position, azimuth) in places {
        for sensor in [&DepthCamera(camera) as &dyn Sensor, &RayCamera(camera)] {
            let mut frame = Frame::default();
            sensor.capture(&scene, &Pose { position, azimuth }, &mut frame);
            assert!(frame.depth.iter().all(|&depth| depth == 0.0), "{position} {azimuth}: {:?}", frame.depth);
        }
    }
    // As far as numbers go, and no farther than the walls.
    for range in [1e6, 1e30] {
        let mut frame = Frame::default();
        DepthCamera(Camera { range, ..camera }).capture(&scene, &Pose { position: inside, azimuth: 1.0 }, &mut frame);
        assert!(frame.depth.iter().all(|&depth| depth > 0.0 && depth < 15.0), "{:?}", frame.depth);
    }
}

#[test]
fn simulator_settings() {
    type Change = fn(&mut SimConfig);
    let table: [(Change, &[&str]); 30] = [
        (|s| s.camera.width = 0, &["camera.width × camera.height is 0 × 256", "must be 1 to"]),
        (|s| s.camera.height = 0, &["camera.width × camera.height is 456 × 0", "must be 1 to"]),
        (|s| s.camera.width = usize::MAX, &["camera.width", "must be 1 to"]),
        (|s| s.camera.hfov_degrees = 0.0, &["camera.hfov_degrees is 0", "must be 1 to 170"]),
        (|s| s.camera.hfov_degrees = 180.0, &["camera.hfov_degrees is 180"]),
        (|s| s.camera.hfov_degrees = f32::NAN, &["camera.hfov_degrees is NaN"]),
        (|s| s.camera.range = 0.0, &["camera.range is 0 m", "positive, finite"]),
        (|s| s.camera.range = -1.0, &["camera.range is -1 m"]),
        (|s| s.camera.range = f32::INFINITY, &["camera.range is inf m"]),
        (|s| s.coverage.epsilon = 1e30, &["coverage", "1 km"]),
        (|s| s.agent = robot(|r| r.lattice_step = 0.0), &["sim.agent.", "lattice_step"]),
        (|s| s.agent = robot(|r| r.lattice_step = f32::NAN), &["sim.agent.", "lattice_step"]),
        (|s| s.agent = robot(|r| r.turn_degrees = 0.0), &["sim.agent.turn_degrees is 0", "from 1 to 45"]),
        (|s| s.agent = robot(|r| r.camera_height = f32::NAN), &["sim.agent.camera_height is NaN"]),
        (|s| s.agent = robot(|r| r.radius = -1.0), &["sim.agent.radius is -1"]),
        (|s| s.coverage.epsilon = 0.0, &["coverage", "epsilon 0", "positive"]),
        (|s| s.coverage.epsilon = -0.5, &["coverage", "epsilon -0.5"]),
        (|s| s.coverage.epsilon = f32::NAN, &["coverage", "epsilon NaN"]),
        (|s| s.coverage.epsilon = f32::INFINITY, &["coverage", "epsilon inf"]),
        (|s| s.coverage.points = 0, &["coverage", "0 points"]),
        (|s| s.keep = 0.0, &["sim.keep is 0", "above 0"]),
        (|s| s.keep = -0.1, &["sim.keep is -0.1"]),
        (|s| s.keep = 1.5, &["sim.keep is 1.5", "at most 1"]),
        (|s| s.keep = f32::NAN, &["sim.keep is NaN"]),
        (|s| s.captures = 0, &["sim.captures is 0", "from 1 to 64"]),
        (|s| s.captures = 1000, &["sim.captures is 1000"]),
        (|s| s.encode.window.pixels = 0, &["sim.encode.window.pixels is 0", "multiple of 16"]),
        (|s| s.encode.window.metres = 0.0, &["sim.encode.window.metres is 0"]),
        (|s| s.encode.layers.count = 0, &["sim.encode.layers.count is 0"]),
        (|s| s.encode.layers.top = f32::NAN, &["sim.encode.layers.top", "above"]),
    ];
    for (change, words) in table {
        let mut config = SimConfig::default();
        change(&mut config);
        let error = World::new(Scene::two_rooms(), &config).err().unwrap_or_else(|| panic!("accepted: {words:?}"));
        says(&error, words);
    }
}

#[test]
fn starts() {
    let mut wide = settings();
    (wide.camera.pose_l, wide.camera.pose_h) = (6, 4);
    let scene = Scene::new("room", room(), &wide).unwrap();
    let world = Arc::new(World::new(scene, &SimConfig::default()).unwrap());
    let table: [(Node, &[&str]); 5] = [
        (Node { i: 5, k: 0 }, &["scene room", "start (5, 0)", "8.25", "in a wall or outside", "Scene::starts"]),
        (Node { i: 6, k: 0 }, &["scene room", "start (6, 0)", "outside the lattice", "(5, 3)", "Scene::starts"]),
        (Node { i: -1, k: 2 }, &["start (-1, 2)", "outside the lattice"]),
        (Node { i: i32::MIN, k: i32::MAX }, &["outside the lattice"]),
        (Node { i: 0, k: 4 }, &["start (0, 4)", "outside the lattice"]),
    ];
    for (node, words) in table {
        let start = LatticePose { node, heading: Heading::new(0) };
        says(&Episode::new(Arc::clone(&world), start, 3, SeedTree::new(0)).err().unwrap(), words);
        let mut episode = Episode::random(Arc::clone(&world), 3, SeedTree::new(0));
        says(&episode.reset_at(start, SeedTree::new(0)).unwrap_err(), words);
    }
}
