//! Images with a border of zeros, in memory that is used again.

use rayon::prelude::*;
use std::sync::Mutex;

/// Zeros after each plane: the last vector of a line may reach so far, and must not meet the next plane's pixels.
const TAIL: usize = 16;
/// Numbers after the last plane that a kernel may read (and ignore).
const SLACK: usize = 64;

/// Buffers kept for the next call: fresh pages from the system cost more than filling them.
static POOL: Mutex<Vec<Vec<f32>>> = Mutex::new(Vec::new());
const KEPT: usize = 4;

/// Planes of `height × width`, each with a border of `halo` zeros, seen as one line of numbers.
///
/// Pixel `(y, x)` of a plane is `(y + halo) · pitch + x + halo`, so a kernel's tap at `(dy, dx)` lies at the same distance
/// from every pixel and a convolution is a sum of shifted lines, whatever the width.
#[derive(Debug)]
pub(super) struct Padded {
    pub(super) numbers: Vec<f32>,
    /// Numbers from row to row.
    pub(super) pitch: usize,
    /// Numbers from plane to plane.
    pub(super) plane: usize,
}

impl Padded {
    pub(super) fn new(source: &[f32], height: usize, width: usize, halo: usize) -> Self {
        let pitch = width + 2 * halo;
        let plane = (height + 2 * halo) * pitch + TAIL;
        let len = source.len() / (height * width) * plane;
        let mut numbers = take();
        numbers.resize(len + SLACK, 0.0);
        // What a kernel reads past the end is multiplied by zeros, which a stale NaN would survive.
        numbers[len..].fill(0.0);
        let (top, inner) = (halo * pitch, height * pitch);
        numbers[..len].par_chunks_mut(plane).zip(source.par_chunks(height * width)).for_each(|(padded, image)| {
            padded[..top].fill(0.0);
            padded[top + inner..].fill(0.0);
            for (row, line) in padded[top..top + inner].chunks_exact_mut(pitch).zip(image.chunks_exact(width)) {
                row[..halo].fill(0.0);
                row[halo..halo + width].copy_from_slice(line);
                row[halo + width..].fill(0.0);
            }
        });
        Self { numbers, pitch, plane }
    }
}

impl Drop for Padded {
    fn drop(&mut self) {
        let mut pool = POOL.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        if pool.len() < KEPT {
            pool.push(std::mem::take(&mut self.numbers));
        }
    }
}

fn take() -> Vec<f32> {
    POOL.lock().unwrap_or_else(|poisoned| poisoned.into_inner()).pop().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn borders_are_zero_even_in_used_memory() {
        for _ in 0..3 {
            let padded = Padded::new(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0], 2, 2, 1);
            assert_eq!((padded.pitch, padded.plane), (4, 32));
            let want = [0., 0., 0., 0., 0., 1., 2., 0., 0., 3., 4., 0., 0., 0., 0., 0.];
            assert_eq!(padded.numbers[..16], want);
            assert!(padded.numbers[16..32].iter().all(|&x| x == 0.0));
            assert_eq!(padded.numbers[32 + 5], 5.0);
            assert!(padded.numbers[48..].iter().all(|&x| x == 0.0));
            drop(padded);
            let mut dirty = Padded::new(&[f32::NAN; 64], 8, 8, 0);
            dirty.numbers.fill(f32::NAN);
        }
    }
}
