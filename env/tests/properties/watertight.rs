//! Rays through the seams of closed meshes: none slips through.

use super::{MANY, for_all, point};
use glam::Vec3;
use nbp_env::Rng;
use nbp_env::scene::{Interior, Mesh, RayIndex};
use rand::RngExt as _;

/// [`scenes::ball`](super::scenes::ball) as a mesh.
fn ball(centre: Vec3, rings: u32, radius: impl FnMut() -> f32) -> Mesh {
    let (vertices, triangles) = super::scenes::ball(centre, rings, radius);
    Mesh::new(vertices, triangles).unwrap()
}

/// A box, its faces cut into squares and those into triangles.
fn cuboid(centre: Vec3, half: Vec3, cuts: u32) -> Mesh {
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for axis in 0..3 {
        let [u, v] = [1, 2].map(|n| (axis + n) % 3);
        for side in [-1.0, 1.0] {
            let first = vertices.len() as u32;
            for (i, k) in (0..=cuts).flat_map(|i| (0..=cuts).map(move |k| (i, k))) {
                let mut at = Vec3::ZERO;
                at[axis] = side;
                (at[u], at[v]) = (2.0 * i as f32 / cuts as f32 - 1.0, 2.0 * k as f32 / cuts as f32 - 1.0);
                vertices.push(centre + at * half);
            }
            for a in (0..cuts).flat_map(|i| (0..cuts).map(move |k| first + i * (cuts + 1) + k)) {
                triangles.extend([[a, a + 1, a + cuts + 2], [a, a + cuts + 2, a + cuts + 1]]);
            }
        }
    }
    Mesh::new(vertices, triangles).unwrap()
}

/// Seams drawn for a few of the floor: of the coarsest box, one in forty is.
const TRIES: usize = 4000;

/// A corner or a point of an edge.
fn seam(mesh: &Mesh, rng: &mut Rng) -> Vec3 {
    let corners = mesh.corners(rng.random_range(0..mesh.triangles().len()));
    let (a, b) = (corners[rng.random_range(0..3)], corners[rng.random_range(0..3)]);
    match rng.random_range(0..3) {
        0 => a,
        1 => (a + b) / 2.0,
        _ => a.lerp(b, rng.random()),
    }
}

#[test]
fn no_ray_slips_through_a_seam() {
    for_all("no_ray_slips_through_a_seam", MANY, |rng| {
        let centre = if rng.random_bool(0.5) { Vec3::ZERO } else { point(rng, 1000.0) };
        let size: f32 = 10.0_f32.powf(rng.random_range(-1.0..1.7));
        let mesh = match rng.random_range(0..3) {
            0 => ball(centre, rng.random_range(2..9), || size * rng.random_range(0.5..1.5)),
            1 => cuboid(centre, size * Vec3::new(1.0, 0.6, 1.7), rng.random_range(1..5)),
            _ => ball(centre, rng.random_range(2..9), || size),
        };
        let rays = RayIndex::build(&mesh);
        for _ in 0..8 {
            // Near enough to the centre to lie inside whatever the corners.
            let origin = match rng.random_range(0..4) {
                0 => centre,
                _ => centre + point(rng, 0.08 * size),
            };
            let target = seam(&mesh, rng);
            let away = target - origin;
            let said = || format!("from {origin} to {target}");
            let hit = rays.nearest(origin, away, f32::INFINITY).unwrap_or_else(|| panic!("a miss {}", said()));
            let rounding = 1e-6 * target.length() + 1e-4 * size;
            assert!((hit.t - 1.0) * away.length() < rounding, "{hit:?} {}", said());
            assert!(rays.nearest(origin, away.normalize(), f32::INFINITY).is_some(), "{}", said());
            assert!(rays.segment_is_blocked(origin, origin + 2.0 * away), "{}", said());
            assert!(rays.segment_is_blocked(origin + 2.0 * away, origin), "{}", said());
            assert!(!rays.crossings(origin, away).is_empty(), "{}", said());
        }
    });
}

#[test]
fn what_stands_above_a_seam_of_the_floor_is_inside() {
    for_all("what_stands_above_a_seam_of_the_floor_is_inside", MANY, |rng| {
        let centre = if rng.random_bool(0.5) { Vec3::ZERO } else { point(rng, 300.0) };
        let mesh = match rng.random_bool(0.5) {
            true => ball(centre, 2 * rng.random_range(1..5), || 4.0),
            false => cuboid(centre, Vec3::new(5.0, 3.0, 7.0), rng.random_range(1..6)),
        };
        let (rays, [low, high]) = (RayIndex::build(&mesh), mesh.bounds());
        let height = high.y - low.y;
        let within = |floor: Vec3| ((floor - centre).abs() / (high - low)).cmplt(Vec3::new(0.49, 9.0, 0.49)).all();
        // Of the lower faces only: their seams lie below the middle, and within the outline.
        let is_floor = |floor: &Vec3| floor.y <= centre.y - 0.1 * height && within(*floor);
        let seams = std::iter::repeat_with(|| seam(&mesh, rng)).take(TRIES);
        let floors: Vec<Vec3> = seams.filter(is_floor).take(8).collect();
        assert_eq!(floors.len(), 8, "too few seams of the floor among {TRIES}");
        for floor in floors {
            let position = floor.with_y(floor.y + (centre.y - floor.y) * rng.random_range(0.05..1.0));
            assert!(Interior::Closed.contains(&rays, position), "{position} above {floor}");
            let below = floor.with_y(low.y - height * rng.random_range(0.01..1.0));
            assert!(!Interior::Closed.contains(&rays, below), "{below} below {floor}");
        }
    });
}
