//! The structure that the WAD reader and the generator share: vertices, linedefs, sidedefs, sectors, things.
//!
//! Units are Doom's: whole map units, `x` to the right and `y` up on the map, heights upwards. 50 units are 1 m along
//! the ground and 41.67 units are 1 m of height.

use std::fmt::{self, Write as _};

/// Map units in a metre along the ground.
pub const UNITS_PER_METRE: f64 = 50.0;

/// Map units in a metre of height: the published maps stretch heights by 1.2.
pub const HEIGHT_UNITS_PER_METRE: f64 = UNITS_PER_METRE / 1.2;

/// Height of the camera above the modal floor, map units (1.65 m).
pub const CAMERA_UNITS: f64 = 68.75;

/// Distance of neighbouring lattice nodes, map units (1.5 m).
pub const LATTICE_UNITS: f64 = 75.0;

/// Name of a texture, a flat or a lump: up to eight bytes, upper case.
#[derive(Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Name([u8; 8]);

impl Name {
    /// "No texture": nothing is drawn there.
    pub const NONE: Self = Self::of("-");

    /// The name in a text, cut to eight bytes.
    pub const fn of(text: &str) -> Self {
        let bytes = text.as_bytes();
        let (mut name, mut at) = ([0; 8], 0);
        while at < bytes.len() && at < 8 {
            name[at] = bytes[at].to_ascii_uppercase();
            at += 1;
        }
        Self(name)
    }

    /// The name in a record: what follows a zero byte is dropped.
    pub fn from_record(record: &[u8]) -> Self {
        let mut name = [0; 8];
        for (to, from) in name.iter_mut().zip(record.iter().take_while(|&&b| b != 0)) {
            *to = from.to_ascii_uppercase();
        }
        Self(name)
    }

    /// As in a record, padded with zeros.
    pub fn bytes(&self) -> &[u8; 8] {
        &self.0
    }
}

impl fmt::Display for Name {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let text = self.0.iter().take_while(|&&b| b != 0);
        text.flat_map(|b| b.escape_ascii()).try_for_each(|b| f.write_char(b.into()))
    }
}

impl fmt::Debug for Name {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}", self.to_string())
    }
}

/// One map.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct DoomMap {
    /// Name of the scene it becomes.
    pub name: String,
    /// Corners of the plan.
    pub vertices: Vec<Vertex>,
    /// Lines of the plan.
    pub linedefs: Vec<LineDef>,
    /// Sides of lines.
    pub sidedefs: Vec<SideDef>,
    /// Rooms, steps, doors: areas with one floor and one ceiling.
    pub sectors: Vec<Sector>,
    /// Player starts, items, monsters. Not part of the mesh.
    pub things: Vec<Thing>,
}

/// A corner of the plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Vertex {
    /// To the right.
    pub x: i32,
    /// Up on the map.
    pub y: i32,
}

/// A line from one vertex to another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LineDef {
    /// Index of the first vertex.
    pub from: u32,
    /// Index of the second vertex.
    pub to: u32,
    /// Bit 2 (value 4) marks two-sided lines.
    pub flags: u16,
    /// What happens when it is used, crossed or shot.
    pub special: u16,
    /// Sectors on which the special works.
    pub tag: u16,
    /// Side to the right of the direction `from → to`.
    pub front: Option<u32>,
    /// Side to the left.
    pub back: Option<u32>,
}

/// One side of a line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SideDef {
    /// Index of the sector on this side.
    pub sector: u32,
    /// Texels by which the textures are moved to the left and up.
    pub offset: [i16; 2],
    /// Texture above an opening.
    pub upper: Name,
    /// Texture below an opening.
    pub lower: Name,
    /// Texture of a wall without an opening, or in it.
    pub middle: Name,
}

/// An area with one floor and one ceiling.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sector {
    /// Height of the floor.
    pub floor: i32,
    /// Height of the ceiling; at or below the floor for a closed door.
    pub ceiling: i32,
    /// Whether the ceiling shows the sky, which its flat's name tells. The mesh is closed there all the same.
    pub is_sky: bool,
    /// Sector type (14 is a door that opens by itself).
    pub special: u16,
    /// Name that linedef specials use.
    pub tag: u16,
    /// Flat on the floor.
    pub floor_flat: Name,
    /// Flat on the ceiling.
    pub ceiling_flat: Name,
    /// Brightness, 0 to 255.
    pub light: u16,
}

/// A thing on the map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Thing {
    /// To the right.
    pub x: i32,
    /// Up on the map.
    pub y: i32,
    /// Facing, degrees from east, counter-clockwise.
    pub angle: u16,
    /// 1 is the first player's start.
    pub kind: u16,
    /// Difficulty flags.
    pub flags: u16,
}

impl DoomMap {
    /// Sector of a side, if the line has that side and every index is valid.
    pub fn sector_of(&self, side: Option<u32>) -> Option<u32> {
        let side = self.sidedefs.get(side? as usize)?;
        ((side.sector as usize) < self.sectors.len()).then_some(side.sector)
    }
}

#[cfg(test)]
pub(crate) mod build {
    //! Small maps for tests.

    use super::*;

    impl DoomMap {
        /// Adds a sector and names it.
        pub(crate) fn sector(&mut self, floor: i32, ceiling: i32) -> u32 {
            self.sectors.push(Sector { floor, ceiling, ..Sector::default() });
            self.sectors.len() as u32 - 1
        }

        /// Adds a line with the sectors to its right and left, and hands it out for changes.
        pub(crate) fn line(&mut self, a: [i32; 2], b: [i32; 2], right: Option<u32>, left: Option<u32>) -> &mut LineDef {
            let [from, to] = [a, b].map(|[x, y]| {
                let known = self.vertices.iter().position(|v| (v.x, v.y) == (x, y));
                known.unwrap_or_else(|| {
                    self.vertices.push(Vertex { x, y });
                    self.vertices.len() - 1
                }) as u32
            });
            let [front, back] = [right, left].map(|sector| {
                sector.map(|sector| {
                    self.sidedefs.push(SideDef { sector, ..SideDef::default() });
                    self.sidedefs.len() as u32 - 1
                })
            });
            let line = LineDef { from, to, flags: 0, special: 0, tag: 0, front, back };
            self.linedefs.push(line);
            let last = self.linedefs.len() - 1;
            &mut self.linedefs[last]
        }

        /// Adds one-sided lines around a counter-clockwise outline, from its first to its last corner.
        pub(crate) fn walls(&mut self, outline: &[[i32; 2]], inside: u32) {
            for pair in outline.windows(2) {
                // The inside lies to the left of the outline, hence to the right of its lines.
                self.line(pair[1], pair[0], Some(inside), None);
            }
        }

        /// Two rooms of 400×400 units, floor 0 and ceilings 128 and 160, with a closed door sector (number 2) between
        /// them that is 32 deep and 100 wide.
        pub(crate) fn with_door() -> (Self, u32) {
            let mut map = Self { name: "door".into(), ..Self::default() };
            let (left, right, door) = (map.sector(0, 128), map.sector(0, 160), map.sector(0, 0));
            map.walls(&[[400, 250], [400, 400], [0, 400], [0, 0], [400, 0], [400, 150]], left);
            map.walls(&[[432, 150], [432, 0], [832, 0], [832, 400], [432, 400], [432, 250]], right);
            map.walls(&[[400, 150], [432, 150]], door);
            map.walls(&[[432, 250], [400, 250]], door);
            map.line([400, 150], [400, 250], Some(door), Some(left));
            map.line([432, 250], [432, 150], Some(door), Some(right));
            (map, door)
        }
    }
}
