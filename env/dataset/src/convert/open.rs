//! Doors opened, lifts and floors lowered: the heights that a player can make.
//!
//! Whatever a player can trigger counts as triggered. What closes, rises or crushes is left as it was: stairs and bridges
//! that would rise, crushers, doors that shut. Types are those of Doom 2 and Boom ("Boom reference", sections 6 to 15).

use crate::doom_map::{DoomMap, LineDef};
use std::collections::{BTreeMap, BTreeSet};

/// An open door hangs this far below the lowest ceiling next to it.
const DOOR_GAP: i32 = 4;

/// Sector type "opens five minutes after the start".
const SECTOR_OPENS_LATE: u16 = 14;

/// Sectors with this tag open or sink when the last boss dies.
const BOSS_TAG: u16 = 666;

/// Sectors that are looked at around the ring of a donut, for maps made to be slow.
const MAX_RING: usize = 256;

/// What a linedef special does to a sector, as far as it frees space.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Effect {
    OpenDoor,
    Floor(Level),
    Ceiling(Level),
    /// Floor and ceiling go up and down together, between the lowest and the highest floor around.
    Elevator,
    /// A pillar sinks to the level outside of the ring around it.
    Donut,
}

/// Where a floor sinks to, or a ceiling rises to, among those of the neighbours.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Level {
    Lowest,
    Highest,
    /// Eight units above the highest floor.
    AboveHighest,
    /// The nearest that differs.
    Next,
    By(i32),
}

/// Where a special works.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Target {
    /// The sector behind the line.
    Back,
    /// All sectors with the line's tag.
    Tag,
}

/// Floor and ceiling of every sector after everything has been opened.
#[derive(Debug, Clone)]
pub struct OpenHeights {
    /// `(floor, ceiling)`, map units, for each sector.
    pub heights: Vec<(i32, i32)>,
    /// Sectors whose ceiling was raised.
    pub doors: usize,
    /// Sectors whose floor was lowered.
    pub lifts: usize,
}

/// Opens what opens.
pub fn open_heights(map: &DoomMap) -> OpenHeights {
    let mut heights: Vec<(i32, i32)> = map.sectors.iter().map(|s| (s.floor, s.ceiling)).collect();
    let effects = effects(map);
    let doors: BTreeSet<usize> =
        effects.iter().filter(|(_, e)| *e == Effect::OpenDoor).map(|(sector, _)| *sector).collect();
    let neighbours = neighbours(map);
    for &(sector, effect) in &effects {
        let around = || neighbours[sector].iter().map(|&n| &map.sectors[n as usize]);
        let here = &map.sectors[sector];
        let (floor, ceiling) = match effect {
            Effect::OpenDoor => {
                // A door cut into several sectors rises as one: its closed parts are no measure for each other.
                let outside = neighbours[sector].iter().filter(|&&n| !doors.contains(&(n as usize)));
                let lowest = outside.map(|&n| map.sectors[n as usize].ceiling).min();
                let lowest = lowest.or_else(|| around().map(|s| s.ceiling).max());
                (None, lowest.map(|ceiling| ceiling - DOOR_GAP))
            }
            Effect::Floor(level) => (level.of(here.floor, -1, around().map(|s| s.floor)), None),
            Effect::Ceiling(level) => (None, level.of(here.ceiling, 1, around().map(|s| s.ceiling))),
            Effect::Elevator => {
                let rise = around().map(|s| s.floor - here.floor).max();
                (around().map(|s| s.floor).min(), rise.map(|rise| here.ceiling + rise))
            }
            Effect::Donut => {
                let ring = neighbours[sector].iter().flat_map(|&ring| &neighbours[ring as usize]).take(MAX_RING);
                let outside = ring.filter(|&&n| n as usize != sector && !neighbours[sector].contains(&n));
                (outside.map(|&n| map.sectors[n as usize].floor).min(), None)
            }
        };
        let height = &mut heights[sector];
        *height = (height.0.min(floor.unwrap_or(height.0)), height.1.max(ceiling.unwrap_or(height.1)));
    }
    let changed = |is: fn((i32, i32), (i32, i32)) -> bool| {
        heights.iter().zip(&map.sectors).filter(|(now, s)| is(**now, (s.floor, s.ceiling))).count()
    };
    let (doors, lifts) = (changed(|now, then| now.1 > then.1), changed(|now, then| now.0 < then.0));
    OpenHeights { heights, doors, lifts }
}

