//! Every point of the reconstruction, for export, pictures and policies that want more than the grids.
//!
//! Points are kept as what they are made of, a pixel and its depth: half the memory of positions, and the same positions
//! to the bit.

use crate::seed::Rng;
use crate::sensor::{Frame, PosedCamera};
use glam::Vec3;

/// Points in the order in which they were kept.
#[derive(Debug, Clone, Default)]
pub struct Cloud {
    shots: Vec<Shot>,
    len: usize,
}

/// The points of one frame.
#[derive(Debug, Clone)]
struct Shot {
    eye: PosedCamera,
    width: usize,
    len: usize,
    /// From each kept pixel to the next in row-major order, with entries of depth 0 on the way where it is farther than
    /// `u16` counts.
    gaps: Box<[u16]>,
    depths: Box<[f32]>,
}

impl Cloud {
    /// Adds the pixels of a frame, in ascending order, that a camera saw a surface in.
    pub fn add(&mut self, eye: PosedCamera, frame: &Frame, pixels: &[u32]) {
        let (mut gaps, mut depths) = (Vec::with_capacity(pixels.len()), Vec::with_capacity(pixels.len()));
        let mut last = 0;
        for &pixel in pixels {
            while let far @ 65_536.. = pixel - last {
                let gap = far.min(65_535);
                gaps.push(gap as u16);
                depths.push(0.0);
                last += gap;
            }
            gaps.push((pixel - last) as u16);
            depths.push(frame.depth[pixel as usize]);
            last = pixel;
        }
        self.len += pixels.len();
        let (gaps, depths) = (gaps.into(), depths.into());
        self.shots.push(Shot { eye, width: frame.width, len: pixels.len(), gaps, depths });
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.len
    }

    /// True without points.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// The points, metres.
    pub fn iter(&self) -> impl Iterator<Item = Vec3> + '_ {
        self.shots.iter().flat_map(Shot::iter)
    }

    /// Number of frames that points were kept of.
    pub fn frames(&self) -> usize {
        self.shots.len()
    }

    /// The points of the frames from number `first` on, metres.
    pub fn of_frames(&self, first: usize) -> impl Iterator<Item = Vec3> + '_ {
        self.shots.iter().skip(first).flat_map(Shot::iter)
    }

    /// The points of frame number `frame`, metres; none if there is no such frame.
    pub fn of_frame(&self, frame: usize) -> impl Iterator<Item = Vec3> + '_ {
        self.shots.get(frame).into_iter().flat_map(Shot::iter)
    }

    /// `amount` different points at random, or all if there are fewer, in the order in which they were kept.
    pub fn sample(&self, rng: &mut Rng, amount: usize) -> Vec<Vec3> {
        let mut chosen = rand::seq::index::sample(rng, self.len, amount.min(self.len)).into_vec();
        chosen.sort_unstable();
        let (mut points, mut chosen, mut first) = (Vec::with_capacity(amount), &chosen[..], 0);
        for shot in &self.shots {
            let (here, later) = chosen.split_at(chosen.partition_point(|&number| number < first + shot.len));
            let (mut of_shot, mut next) = (shot.iter(), first);
            for &number in here {
                points.extend(of_shot.nth(number - next));
                next = number + 1;
            }
            (chosen, first) = (later, first + shot.len);
        }
        points
    }

    /// Memory that it holds, bytes.
    pub fn bytes(&self) -> usize {
        let points = self.shots.iter().map(|shot| size_of_val(&*shot.gaps) + size_of_val(&*shot.depths)).sum::<usize>();
        points + self.shots.capacity() * size_of::<Shot>()
    }
}

impl Shot {
    fn iter(&self) -> impl Iterator<Item = Vec3> + '_ {
        let mut pixel = 0;
        self.gaps.iter().zip(&self.depths).filter_map(move |(&gap, &depth)| {
            pixel += usize::from(gap);
            (depth > 0.0).then(|| self.eye.unproject(pixel % self.width, pixel / self.width, depth))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::Pose;
    use crate::seed::SeedTree;
    use crate::sensor::Camera;

    #[test]
    fn points_come_back_to_the_bit_however_far_apart_their_pixels_lie() {
        let camera = Camera { width: 700, height: 400, ..Camera::default() };
        let depth: Vec<f32> = (0..280_000).map(|n| 1.0 + (n as f32 * 0.37).sin()).collect();
        let frame = Frame { width: 700, height: 400, depth, ..Frame::default() };
        let (mut cloud, mut expected) = (Cloud::default(), Vec::new());
        for (shot, pixels) in
            [vec![0, 65_535, 65_536, 131_072, 279_999], vec![], vec![5, 6, 200_000]].into_iter().enumerate()
        {
            let eye = camera.at(&Pose { position: Vec3::new(shot as f32, 1.65, 0.3), azimuth: 0.7 * shot as f32 });
            cloud.add(eye, &frame, &pixels);
            let point = |&p: &u32| eye.unproject(p as usize % 700, p as usize / 700, frame.depth[p as usize]);
            expected.extend(pixels.iter().map(point));
        }
        assert!(cloud.iter().eq(expected.iter().copied()));
        assert_eq!((cloud.len(), cloud.frames()), (8, 3));
        assert!(cloud.of_frames(1).eq(expected[5..].iter().copied()));
        let all = cloud.sample(&mut SeedTree::new(1).rng(), 99);
        assert_eq!(all, expected);
        let some = cloud.sample(&mut SeedTree::new(1).rng(), 3);
        assert!(some.len() == 3 && some.iter().all(|point| expected.contains(point)), "{some:?}");
    }
}
