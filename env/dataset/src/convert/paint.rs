//! Which texture every face shows, and which part of it: Doom's rules of alignment.
//!
//! A texel is a map unit, along and up. Flats lie on the grid of 64 units. A wall's columns count from the start of its
//! linedef, seen from the face's side; its rows hang from a height that the pegging flags choose. Faces do not come from
//! linedefs, so the linedef is looked up on the edge of the plan below the face; where none names a texture, the sector's
//! or the map's most common one is taken.

use super::label::LabelledPlan;
use super::pattern;
use super::solid::{Air, Faces, Part, Surface};
use crate::doom_map::{DoomMap, Name, Sector, SideDef};
use crate::wad::Textures;
use crate::wad::textures::FLAT_SIDE;
use glam::Vec2;
use nbp_env::scene::{Appearance, Image, Paint};
use std::collections::{BTreeMap, BTreeSet};

/// Linedef flags: upper textures hang from the ceiling, lower and middle ones stand on the floor.
const UNPEG_TOP: u16 = 8;
const UNPEG_BOTTOM: u16 = 16;

/// Most texels of all images of a map; real maps have a tenth of it. Past it, names share the images that are there.
const MAX_TEXELS: usize = 1 << 25;

/// Where no sky texture gives another.
const SKY: [u8; 3] = [112, 146, 190];

/// What the faces were made from.
pub(super) struct Site<'a> {
    pub(super) map: &'a DoomMap,
    pub(super) labelled: &'a LabelledPlan,
    /// Floor and ceiling of every sector, opened.
    pub(super) heights: &'a [(i32, i32)],
    /// Of every triangle of the plan.
    pub(super) air: &'a [Air],
}

/// What a surface shows.
#[derive(Clone, Copy)]
enum Skin {
    Sky,
    Flat(u32),
    Wall {
        image: u32,
        /// Columns count from here, in this direction.
        start: [f64; 2],
        along: [f64; 2],
        /// Column at the start, and height of the first row.
        column: f64,
        top: f64,
    },
}

/// Paints for all faces, and what was wrong with textures, in words. Without textures, drawn tiles stand in.
pub(super) fn paint(site: &Site<'_>, faces: &Faces, textures: Option<&Textures>) -> (Appearance, Vec<String>) {
    let images =
        Images { textures, made: Vec::new(), texels: 0, number_of: BTreeMap::new(), problems: BTreeSet::new() };
    let mut painter = Painter { site, common: Common::new(site.map), images };
    let sky = textures.and_then(|textures| sky_colour(&textures.wall(Name::of("SKY1")).ok()?)).unwrap_or(SKY);
    let mut paints = Vec::with_capacity(faces.triangles.len());
    let mut last = None;
    for (triangle, &surface) in faces.triangles.iter().zip(&faces.surfaces) {
        let skin = match last {
            Some((known, skin)) if known == surface => skin,
            _ => painter.skin(surface),
        };
        last = Some((surface, skin));
        let corners = triangle.map(|v| faces.vertices[v as usize]);
        paints.push(match skin {
            Skin::Sky => Paint::Corners([sky; 3]),
            Skin::Flat(image) => {
                let side = FLAT_SIDE as f64;
                Paint::Image {
                    image,
                    corners: corners.map(|[x, y, _]| Vec2::new((x / side) as f32, (y / side) as f32)),
                }
            }
            Skin::Wall { image, start, along, column, top } => {
                let size = &painter.images.made[image as usize];
                let uv = |[x, y, height]: [f64; 3]| {
                    let column = column + (x - start[0]) * along[0] + (y - start[1]) * along[1];
                    Vec2::new((column / size.width as f64) as f32, ((height - top) / size.height as f64) as f32)
                };
                Paint::Image { image, corners: corners.map(uv) }
            }
        });
    }
    (Appearance { images: painter.images.made, paints }, painter.images.problems.into_iter().collect())
}

/// Images in use, by flat or wall texture and name.
struct Images<'a> {
    textures: Option<&'a Textures>,
    made: Vec<Image>,
    /// Of all that are made.
    texels: usize,
    number_of: BTreeMap<(bool, Name), u32>,
    problems: BTreeSet<String>,
}

