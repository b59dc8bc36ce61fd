//! Doors opened, lifts and floors lowered: the heights that a player can make.

use crate::doom_map::{DoomMap, LineDef};
use std::collections::{BTreeMap, BTreeSet};

/// An open door hangs this far below the lowest ceiling next to it.
const DOOR_GAP: i32 = 4;

/// Sector type "opens five minutes after the start".
const SECTOR_OPENS_LATE: u16 = 14;

/// What a linedef special does to a sector, as far as it frees space.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Effect {
    OpenDoor,
    LowerFloor,
}

/// Where a special works.
#[derive(Clone, Copy, PartialEq, Eq)]
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
    let (doors, floors) = targets(map);
    let neighbours = neighbours(map);
    let around = |sector: usize| neighbours.get(sector).into_iter().flatten().map(|&n| n as usize);
    let mut lifts = 0;
    for &sector in &floors {
        let lowest = around(sector).map(|n| map.sectors[n].floor).min();
        if let Some(floor) = lowest.filter(|&floor| floor < heights[sector].0) {
            heights[sector].0 = floor;
            lifts += 1;
        }
    }
    let mut opened = 0;
    for &door in &doors {
        // A door cut into several sectors rises as one: its closed parts are no measure for each other.
        let outside = around(door).filter(|n| !doors.contains(n)).map(|n| map.sectors[n].ceiling).min();
        let lowest = outside.or_else(|| around(door).map(|n| map.sectors[n].ceiling).max());
        if let Some(ceiling) = lowest.map(|c| c - DOOR_GAP).filter(|&c| c > heights[door].1) {
            heights[door].1 = ceiling;
            opened += 1;
        }
    }
    OpenHeights { heights, doors: opened, lifts }
}

fn targets(map: &DoomMap) -> (BTreeSet<usize>, BTreeSet<usize>) {
    let mut tagged: BTreeMap<u16, Vec<usize>> = BTreeMap::new();
    for (index, sector) in map.sectors.iter().enumerate() {
        tagged.entry(sector.tag).or_default().push(index);
    }
    let (mut doors, mut floors) = (BTreeSet::new(), BTreeSet::new());
    let mut pulled = BTreeSet::new();
    for line in &map.linedefs {
        let Some((effect, target)) = effect(line.special) else { continue };
        let is_door = effect == Effect::OpenDoor;
        let set = if is_door { &mut doors } else { &mut floors };
        match target {
            Target::Back => set.extend(map.sector_of(line.back).map(|s| s as usize)),
            // Tag 0 means "every sector without a tag": a slip of the map's author, which the game ignores for doors.
            Target::Tag if line.tag == 0 || !pulled.insert((is_door, line.tag)) => {}
            Target::Tag => set.extend(tagged.get(&line.tag).into_iter().flatten()),
        }
    }
    doors
        .extend(map.sectors.iter().enumerate().filter(|(_, s)| s.special == SECTOR_OPENS_LATE).map(|(index, _)| index));
    (doors, floors)
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

/// Line specials of Doom 2 and Boom's generalized ranges that open a way.
fn effect(special: u16) -> Option<(Effect, Target)> {
    use Effect::{LowerFloor, OpenDoor};
    let generalized = |effect| Some((effect, if special & 6 == 6 { Target::Back } else { Target::Tag }));
    match special {
        1 | 26..=28 | 31..=34 | 117 | 118 => Some((OpenDoor, Target::Back)),
        2
        | 4
        | 16
        | 29
        | 46
        | 61
        | 63
        | 76
        | 86
        | 90
        | 99
        | 103
        | 105
        | 106
        | 108
        | 109
        | 111
        | 112
        | 114
        | 115
        | 133..=137
        | 175
        | 196 => Some((OpenDoor, Target::Tag)),
        10 | 19 | 21 | 23 | 36..=38 | 45 | 60 | 62 | 70 | 71 | 82..=84 | 88 | 98 | 102 | 120..=123 => {
            Some((LowerFloor, Target::Tag))
        }
        0x3400..=0x37ff => generalized(LowerFloor),
        0x3800..=0x3bff => generalized(OpenDoor),
        // Kind 3 of a generalized door closes it.
        0x3c00..=0x3fff if special & 0x60 != 0x60 => generalized(OpenDoor),
        // Bit 6 of a generalized floor means upwards.
        0x6000..=0x7fff if special & 0x40 == 0 => generalized(LowerFloor),
        _ => None,
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
        assert!(matches!(effect(0x6000), Some((Effect::LowerFloor, Target::Tag))));
        assert!(effect(0x6040).is_none(), "a floor that rises");
        assert!(effect(0).is_none());
    }
}
