//! The floors of a building, and what part of the mesh belongs to which.

use super::ImportError;
use super::align::Up;
use super::columns::{Column, Columns, median};
use glam::Vec3;
use nbp_env::pose::CAMERA_HEIGHT;
use nbp_env::scene::{Interior, RayIndex};
use rayon::prelude::*;

/// Free height over a floor, metres.
const HEADROOM: f32 = 1.8;

/// Floors nearer to each other than this are one, with steps, metres.
const LEAST_STOREY: f32 = 2.0;

/// Smallest floor, square metres.
const LEAST_AREA: f32 = 4.0;

/// Smallest floor beside larger ones, as a share of the largest: landings and galleries are no storeys.
const LEAST_SHARE: f32 = 0.15;

/// Resolution of heights, metres.
const BIN: f32 = 0.05;

/// Heights within this of a floor count as the floor, metres.
const NEAR: f32 = 0.15;

/// Steps and sunken rooms within this of the floor belong to its storey, metres.
const RELIEF: f32 = 1.2;

/// How far under its floor a storey above another begins: thresholds and first steps belong to it, metres.
const BELOW: f32 = 0.2;

/// How far around the places to stand a storey reaches, so that walls and what is under sloping roofs belong to it, and the
/// garden does not, metres.
const AROUND: f32 = 1.5;

/// One storey of a building.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Storey {
    /// Height of its floor, metres.
    pub(super) floor: f32,
    /// Area of its floor at this height with room to stand, square metres.
    pub(super) area: f32,
    /// What lies in this box belongs to it; infinite where the mesh ends.
    pub(super) bounds: [Vec3; 2],
}

/// The storeys of a mesh in metres with `y` up, from below.
///
/// A floor is a height at which plumb lines meet a surface with 1.8 m of air above it where walls stand around the camera.
pub(super) fn find(rays: &RayIndex, bounds: [Vec3; 2], up: Up, scale: f32) -> Result<Vec<Storey>, ImportError> {
    let size = bounds[1] - bounds[0];
    // Lines every 20 cm, or 200 of them.
    let plan = Columns::of(rays, bounds, ((size.x.max(size.z) / 0.2) as usize).clamp(20, 200));
    let area = plan.cell * plan.cell;
    let standing: Vec<Stand> = plan.columns.par_iter().flat_map_iter(|column| stands(rays, column)).collect();
    let near = |floor: f32| standing.iter().filter(move |stand| (stand.floor - floor).abs() <= NEAR);
    let mut bins = vec![0_u32; (size.y / BIN) as usize + 2];
    let bin_of = |height: f32| ((height - bounds[0].y) / BIN) as usize;
    standing.iter().filter_map(|stand| bins.get_mut(bin_of(stand.floor)).map(|bin| *bin += 1)).for_each(drop);
    let around = |at: usize| bins[at.saturating_sub(1)..(at + 2).min(bins.len())].iter().sum::<u32>();
    let mut ranked: Vec<(u32, usize)> =
        (0..bins.len()).map(|at| (around(at), at)).filter(|(sum, _)| *sum > 0).collect();
    // The lowest of equals.
    ranked.sort_by_key(|&(sum, at)| (std::cmp::Reverse(sum), at));
    let most = ranked.first().map_or(0, |best| best.0) as f32;
    let mut floors: Vec<f32> = Vec::new();
    for (sum, at) in ranked {
        let rough = bounds[0].y + (at as f32 + 0.5) * BIN;
        let is_large = sum as f32 * area >= LEAST_AREA && sum as f32 >= LEAST_SHARE * most;
        if is_large && floors.iter().all(|floor| (floor - rough).abs() >= LEAST_STOREY) {
            let level = near(rough).map(|stand| stand.floor).filter(|height| (height - rough).abs() < 1.5 * BIN + 1e-4);
            floors.push(median(level.collect()).unwrap_or(rough));
        }
    }
    if floors.is_empty() {
        return Err(ImportError::NoFloor {
            need: LEAST_AREA,
            best: most * area,
            height: median(standing.iter().map(|stand| stand.floor).collect()).unwrap_or(bounds[0].y),
            up: up.name(),
            scale,
        });
    }
    floors.sort_by(f32::total_cmp);
    let area_of = |floor: f32| near(floor).count() as f32 * area;
    let mut low = f32::NEG_INFINITY;
    let storey = |(number, &floor): (usize, &f32)| {
        let high = floors.get(number + 1).map_or(f32::INFINITY, |&next| {
            let ceilings = near(floor).map(|stand| stand.ceiling).filter(|&above| above < next + NEAR);
            match median(ceilings.collect()) {
                // A slab with two faces is cut between them; one with a single face is the ceiling of this storey, too.
                Some(ceiling) if ceiling < next - NEAR => (ceiling + next) / 2.0,
                _ => next + NEAR,
            }
        });
        let mut bounds = [Vec3::INFINITY, Vec3::NEG_INFINITY];
        for stand in standing.iter().filter(|stand| (stand.floor - floor).abs() <= RELIEF) {
            let at = Vec3::new(stand.x, 0.0, stand.z);
            bounds = [bounds[0].min(at - AROUND - plan.cell), bounds[1].max(at + AROUND + plan.cell)];
        }
        let bounds = [bounds[0].with_y(low), bounds[1].with_y(high)];
        low = floors.get(number + 1).map_or(0.0, |next| next - BELOW);
        Storey { floor, area: area_of(floor), bounds }
    };
    Ok(floors.iter().enumerate().map(storey).collect())
}

/// A place to stand.
struct Stand {
    x: f32,
    z: f32,
    floor: f32,
    /// The next surface above; infinite without one.
    ceiling: f32,
}

fn stands<'a>(rays: &'a RayIndex, column: &'a Column) -> impl Iterator<Item = Stand> + 'a {
    let (x, z) = (column.x, column.z);
    let above = column.heights.iter().skip(1).copied().chain([f32::INFINITY]);
    let stands = column.heights.iter().copied().zip(above).map(move |(floor, ceiling)| Stand { x, z, floor, ceiling });
    stands.filter(|stand| {
        let eye = Vec3::new(stand.x, stand.floor + CAMERA_HEIGHT, stand.z);
        stand.ceiling - stand.floor >= HEADROOM && Interior::Open.contains(rays, eye)
    })
}
