//! The whole episode from above: what was reconstructed, which walls were seen, where the agent went and looked.

use super::frame::Frame;
use super::{Rgb, colour};
use glam::{Vec2, Vec3};
use nbp_env::map::{Cell, MapView, OccupancyGrid, occupancy};
use nbp_env::{Episode, Pose};
use std::f32::consts::{PI, TAU};

/// Longer side of the map to aim at, pixels.
const TARGET: f32 = 1000.0;
/// Pixels per metre: never more, and less only for scenes so large that the picture would be.
const SCALE: [f32; 2] = [12.0, 72.0];
/// Longest side of a map, pixels.
const LARGEST: f32 = 6000.0;
/// Room around the walls, metres.
const MARGIN: f32 = 1.0;

/// From metres to pixels, `+z` up and `+x` left.
pub(super) struct Plan {
    low: Vec2,
    high: Vec2,
    scale: f32,
    corner: Vec2,
    /// Pixels for each length of marks and lettering.
    unit: f32,
}

impl Plan {
    /// At a scale to look at closely, and what stands around it.
    fn of(episode: &Episode) -> (Self, Frame) {
        let [low, high] = bounds(episode);
        let longest = (high - low).max_element();
        let scale = (TARGET / longest).clamp(SCALE[0], SCALE[1]).min(LARGEST / longest);
        let frame = Frame::around((high - low) * scale);
        (Self { low, high, scale, corner: frame.corner(), unit: frame.unit }, frame)
    }

    /// In the middle of a square of `side` pixels that begins at `corner`.
    pub(super) fn within(episode: &Episode, corner: Vec2, side: f32) -> Self {
        let [low, high] = bounds(episode);
        let scale = (side / (high - low).max_element()).min(SCALE[1]);
        let free = Vec2::splat(side) - (high - low) * scale;
        Self { low, high, scale, corner: (corner + free / 2.0).round(), unit: 0.75 }
    }

    fn size(&self) -> Vec2 {
        (self.high - self.low) * self.scale
    }

    pub(super) fn pixel(&self, p: Vec2) -> Vec2 {
        self.corner + (self.high - p) * self.scale
    }

    fn position(&self, pixel: Vec2) -> Vec2 {
        self.high - (pixel - self.corner) / self.scale
    }
}

/// Of the walls and the way, metres.
fn bounds(episode: &Episode) -> [Vec2; 2] {
    let ends = episode.world().scene().walls().iter().flatten().copied();
    let path = episode.track().iter().map(|pose| flat(pose.position));
    let [low, high] = ends.chain(path).fold([Vec2::INFINITY, Vec2::NEG_INFINITY], |[l, h], p| [l.min(p), h.max(p)]);
    [low - MARGIN, high + MARGIN]
}

pub(super) fn flat(p: Vec3) -> Vec2 {
    Vec2::new(p.x, p.z)
}

/// The episode so far, seen from above: points of the reconstruction, free space, true walls (seen or not), the path and
/// its headings coloured by time. `title` heads the picture.
pub fn topdown(episode: &Episode, title: &str) -> Rgb {
    let (plan, frame) = Plan::of(episode);
    let mut image = frame.blank();
    draw_map(&mut image, &plan, episode);
    draw_path(&mut image, &plan, episode);
    draw_ends(&mut image, &plan, episode.track());
    frame.head(&mut image, title, &facts(episode));
    frame.foot(&mut image, plan.scale, episode.steps());
    image
}

/// What is known of the map so far, and all walls.
pub(super) fn draw_map(image: &mut Rgb, plan: &Plan, episode: &Episode) {
    let view = episode.view();
    draw_free(image, plan, view.occupancy());
    draw_points(image, plan, &view);
    draw_walls(image, plan, episode);
}

fn draw_free(image: &mut Rgb, plan: &Plan, grid: &OccupancyGrid) {
    for_map_pixels(image, plan, |image, x, y, p| {
        // Bilinear between the middles of the four cells around, so that borders are not stairs.
        let at = p / occupancy::CELL - 0.5;
        let (cell, share) = (at.floor(), at - at.floor());
        let free =
            |dx: i32, dz: i32| f32::from(u8::from(grid.get([cell.x as i32 + dx, cell.y as i32 + dz]) != Cell::Unknown));
        let low = free(0, 0) + (free(1, 0) - free(0, 0)) * share.x;
        let high = free(0, 1) + (free(1, 1) - free(0, 1)) * share.x;
        let known = low + (high - low) * share.y;
        if known > 0.0 {
            image.blend(x, y, colour::FREE, known);
        }
    });
}

