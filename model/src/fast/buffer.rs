//! Memory that is used again, and images with a border of zeros in it.

use rayon::prelude::*;
use std::ops::{Deref, DerefMut};
use std::sync::Mutex;

/// Zeros after each plane: the last vector of a line may reach so far, and must not meet the next plane's pixels.
const TAIL: usize = 16;
/// Numbers after the last plane that a kernel may read (and ignore).
const SLACK: usize = 64;

/// Memory kept for the next call: fresh pages from the system cost more than filling them.
static POOL: Mutex<Vec<Vec<f32>>> = Mutex::new(Vec::new());
const KEPT: usize = 8;

/// Numbers of no particular value at first, in memory that is used again.
#[derive(Debug)]
pub(super) struct Buffer {
    memory: Vec<f32>,
    len: usize,
}

impl Buffer {
    pub(super) fn take(len: usize) -> Self {
        let mut memory = if len > 0 { Self::fitting(len) } else { Vec::new() };
        if memory.len() < len {
            // What it held is not worth copying.
            memory.clear();
            memory.resize(len, 0.0);
        }
        Self { memory, len }
    }

    /// The smallest of the pool that is large enough, or else the largest.
    fn fitting(len: usize) -> Vec<f32> {
        let mut pool = POOL.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        let key = |memory: &Vec<f32>| if memory.len() < len { usize::MAX - memory.len() } else { memory.len() };
        let fitting = pool.iter().enumerate().min_by_key(|(_, memory)| key(memory)).map(|(index, _)| index);
        fitting.map(|index| pool.swap_remove(index)).unwrap_or_default()
    }
}

impl Deref for Buffer {
    type Target = [f32];

    fn deref(&self) -> &[f32] {
        &self.memory[..self.len]
    }
}

impl DerefMut for Buffer {
    fn deref_mut(&mut self) -> &mut [f32] {
        &mut self.memory[..self.len]
    }
}

impl Drop for Buffer {
    fn drop(&mut self) {
        let mut pool = POOL.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        if !self.memory.is_empty() && pool.len() < KEPT {
            pool.push(std::mem::take(&mut self.memory));
        }
    }
}

/// Planes of `height × width`, each with a border of `halo` zeros, seen as one line of numbers.
///
/// Pixel `(y, x)` of a plane is `(y + halo) · pitch + x + halo`, so a kernel's tap at `(dy, dx)` lies at the same distance
/// from every pixel and a convolution is a sum of shifted lines, whatever the width.
#[derive(Debug)]
pub(super) struct Padded {
    /// All planes, then at least [`SLACK`] zeros.
    pub(super) numbers: Buffer,
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
        let mut numbers = Buffer::take(len + SLACK);
        // What a kernel reads past the end is multiplied by zeros, which a stale NaN would survive.
        numbers[len..len + SLACK].fill(0.0);
        let (top, inner) = (halo * pitch, height * pitch);
        numbers[..len].par_chunks_mut(plane).zip(source.par_chunks(height * width)).for_each(|(padded, image)| {
            padded[..top].fill(0.0);
            padded[top + inner..].fill(0.0);
            for (y, row) in padded[top..top + inner].chunks_exact_mut(pitch).enumerate() {
                row[..halo].fill(0.0);
                row[halo + width..].fill(0.0);
                row[halo..halo + width].copy_from_slice(&image[y * width..(y + 1) * width]);
            }
        });
        Self { numbers, pitch, plane }
    }

    /// Where the first pixel lies in its plane.
    pub(super) fn first_pixel(&self, halo: usize) -> usize {
        halo * (self.pitch + 1)
    }
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
            assert!(padded.numbers[48..64 + SLACK].iter().all(|&x| x == 0.0));
            drop(padded);
            let mut dirty = Padded::new(&[f32::NAN; 64], 8, 8, 0);
            dirty.numbers.fill(f32::NAN);
        }
    }
}
