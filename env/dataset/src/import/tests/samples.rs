//! Small buildings and the files that hold them, made here.

use glam::{Mat4, Vec3};
use std::fmt::Write as _;

/// Polygons with a colour each; no two share vertices.
#[derive(Clone, Default)]
pub(super) struct House {
    pub(super) polygons: Vec<(Vec<Vec3>, [u8; 3])>,
}

pub(super) const FLOOR: [u8; 3] = [200, 30, 30];
pub(super) const WALL: [u8; 3] = [90, 120, 90];
pub(super) const TABLE: [u8; 3] = [20, 20, 220];

impl House {
    pub(super) fn face(&mut self, corners: &[[f32; 3]], colour: [u8; 3]) {
        self.polygons.push((corners.iter().map(|&c| Vec3::from(c)).collect(), colour));
    }

    /// A level rectangle, split into tiles of about a metre.
    fn level(&mut self, [x0, z0, x1, z1]: [f32; 4], y: f32, colour: [u8; 3]) {
        let count = |length: f32| length.ceil().max(1.0) as usize;
        let (columns, rows) = (count(x1 - x0), count(z1 - z0));
        let at = |from: f32, to: f32, n: usize, of: usize| from + (to - from) * n as f32 / of as f32;
        for i in 0..columns {
            for k in 0..rows {
                let ([a, b], [c, d]) = (
                    [at(x0, x1, i, columns), at(x0, x1, i + 1, columns)],
                    [at(z0, z1, k, rows), at(z0, z1, k + 1, rows)],
                );
                self.face(&[[a, y, c], [a, y, d], [b, y, d], [b, y, c]], colour);
            }
        }
    }

    fn wall(&mut self, a: [f32; 2], b: [f32; 2], low: f32, high: f32) {
        self.face(&[[a[0], low, a[1]], [b[0], low, b[1]], [b[0], high, b[1]], [a[0], high, a[1]]], WALL);
    }

    fn shell(&mut self, [x0, z0, x1, z1]: [f32; 4], low: f32, high: f32) {
        let corners = [[x0, z0], [x1, z0], [x1, z1], [x0, z1]];
        (0..4).for_each(|n| self.wall(corners[n], corners[(n + 1) % 4], low, high));
    }

    /// Two rooms of 4.5 × 6 m behind a wall without thickness with a door, 2.6 m high, and the top of a table.
    pub(super) fn two_rooms() -> Self {
        let mut house = Self::default();
        house.level([0.0, 0.0, 9.0, 6.0], 0.0, FLOOR);
        house.level([0.0, 0.0, 9.0, 6.0], 2.6, WALL);
        house.shell([0.0, 0.0, 9.0, 6.0], 0.0, 2.6);
        house.wall([4.5, 0.0], [4.5, 2.0], 0.0, 2.6);
        house.wall([4.5, 3.5], [4.5, 6.0], 0.0, 2.6);
        house.wall([4.5, 2.0], [4.5, 3.5], 2.1, 2.6);
        house.level([7.0, 0.4, 8.0, 1.4], 0.75, TABLE);
        house
    }

    /// Two storeys of 9 × 6 m with a stair between, slab 2.5 to 2.8 m, and a lawn around.
    pub(super) fn two_storeys() -> Self {
        let mut house = Self::default();
        let well = [0.5, 0.5, 1.5, 4.5];
        for (y, colour) in [(2.5, WALL), (2.8, FLOOR)] {
            house.level([0.0, 0.0, 0.5, 6.0], y, colour);
            house.level([0.5, 0.0, 1.5, 0.5], y, colour);
            house.level([0.5, 4.5, 1.5, 6.0], y, colour);
            house.level([1.5, 0.0, 9.0, 6.0], y, colour);
        }
        house.shell(well, 2.5, 2.8);
        house.level([0.0, 0.0, 9.0, 6.0], 0.0, FLOOR);
        house.level([0.0, 0.0, 9.0, 6.0], 5.3, WALL);
        house.shell([0.0, 0.0, 9.0, 6.0], 0.0, 5.3);
        for step in 0..14 {
            let z = 0.5 + step as f32 * 4.0 / 14.0;
            house.level([0.5, z, 1.5, z + 4.0 / 14.0], (step + 1) as f32 * 0.2, WALL);
            house.wall([0.5, z], [1.5, z], step as f32 * 0.2, (step + 1) as f32 * 0.2);
        }
        for lawn in [[-8.0, -8.0, 17.0, 0.0], [-8.0, 6.0, 17.0, 14.0], [-8.0, 0.0, 0.0, 6.0], [9.0, 0.0, 17.0, 6.0]] {
            house.level(lawn, -0.1, WALL);
        }
        house
    }