impl Images<'_> {
    fn number(&mut self, name: Name, is_flat: bool) -> u32 {
        if let Some(&number) = self.number_of.get(&(is_flat, name)) {
            return number;
        }
        let found = self.textures.filter(|_| is_named(name)).and_then(|textures| {
            let found = if is_flat { textures.flat(name) } else { textures.wall(name) };
            found.map_err(|error| self.problems.insert(error.to_string())).ok()
        });
        let room = MAX_TEXELS.saturating_sub(self.texels);
        let found = found.filter(|image| {
            image.pixels.len() <= room || {
                self.problems
                    .insert(format!("{name} is left out: the map's textures have more than {MAX_TEXELS} texels"));
                false
            }
        });
        let number = if found.is_none() && room < pattern::TEXELS && !self.made.is_empty() {
            pattern::hash(name, is_flat) % self.made.len() as u32
        } else {
            let image = found.unwrap_or_else(|| pattern::tile(name, is_flat));
            self.texels += image.pixels.len();
            self.made.push(image);
            self.made.len() as u32 - 1
        };
        self.number_of.insert((is_flat, name), number);
        number
    }
}

struct Painter<'a> {
    site: &'a Site<'a>,
    common: Common,
    images: Images<'a>,
}

impl Painter<'_> {
    fn skin(&mut self, surface: Surface) -> Skin {
        let sector = |triangle: u32| {
            let sector = self.site.labelled.sector[triangle as usize]?;
            Some((sector, self.site.map.sectors.get(sector as usize)?))
        };
        let is_sky = |triangle: u32| sector(triangle).is_some_and(|(_, sector)| sector.is_sky);
        let flat = |triangle: u32, of: fn(&Sector) -> Name| sector(triangle).map_or(Name::NONE, |(_, s)| of(s));
        match surface {
            Surface::Floor(triangle) => Skin::Flat(self.images.number(flat(triangle, |s| s.floor_flat), true)),
            Surface::Ceiling(triangle) if is_sky(triangle) => Skin::Sky,
            Surface::Ceiling(triangle) => Skin::Flat(self.images.number(flat(triangle, |s| s.ceiling_flat), true)),
            Surface::Wall { triangle, edge, part } => {
                let beyond = self.site.labelled.plan.neighbours[triangle as usize][edge as usize];
                if part == Part::Upper && is_sky(triangle) && beyond.is_some_and(is_sky) {
                    return Skin::Sky;
                }
                let [here, beyond] =
                    [Some(triangle), beyond].map(|triangle| sector(triangle?).map(|(number, _)| number));
                self.wall(triangle as usize, edge as usize, part, here, beyond)
            }
        }
    }

    fn wall(&mut self, triangle: usize, edge: usize, part: Part, here: Option<u32>, beyond: Option<u32>) -> Skin {
        let site = self.site;
        let (floor, ceiling) = site.air[triangle].unwrap_or_default();
        let beyond = beyond.and_then(|sector| site.heights.get(sector as usize).copied());
        // Against a closed sector the face is the step up to it or what hangs down from it.
        let part = match (part, beyond) {
            (Part::Whole, Some((step, _))) if step >= ceiling => Part::Lower,
            (Part::Whole, Some(_)) => Part::Upper,
            _ => part,
        };
        let plan = &site.labelled.plan;
        let ends = plan.edge(triangle, edge).map(|v| plan.points[v as usize]);
        let lines = || plan.segments_on(triangle, edge).iter().filter_map(|&line| seen(site.map, line, ends));
        let of_part = |side: Option<&SideDef>| side.and_then(|side| texture(side, part));
        let of_any =
            |side: Option<&SideDef>| [Part::Upper, Part::Lower].into_iter().find_map(|part| texture(side?, part));
        type Find<'f> = &'f dyn Fn(&Line<'_>) -> Option<Name>;
        let names: [Find<'_>; 4] = [&|l| of_part(l.near), &|l| of_any(l.near), &|l| of_part(l.far), &|l| of_any(l.far)];
        let chosen = names.iter().find_map(|name| lines().find_map(|line| Some((name(&line)?, line))));
        let (name, line) = match chosen {
            Some((name, line)) => (name, Some(line)),
            None => (self.common.of(here), lines().next()),
        };
        let image = self.images.number(name, false);
        let rows = self.images.made[image as usize].height as f64;
        let flags = line.as_ref().map_or(0, |line| line.flags);
        let [floor, ceiling] = [floor, ceiling].map(f64::from);
        let top = match (part, beyond) {
            (Part::Whole, _) if flags & UNPEG_BOTTOM != 0 => floor + rows,
            (Part::Lower, Some((step, _))) if flags & UNPEG_BOTTOM == 0 => f64::from(step),
            (Part::Upper, Some((_, lintel))) if flags & UNPEG_TOP == 0 => f64::from(lintel) + rows,
            _ => ceiling,
        };
        let (start, to) = line.as_ref().map_or((ends[0], ends[1]), |line| (line.start, line.end));
        let length = (to[0] - start[0]).hypot(to[1] - start[1]).max(f64::MIN_POSITIVE);
        let along = [0, 1].map(|axis| (to[axis] - start[axis]) / length);
        let [column, down] = line.and_then(|line| line.near).map_or([0; 2], |side| side.offset).map(f64::from);
        Skin::Wall { image, start, along, column, top: top + down }
    }
}

/// A linedef seen from the left of an edge that lies on it.
fn seen(map: &DoomMap, line: u32, [a, b]: [[f64; 2]; 2]) -> Option<Line<'_>> {
    let line = map.linedefs.get(line as usize)?;
    let corner = |v: u32| map.vertices.get(v as usize).map(|v| [f64::from(v.x), f64::from(v.y)]);
    let [from, to] = [corner(line.from)?, corner(line.to)?];
    let side = |side: Option<u32>| map.sidedefs.get(side? as usize);
    let is_back = (to[0] - from[0]) * (b[0] - a[0]) + (to[1] - from[1]) * (b[1] - a[1]) > 0.0;
    Some(if is_back {
        Line { flags: line.flags, start: to, end: from, near: side(line.back), far: side(line.front) }
    } else {
        Line { flags: line.flags, start: from, end: to, near: side(line.front), far: side(line.back) }
    })
}