/// Points are counted in squares of about this side, metres: finer ones would show single points.
const SQUARE: f32 = 0.04;

fn draw_points(image: &mut Rgb, plan: &Plan, view: &MapView<'_>) {
    let side = (SQUARE * plan.scale).ceil().max(1.0) as usize;
    let columns = image.width.div_ceil(side);
    let mut counts = vec![0_u32; columns * image.height.div_ceil(side)];
    for point in view.cloud().iter() {
        let pixel = plan.pixel(flat(point));
        let is_inside = pixel.cmpge(plan.corner).all() && pixel.cmplt(plan.corner + plan.size()).all();
        if is_inside {
            let at = pixel.y as usize / side * columns + pixel.x as usize / side;
            if let Some(count) = counts.get_mut(at) {
                *count += 1;
            }
        }
    }
    let mut ranked: Vec<u32> = counts.iter().copied().filter(|&count| count > 0).collect();
    ranked.sort_unstable();
    // Not the very highest: what stands upright gets many times as many points as floors.
    let full = ranked.get(ranked.len() * 97 / 100).map_or(1.0, |&count| (count as f32).ln_1p());
    for y in 0..image.height {
        for x in 0..image.width {
            let count = counts[y / side * columns + x / side];
            if count > 0 {
                let tone = ((count as f32).ln_1p() / full).min(1.0);
                image.blend(x, y, colour::density(tone.powf(1.4)), 0.35 + 0.55 * tone);
            }
        }
    }
}

/// Length of the pieces of a wall that are seen or not as a whole, metres.
const PIECE: f32 = 0.1;

fn draw_walls(image: &mut Rgb, plan: &Plan, episode: &Episode) {
    let view = episode.view();
    let is_seen = |p: Vec2| {
        let [x, z] = OccupancyGrid::cell_of(Vec3::new(p.x, 0.0, p.y));
        let around = (-1..=1).flat_map(|dx| (-1..=1).map(move |dz| [x + dx, z + dz]));
        around.into_iter().any(|cell| view.occupancy().get(cell) == Cell::Occupied)
    };
    let width = (0.07 * plan.scale).clamp(1.6, 3.2) * plan.unit.min(1.0);
    for want_seen in [false, true] {
        for &[a, b] in episode.world().scene().walls() {
            let pieces = (a.distance(b) / PIECE).ceil().clamp(1.0, 1e5) as usize;
            let at = |n: usize| a.lerp(b, n as f32 / pieces as f32);
            let mut from = 0;
            for n in 0..pieces {
                let state = |n: usize| is_seen(a.lerp(b, (n as f32 + 0.5) / pieces as f32));
                if n + 1 < pieces && state(n) == state(n + 1) {
                    continue;
                }
                if state(n) == want_seen {
                    let ink = if want_seen { colour::SEEN } else { colour::UNSEEN };
                    image.line(plan.pixel(at(from)), plan.pixel(at(n + 1)), width, ink, 1.0);
                }
                from = n + 1;
            }
        }
    }
}

/// Share of the episode's time at step `n` of `poses` poses.
fn share(n: usize, poses: usize) -> f32 {
    n as f32 / (poses.max(2) - 1) as f32
}

/// In the continuous world a heading is drawn once the agent is so far from the last one drawn, metres and radians: one
/// for each motion would hide the map.
const APART: [f32; 2] = [0.5, 0.7];

/// Steps whose headings are drawn.
fn marks(episode: &Episode) -> Vec<usize> {
    let track = episode.track();
    let mut marks: Vec<usize> = Vec::new();
    for (n, pose) in track.iter().enumerate() {
        let is_apart = marks.last().is_none_or(|&last| {
            let turned = (pose.azimuth - track[last].azimuth + PI).rem_euclid(TAU) - PI;
            pose.position.distance(track[last].position) >= APART[0] || turned.abs() >= APART[1]
        });
        if is_apart || !episode.is_continuous() {
            marks.push(n);
        }
    }
    marks
}

