//! Barred windows between rooms: one sees through and does not walk through.

use super::draft::{Change, Draft, Host};
use super::outline::edges;
use super::raster::{CELL, Cover, Rect};
use crate::convert::LATTICE_PHASE;
use crate::doom_map::LATTICE_UNITS;
use nbp_env::Rng;
use rand::RngExt as _;
use rand::seq::IndexedRandom as _;

/// Side of a bar, map units.
const BAR: i32 = 16;

/// Walls up to this thick get barred windows, map units.
const THICKEST_WALL: i32 = 64;

/// Opens a barred window in a random wall between two spaces, if one is found.
pub(crate) fn window(draft: &mut Draft, rng: &mut Rng) {
    for _ in 0..24 {
        let Some(room) = draft.site.rooms.choose(rng) else { return };
        let sides: Vec<_> = edges(&room.polygon).collect();
        let Some(&[a, b]) = sides.choose(rng) else { return };
        let along = usize::from(a[0] == b[0]);
        let length = (b[along] - a[along]).abs();
        let width = rng.random_range(6..=14) * 16;
        if a[1 - along] != b[1 - along] || length < width + 32 {
            continue;
        }
        let mut middle = a;
        let start = a[along].min(b[along]) / CELL * CELL + 16;
        middle[along] = start + width / 2 + rng.random_range(0..=(length - width - 32) / CELL) * CELL;
        // Outlines are counter-clockwise: the solid lies to the right.
        let outward = if along == 0 { (a[0] - b[0]).signum() } else { (b[1] - a[1]).signum() };
        middle[1 - along] += outward * CELL;
        let Some(rect) = draft.bridge(middle, 1 - along, width, THICKEST_WALL) else { continue };
        if rect.size()[1 - along] - 2 * CELL > THICKEST_WALL {
            continue;
        }
        let floor = *[0, 16, 24, 32, 40].choose(rng).unwrap_or(&0);
        draft.carve(rect, draft.theme.frame(floor, rng.random_range(12..=18) * 8));
        set_bars(draft, rect, along, rng);
        return;
    }
}

/// Bars in the last passage. One stands on every line of the camera lattice, so that no way leads through.
fn set_bars(draft: &mut Draft, rect: Rect, along: usize, rng: &mut Rng) {
    let face = draft.theme.pillar(rng);
    let host = Host::Passage(draft.passages.len().saturating_sub(1));
    let centre = (rect.low[1 - along] + rect.high[1 - along]) / 2 / CELL * CELL;
    let first = (f64::from(rect.low[along]) - LATTICE_PHASE[along]) / LATTICE_UNITS;
    let last = (f64::from(rect.high[along]) - LATTICE_PHASE[along]) / LATTICE_UNITS;
    // Every other bar stands half-way between two lines.
    for half_lines in (2.0 * first).ceil() as i32..=(2.0 * last).floor() as i32 {
        let at = LATTICE_PHASE[along] + f64::from(half_lines) * LATTICE_UNITS / 2.0;
        let mut middle = [centre; 2];
        middle[along] = (at / f64::from(CELL)).round() as i32 * CELL;
        let bar = Rect::around(middle, [BAR; 2]).polygon();
        draft.raster.fill(&bar, Cover::Blocked);
        draft.decorate(host, bar, Change::Solid(face));
    }
}