struct Line<'a> {
    flags: u16,
    /// Left and right end, seen from the near side.
    start: [f64; 2],
    end: [f64; 2],
    near: Option<&'a SideDef>,
    far: Option<&'a SideDef>,
}

fn is_named(name: Name) -> bool {
    name != Name::NONE && name != Name::default()
}

fn texture(side: &SideDef, part: Part) -> Option<Name> {
    let name = match part {
        Part::Whole => side.middle,
        Part::Lower => side.lower,
        Part::Upper => side.upper,
    };
    Some(name).filter(|&name| is_named(name))
}

/// The wall textures with the greatest length, of each sector and of the map.
struct Common {
    of_sector: BTreeMap<u32, Name>,
    of_map: Name,
}

impl Common {
    fn new(map: &DoomMap) -> Self {
        let mut lengths: BTreeMap<(Option<u32>, Name), f64> = BTreeMap::new();
        for line in &map.linedefs {
            let corner = |v: u32| map.vertices.get(v as usize).map_or([0.0; 2], |v| [v.x, v.y].map(f64::from));
            let [a, b] = [corner(line.from), corner(line.to)];
            let length = (b[0] - a[0]).hypot(b[1] - a[1]);
            for side in [line.front, line.back].iter().filter_map(|side| map.sidedefs.get((*side)? as usize)) {
                // The middle of a two-sided line is a grating.
                let parts = if line.back.is_some() { [Part::Lower, Part::Upper] } else { [Part::Whole, Part::Whole] };
                let names: BTreeSet<Name> = parts.iter().filter_map(|&part| texture(side, part)).collect();
                for (name, sector) in names.into_iter().flat_map(|name| [(name, Some(side.sector)), (name, None)]) {
                    *lengths.entry((sector, name)).or_default() += length;
                }
            }
        }
        let mut longest: BTreeMap<Option<u32>, (f64, Name)> = BTreeMap::new();
        for ((sector, name), length) in lengths {
            let best = longest.entry(sector).or_insert((length, name));
            if length > best.0 {
                *best = (length, name);
            }
        }
        let of_map = longest.get(&None).map_or(Name::NONE, |&(_, name)| name);
        let of_sector = longest.into_iter().filter_map(|(sector, (_, name))| Some((sector?, name)));
        Self { of_sector: of_sector.collect(), of_map }
    }