    /// Triangles as quads with a corner twice, for [`Self::glb`].
    pub(super) fn clone_as_quads(&self) -> Self {
        let mut quads = self.clone();
        quads.polygons.iter_mut().for_each(|(corners, _)| corners.push(corners[2]));
        quads
    }

    /// The same in other axes or units.
    pub(super) fn map(mut self, change: impl Fn(Vec3) -> Vec3) -> Self {
        self.polygons.iter_mut().flat_map(|(corners, _)| corners).for_each(|corner| *corner = change(*corner));
        self
    }

    pub(super) fn obj(&self) -> Vec<u8> {
        let (mut vertices, mut faces, mut count) = (String::new(), String::new(), 0);
        for (corners, [r, g, b]) in &self.polygons {
            faces.push('f');
            for c in corners {
                count += 1;
                let [r, g, b] = [r, g, b].map(|&v| f32::from(v) / 255.0);
                writeln!(vertices, "v {} {} {} {r} {g} {b}", c.x, c.y, c.z).unwrap();
                write!(faces, " {count}").unwrap();
            }
            faces.push('\n');
        }
        (vertices + &faces).into_bytes()
    }

    /// `little`: binary of that byte order, or text.
    pub(super) fn ply(&self, little: Option<bool>) -> Vec<u8> {
        let format = match little {
            None => "ascii",
            Some(true) => "binary_little_endian",
            Some(false) => "binary_big_endian",
        };
        let count: usize = self.polygons.iter().map(|(corners, _)| corners.len()).sum();
        let mut file = format!(
            "ply\nformat {format} 1.0\ncomment made here\nelement vertex {count}\nproperty double x\nproperty float y\n\
             property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nproperty uchar alpha\n\
             element face {}\nproperty list uchar int vertex_indices\nproperty int object_id\nend_header\n",
            self.polygons.len()
        )
        .into_bytes();
        let order = |bytes: &[u8]| match little {
            Some(false) => bytes.iter().rev().copied().collect(),
            _ => bytes.to_vec(),
        };
        for (corners, [r, g, b]) in &self.polygons {
            for c in corners {
                if little.is_none() {
                    file.extend(format!("{} {} {} {r} {g} {b} 255\n", c.x, c.y, c.z).bytes());
                } else {
                    file.extend(order(&f64::from(c.x).to_le_bytes()));
                    [c.y, c.z].iter().for_each(|v| file.extend(order(&v.to_le_bytes())));
                    file.extend([*r, *g, *b, 255]);
                }
            }
        }
        let mut next = 0;
        for (corners, _) in &self.polygons {
            let numbers: Vec<i32> = (next..next + corners.len() as i32).collect();
            next += corners.len() as i32;
            if little.is_none() {
                let text: Vec<String> = numbers.iter().map(ToString::to_string).collect();
                file.extend(format!("{} {} 7\n", corners.len(), text.join(" ")).bytes());
            } else {
                file.push(corners.len() as u8);
                numbers.iter().chain([&7]).for_each(|n| file.extend(order(&n.to_le_bytes())));
            }
        }
        if little.is_none() {
            file.pop();
        }
        file
    }

