//! Which lines pass through which block of the map, for collisions; and which sectors cannot see each other, for monsters.

use crate::doom_map::DoomMap;
use std::collections::BTreeMap;

/// Side of a block, map units.
const BLOCK: i32 = 128;
/// What the lists of lines end with.
const END: u16 = 0xffff;
/// The game's own node builder leaves this much around the map.
const MARGIN: i32 = 8;
/// Sectors from which a table of pairs is a waste.
const MOST_SECTORS: usize = 8192;

/// The block map: origin, columns and rows, an offset for each block, lists of lines. Equal lists are stored once.
pub(super) fn blockmap(map: &DoomMap) -> Result<Vec<u8>, String> {
    let corner = |v: u32| map.vertices.get(v as usize).map_or([0; 2], |v| [v.x, v.y]);
    let lines: Vec<_> = map.linedefs.iter().map(|line| [corner(line.from), corner(line.to)]).collect();
    let ends = || lines.iter().flatten();
    let origin = [0, 1].map(|axis| ends().map(|p| p[axis]).min().unwrap_or(0) - MARGIN);
    let block = |p: [i32; 2]| [0, 1].map(|axis| (p[axis] - origin[axis]) / BLOCK);
    let [columns, rows] = [0, 1].map(|axis| ends().map(|&p| block(p)[axis]).max().unwrap_or(0) as usize + 1);
    let too_large = || "its block map has more than 65535 words".to_string();
    if columns * rows > usize::from(u16::MAX) {
        return Err(too_large());
    }
    let mut lists = vec![Vec::new(); columns * rows];
    for (number, &[a, b]) in (0_u16..).zip(&lines) {
        let (from, to) = (block([a[0].min(b[0]), a[1].min(b[1])]), block([a[0].max(b[0]), a[1].max(b[1])]));
        for row in from[1]..=to[1] {
            for column in from[0]..=to[0] {
                let low = [origin[0] + column * BLOCK, origin[1] + row * BLOCK];
                if touches([a, b], low) {
                    lists[row as usize * columns + column as usize].push(number);
                }
            }
        }
    }
    let mut offsets: BTreeMap<&[u16], usize> = BTreeMap::new();
    let mut words = vec![origin[0] as u16, origin[1] as u16, columns as u16, rows as u16];
    let mut bodies: Vec<u16> = Vec::new();
    for list in &lists {
        let offset = *offsets.entry(list).or_insert_with(|| {
            let at = 4 + lists.len() + bodies.len();
            bodies.push(0);
            bodies.extend(list);
            bodies.push(END);
            at
        });
        words.push(u16::try_from(offset).map_err(|_| too_large())?);
    }
    words.extend(bodies);
    Ok(words.into_iter().flat_map(u16::to_le_bytes).collect())
}

/// Whether a line passes through the block with this lower corner, its border included.
fn touches([a, b]: [[i32; 2]; 2], low: [i32; 2]) -> bool {
    let [x, y] = [0, 1].map(|axis| i64::from(b[axis]) - i64::from(a[axis]));
    let sides = [[0, 0], [BLOCK, 0], [0, BLOCK], [BLOCK, BLOCK]].map(|[right, up]| {
        let corner = [i64::from(low[0] + right - a[0]), i64::from(low[1] + up - a[1])];
        (x * corner[1] - y * corner[0]).signum()
    });
    // The box of the line meets the block already: only its own direction can part them.
    !(sides == [1; 4] || sides == [-1; 4])
}

/// The reject table: every sector may see every other.
pub(super) fn reject(map: &DoomMap) -> Result<Vec<u8>, String> {
    let sectors = map.sectors.len();
    if sectors > MOST_SECTORS {
        return Err(format!("it has {sectors} sectors; a table of pairs is written for at most {MOST_SECTORS}"));
    }
    Ok(vec![0; (sectors * sectors).div_ceil(8)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generate::{Level, generate};

    #[test]
    fn every_point_of_a_line_finds_it_in_its_block() {
        let map = generate(Level::Normal, 7).unwrap().map;
        let words: Vec<u16> =
            blockmap(&map).unwrap().chunks_exact(2).map(|b| u16::from_le_bytes([b[0], b[1]])).collect();
        let columns = usize::from(words[2]);
        let list = |column: usize, row: usize| {
            let at = usize::from(words[4 + row * columns + column]);
            assert_eq!(words[at], 0);
            words[at + 1..].iter().copied().take_while(|&word| word != END)
        };
        let mut listed = 0;
        for (number, line) in map.linedefs.iter().enumerate() {
            let [a, b] = [line.from, line.to].map(|v| map.vertices[v as usize]);
            for step in 0..=64 {
                let t = f64::from(step) / 64.0;
                let [x, y] = [(a.x, b.x, words[0]), (a.y, b.y, words[1])]
                    .map(|(a, b, origin)| f64::from(a) + t * f64::from(b - a) - f64::from(origin as i16));
                let [column, row] = [x, y].map(|c| (c / f64::from(BLOCK)) as usize);
                assert!(list(column, row).any(|found| usize::from(found) == number), "line {number} at {t}");
            }
        }
        for row in 0..usize::from(words[3]) {
            listed += (0..columns).map(|column| list(column, row).count()).sum::<usize>();
        }
        assert!(listed < 4 * map.linedefs.len(), "{listed} entries for {} lines", map.linedefs.len());
    }

    #[test]
    fn only_blocks_on_the_way_are_touched() {
        let diagonal = [[0, 0], [512, 512]];
        assert!(touches(diagonal, [256, 256]) && touches(diagonal, [128, 256]), "a corner counts");
        assert!(!touches(diagonal, [0, 256]));
        assert_eq!(reject(&DoomMap { sectors: vec![Default::default(); 9], ..DoomMap::default() }).unwrap().len(), 11);
    }

    #[test]
    fn a_map_over_the_limit_is_refused() {
        let mut map = DoomMap::default();
        map.line([-32_000, -32_000], [32_000, 32_000], None, None);
        assert!(blockmap(&map).is_err_and(|reason| reason.contains("65535 words")));
    }
}