    fn of(&self, sector: Option<u32>) -> Name {
        sector.and_then(|sector| self.of_sector.get(&sector)).copied().unwrap_or(self.of_map)
    }
}

/// Mean of a sky's upper half.
fn sky_colour(image: &Image) -> Option<[u8; 3]> {
    let upper = image.pixels.get(..image.width * (image.height / 2)).filter(|upper| !upper.is_empty())?;
    Some([0, 1, 2].map(|n| (upper.iter().map(|texel| usize::from(texel[n])).sum::<usize>() / upper.len()) as u8))
}

#[cfg(test)]
mod tests {
    use super::super::{ConvertOptions, SceneBundle, convert};
    use super::*;
    use glam::Vec3;

    /// Texture coordinates of the corners of painted faces, in texels of the drawn tiles.
    fn corners(scene: &SceneBundle) -> Vec<[(Vec3, Vec2); 3]> {
        let appearance = scene.mesh.appearance().unwrap();
        let of_face = |(paint, corners): (&Paint, [Vec3; 3])| match paint {
            Paint::Image { corners: uv, .. } => Some([0, 1, 2].map(|n| (corners[n], uv[n] * 64.0))),
            Paint::Corners(_) => None,
        };
        appearance.paints.iter().zip(scene.mesh.iter_corners()).filter_map(of_face).collect()
    }

    /// Rise of a value over a face, by the corners' positions and values.
    fn rise(face: &[(Vec3, Vec2); 3], value: fn(Vec2) -> f32, direction: Vec3) -> f32 {
        let [a, b, c] = face.map(|(p, _)| p);
        let normal = (b - a).cross(c - a);
        let gradient = (value(face[1].1 - face[0].1) * (c - a).cross(normal)
            - value(face[2].1 - face[0].1) * (b - a).cross(normal))
            / normal.length_squared();
        gradient.dot(direction)
    }

    #[test]
    fn textures_are_upright_and_read_from_left_to_right() {
        let (mut map, door) = DoomMap::with_door();
        map.sectors[door as usize].special = 14;
        let scene = convert(&map, ConvertOptions::default()).unwrap();
        let faces = corners(&scene);
        assert_eq!(faces.len(), scene.mesh.triangles().len());
        for face in &faces {
            let [a, b, c] = face.map(|(p, _)| p);
            let normal = (b - a).cross(c - a).normalize();
            let (right, up) = if normal.y.abs() < 0.5 {
                // Seen from the free side.
                ((-normal).cross(Vec3::Y), Vec3::Y)
            } else {
                (Vec3::NEG_X, Vec3::Z)
            };
            let [u, v] = [rise(face, |t| t.x, right), rise(face, |t| t.y, up)];
            // 50 texels a metre along, and 41.67 up.
            let want = if normal.y.abs() < 0.5 { [50.0, 50.0 / 1.2] } else { [50.0; 2] };
            assert!((u - want[0]).abs() < 0.01 && (v - want[1]).abs() < 0.01, "{face:?}: {u}, {v}");
        }
    }

