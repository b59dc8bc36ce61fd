//! Blocks on one sheet, in shelves.

/// Largest side of a sheet, texels: what every viewer and graphics card takes.
pub(super) const MAX_SIDE: usize = 8192;

/// Where each block lies and how large the sheet is.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Sheet {
    /// Upper left corners.
    pub(super) corners: Vec<[usize; 2]>,
    /// Width and height.
    pub(super) size: [usize; 2],
}

/// Places blocks of the given widths and heights; `None` where no sheet of [`MAX_SIDE`] holds them.
pub(super) fn pack(blocks: &[[usize; 2]]) -> Option<Sheet> {
    let mut order: Vec<usize> = (0..blocks.len()).collect();
    order.sort_by_key(|&n| (std::cmp::Reverse([blocks[n][1], blocks[n][0]]), n));
    let widest = blocks.iter().map(|block| block[0]).max()?;
    let widths = (0..).map(|power| 64 << power).take_while(|&width| width <= MAX_SIDE);
    let sheets = widths.filter(|&width| width >= widest).map(|width| shelves(blocks, &order, width));
    let fitting = sheets.filter(|sheet| sheet.size[1] <= MAX_SIDE);
    // Square sheets rather than strips, and of two like that the smaller one.
    fitting.min_by_key(|sheet| (sheet.size[0].max(sheet.size[1]), sheet.size[0] * sheet.size[1]))
}

fn shelves(blocks: &[[usize; 2]], order: &[usize], width: usize) -> Sheet {
    let mut corners = vec![[0; 2]; blocks.len()];
    let ([mut x, mut y], mut shelf) = ([0, 0], 0);
    for &n in order {
        if x + blocks[n][0] > width {
            (x, y, shelf) = (0, y + shelf, 0);
        }
        corners[n] = [x, y];
        x += blocks[n][0];
        shelf = shelf.max(blocks[n][1]);
    }
    Sheet { corners, size: [width, y + shelf] }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_do_not_overlap() {
        let blocks: Vec<[usize; 2]> = (0..60).map(|n| [8 + 7 * n % 90, 5 + 11 * n % 70]).collect();
        let sheet = pack(&blocks).unwrap();
        let ends = |n: usize| [0, 1].map(|axis| sheet.corners[n][axis] + blocks[n][axis]);
        for a in 0..blocks.len() {
            assert!((0..2).all(|axis| ends(a)[axis] <= sheet.size[axis]));
            for b in 0..a {
                let apart =
                    |axis: usize| ends(a)[axis] <= sheet.corners[b][axis] || ends(b)[axis] <= sheet.corners[a][axis];
                assert!(apart(0) || apart(1), "{a} and {b}");
            }
        }
        assert_eq!(pack(&[[MAX_SIDE + 1, 1]]), None);
        assert_eq!(pack(&[[MAX_SIDE, MAX_SIDE], [1, 1]]), None);
    }
}