impl Level {
    /// The height reached from `here`, up (`sign` 1) or down (-1); of no use where it lies the other way.
    fn of(self, here: i32, sign: i32, around: impl Iterator<Item = i32> + Clone) -> Option<i32> {
        match self {
            Self::Lowest => around.min(),
            Self::Highest => around.max(),
            Self::AboveHighest => around.max().map(|height| height + 8),
            Self::Next => {
                around.filter(|&height| (height - here) * sign > 0).min_by_key(|height| height.abs_diff(here))
            }
            Self::By(step) => Some(here + sign * step),
        }
    }
}

/// What happens to which sectors, each pair once, in order.
fn effects(map: &DoomMap) -> BTreeSet<(usize, Effect)> {
    let mut tagged: BTreeMap<u16, Vec<usize>> = BTreeMap::new();
    for (index, sector) in map.sectors.iter().enumerate() {
        tagged.entry(sector.tag).or_default().push(index);
    }
    let (mut effects, mut pulled) = (BTreeSet::new(), BTreeSet::new());
    for line in &map.linedefs {
        let Some((effect, target)) = effect(line.special) else { continue };
        match target {
            Target::Back => effects.extend(map.sector_of(line.back).map(|s| (s as usize, effect))),
            // Tag 0 means "every sector without a tag": a slip of the map's author, which the game ignores for doors.
            Target::Tag if line.tag == 0 || !pulled.insert((effect, line.tag)) => {}
            Target::Tag => effects.extend(tagged.get(&line.tag).into_iter().flatten().map(|&s| (s, effect))),
        }
    }
    let late = map.sectors.iter().enumerate().filter(|(_, s)| s.special == SECTOR_OPENS_LATE);
    effects.extend(late.map(|(index, _)| (index, Effect::OpenDoor)));
    if !map.linedefs.iter().any(|line| line.tag == BOSS_TAG) {
        let is_closed = |s: usize| map.sectors[s].ceiling <= map.sectors[s].floor;
        let effect = |s: usize| if is_closed(s) { Effect::OpenDoor } else { Effect::Floor(Level::Lowest) };
        effects.extend(tagged.get(&BOSS_TAG).into_iter().flatten().map(|&s| (s, effect(s))));
    }
    effects
}

/// Sectors on the other side of each sector's two-sided lines.
fn neighbours(map: &DoomMap) -> Vec<BTreeSet<u32>> {
    let mut neighbours = vec![BTreeSet::new(); map.sectors.len()];
    let pair = |line: &LineDef| Some((map.sector_of(line.front)?, map.sector_of(line.back)?));
    for (a, b) in map.linedefs.iter().filter_map(pair).filter(|(a, b)| a != b) {
        neighbours[a as usize].insert(b);
        neighbours[b as usize].insert(a);
    }
    neighbours
}