    #[test]
    fn pegs_and_offsets_hang_textures() {
        // Two rooms with floors at 0 and 40 and ceilings at 200 and 150; the line between them runs north at x = 400.
        let mut map = DoomMap { name: "pegs".into(), ..DoomMap::default() };
        let (left, right) = (map.sector(0, 200), map.sector(40, 150));
        map.walls(&[[400, 400], [0, 400], [0, 0], [400, 0]], left);
        map.walls(&[[400, 0], [800, 0], [800, 400], [400, 400]], right);
        map.line([400, 0], [400, 400], Some(right), Some(left));
        let wall = Name::of("WALL");
        map.sidedefs.iter_mut().for_each(|s| (s.upper, s.lower, s.middle, s.offset) = (wall, wall, wall, [5, 3]));
        let rows_at = |flags: u16| {
            let mut map = map.clone();
            map.linedefs.iter_mut().for_each(|line| line.flags = flags);
            let scene = convert(&map, ConvertOptions::default()).unwrap();
            let [x, z] = scene.report.origin;
            let faces = corners(&scene);
            // Height and columns in map units, back from metres.
            let place = |p: Vec3| [x as f32 - p.x * 50.0, z as f32 + p.z * 50.0, p.y / 1.2 * 50.0].map(f32::round);
            let at = |want: [f32; 3], is_face: &dyn Fn([[f32; 3]; 3]) -> bool| {
                let face = faces
                    .iter()
                    .find(|f| is_face(f.map(|(p, _)| place(p))) && f.iter().any(|(p, _)| place(*p) == want));
                let (_, uv) = face.unwrap().iter().find(|(p, _)| place(*p) == want).copied().unwrap();
                // Columns from the left, rows from the top.
                [uv.x, -uv.y].map(f32::round)
            };
            let within = |low: f32, high: f32| {
                move |face: [[f32; 3]; 3]| face.iter().all(|p| p[0] == 400.0 && (low..=high).contains(&p[2]))
            };
            let west = |face: [[f32; 3]; 3]| face.iter().all(|p| p[0] == 0.0);
            // Seen from the left room, columns start at the line's north end.
            [
                at([400.0, 400.0, 40.0], &within(0.0, 40.0)),
                at([400.0, 400.0, 150.0], &within(150.0, 200.0)),
                at([0.0, 0.0, 200.0], &west),
            ]
        };
        assert_eq!(
            rows_at(0),
            [[5.0, 3.0], [5.0, 67.0], [5.0, 3.0]],
            "under the step, over the lintel, under the ceiling"
        );
        let [lower, upper, whole] = rows_at(UNPEG_TOP | UNPEG_BOTTOM);
        assert_eq!((lower, upper), ([5.0, 163.0], [5.0, 53.0]), "both from the ceiling");
        assert_eq!(whole, [5.0, 3.0 + 64.0 - 200.0], "a tile ends on the floor");
    }

    #[test]
    fn names_without_end_share_tiles() {
        let texels = MAX_TEXELS - 2 * pattern::TEXELS;
        let mut images =
            Images { textures: None, made: Vec::new(), texels, number_of: BTreeMap::new(), problems: BTreeSet::new() };
        let numbers: BTreeSet<u32> = (0..99).map(|n| images.number(Name::of(&format!("N{n}")), true)).collect();
        assert_eq!((images.made.len(), images.texels, numbers), (2, MAX_TEXELS, [0, 1].into()));
    }

    #[test]
    fn faces_without_a_texture_take_a_neighbours_and_the_sky_is_plain() {
        let (mut map, door) = DoomMap::with_door();
        map.sectors[door as usize].special = 14;
        let wall = Name::of("WALL");
        map.sidedefs[0].middle = wall;
        map.sectors.iter_mut().for_each(|s| (s.floor_flat, s.ceiling_flat) = (wall, wall));
        map.sectors[1].is_sky = true;
        let scene = convert(&map, ConvertOptions::default()).unwrap();
        let appearance = scene.mesh.appearance().unwrap();
        assert_eq!(appearance.images, [pattern::tile(wall, true), pattern::tile(wall, false)]);
        let painted = appearance.paints.iter().zip(scene.mesh.iter_corners());
        let sky: Vec<_> = painted.filter(|(paint, _)| matches!(paint, Paint::Corners(_))).collect();
        assert!(sky.len() >= 2);
        assert!(sky.iter().all(|(paint, _)| **paint == Paint::Corners([SKY; 3])));
        assert!(sky.iter().all(|(_, corners)| corners.iter().all(|c| c.x <= 0.0)), "the eastern room only");
    }
}
