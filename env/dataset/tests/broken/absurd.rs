//! Files that break no rule of their format and ask for the impossible.

use super::examples;
use super::readers::{self, Read};
use nbp_dataset::doom_map::{DoomMap, LineDef, Sector, SideDef, Vertex};
use nbp_dataset::wad::to_bytes;
use nbp_env::SeedTree;
use rand::RngExt as _;

/// Most of anything in a WAD.
const MOST: usize = 65_534;
const FAR: i32 = 32_767;

/// Half a second or more each: for the long run.
pub(crate) const SLOW: [&str; 5] = [
    "2500 squares in each other that say nothing",
    "one room of 1.3 × 1.3 km",
    "settings: a scan of 1400 m",
    "obj: the same face 100,000 times",
    "obj: a hundred faces with 4096 corners",
];

pub(crate) fn all() -> Vec<(&'static str, Read, Vec<u8>)> {
    let wad = |map: DoomMap| to_bytes(&map, "MAP01").unwrap();
    let settings = |key: &str, value: &str| {
        let text = String::from_utf8(examples::settings()).unwrap();
        let mut json: serde_json::Value = serde_json::from_str(&text).unwrap();
        *json.pointer_mut(key).unwrap() = serde_json::from_str(value).unwrap();
        json.to_string().into_bytes()
    };
    let mut all: Vec<(&'static str, Read, Vec<u8>)> = [
        ("65,534 lines at random", random_lines()),
        ("65,534 long lines side by side", side_by_side()),
        ("65,534 times the same line", lines(|_| [[0, 0], [500, 300]])),
        ("500 × 500 lines, 250,000 crossings", lattice(500)),
        ("200 × 200 lines, 40,000 crossings", lattice(200)),
        ("3000 lines that hardly differ", lines_of(3000, |n| [[-FAR, n - 1500], [FAR, 1500 - n]])),
        ("3000 sectors of other heights in a fan", fan(3000)),
        ("2500 squares in each other that say nothing", nested(2500)),
        ("65,534 switches for 65,534 sectors", tagged()),
        ("one room of 1.3 × 1.3 km", square_room(FAR)),
    ]
    .map(|(name, map)| (name, readers::wad as Read, wad(map)))
    .into();
    all.extend(
        [
            ("settings: 1000 × 1000 nodes", settings("/camera/pose_l", "1000"), "/camera/pose_h", "1000"),
            ("settings: 4,000,000 nodes in a row", settings("/camera/pose_l", "4000000"), "/camera/pose_h", "1"),
            ("settings: pose_l 2e9", settings("/camera/pose_l", "2000000000"), "/camera/pose_w", "1"),
            ("settings: a unit of 1e30 m", settings("/scene/metres_per_unit", "1e30"), "/camera/pose_w", "1"),
            ("settings: a scan of 1400 m", settings("/scene/metres_per_unit", "200"), "/scene/open", "true"),
            ("settings: corner at 1e30", settings("/camera/x_min", "[1e30, 0, 0]"), "/camera/pose_w", "1"),
            ("settings: null", settings("/camera/x_min", "[null, 0, 0]"), "/camera/pose_w", "1"),
        ]
        .map(|(name, bytes, key, value)| {
            let mut json: serde_json::Value = serde_json::from_slice(&bytes).unwrap();
            let (object, key) = key.rsplit_once('/').unwrap();
            json.pointer_mut(object).unwrap()[key] = serde_json::from_str(value).unwrap();
            if name.contains("1400 m") {
                json["camera"]["pose_l"] = 940.into();
                json["camera"]["pose_h"] = 940.into();
            }
            (name, readers::settings as Read, json.to_string().into_bytes())
        }),
    );
    all.push(("obj: the same face 100,000 times", readers::obj, {
        let faces = "f 4 1 5 8\n".repeat(100_000);
        [examples::OBJ.as_bytes(), faces.as_bytes()].concat()
    }));
    all.push(("obj: a hundred faces with 4096 corners", readers::obj, {
        let mut rng = SeedTree::new(2).rng();
        let corners = (0..4096).map(|_| format!(" {}", rng.random_range(1..=9))).collect::<String>();
        [examples::OBJ.as_bytes(), format!("f{corners}\n").repeat(100).as_bytes()].concat()
    }));
    all.push(("settings: 100,000 brackets", readers::settings, "[".repeat(100_000).into_bytes()));
    all
}

fn sector(map: &mut DoomMap, floor: i32) -> u32 {
    map.sectors.push(Sector { floor, ceiling: 32_000, tag: 1, ..Sector::default() });
    map.sectors.len() as u32 - 1
}

fn line(map: &mut DoomMap, ends: [[i32; 2]; 2], sectors: [Option<u32>; 2]) {
    let [from, to] = ends.map(|[x, y]| {
        if let Some(known) = map.vertices.iter().rev().take(4).position(|v| (v.x, v.y) == (x, y)) {
            return (map.vertices.len() - 1 - known) as u32;
        }
        map.vertices.push(Vertex { x, y });
        map.vertices.len() as u32 - 1
    });
    let [front, back] = sectors.map(|sector| {
        map.sidedefs.push(SideDef { sector: sector?, ..SideDef::default() });
        Some(map.sidedefs.len() as u32 - 1)
    });
    map.linedefs.push(LineDef { from, to, flags: 0, special: 0, tag: 0, front, back });
}

