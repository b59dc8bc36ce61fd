//! One body of code, compiled for several instruction sets, and the choice among them at run time.
//!
//! The loops of this module work on arrays of 8 and 16 numbers without any intrinsics. Compiled for the baseline of the
//! target (SSE2 on x86-64, NEON on ARM) they are correct anywhere; compiled again for wider registers they are faster.
//! No instruction set fuses products with sums here, so all give the same bits, which a test checks.

use super::image::Image;
use super::index::RasterIndex;
use super::pyramid::Pyramid;
use super::view::View;
use super::walk::{Queue, walk};
use crate::sensor::colour::Painting;
use crate::sensor::{Camera, Frame};
use std::sync::LazyLock;

/// Memory that one frame leaves to the next on the same thread.
#[derive(Default)]
pub(super) struct Scratch {
    pyramid: Pyramid,
    queue: Queue,
}

/// A set of instructions that this machine has. Made by [`InstructionSet::available`] only, so that holding one proves
/// that its instructions may be run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InstructionSet(Set);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Set {
    Baseline,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl InstructionSet {
    /// Those that the rasteriser was compiled for and this machine has, from the narrowest to the widest.
    pub fn available() -> impl DoubleEndedIterator<Item = Self> {
        #[cfg(target_arch = "x86_64")]
        let all = {
            use std::arch::is_x86_feature_detected as has;
            let avx2 = has!("avx2") && has!("bmi1") && has!("bmi2") && has!("lzcnt") && has!("popcnt");
            let avx512 = avx2 && has!("avx512f") && has!("avx512vl") && has!("avx512dq") && has!("avx512bw");
            [Some(Self(Set::Baseline)), avx2.then_some(Self(Set::Avx2)), avx512.then_some(Self(Set::Avx512))]
        };
        #[cfg(not(target_arch = "x86_64"))]
        let all = [Some(Self(Set::Baseline))];
        all.into_iter().flatten()
    }

    /// The fastest available. AVX-512 is not: measured on Zen 5, AVX2 is 3 to 8 % ahead of it.
    pub fn best() -> Self {
        // Asked once: the answer of the machine does not change.
        static BEST: LazyLock<InstructionSet> = LazyLock::new(|| {
            let is_narrow = |set: &InstructionSet| match set.0 {
                Set::Baseline => true,
                #[cfg(target_arch = "x86_64")]
                Set::Avx2 => true,
                #[cfg(target_arch = "x86_64")]
                Set::Avx512 => false,
            };
            InstructionSet::available().rfind(is_narrow).unwrap_or(InstructionSet(Set::Baseline))
        });
        *BEST
    }

    /// Name for tables.
    pub fn name(&self) -> &'static str {
        match self.0 {
            Set::Baseline => "baseline",
            #[cfg(target_arch = "x86_64")]
            Set::Avx2 => "AVX2",
            #[cfg(target_arch = "x86_64")]
            Set::Avx512 => "AVX-512",
        }
    }

    /// Writes the colours of an image.
    #[allow(unsafe_code)]
    pub(in crate::sensor) fn paint(self, painting: &Painting, triangles: &[u32], out: &mut [[u8; 3]]) {
        match self.0 {
            Set::Baseline => painting.paint_runs(triangles, out),
            // SAFETY: as in `draw`.
            #[cfg(target_arch = "x86_64")]
            Set::Avx2 => unsafe { paint_avx2(painting, triangles, out) },
            // SAFETY: as in `draw`.
            #[cfg(target_arch = "x86_64")]
            Set::Avx512 => unsafe { paint_avx512(painting, triangles, out) },
        }
    }

    /// Draws one image; with `MARKED`, leaves the triangles that it shows in `marks`.
    #[allow(unsafe_code)]
    pub(super) fn draw<const MARKED: bool>(
        self,
        index: &RasterIndex,
        camera: &Camera,
        view: &View,
        scratch: &mut Scratch,
        marks: &mut Vec<u32>,
        out: &mut Frame,
    ) {
        match self.0 {
            Set::Baseline => draw::<MARKED>(index, camera, view, scratch, marks, out),
            // SAFETY: the bodies are safe code that needs the named features, and `available` found them.
            #[cfg(target_arch = "x86_64")]
            Set::Avx2 => unsafe { draw_avx2::<MARKED>(index, camera, view, scratch, marks, out) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Set::Avx512 => unsafe { draw_avx512::<MARKED>(index, camera, view, scratch, marks, out) },
        }
    }
}

#[inline(always)]
fn draw<const MARKED: bool>(
    index: &RasterIndex,
    camera: &Camera,
    view: &View,
    scratch: &mut Scratch,
    marks: &mut Vec<u32>,
    out: &mut Frame,
) {
    let mut image = Image::<MARKED>::start(camera, view.far, &mut scratch.pyramid, marks, out);
    walk(index, view, &mut image, &mut scratch.queue);
    image.finish(view.far);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
fn draw_avx2<const MARKED: bool>(
    index: &RasterIndex,
    camera: &Camera,
    view: &View,
    scratch: &mut Scratch,
    marks: &mut Vec<u32>,
    out: &mut Frame,
) {
    draw::<MARKED>(index, camera, view, scratch, marks, out);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt,avx512f,avx512vl,avx512dq,avx512bw")]
fn draw_avx512<const MARKED: bool>(
    index: &RasterIndex,
    camera: &Camera,
    view: &View,
    scratch: &mut Scratch,
    marks: &mut Vec<u32>,
    out: &mut Frame,
) {
    draw::<MARKED>(index, camera, view, scratch, marks, out);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
fn paint_avx2(painting: &Painting, triangles: &[u32], out: &mut [[u8; 3]]) {
    painting.paint_runs(triangles, out);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt,avx512f,avx512vl,avx512dq,avx512bw")]
fn paint_avx512(painting: &Painting, triangles: &[u32], out: &mut [[u8; 3]]) {
    painting.paint_runs(triangles, out);
}
