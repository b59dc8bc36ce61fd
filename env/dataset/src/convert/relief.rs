//! Walkable floors pressed into a band, so that the plane of the camera reaches what a player can walk to.
//!
//! Hand-made maps climb and sink by many metres, and a camera at one height sees a part of them only. Floors that a player
//! reaches are scaled towards their median; the other sectors move with their neighbours, and ceilings with
//! their floors, so rooms keep their shape. Where a player walks below the camera, under 56 units and more, the ceiling
//! is raised to let the camera pass.

use super::HEAD_ROOM;
use super::label::LabelledPlan;
use super::solid::Air;
use crate::doom_map::Sector;
use std::collections::{BTreeMap, BTreeSet};

/// Highest step that a player climbs, and height of a player, map units.
const STEP: i32 = 24;
const PLAYER: i32 = 56;

/// Parts from which walks are tried: as many of the largest, and at least this share of the largest one. Ledges, from which
/// a player only drops, are none.
const PARTS: usize = 8;
const PART: f64 = 0.25;

/// Half the height of the band, map units: less than the camera's 68.75 above the modal floor.
const BAND: i32 = 40;

/// Compresses the relief of what can be walked to, given sectors as they were and their heights after opening. Returns the factor on its floors' distances from their median: 1
/// where they lie in the band anyway.
pub(super) fn compress(labelled: &LabelledPlan, original: &[Sector], heights: &mut [(i32, i32)]) -> f64 {
    let floors = walkable(labelled, original, heights);
    let by_height = areas(floors.values().copied());
    let Some(median) = median(&by_height) else { return 1.0 };
    let reach = by_height.keys().map(|floor| floor.abs_diff(median)).max().unwrap_or(0);
    let factor = (f64::from(BAND) / f64::from(reach.max(1))).min(1.0);
    let pressed = |floor: i32| median + (f64::from(floor - median) * factor).round() as i32;
    let shifts = floors.iter().map(|(&sector, &(floor, _))| (sector, f64::from(pressed(floor) - floor))).collect();
    for (sector, shift) in hang(labelled, shifts) {
        if let Some((floor, ceiling)) = heights.get_mut(sector as usize) {
            let shift = shift.round() as i32;
            (*floor, *ceiling) = (*floor + shift, *ceiling + shift);
        }
    }
    let pressed = areas(floors.values().map(|&(floor, area)| (pressed(floor), area)));
    let modal = pressed.iter().rev().max_by(|a, b| a.1.total_cmp(b.1)).map_or(median, |(&floor, _)| floor);
    for &sector in floors.keys() {
        if let Some((_, ceiling)) = heights.get_mut(sector as usize) {
            *ceiling = (*ceiling).max(modal + HEAD_ROOM);
        }
    }
    factor
}

/// Area at each height.
fn areas(floors: impl Iterator<Item = (i32, f64)>) -> BTreeMap<i32, f64> {
    let mut areas = BTreeMap::new();
    floors.for_each(|(floor, area)| *areas.entry(floor).or_insert(0.0) += area);
    areas
}

/// Floor and area of each sector that a player reaches: by steps up, by drops of any height, and by lifts, which take
/// whoever stands on them to where they were. It starts from that one of the largest parts, each to be walked through both
/// ways, from which most is reached.
fn walkable(labelled: &LabelledPlan, original: &[Sector], heights: &[(i32, i32)]) -> BTreeMap<u32, (i32, f64)> {
    let plan = &labelled.plan;
    let air: Vec<Air> = labelled.sector.iter().map(|sector| heights.get((*sector)? as usize).copied()).collect();
    let top = |t: usize| {
        let lift = labelled.sector[t].and_then(|sector| original.get(sector as usize));
        lift.filter(|lift| lift.ceiling - lift.floor >= PLAYER).map(|lift| lift.floor)
    };
    let passes = |t: usize, n: usize| match (air[t], air[n]) {
        (Some(a), Some(b)) => b.0 - top(t).unwrap_or(a.0).max(a.0) <= STEP && a.1.min(b.1) - a.0.max(b.0) >= PLAYER,
        _ => false,
    };
    let (part, count) = plan.flood(|t| passes(t, t), |t, _, n| passes(t, n) && passes(n, t));
    let mut areas = vec![0.0; count as usize];
    part.iter()
        .enumerate()
        .filter_map(|(t, part)| Some((t, (*part)?)))
        .for_each(|(t, p)| areas[p as usize] += plan.area(t));
    let mut order: Vec<u32> = (0..count).collect();
    order.sort_by(|&a, &b| areas[b as usize].total_cmp(&areas[a as usize]));
    let reached = |from: u32| {
        let mut is_reached: Vec<bool> = part.iter().map(|&part| part == Some(from)).collect();
        let mut stack: Vec<usize> = (0..part.len()).filter(|&t| is_reached[t]).collect();
        let mut area = 0.0;
        while let Some(triangle) = stack.pop() {
            area += plan.area(triangle);
            for next in plan.neighbours[triangle].iter().flatten().map(|&n| n as usize) {
                if !is_reached[next] && passes(triangle, next) {
                    is_reached[next] = true;
                    stack.push(next);
                }
            }
        }
        (area, is_reached)
    };
    let largest = order.first().map_or(0.0, |&part| areas[part as usize]);
    let starts = order.into_iter().take(PARTS).filter(|&part| areas[part as usize] >= PART * largest);
    let best = starts.map(reached).max_by(|a, b| a.0.total_cmp(&b.0));
    let is_reached = best.map(|(_, is_reached)| is_reached).unwrap_or_default();
    let mut floors: BTreeMap<u32, (i32, f64)> = BTreeMap::new();
    for triangle in (0..is_reached.len()).filter(|&t| is_reached[t]) {
        if let (Some(sector), Some((floor, _))) = (labelled.sector[triangle], air[triangle]) {
            floors.entry(sector).or_insert((floor, 0.0)).1 += plan.area(triangle);
        }
    }
    floors
}

