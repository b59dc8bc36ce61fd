//! Whole files to damage: small, so that thousands go through in a second, and with something of everything.

use glam::{Vec2, Vec3};
use nbp_dataset::doom_map::{DoomMap, LineDef, Name, Sector, SideDef, Thing, Vertex};
use nbp_dataset::wad::to_playable;
use nbp_dataset::{Level, generate};
use nbp_env::scene::Settings;
use png::{BitDepth, ColorType};
use std::path::Path;

/// Two rooms of different heights, a pillar in one and a door with a tag between them, with and without textures; and, for
/// one case in 25, a whole
/// generated map.
pub(crate) fn wads() -> Vec<Vec<u8>> {
    let small = to_playable(&rooms(), "MAP01").unwrap();
    let large = to_playable(&generate(Level::Simple, 3).unwrap().map, "E1M1").unwrap();
    let mut all = vec![small.clone(); 12];
    all.extend(vec![with_textures(&small); 12]);
    all.push(large);
    all
}

/// A WAD with palette, patch, textures and flats for [`rooms`] behind its own lumps.
fn with_textures(wad: &[u8]) -> Vec<u8> {
    let number = |at: usize| u32::from_le_bytes([wad[at], wad[at + 1], wad[at + 2], wad[at + 3]]) as usize;
    let (count, directory) = (number(4), number(8));
    let shorts = |values: &[u16]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    let name = |text: &str| Name::of(text).bytes().to_vec();
    // Two columns, each of two posts.
    let column = [0, 2, 0, 9, 8, 0, 60, 3, 0, 7, 6, 5, 0, 255];
    let patch = [shorts(&[2, 64, 0, 0]), [16_u32, 16].map(u32::to_le_bytes).concat(), column.to_vec()].concat();
    let placed = |x: u16, y: u16| shorts(&[x, y, 0, 1, 0]);
    let texture =
        [name("WALL"), shorts(&[0, 0, 8, 64, 0, 0, 3]), placed(0, 0), placed(4, 9), placed(7, 65_500)].concat();
    let lumps: [(&str, Vec<u8>); 9] = [
        ("PLAYPAL", (0..768).map(|n| (n % 251) as u8).collect()),
        ("PNAMES", [vec![1, 0, 0, 0], name("POSTS")].concat()),
        ("TEXTURE1", [[1_u32, 8].map(u32::to_le_bytes).concat(), texture].concat()),
        ("POSTS", patch),
        ("F_START", Vec::new()),
        ("FLOOR", vec![3; 4096]),
        ("CEIL", vec![4; 4096]),
        ("F_END", Vec::new()),
        ("END", Vec::new()),
    ];
    let (mut body, mut entries) = (wad[..directory].to_vec(), wad[directory..].to_vec());
    for (lump, bytes) in &lumps {
        entries.extend([body.len() as u32, bytes.len() as u32].map(u32::to_le_bytes).concat());
        entries.extend(name(lump));
        body.extend(bytes);
    }
    let header = [(count + lumps.len()) as u32, body.len() as u32].map(u32::to_le_bytes).concat();
    body[4..12].copy_from_slice(&header);
    [body, entries].concat()
}

fn rooms() -> DoomMap {
    let mut map = DoomMap { name: "rooms".into(), ..DoomMap::default() };
    for (floor, ceiling, tag) in [(0, 128, 0), (16, 160, 0), (0, 0, 7)] {
        let [floor_flat, ceiling_flat] = [Name::of("FLOOR"), Name::of("CEIL")];
        map.sectors.push(Sector { floor, ceiling, tag, floor_flat, ceiling_flat, light: 160, ..Sector::default() });
    }
    let mut line = |a: [i32; 2], b: [i32; 2], sectors: [Option<u32>; 2], special: u16| {
        let [from, to] = [a, b].map(|[x, y]| {
            map.vertices.push(Vertex { x, y });
            map.vertices.len() as u32 - 1
        });
        let [front, back] = sectors.map(|sector| {
            let wall = Name::of("WALL");
            let side = SideDef { sector: sector?, upper: wall, lower: wall, middle: wall, ..SideDef::default() };
            map.sidedefs.push(side);
            Some(map.sidedefs.len() as u32 - 1)
        });
        map.linedefs.push(LineDef { from, to, flags: 0, special, tag: special & 7, front, back });
    };
    let mut walls = |corners: &[[i32; 2]], sector: u32| {
        corners.windows(2).for_each(|pair| line(pair[1], pair[0], [Some(sector), None], 0));
    };
    walls(&[[400, 250], [400, 400], [0, 400], [0, 0], [400, 0], [400, 150]], 0);
    walls(&[[432, 150], [432, 0], [832, 0], [832, 400], [432, 400], [432, 250]], 1);
    walls(&[[100, 100], [100, 140], [140, 140], [140, 100], [100, 100]], 0);
    walls(&[[400, 150], [432, 150]], 2);
    walls(&[[432, 250], [400, 250]], 2);
    line([400, 150], [400, 250], [Some(2), Some(0)], 0);
    line([432, 250], [432, 150], [Some(2), Some(1)], 103);
    map.linedefs.iter_mut().for_each(|line| line.tag = if line.special == 103 { 7 } else { 0 });
    map.things.push(Thing { x: 200, y: 200, angle: 90, kind: 1, flags: 7 });
    map
}

