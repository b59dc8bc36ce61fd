//! Files of every format, from bytes to scenes.

mod samples;

use super::*;
use crate::stats::measure;
use glam::Vec2;
use nbp_env::Scene;
use nbp_env::scene::Paint;
use samples::{FLOOR, Glb, House, TABLE};

fn scenes(bytes: &[u8], format: Format, options: &ImportOptions) -> (Vec<Imported>, Assumptions) {
    import(parse(bytes, format).unwrap(), format, "house", options).unwrap()
}

fn scene(imported: &Imported) -> Scene {
    Scene::new(imported.name.clone(), imported.mesh.clone(), &imported.settings).unwrap()
}

/// Middle of the faces of a colour, weighted by area, and their area.
fn faces_of(mesh: &Mesh, colour: [u8; 3]) -> (Vec3, f32) {
    let paints = &mesh.appearance().unwrap().paints;
    let painted = mesh.iter_corners().zip(paints).filter(|(_, paint)| **paint == Paint::Corners([colour; 3]));
    let (sum, area) = painted.fold((Vec3::ZERO, 0.0), |(sum, area), ([a, b, c], _)| {
        let doubled = (b - a).cross(c - a).length();
        (sum + (a + b + c) / 3.0 * doubled, area + doubled)
    });
    (sum / area, area / 2.0)
}

/// What any file of [`House::two_rooms`] must become.
fn check_two_rooms(what: &str, (imported, assumed): &(Vec<Imported>, Assumptions)) {
    let [imported] = imported.as_slice() else { panic!("{what}: {} scenes", imported.len()) };
    assert_eq!(imported.name, "house");
    let [low, high] = imported.mesh.bounds();
    assert!(low.abs_diff_eq(Vec3::new(-4.5, 0.0, -3.0), 1e-4), "{what}: {low}");
    assert!(high.abs_diff_eq(Vec3::new(4.5, 2.6, 3.0), 1e-4), "{what}: {high}");
    // A mirrored or turned house would have its table elsewhere.
    let (table, area) = faces_of(&imported.mesh, TABLE);
    assert!(table.abs_diff_eq(Vec3::new(3.0, 0.75, -2.1), 1e-4) && (area - 1.0).abs() < 1e-4, "{what}: {table} {area}");
    assert!((faces_of(&imported.mesh, FLOOR).1 - 54.0).abs() < 1e-3, "{what}");
    assert!((assumed.room_height - 2.6).abs() < 1e-3, "{what}: {assumed:?}");
    let scene = scene(imported);
    let measured = measure(&scene);
    assert!((measured.floor_area_m2 - 54.0).abs() < 1.1, "{what}: {measured:?}");
    assert!(measured.positions >= 20 && measured.positions == imported.report.nodes, "{what}: {measured:?}");
    assert_eq!(scene.starts().len(), 5);
    assert!(scene.starts().iter().all(|start| scene.graph().largest_component().contains(&start.node)), "{what}");
}

#[test]
fn every_format_gives_the_same_rooms() {
    let default = ImportOptions::default();
    let house = House::two_rooms();
    let z_up = |p: Vec3| Vec3::new(p.x, -p.z, p.y);
    let x_up = |p: Vec3| Vec3::new(p.y, p.z, p.x);
    let with_up = |up| ImportOptions { up: Some(up), ..ImportOptions::default() };
    check_two_rooms("obj", &scenes(&house.obj(), Format::Obj, &default));
    check_two_rooms("glb", &scenes(&house.glb(), Format::Gltf, &default));
    for little in [None, Some(true), Some(false)] {
        let what = format!("ply {little:?}");
        let found = scenes(&house.clone().map(z_up).ply(little), Format::Ply, &default);
        check_two_rooms(&what, &found);
        assert_eq!((found.1.up.value, found.1.scale.value), (Up::Z, 1.0), "{what}");
        let centimetres = house.clone().map(|p| 100.0 * x_up(p) + 1234.0).ply(little);
        let found = scenes(&centimetres, Format::Ply, &with_up(Up::X));
        assert_eq!((found.1.up.source, found.1.scale.value), (Source::Given, 0.01), "{what}");
        check_two_rooms(&what, &found);
    }
}

