//! Polygons in the plan: corners in map units, counter-clockwise unless said otherwise.

/// Corners.
pub(crate) type Polygon = Vec<[i32; 2]>;

/// Edges of a polygon.
pub(crate) fn edges(polygon: &[[i32; 2]]) -> impl Iterator<Item = [[i32; 2]; 2]> + '_ {
    (0..polygon.len()).map(|n| [polygon[n], polygon[(n + 1) % polygon.len()]])
}

/// Lower and upper corner of a polygon's box.
pub(crate) fn bounds(polygon: &[[i32; 2]]) -> [[i32; 2]; 2] {
    polygon.iter().fold([[i32::MAX; 2], [i32::MIN; 2]], |[low, high], p| {
        [[low[0].min(p[0]), low[1].min(p[1])], [high[0].max(p[0]), high[1].max(p[1])]]
    })
}

/// Whether a point lies inside of a polygon (even-odd).
pub(crate) fn contains(polygon: &[[i32; 2]], [x, y]: [f64; 2]) -> bool {
    edges(polygon).filter(|&[a, b]| crossing(a, b, y).is_some_and(|at| at > x)).count() % 2 == 1
}

/// Area of a polygon, square map units.
pub(crate) fn area(polygon: &[[i32; 2]]) -> f64 {
    let twice: i64 =
        edges(polygon).map(|[a, b]| i64::from(a[0]) * i64::from(b[1]) - i64::from(b[0]) * i64::from(a[1])).sum();
    twice.abs() as f64 / 2.0
}

/// The parts of a line inside of a polygon, along an axis (0 is `x`), where the other coordinate is `across`.
pub(crate) fn spans_along(polygon: &[[i32; 2]], axis: usize, across: f64) -> Vec<[f64; 2]> {
    let turned = |p: [i32; 2]| if axis == 0 { p } else { [p[1], p[0]] };
    let mut crossings: Vec<f64> = edges(polygon).filter_map(|[a, b]| crossing(turned(a), turned(b), across)).collect();
    crossings.sort_unstable_by(f64::total_cmp);
    crossings.chunks_exact(2).map(|span| [span[0], span[1]]).collect()
}

/// Where an edge crosses a horizontal line; the upper end does not count.
fn crossing(a: [i32; 2], b: [i32; 2], y: f64) -> Option<f64> {
    let [[ax, ay], [bx, by]] = [a, b].map(|p| p.map(f64::from));
    ((ay > y) != (by > y)).then(|| ax + (y - ay) / (by - ay) * (bx - ax))
}

/// The polygon with all edges moved inwards; `None` where an edge would be shorter than `least`.
pub(crate) fn inset(polygon: &[[i32; 2]], distance: f64, least: f64) -> Option<Polygon> {
    let count = polygon.len();
    let directions: Vec<[f64; 2]> = edges(polygon).map(|[a, b]| direction(a, b)).collect();
    let moved: Polygon = (0..count)
        .map(|n| {
            let [before, after] = [directions[(n + count - 1) % count], directions[n]];
            let along = before[0] * after[0] + before[1] * after[1];
            // The sum of the inward normals, which lie to the left of the edges.
            let normal = [-before[1] - after[1], before[0] + after[0]];
            [0, 1].map(|axis| polygon[n][axis] + (distance * normal[axis] / (1.0 + along)).round() as i32)
        })
        .collect();
    let keeps_on = |(edge, [a, b]): (usize, [[i32; 2]; 2])| {
        let [dx, dy] = [0, 1].map(|axis| f64::from(b[axis] - a[axis]));
        dx * directions[edge][0] + dy * directions[edge][1] >= least
    };
    let is_valid = edges(&moved).enumerate().all(keeps_on);
    is_valid.then_some(moved)
}

/// The polygon with its corners cut off, by at most a third of their edges.
pub(crate) fn bevelled(polygon: &[[i32; 2]], cut: f64) -> Polygon {
    let count = polygon.len();
    let towards = |from: [i32; 2], to: [i32; 2]| {
        let length = f64::from(to[0] - from[0]).hypot(f64::from(to[1] - from[1])).max(1.0);
        let share = (cut / length).min(1.0 / 3.0);
        [0, 1].map(|axis| from[axis] + (share * f64::from(to[axis] - from[axis])).round() as i32)
    };
    (0..count)
        .flat_map(|n| {
            let [before, here, after] = [count - 1, 0, 1].map(|step| polygon[(n + step) % count]);
            [towards(here, before), towards(here, after)]
        })
        .collect()
}

/// Unit vector.
pub(crate) fn direction(a: [i32; 2], b: [i32; 2]) -> [f64; 2] {
    let [dx, dy] = [0, 1].map(|axis| f64::from(b[axis] - a[axis]));
    let length = dx.hypot(dy).max(f64::MIN_POSITIVE);
    [dx / length, dy / length]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn insets_keep_their_distance_or_fail() {
        let ell = [[0, 0], [300, 0], [300, 100], [100, 100], [100, 300], [0, 300]];
        assert_eq!(area(&ell), 50_000.0);
        let moved = inset(&ell, 20.0, 16.0).unwrap();
        assert_eq!(moved, [[20, 20], [280, 20], [280, 80], [80, 80], [80, 280], [20, 280]]);
        assert!(inset(&ell, 45.0, 16.0).is_none(), "its arms are 100 wide");
        let square = [[0, 0], [90, 0], [90, 90], [0, 90]];
        assert_eq!(area(&bevelled(&square, 10.0)), 8100.0 - 4.0 * 50.0);
        assert_eq!(bevelled(&square, 99.0)[0], [0, 30]);
        assert_eq!(spans_along(&ell, 1, 200.0), [[0.0, 100.0]]);
        assert!(contains(&ell, [50.0, 200.0]) && !contains(&ell, [200.0, 200.0]));
    }
}