/// A whole scene without settings: one of its files is damaged.
pub(crate) fn write_folder(folder: &Path) {
    for (name, bytes) in [("scene.obj", OBJ.as_bytes()), ("scene.mtl", MTL.as_bytes()), ("scene.png", &pngs()[0])] {
        std::fs::write(folder.join(name), bytes).unwrap();
    }
}

/// Settings of [`OBJ`], in metres.
pub(crate) fn settings() -> Vec<u8> {
    let corners = [Vec3::ZERO, Vec3::new(6.0, 3.0, 7.0)];
    let mut settings = Settings::for_box(corners, 0.0, Vec2::splat(0.75));
    settings.camera.start_positions = vec![[1, 0, 1, 2, 0], [2, 0, 3, 2, 5]];
    serde_json::to_vec_pretty(&settings).unwrap()
}

pub(crate) const JPEG: &[u8] = include_bytes!("../../../src/scene/fixtures/red_blue.jpg");

/// PNG files of several colour types and depths.
pub(crate) fn pngs() -> Vec<Vec<u8>> {
    let types = [
        (ColorType::Rgb, BitDepth::Eight, 3),
        (ColorType::Rgba, BitDepth::Sixteen, 8),
        (ColorType::Grayscale, BitDepth::Eight, 1),
        (ColorType::GrayscaleAlpha, BitDepth::Eight, 2),
        (ColorType::Indexed, BitDepth::Eight, 1),
    ];
    let png = |&(colour, depth, bytes): &(ColorType, BitDepth, usize)| {
        let mut file = Vec::new();
        let mut encoder = png::Encoder::new(&mut file, 16, 12);
        encoder.set_color(colour);
        encoder.set_depth(depth);
        if colour == ColorType::Indexed {
            encoder.set_palette(&[7; 3 * 256][..]);
        }
        let pixels: Vec<u8> = (0..16 * 12 * bytes).map(|n| (n * n % 251) as u8).collect();
        let mut writer = encoder.write_header().unwrap();
        writer.write_image_data(&pixels).unwrap();
        drop(writer);
        file
    };
    types.iter().map(png).collect()
}

/// Polygons, colours of some vertices, a textured face, indices from the end.
pub(crate) const OBJ: &str = "mtllib scene.mtl\no room\n\
    v 0 0 0 1 0 0\nv 6 0 0 0 1 0\nv 6 0 6 0 0 1\nv 0 0 6 1 1 1\nv 0 3 0\nv 6 3 0\nv 6 3 6\nv 0 3 6\nv 3 0 7\n\
    vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvn 0 1 0\nusemtl wood\ns off\n\
    f 1/1/1 2/2/1 3/3/1 9/1 4/4/1\nf -5//1 -4//1 -3//1 \\\n 8\ng walls\nusemtl plain\nf 1/1 2/2 6/3 5/4\nf 2 3 7 6\n\
    f 3 9 4 8 7 # five\nf 4 1 5 8\n";

/// Materials of [`OBJ`], one with an image.
pub(crate) const MTL: &str = "newmtl wood\nKa 0 0 0\nKd 0.5 0.25 0.125\nillum 1\nmap_Kd -s 2 2 1 -o 0.5 0 0 scene.png\n\
    newmtl plain\nKd 1 1 1\nTr 0\n";