#[test]
fn each_storey_is_a_scene() {
    let house = House::two_storeys();
    let (imported, assumed) = scenes(&house.ply(Some(true)), Format::Ply, &ImportOptions::default());
    assert_eq!(assumed.up.value, Up::Y);
    let names: Vec<&str> = imported.iter().map(|scene| scene.name.as_str()).collect();
    assert_eq!(names, ["house_floor0", "house_floor1"]);
    for (floor, expected) in assumed.floors.iter().zip([0.1, 2.9]) {
        assert!((floor - expected).abs() < 0.01, "{assumed:?}");
    }
    for (imported, rooms) in imported.iter().zip([54.0, 50.0]) {
        let scene = scene(imported);
        let (name, measured) = (scene.name(), measure(&scene));
        assert!((measured.floor_area_m2 - rooms).abs() < 6.0, "{name}: {measured:?}");
        assert!(measured.positions >= 16, "{name}: {measured:?}");
        // Nobody stands on the lawn, or over the stairwell.
        let plan = |node| scene.lattice().position(node).abs();
        assert!(scene.graph().largest_component().iter().all(|&n| plan(n).x < 4.5 && plan(n).z < 3.0), "{name}");
        // What counts for coverage is this storey's: nothing of the other one's floor or ceiling.
        let points = nbp_env::scene::surface::sample(&scene, 5000);
        let [low, high] = scene.mesh().bounds();
        assert!(points.iter().all(|p| p.y > low.y - 0.01 && p.y < high.y + 0.01) && points.len() == 5000);
        let floor = points.iter().filter(|p| p.y.abs() < 0.01 && p.x.abs() < 4.5 && p.z.abs() < 3.0).count();
        assert!(floor > 400, "{name}: {floor}");
    }
    assert!(imported[0].mesh.bounds()[1].y < 2.8 && imported[0].mesh.bounds()[1].y > 2.49);
    assert!(imported[1].mesh.bounds()[0].y > -0.21 && (imported[1].mesh.bounds()[1].y - 2.5).abs() < 0.01);
    let only = ImportOptions { storey: Some(1), ..ImportOptions::default() };
    assert_eq!(scenes(&house.ply(None), Format::Ply, &only).0[0].mesh, imported[1].mesh);
    let missing = ImportOptions { storey: Some(2), ..ImportOptions::default() };
    let refused = import(parse(&house.obj(), Format::Obj).unwrap(), Format::Obj, "house", &missing).unwrap_err();
    assert!(refused.to_string().contains("2, counted from 0 (0.10 m, 2.90 m)"), "{refused}");
}

#[test]
fn a_scan_without_a_ceiling_keeps_its_unit_and_its_inside() {
    let mut house = House::two_rooms();
    house.polygons.retain(|(corners, _)| corners.iter().any(|corner| corner.y < 2.6));
    let (imported, assumed) = scenes(&house.ply(Some(true)), Format::Ply, &ImportOptions::default());
    assert_eq!((assumed.up.value, assumed.scale.value, assumed.room_height), (Up::Y, 1.0, 2.6));
    assert!(imported[0].report.open, "{:?}", imported[0].report);
    let measured = measure(&scene(&imported[0]));
    assert!(measured.positions >= 20 && (measured.floor_area_m2 - 54.0).abs() < 1.1, "{measured:?}");
}