/// Line specials of Doom 2, of Boom, and Boom's generalized ranges that open a way.
fn effect(special: u16) -> Option<(Effect, Target)> {
    use Effect::{Ceiling, Donut, Elevator, Floor, OpenDoor};
    use Level::{AboveHighest, By, Highest, Lowest, Next};
    let (effect, target) = match special {
        1 | 26..=28 | 31..=34 | 117 | 118 => (OpenDoor, Target::Back),
        2 | 4 | 29 | 46 | 61 | 63 | 86 | 90 | 99 | 103 | 105 | 106 | 108 | 109 | 111 | 112 | 114 | 115 | 133..=137 => {
            (OpenDoor, Target::Tag)
        }
        40 | 151 | 166 | 186 => (Ceiling(Highest), Target::Tag),
        9 | 146 | 155 | 191 => (Donut, Target::Tag),
        // Lifts, platforms without end, floors that sink.
        10 | 21 | 62 | 88 | 120..=123 | 53 | 87 | 162 | 181 | 23 | 37 | 38 | 60 | 82 | 84 | 159 | 177 => {
            (Floor(Lowest), Target::Tag)
        }
        19 | 45 | 83 | 102 => (Floor(Highest), Target::Tag),
        36 | 70 | 71 | 98 => (Floor(AboveHighest), Target::Tag),
        219..=222 => (Floor(Next), Target::Tag),
        227..=238 => (Elevator, Target::Tag),
        0x3400.. => (generalized(special)?, if special & 6 == 6 { Target::Back } else { Target::Tag }),
        _ => return None,
    };
    return Some((effect, target));

    fn generalized(special: u16) -> Option<Effect> {
        // Three bits name the goal of a floor or ceiling.
        let goal = || match special >> 7 & 7 {
            0 => Some(Highest),
            1 => Some(Lowest),
            2 => Some(Next),
            6 => Some(By(24)),
            7 => Some(By(32)),
            _ => None,
        };
        let is_up = special & 0x40 != 0;
        match special {
            // Lifts: to the lowest or the next floor around, to the lowest ceiling, or without end.
            0x3400..=0x37ff => match special >> 8 & 3 {
                0 | 3 => Some(Floor(Lowest)),
                1 => Some(Floor(Next)),
                _ => None,
            },
            // Locked doors, and doors of the two kinds that open; the other two close.
            0x3800..=0x3bff => Some(OpenDoor),
            0x3c00..=0x3fff if !is_up => Some(OpenDoor),
            0x4000..=0x5fff if is_up => goal().map(Ceiling),
            0x6000..=0x7fff if !is_up => goal().map(Floor),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn doors_open_and_lifts_sink() {
        let (mut map, door) = DoomMap::with_door();
        let heights = |map: &DoomMap| open_heights(map).heights[door as usize];
        assert_eq!(heights(&map), (0, 0), "no special, no door");
        // The front of both door lines is the door itself: a manual special opens what lies behind.
        let last = map.linedefs.len() - 1;
        map.linedefs[last].special = 1;
        assert_eq!(heights(&map), (0, 0));
        let line = &mut map.linedefs[last];
        std::mem::swap(&mut line.from, &mut line.to);
        std::mem::swap(&mut line.front, &mut line.back);
        assert_eq!(heights(&map), (0, 128 - DOOR_GAP));
        map.linedefs[last].special = 0;
        map.linedefs[0].special = 103;
        map.linedefs[0].tag = 7;
        map.sectors[door as usize].tag = 7;
        assert_eq!(heights(&map), (0, 128 - DOOR_GAP), "opened by a switch");
        map.sectors[door as usize] = crate::doom_map::Sector { floor: 96, ceiling: 128, ..map.sectors[door as usize] };
        map.linedefs[0].special = 62;
        assert_eq!(heights(&map), (0, 128), "a lift comes down");
    }

    #[test]
    fn generalized_specials() {
        assert!(matches!(effect(0x3c00), Some((Effect::OpenDoor, Target::Tag))));
        assert!(matches!(effect(0x3c06), Some((Effect::OpenDoor, Target::Back))));
        assert!(effect(0x3c60).is_none(), "a door that closes");
        assert!(effect(0x3c40).is_none(), "a door that closes for a while");
        assert_eq!(effect(0x6000), Some((Effect::Floor(Level::Highest), Target::Tag)));
        assert_eq!(effect(0x6087), Some((Effect::Floor(Level::Lowest), Target::Back)));
        assert!(effect(0x6040).is_none(), "a floor that rises");
        assert_eq!(effect(0x4340), Some((Effect::Ceiling(Level::By(24)), Target::Tag)));
        assert_eq!(effect(0x3500), Some((Effect::Floor(Level::Next), Target::Tag)));
        assert!(effect(0).is_none() && effect(0xffff).is_none());
    }

    /// Rooms in a row with floors 0, 64, 96 and 40 and ceilings 200; heights of the third after a special on it.
    #[test]
    fn floors_sink_and_ceilings_rise_to_their_goals() {
        let after = |special: u16, tag: u16| {
            let mut map = DoomMap::default();
            let rooms = [0, 64, 96, 40].map(|floor| map.sector(floor, 200 + floor));
            for (n, pair) in rooms.windows(2).enumerate() {
                let x = 100 * n as i32;
                map.line([x, 0], [x, 100], Some(pair[0]), Some(pair[1]));
            }
            map.sectors[2].tag = tag;
            map.linedefs[0].special = special;
            map.linedefs[0].tag = if special == 0 { 0 } else { tag };
            open_heights(&map).heights[2]
        };
        assert_eq!(after(38, 7), (40, 296), "to the lowest around");
        assert_eq!(after(19, 7), (64, 296), "to the highest around");
        assert_eq!(after(36, 7), (72, 296), "eight above it");
        assert_eq!(after(219, 7), (64, 296), "to the next below");
        assert_eq!(after(227, 7), (40, 296), "an elevator cannot rise here");
        assert_eq!(after(9, 7), (0, 296), "to the level beyond the ring");
        assert_eq!(after(40, 7), (96, 296), "no ceiling around is higher");
        assert_eq!(after(0, BOSS_TAG), (40, 296), "the boss dies");
        for stays in [3, 5, 7, 8, 16, 18, 20, 44, 58, 73, 76, 127, 130, 145, 175, 196, 211, 256] {
            assert_eq!(after(stays, 7), (96, 296), "type {stays} frees nothing");
        }
    }
}