fn draw_path(image: &mut Rgb, plan: &Plan, episode: &Episode) {
    let track = episode.track();
    let at = |pose: &Pose| plan.pixel(flat(pose.position));
    let width = (0.11 * plan.scale).clamp(2.4, 4.5);
    for pair in track.windows(2).filter(|pair| pair[0].position != pair[1].position) {
        image.line(at(&pair[0]), at(&pair[1]), width + 3.0, colour::BACKGROUND, 0.55);
    }
    for (n, pair) in track.windows(2).enumerate().filter(|(_, pair)| pair[0].position != pair[1].position) {
        image.line(at(&pair[0]), at(&pair[1]), width, colour::time(share(n + 1, track.len())), 1.0);
    }
    let metre = plan.scale.clamp(24.0, 48.0);
    for n in marks(episode) {
        let Pose { azimuth, .. } = track[n];
        // On the picture `+x` is left and `+z` up.
        let (ahead, aside) = (Vec2::new(-azimuth.sin(), -azimuth.cos()), Vec2::new(azimuth.cos(), -azimuth.sin()));
        let middle = at(&track[n]);
        let base = middle + ahead * 0.24 * metre;
        let corners = [middle + ahead * 0.58 * metre, base + aside * 0.15 * metre, base - aside * 0.15 * metre];
        let ink = colour::time(share(n, track.len()));
        image.triangle(corners, ink, 0.9);
        image.disc(middle, 0.11 * metre, ink, 1.0);
    }
}

fn draw_ends(image: &mut Rgb, plan: &Plan, track: &[Pose]) {
    let (Some(first), Some(last)) = (track.first(), track.last()) else { return };
    let at = |pose: &Pose| plan.pixel(flat(pose.position));
    let unit = plan.unit;
    let radius = (0.3 * plan.scale).clamp(6.0, 10.0) * unit;
    for (pose, time, name, below) in [(first, 0.0, "start", false), (last, 1.0, "end", true)] {
        let middle = at(pose);
        image.disc(middle, radius + 2.0, colour::BACKGROUND, 0.8);
        image.disc(middle, radius, colour::time(time), 1.0);
        image.ring(middle, radius, 2.2, colour::SEEN);
        let away = if below { radius + 9.0 * unit } else { -radius - 20.0 * unit };
        image.label(name, middle + Vec2::new(0.0, away), 11.0 * unit, [colour::TEXT, colour::BACKGROUND]);
    }
}

fn facts(episode: &Episode) -> String {
    let coverage = 100.0 * episode.curve().last().copied().unwrap_or(0.0);
    let (walked, bumps) = (episode.path_length(), episode.bumps());
    format!("{coverage:.1} % covered  ·  {} steps  ·  {walked:.0} m walked  ·  bumps: {bumps}", episode.steps())
}

fn for_map_pixels(image: &mut Rgb, plan: &Plan, mut draw: impl FnMut(&mut Rgb, usize, usize, Vec2)) {
    let (low, size) = (plan.corner, plan.size());
    for y in low.y as usize..((low.y + size.y) as usize).min(image.height) {
        for x in low.x as usize..((low.x + size.x) as usize).min(image.width) {
            draw(image, x, y, plan.position(Vec2::new(x as f32 + 0.5, y as f32 + 0.5)));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nbp_env::{Action, Direction, Heading, LatticePose, Node, Scene, SeedTree, SimConfig, World};
    use std::sync::Arc;

    #[test]
    fn it_shows_the_walk_the_right_way_round() {
        let world = Arc::new(World::new(Scene::two_rooms(), &SimConfig::default()).unwrap());
        let start = LatticePose { node: Node { i: 0, k: 0 }, heading: Heading::new(0) };
        let mut episode = Episode::new(world, start, 3, SeedTree::new(1)).unwrap();
        for heading in 0..3 {
            episode.step(Action { direction: Some(Direction::PlusX), heading: Heading::new(heading) });
        }
        let image = topdown(&episode, "two_rooms");
        let (plan, _) = Plan::of(&episode);
        assert_eq!(image.data.len(), image.width * image.height * 3);
        assert!(plan.scale >= 12.0);
        // The start is at small x and z: to the right and at the bottom; the end is further left.
        let [first, last] = [0.75, 5.25].map(|x| plan.pixel(Vec2::new(x, 0.75)));
        assert!(last.x < first.x && first.x > plan.corner.x + plan.size().x / 2.0);
        assert!(first.y > plan.corner.y + plan.size().y / 2.0);
        let at = |p: Vec2| &image.data[(p.y as usize * image.width + p.x as usize) * 3..][..3];
        assert_eq!(at(first), colour::time(0.0));
        assert_eq!(at(last), colour::time(1.0));
        assert!(plan.position(first).distance(Vec2::new(0.75, 0.75)) < 1e-3);
    }
}