#[test]
fn concave_polygons_keep_their_area() {
    let mut house = House::default();
    let plan = [[0.0, 0.0], [9.0, 0.0], [9.0, 3.0], [4.0, 3.0], [4.0, 9.0], [0.0, 9.0]];
    for y in [0.0, 3.0] {
        house.face(&plan.map(|[x, z]| [x, y, z]), FLOOR);
    }
    for (n, a) in plan.iter().enumerate() {
        let b = plan[(n + 1) % plan.len()];
        house.face(&[[a[0], 0.0, a[1]], [b[0], 0.0, b[1]], [b[0], 3.0, b[1]], [a[0], 3.0, a[1]]], TABLE);
    }
    for (bytes, format) in [(house.obj(), Format::Obj), (house.ply(Some(true)), Format::Ply)] {
        let (imported, _) = scenes(&bytes, format, &ImportOptions::default());
        let measured = measure(&scene(&imported[0]));
        assert!((measured.floor_area_m2 - 51.0).abs() < 1e-3, "{format}: {measured:?}");
        assert!(!imported[0].report.open && measured.positions >= 20, "{format}: {measured:?}");
        assert!((faces_of(&imported[0].mesh, FLOOR).1 - 102.0).abs() < 1e-3);
    }
}

#[test]
fn gltf_textures_factors_and_vertex_colours() {
    let mut glb = Glb::default();
    let floats = |values: &[f32]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>().into_iter();
    let positions = glb.accessor(5126, "VEC3", 3, floats(&[0., 0., 0., 1., 0., 0., 0., 0., 1.]));
    let uv = glb.accessor(5126, "VEC2", 3, floats(&[0., 0., 1., 0., 0., 1.]));
    let colours = glb.accessor(5126, "VEC3", 3, floats(&[1., 0., 0., 0., 1., 0., 0., 0., 1.]));
    let mut png = Vec::new();
    let mut encoder = png::Encoder::new(&mut png, 2, 1);
    encoder.set_color(png::ColorType::Rgb);
    encoder.write_header().unwrap().write_image_data(&[255, 0, 0, 10, 20, 30]).unwrap();
    let image = glb.view(png.into_iter());
    let textured = r#"{"pbrMetallicRoughness":{"baseColorTexture":{"index":0}}}"#;
    let compressed = r#"{"pbrMetallicRoughness":{"baseColorTexture":{"index":1},"baseColorFactor":[0,1,0,1]}}"#;
    let again = r#"{"pbrMetallicRoughness":{"baseColorTexture":{"index":2}}}"#;
    let [textured, compressed, again] = [textured, compressed, again].map(|text| glb.raw_material(text));
    glb.more = format!(
        r#","textures":[{{"source":0}},{{"extensions":{{"KHR_texture_basisu":{{"source":0}}}}}},{{"source":0}}],"images":[{{"bufferView":{image},"mimeType":"image/png"}}],"extensionsRequired":["KHR_texture_basisu"]"#
    );
    let attributes = format!(r#""POSITION":{positions},"TEXCOORD_0":{uv}"#);
    let mesh = format!(
        r#"{{"primitives":[{{"attributes":{{{attributes}}},"material":{textured}}},{{"attributes":{{{attributes}}},"material":{compressed}}},{{"attributes":{{"POSITION":{positions},"COLOR_0":{colours}}}}},{{"attributes":{{"POSITION":{positions}}},"mode":1}},{{"attributes":{{{attributes}}},"material":{again}}}]}}"#
    );
    let scan = parse(&glb.file(&[mesh], &[r#"{"mesh":0}"#.into()]), Format::Gltf).unwrap();
    let corners = [Vec2::new(0.0, 1.0), Vec2::new(1.0, 1.0), Vec2::new(0.0, 0.0)];
    assert_eq!(scan.paints[0], Paint::Image { image: 0, corners });
    assert_eq!(scan.images[0].pixels, [[255, 0, 0], [10, 20, 30]]);
    assert_eq!((scan.images.len(), scan.paints[3]), (1, scan.paints[0]), "two textures of one image");
    assert_eq!(scan.paints[1], Paint::Corners([[0, 255, 0]; 3]));
    assert_eq!(scan.paints[2], Paint::Corners([[255, 0, 0], [0, 255, 0], [0, 0, 255]]));
    let notes = scan.notes.join("\n");
    assert!(notes.contains("Basis") && notes.contains("1 primitives of points or lines"), "{notes}");
}

#[test]
fn files_beside_a_scan_are_read_once_and_only_if_regular() {
    let folder = tempfile::tempdir().unwrap();
    let mut png = Vec::new();
    let mut writer = png::Encoder::new(&mut png, 1, 1).write_header().unwrap();
    writer.write_image_data(&[7]).unwrap();
    writer.finish().unwrap();
    fs::write(folder.path().join("a.png"), png).unwrap();
    let ply = String::from_utf8(House::two_rooms().ply(None)).unwrap();
    let names = ["a.png", "a.png", ".", "."].map(|name| format!("comment TextureFile {name}\n")).concat();
    let path = folder.path().join("house.ply");
    fs::write(&path, ply.replacen("comment made here\n", &names, 1)).unwrap();
    let (scan, _) = parse_file(&path).unwrap();
    let told = scan.notes.iter().filter(|note| note.contains("it is no regular file")).count();
    assert_eq!((scan.images.len(), told), (1, 1), "{:?}", scan.notes);
    fs::create_dir(folder.path().join("folder.ply")).unwrap();
    assert!(parse_file(&folder.path().join("folder.ply")).unwrap_err().to_string().contains("no regular file"));
}

#[test]
fn a_generated_map_comes_back_from_files() {
    let made = crate::generate(crate::Level::Simple, 5).unwrap();
    let original = made.scene.mesh;
    let mut house = House::default();
    original.iter_corners().for_each(|corners| house.face(&corners.map(|c| c.to_array()), FLOOR));
    let [low, high] = original.bounds();
    let move_back = (low + high) / 2.0 * Vec3::new(1.0, 0.0, 1.0);
    let sorted = |corners: &mut dyn Iterator<Item = [Vec3; 3]>| {
        let mut all: Vec<[[i64; 3]; 3]> = corners
            .map(|corners| {
                // To half a millimetre, the first corner the smallest.
                let mut keys =
                    corners.map(|c| ((c + 100.0).to_array()).map(|v| (f64::from(v) * 2000.0).round() as i64));
                let first = (0..3).min_by_key(|&n| keys[n]).unwrap_or(0);
                keys.rotate_left(first);
                keys
            })
            .collect();
        all.sort_unstable();
        all
    };
    let expected = sorted(&mut original.iter_corners());
    let complexity = |mesh: &Mesh, settings: &Settings| {
        measure(&Scene::new("map", mesh.clone(), settings).unwrap()).navigation_complexity
    };
    let original_complexity = complexity(&original, &made.scene.settings);
    for (bytes, format) in [(house.ply(Some(true)), Format::Ply), (house.clone_as_quads().glb(), Format::Gltf)] {
        let (imported, assumed) = scenes(&bytes, format, &ImportOptions::default());
        assert_eq!((imported.len(), assumed.up.value, assumed.scale.value), (1, Up::Y, 1.0), "{format}");
        let imported = &imported[0];
        assert!(!imported.report.open, "{format}: {:?}", imported.report);
        let back = moved(&imported.mesh, move_back).unwrap();
        let found = sorted(&mut back.iter_corners());
        let equal = found.iter().zip(&expected).filter(|(a, b)| a == b).count();
        assert!(found.len() == expected.len() && equal == found.len(), "{format}: {equal} of {}", expected.len());
        assert_eq!(complexity(&back, &made.scene.settings), original_complexity, "{format}");
        let own = complexity(&imported.mesh, &imported.settings);
        assert!((own / original_complexity - 1.0).abs() < 0.4, "{format}: {own} against {original_complexity}");
    }
}

#[test]
fn refusals_say_what_and_where() {
    let house = House::two_rooms();
    let text = |bytes: &[u8], format| match parse(bytes, format) {
        Ok(scan) => import(scan, format, "house", &ImportOptions::default()).map(drop).unwrap_err().to_string(),
        Err(error) => error.to_string(),
    };
    let ply = String::from_utf8(house.ply(None)).unwrap();
    let first_row = "0 0 0 200 30 30 255\n";
    for (from, to, want) in [
        ("ply\n", "plx\n", "header: File must start with 'ply'"),
        (first_row, "0 nan 0 200 30 30 255\n", "vertex 0 (counted from 0) is at"),
        (first_row, "0 0 zero 200 30 30 255\n", "element vertex: row 0: Failed to parse f32"),
        ("\n4 0 1 2 3 7", "\n4 0 1 2 9999 7", "face 0 names vertex 9999, but there are"),
        ("\n4 0 1 2 3 7", "\n4 0 1 2 -3 7", "element face: row 0"),
        ("element vertex ", "element vertex 4000000000", "cannot hold"),
        ("property float y\n", "", "element vertex: row 0: missing field `y`"),
    ] {
        let broken = ply.replacen(from, to, 1);
        assert_ne!(broken, ply, "{from:?}");
        let told = text(broken.as_bytes(), Format::Ply);
        assert!(told.contains(want), "{from:?} as {to:?}: {told}");
    }
    let points = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n1 2 3";
    assert!(text(points.as_bytes(), Format::Ply).contains("not a cloud of points"));
    let glb = house.glb();
    let told = text(&glb[..glb.len() - 9], Format::Gltf);
    assert!(told.contains("GLB header") && told.contains("cut short"), "{told}");
    let json = |from: &str, to: &str| {
        let text = String::from_utf8_lossy(&glb[20..20 + u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize]);
        let json = text.replacen(from, to, 1);
        assert_ne!(json, text, "{from}");
        let data = &glb[20 + text.len() + 8..];
        let chunk = |kind: &[u8; 4], data: &[u8]| [&(data.len() as u32).to_le_bytes()[..], kind, data].concat();
        let body = [chunk(b"JSON", json.as_bytes()), chunk(b"BIN\0", data)].concat();
        [b"glTF", &2_u32.to_le_bytes()[..], &(body.len() as u32 + 12).to_le_bytes(), &body].concat()
    };
    for (from, to, want) in [
        (r#""children":[1,2]"#, r#""children":[1,2,0]"#, "node 0: it is reached twice"),
        (r#""count":4"#, r#""count":400000000"#, "it has 400000000 items, its buffer view holds 4"),
        (
            r#""scene":0"#,
            r#""extensionsRequired":["KHR_draco_mesh_compression"]"#,
            "KHR_draco_mesh_compression is required",
        ),
        (r#""version":"2.0""#, r#""version":"1.0""#, "asset.version"),
    ] {
        let told = text(&json(from, to), Format::Gltf);
        assert!(told.contains(want), "{from} as {to}: {told}");
    }
    let wall = parse(b"v 0 0 0\nv 9 0 0\nv 9 2.5 0\nv 0 2.5 0\nf 1 2 3 4\n", Format::Obj).unwrap();
    let given = ImportOptions { up: Some(Up::Y), scale: Some(1.0), storey: None };
    let told = import(wall, Format::Obj, "wall", &given).unwrap_err().to_string();
    assert!(told.contains("it has no floor of 4 m²"), "{told}");
    assert!(text(b"v 0 x 0\n", Format::Obj).contains("line 1"));
    let tiny = house.clone().map(|p| p * 1e-6).obj();
    assert!(text(&tiny, Format::Obj).contains("--scale"), "{}", text(&tiny, Format::Obj));
    let huge = house.map(|p| Vec3::new(p.x * 1e6, p.y, p.z)).obj();
    assert!(text(&huge, Format::Obj).contains("m large"), "{}", text(&huge, Format::Obj));
}