    /// A GLB file: even polygons in the first mesh, under a scaled and turned node below a mirrored one, odd ones in the
    /// second as strips of quads without indices; colours as materials. The mirror turns the winding, so the file has it the
    /// other way round.
    pub(super) fn glb(&self) -> Vec<u8> {
        let outer = Mat4::from_scale(Vec3::new(-2.0, 2.0, 2.0)) * Mat4::from_translation(Vec3::new(3.0, 0.0, 1.0));
        let inner = Mat4::from_rotation_y(0.5) * Mat4::from_scale(Vec3::splat(0.5));
        let mut glb = Glb::default();
        let (mut meshes, mut nodes) = (Vec::new(), Vec::new());
        for (odd, transform) in [(0, outer * inner), (1, outer)] {
            let back = transform.inverse();
            let mut primitives = Vec::new();
            for (corners, colour) in self.polygons.iter().skip(odd).step_by(2) {
                assert_eq!(corners.len(), 4);
                let order = if odd == 0 { [0, 1, 2, 3] } else { [1, 0, 2, 3] };
                let placed = order.map(|n| back.transform_point3(corners[n]));
                let positions =
                    glb.accessor(5126, "VEC3", 4, placed.iter().flat_map(|p| p.to_array()).flat_map(f32::to_le_bytes));
                let material = glb.material(*colour);
                primitives.push(if odd == 0 {
                    let indices = match primitives.len() % 3 {
                        0 => glb.accessor(5121, "SCALAR", 6, [0, 2, 1, 0, 3, 2].into_iter()),
                        1 => glb.accessor(
                            5123,
                            "SCALAR",
                            6,
                            [0_u16, 2, 1, 0, 3, 2].into_iter().flat_map(u16::to_le_bytes),
                        ),
                        _ => glb.accessor(
                            5125,
                            "SCALAR",
                            6,
                            [0_u32, 2, 1, 0, 3, 2].into_iter().flat_map(u32::to_le_bytes),
                        ),
                    };
                    format!(r#"{{"attributes":{{"POSITION":{positions}}},"indices":{indices},"material":{material}}}"#)
                } else {
                    format!(r#"{{"attributes":{{"POSITION":{positions}}},"mode":5,"material":{material}}}"#)
                });
            }
            meshes.push(format!(r#"{{"primitives":[{}]}}"#, primitives.join(",")));
        }
        nodes.push(r#"{"children":[1,2],"scale":[-2,2,2],"translation":[-6,0,2]}"#.into());
        let [sin, cos] = [0.25_f32.sin(), 0.25_f32.cos()];
        nodes.push(format!(r#"{{"mesh":0,"rotation":[0,{sin},0,{cos}],"scale":[0.5,0.5,0.5]}}"#));
        nodes.push(r#"{"mesh":1}"#.into());
        glb.file(&meshes, &nodes)
    }
}

/// A GLB file in the making.
#[derive(Default)]
pub(super) struct Glb {
    pub(super) data: Vec<u8>,
    views: Vec<String>,
    accessors: Vec<String>,
    materials: Vec<String>,
    /// More members of the document, each after a comma.
    pub(super) more: String,
}

impl Glb {
    pub(super) fn view(&mut self, bytes: impl Iterator<Item = u8>) -> usize {
        let start = self.data.len();
        self.data.extend(bytes);
        let length = self.data.len() - start;
        while !self.data.len().is_multiple_of(4) {
            self.data.push(0);
        }
        self.views.push(format!(r#"{{"buffer":0,"byteOffset":{start},"byteLength":{length}}}"#));
        self.views.len() - 1
    }

    pub(super) fn accessor(
        &mut self,
        component: u32,
        kind: &str,
        count: usize,
        bytes: impl Iterator<Item = u8>,
    ) -> usize {
        let view = self.view(bytes);
        self.accessors
            .push(format!(r#"{{"bufferView":{view},"componentType":{component},"count":{count},"type":"{kind}"}}"#));
        self.accessors.len() - 1
    }

    fn material(&mut self, colour: [u8; 3]) -> usize {
        let linear = colour.map(|c| {
            let c = f32::from(c) / 255.0;
            if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
        });
        let [r, g, b] = linear;
        let text = format!(r#"{{"pbrMetallicRoughness":{{"baseColorFactor":[{r},{g},{b},1]}}}}"#);
        let known = self.materials.iter().position(|material| *material == text);
        known.unwrap_or_else(|| {
            self.materials.push(text);
            self.materials.len() - 1
        })
    }

    pub(super) fn raw_material(&mut self, text: &str) -> usize {
        self.materials.push(text.into());
        self.materials.len() - 1
    }

    pub(super) fn file(&self, meshes: &[String], nodes: &[String]) -> Vec<u8> {
        let mut json = format!(
            r#"{{"asset":{{"version":"2.0"}},"buffers":[{{"byteLength":{}}}],"bufferViews":[{}],"accessors":[{}],"materials":[{}],"meshes":[{}],"nodes":[{}],"scenes":[{{"nodes":[0]}}],"scene":0{}}}"#,
            self.data.len(),
            self.views.join(","),
            self.accessors.join(","),
            self.materials.join(","),
            meshes.join(","),
            nodes.join(","),
            self.more,
        );
        while !json.len().is_multiple_of(4) {
            json.push(' ');
        }
        let chunk = |kind: &[u8; 4], data: &[u8]| [&(data.len() as u32).to_le_bytes()[..], kind, data].concat();
        let body = [chunk(b"JSON", json.as_bytes()), chunk(b"BIN\0", &self.data)].concat();
        [b"glTF", &2_u32.to_le_bytes()[..], &(body.len() as u32 + 12).to_le_bytes(), &body].concat()
    }
}