/// The height below which half of the area lies.
fn median(area: &BTreeMap<i32, f64>) -> Option<i32> {
    let half = area.values().sum::<f64>() / 2.0;
    let mut below = 0.0;
    let reaches = |(_, area): &(&i32, &f64)| {
        below += **area;
        below >= half
    };
    area.iter().find(reaches).map(|(&height, _)| height)
}

/// Shifts of all sectors that touch those given, wave after wave: each moves by the mean of its neighbours' shifts, by the
/// length of the borders.
fn hang(labelled: &LabelledPlan, mut shifts: BTreeMap<u32, f64>) -> BTreeMap<u32, f64> {
    let mut borders: BTreeMap<u32, BTreeMap<u32, f64>> = BTreeMap::new();
    let plan = &labelled.plan;
    for triangle in 0..plan.triangles.len() {
        for edge in 0..3 {
            let beyond = plan.neighbours[triangle][edge].and_then(|n| labelled.sector[n as usize]);
            if let (Some(here), Some(beyond)) = (labelled.sector[triangle], beyond)
                && here != beyond
            {
                *borders.entry(here).or_default().entry(beyond).or_default() += plan.edge_length(triangle, edge);
            }
        }
    }
    let around = |sector: u32| borders.get(&sector).into_iter().flatten();
    let mut open: BTreeSet<u32> = borders.keys().copied().collect();
    while !open.is_empty() {
        let mut wave = Vec::new();
        for &sector in open.iter().filter(|sector| !shifts.contains_key(sector)) {
            let known = around(sector).filter_map(|(beyond, length)| Some((shifts.get(beyond)?, length)));
            let (sum, length) =
                known.fold((0.0, 0.0), |(sum, all), (shift, length)| (sum + shift * length, all + length));
            if length > 0.0 {
                wave.push((sector, sum / length));
            }
        }
        // Only next to the last wave can there be another one.
        open = wave.iter().flat_map(|&(sector, _)| around(sector).map(|(&beyond, _)| beyond)).collect();
        shifts.extend(wave);
    }
    shifts
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::convert::label;
    use crate::doom_map::DoomMap;

    #[test]
    fn a_stair_is_flattened_and_its_window_moves_along() {
        // Six steps of 24 in a row, and beside the last one a sill of 40 above it.
        let mut map = DoomMap::default();
        let steps: Vec<u32> = (0..6).map(|n| map.sector(24 * n, 24 * n + 128)).collect();
        let sill = map.sector(160, 224);
        for (n, &step) in steps.iter().enumerate() {
            let x = 100 * n as i32;
            map.walls(&[[x, 0], [x + 100, 0]], step);
            map.walls(&[[x + 100, 100], [x, 100]], step);
            if n > 0 {
                map.line([x, 0], [x, 100], Some(step), Some(steps[n - 1]));
            }
        }
        map.walls(&[[0, 100], [0, 0]], steps[0]);
        map.line([600, 0], [600, 100], Some(sill), Some(steps[5]));
        map.walls(&[[600, 0], [650, 0], [650, 100], [600, 100]], sill);
        let labelled = label(&map).unwrap();
        let mut heights: Vec<(i32, i32)> = map.sectors.iter().map(|s| (s.floor, s.ceiling)).collect();
        let factor = compress(&labelled, &map.sectors, &mut heights);
        // The median is the third step, at 48; the last one, at 120, goes to the end of the band.
        assert!((factor - 40.0 / 72.0).abs() < 1e-9, "{factor}");
        assert_eq!(heights.iter().map(|h| h.0).collect::<Vec<_>>(), [21, 35, 48, 61, 75, 88, 128]);
        assert!(heights.iter().zip(&map.sectors).all(|(h, s)| h.1 - h.0 == s.ceiling - s.floor));
        // Pressed once, it stays; a low passage gets the camera's head room over the modal floor.
        let mut flat: Vec<Sector> = map.sectors.clone();
        flat.iter_mut().zip(&heights).for_each(|(sector, h)| (sector.floor, sector.ceiling) = *h);
        let before = heights.clone();
        heights[0].1 = heights[1].0 + PLAYER;
        assert_eq!(compress(&labelled, &flat, &mut heights), 1.0);
        assert_eq!((heights[0], &heights[1..]), ((21, 21 + HEAD_ROOM), &before[1..]));
    }
}