/// Lines with one sector on one side; vertices are shared by two lines.
fn lines_of(count: usize, ends: impl Fn(i32) -> [[i32; 2]; 2]) -> DoomMap {
    let mut map = DoomMap::default();
    let room = sector(&mut map, 0);
    for n in 0..count.min(MOST / 2) {
        line(&mut map, ends(n as i32), [Some(room), None]);
    }
    map
}

fn lines(ends: impl Fn(i32) -> [[i32; 2]; 2]) -> DoomMap {
    let mut map = lines_of(MOST / 2, ends);
    let again: Vec<LineDef> = map.linedefs.iter().rev().copied().collect();
    map.linedefs.extend(again);
    map
}

fn random_lines() -> DoomMap {
    let mut rng = SeedTree::new(1).rng();
    let mut map = DoomMap::default();
    let room = sector(&mut map, 0);
    map.vertices =
        (0..MOST).map(|_| Vertex { x: rng.random_range(-FAR..FAR), y: rng.random_range(-FAR..FAR) }).collect();
    map.sidedefs = vec![SideDef { sector: room, ..SideDef::default() }];
    map.linedefs = (0..MOST)
        .map(|_| {
            let [from, to] = [(); 2].map(|()| rng.random_range(0..MOST as u32));
            LineDef { from, to, flags: 0, special: 0, tag: 0, front: Some(0), back: None }
        })
        .collect();
    map
}

fn side_by_side() -> DoomMap {
    let mut map = lines_of(MOST / 2, |n| [[-FAR, 2 * n - FAR], [FAR, 2 * n - FAR]]);
    let shifted: Vec<LineDef> = map.linedefs.windows(2).map(|pair| LineDef { to: pair[1].to, ..pair[0] }).collect();
    map.linedefs.extend(shifted);
    map
}

fn lattice(side: i32) -> DoomMap {
    lines_of(2 * side as usize, |n| {
        let at = (n / 2 - side / 2) * 60;
        if n % 2 == 0 { [[at, -FAR], [at, FAR]] } else { [[-FAR, at], [FAR, at]] }
    })
}

fn fan(count: usize) -> DoomMap {
    let mut map = DoomMap::default();
    let rim: Vec<[i32; 2]> = (0..count)
        .map(|n| {
            let (sin, cos) = (std::f64::consts::TAU * n as f64 / count as f64).sin_cos();
            [cos, sin].map(|c| (c * f64::from(FAR)) as i32)
        })
        .collect();
    for n in 0..count {
        sector(&mut map, n as i32 * 7919 % 30_000);
    }
    map.vertices = std::iter::once([0, 0]).chain(rim).map(|[x, y]| Vertex { x, y }).collect();
    map.sidedefs = (0..count as u32).map(|sector| SideDef { sector, ..SideDef::default() }).collect();
    for n in 0..count as u32 {
        let next = (n + 1) % count as u32;
        let plain = LineDef { from: 0, to: n + 1, flags: 0, special: 0, tag: 0, front: Some(n), back: None };
        map.linedefs.push(LineDef { back: Some(next), ..plain });
        map.linedefs.push(LineDef { from: next + 1, to: n + 1, ..plain });
    }
    map
}

fn nested(count: i32) -> DoomMap {
    let mut map = DoomMap::default();
    let room = sector(&mut map, 0);
    for n in 0..count {
        let r = FAR - 2 * n;
        let base = map.vertices.len() as u32;
        map.vertices.extend([[-r, -r], [r, -r], [r, r], [-r, r]].map(|[x, y]| Vertex { x, y }));
        for side in 0..4 {
            map.sidedefs.push(SideDef { sector: room, ..SideDef::default() });
            let front = Some((map.sidedefs.len() - 1) as u32);
            let (from, to) = (base + (side + 1) % 4, base + side);
            let back = front.filter(|_| n > 0);
            map.linedefs.push(LineDef { from, to, flags: 0, special: 0, tag: 0, front, back });
        }
    }
    map.vertices.truncate(MOST);
    map.sidedefs.truncate(MOST);
    map
}

fn tagged() -> DoomMap {
    let mut map = square_room(1000);
    for n in 1..MOST {
        sector(&mut map, n as i32 % 100);
    }
    let last = map.linedefs.len() - 1;
    let switch = LineDef { special: 103, tag: 1, ..map.linedefs[last] };
    map.linedefs.extend(vec![switch; MOST - 4]);
    map
}

fn square_room(r: i32) -> DoomMap {
    let mut map = DoomMap::default();
    let room = sector(&mut map, 0);
    for pair in [[-r, -r], [r, -r], [r, r], [-r, r], [-r, -r]].windows(2) {
        line(&mut map, [pair[1], pair[0]], [Some(room), None]);
    }
    map
}
