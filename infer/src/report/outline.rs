//! The outlines of a raster as the path of an SVG: a floor plan in a few kilobytes that is sharp at any size.

use crate::bench::{FloorPlan, SceneInfo, Tile};
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// The tiles of one kind, as images have them: `+z` up and `+x` left.
pub(super) fn of_plan(plan: &FloorPlan, kind: Tile) -> String {
    let (width, height) = (plan.width, plan.height);
    let tile = |x: usize, y: usize| plan.tiles.get((height - 1 - y) * width + width - 1 - x).copied();
    outline(width, height, |x, y| tile(x, y) == Some(kind))
}

/// Column and row, in pixels of that image, of the lattice's node `(0, 0)`, and how far apart nodes are.
pub(super) fn lattice(scene: &SceneInfo) -> [f32; 3] {
    let (plan, lattice) = (&scene.plan, &scene.lattice);
    let pixels = |metres: f32| metres / plan.metres_per_pixel;
    let column = plan.width as f32 - pixels(lattice.origin.x - plan.low[0]);
    [column, plan.height as f32 - pixels(lattice.origin.z - plan.low[1]), pixels(lattice.spacing)]
}

/// Corner of a pixel: column and row, from the upper left.
type Corner = (i32, i32);

/// The border of the pixels for which `is_in` answers yes, of an image of `width · height`: an SVG path in half pixels, even-odd
/// or non-zero alike. It goes through the middles of the pixels' sides, so slanted walls are no stairs.
fn outline(width: usize, height: usize, is_in: impl Fn(usize, usize) -> bool) -> String {
    let inside = |(x, y): Corner| {
        let within = x >= 0 && y >= 0 && (x as usize) < width && (y as usize) < height;
        within && is_in(x as usize, y as usize)
    };
    // Sides of pixels by where they begin, the inside to their right.
    let mut sides: BTreeMap<Corner, Vec<Corner>> = BTreeMap::new();
    for (x, y) in (0..height as i32).flat_map(|y| (0..width as i32).map(move |x| (x, y))).filter(|&at| inside(at)) {
        let around = [
            ((x, y - 1), (x, y), (x + 1, y)),
            ((x + 1, y), (x + 1, y), (x + 1, y + 1)),
            ((x, y + 1), (x + 1, y + 1), (x, y + 1)),
            ((x - 1, y), (x, y + 1), (x, y)),
        ];
        for (_, from, to) in around.into_iter().filter(|&(beyond, ..)| !inside(beyond)) {
            sides.entry(from).or_default().push(to);
        }
    }
    let mut path = String::new();
    while let Some((first, next)) = take_first(&mut sides) {
        let (mut ring, mut from, mut to) = (Vec::new(), first, next);
        loop {
            ring.push((from.0 + to.0, from.1 + to.1));
            if to == first {
                break;
            }
            let Some(after) = turn_right(&mut sides, from, to) else { break };
            (from, to) = (to, after);
        }
        write_ring(&mut path, &ring);
    }
    path
}

fn take_first(sides: &mut BTreeMap<Corner, Vec<Corner>>) -> Option<(Corner, Corner)> {
    let (&from, _) = sides.first_key_value()?;
    Some((from, take(sides, from, 0)?))
}

/// Where two pixels touch by their corners, the border stays with the pixel that it goes around.
fn turn_right(sides: &mut BTreeMap<Corner, Vec<Corner>>, from: Corner, at: Corner) -> Option<Corner> {
    let right = (at.0 - (at.1 - from.1), at.1 + (at.0 - from.0));
    let choice = sides.get(&at)?.iter().position(|&to| to == right).unwrap_or(0);
    take(sides, at, choice)
}

fn take(sides: &mut BTreeMap<Corner, Vec<Corner>>, from: Corner, choice: usize) -> Option<Corner> {
    let ends = sides.get_mut(&from)?;
    let to = ends.swap_remove(choice);
    if ends.is_empty() {
        sides.remove(&from);
    }
    Some(to)
}

/// Points on a straight line between their neighbours are left out; the others are written as steps from the one before.
fn write_ring(path: &mut String, ring: &[Corner]) {
    let at = |n: usize| ring[n % ring.len()];
    let is_corner = |&n: &usize| {
        let [a, b, c] = [at(n + ring.len() - 1), at(n), at(n + 1)];
        (b.0 - a.0) * (c.1 - b.1) != (b.1 - a.1) * (c.0 - b.0)
    };
    let mut last = (0, 0);
    for (number, n) in (0..ring.len()).filter(is_corner).enumerate() {
        let (x, y) = at(n);
        let step = if number == 0 { (x, y) } else { (x - last.0, y - last.1) };
        let [before, between] = [if number == 0 { "M" } else { " " }, if step.1 < 0 { "" } else { " " }];
        let before = if number == 1 {
            "l"
        } else if number > 1 && step.0 < 0 {
            ""
        } else {
            before
        };
        let _ = write!(path, "{before}{}{between}{}", step.0, step.1);
        last = (x, y);
    }
    if last != (0, 0) {
        path.push('z');
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(rows: &[&str]) -> String {
        outline(rows[0].len(), rows.len(), |x, y| rows[y].as_bytes()[x] == b'#')
    }

    #[test]
    fn rooms_have_walls_and_pillars() {
        assert_eq!(of(&["....", "...."]), "");
        assert_eq!(of(&["##", "##"]), "M1 0l2 0 1 1 0 2-1 1-2 0-1-1 0-2z");
        let pillar = of(&["###", "#.#", "###"]);
        assert_eq!(pillar.matches('z').count(), 2, "{pillar}");
        // Slanted walls are slanted lines: two long sides, and the ends of a few half pixels.
        let slant = of(&["##....", ".##...", "..##..", "...##.", "....##"]);
        assert_eq!(slant.matches('z').count(), 1);
        assert_eq!(slant, "M1 0l2 0 9 9-1 1-2 0-9-9z");
        assert_eq!(of(&["#.", ".#"]).matches('z').count(), 2, "corners that touch are no way through");
    }

    /// The area inside, in pixels, from the path as it is read by others.
    fn area(path: &str) -> f64 {
        let mut twice = 0.0;
        for ring in path.split('z').filter(|ring| !ring.is_empty()) {
            let text = ring.replace(['M', 'l'], " ").replace('-', " -");
            let numbers: Vec<f64> = text.split_whitespace().map(|n| n.parse().unwrap()).collect();
            let mut points = vec![(numbers[0], numbers[1])];
            for step in numbers[2..].chunks(2) {
                let (x, y) = *points.last().unwrap();
                points.push((x + step[0], y + step[1]));
            }
            let next = points.iter().cycle().skip(1);
            twice += points.iter().zip(next).map(|(a, b)| a.0 * b.1 - a.1 * b.0).sum::<f64>();
        }
        twice / 8.0
    }

    #[test]
    fn what_is_outlined_has_the_area_of_its_pixels_but_for_the_corners() {
        let rows = ["..######..", "..######..", "..##..##..", "..##..##..", "..######..", "..######.."];
        // Four outer corners lose an eighth of a pixel each, four inner ones win it.
        assert!((area(&of(&rows)) - 32.0).abs() < 1e-9, "{}", area(&of(&rows)));
        let seed = |x: usize, y: usize| (x * 7 + y * 13 + x * y) % 5 < 3;
        let pixels = (0..40).flat_map(|y| (0..30).map(move |x| (x, y))).filter(|&(x, y)| seed(x, y)).count();
        let found = area(&outline(30, 40, seed));
        assert!((found - pixels as f64).abs() < 0.25 * pixels as f64, "{found} {pixels}");
    }
}
