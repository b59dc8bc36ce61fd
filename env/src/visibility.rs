//! What every lattice pose sees, computed once and asked often: coverage gains for labels, oracles and search.
//!
//! A pose sees the ground-truth points that its full frame covers ([`Coverage`], every pixel kept), or glimpses those that the
//! pixels of it cover which an episode would keep. Points are ordered
//! along a Morton curve, so that what one pose sees falls into few 64-bit words, and only those are stored. Poses are
//! computed when they are first asked for, from any thread.

use crate::coverage::Coverage;
use crate::map::Kept;
use crate::pose::{HEADINGS, Lattice, LatticePose};
use crate::seed::SeedTree;
use crate::sensor::Frame;
use crate::visible::visible_points;
use crate::world::World;
use glam::Vec3;
use std::cell::RefCell;
use std::sync::{Mutex, OnceLock, PoisonError};

/// Bits of each axis in a Morton code.
const MORTON_BITS: u32 = 16;

/// A set of ground-truth points of one world, in the order of its [`Visibility`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PointSet {
    words: Vec<u64>,
}

impl PointSet {
    /// Number of points in the set.
    pub fn len(&self) -> usize {
        self.words.iter().map(|word| word.count_ones() as usize).sum()
    }

    /// True without points.
    pub fn is_empty(&self) -> bool {
        self.words.iter().all(|&word| word == 0)
    }
}

/// The words of a [`PointSet`] in which a pose sees something.
#[derive(Debug)]
struct Seen {
    words: Box<[u32]>,
    bits: Box<[u64]>,
}

/// What has been computed for the lattice poses of one world.
#[derive(Debug)]
pub(crate) struct VisibilityCache {
    /// Place of each ground-truth point along the curve.
    rank: Vec<u32>,
    views: Vec<OnceLock<Seen>>,
    /// Share of the pixels that count.
    keep: f32,
    /// One for each thread that looks, covering nothing in between.
    scratch: Mutex<Vec<Coverage>>,
}

impl VisibilityCache {
    /// Nothing is computed yet. Of each frame a share of `keep` counts.
    pub(crate) fn new(points: &[Vec3], lattice: &Lattice, keep: f32) -> Self {
        let views = (0..lattice.len() * HEADINGS).map(|_| OnceLock::new()).collect();
        Self { rank: morton_ranks(points), views, keep, scratch: Mutex::default() }
    }
}

/// What the lattice poses of one world see: [`World::visibility`].
#[derive(Debug, Clone, Copy)]
pub struct Visibility<'a> {
    world: &'a World,
    cache: &'a VisibilityCache,
}

impl<'a> Visibility<'a> {
    pub(crate) fn new(world: &'a World, cache: &'a VisibilityCache) -> Self {
        Self { world, cache }
    }

    /// No points.
    pub fn nothing(&self) -> PointSet {
        PointSet { words: vec![0; self.cache.rank.len().div_ceil(64)] }
    }

    /// The points that an episode in this world has covered.
    pub fn covered_by(&self, coverage: &Coverage) -> PointSet {
        let points = 0..self.cache.rank.len();
        self.set_of(points.filter(|&point| coverage.first_step(point).is_some()))
    }

    /// All points that can be seen, see [`visible_points`]. Takes as long as looking from every pose, and is not kept.
    pub fn visible(&self) -> PointSet {
        let points = visible_points(self.world.scene(), self.world.surface(), *self.world.sensor().camera());
        self.set_of(points.into_iter().map(|point| point as usize))
    }

    /// The points of a set by their number in [`World::surface`], ascending.
    pub fn points(&self, set: &PointSet) -> Vec<u32> {
        let is_in = |&(_, &rank): &(u32, &u32)| set.words[rank as usize / 64] >> (rank % 64) & 1 == 1;
        (0..).zip(&self.cache.rank).filter(is_in).map(|(point, _)| point).collect()
    }

    fn set_of(&self, points: impl Iterator<Item = usize>) -> PointSet {
        let mut set = self.nothing();
        for rank in points.map(|point| self.cache.rank[point]) {
            set.words[rank as usize / 64] |= 1 << (rank % 64);
        }
        set
    }

    /// How many points a pose sees that are not in `covered`; 0 outside the lattice.
    pub fn gain(&self, pose: LatticePose, covered: &PointSet) -> usize {
        let Some(seen) = self.seen(pose) else { return 0 };
        let new = seen.words.iter().zip(&seen.bits).map(|(&word, &bits)| bits & !covered.words[word as usize]);
        new.map(|bits| bits.count_ones() as usize).sum()
    }

    /// Adds what a pose sees to `covered`, and returns how many points are new.
    pub fn cover(&self, pose: LatticePose, covered: &mut PointSet) -> usize {
        let Some(seen) = self.seen(pose) else { return 0 };
        let mut gain = 0;
        for (&word, &bits) in seen.words.iter().zip(&seen.bits) {
            let known = &mut covered.words[word as usize];
            gain += (bits & !*known).count_ones() as usize;
            *known |= bits;
        }
        gain
    }

    /// Memory of what has been computed, bytes.
    pub fn bytes(&self) -> usize {
        let views = self.cache.views.iter().filter_map(OnceLock::get);
        views.map(|seen| size_of_val(&*seen.words) + size_of_val(&*seen.bits)).sum::<usize>()
            + self.cache.views.len() * size_of::<OnceLock<Seen>>()
            + self.cache.rank.len() * size_of::<u32>()
    }

    fn seen(&self, pose: LatticePose) -> Option<&'a Seen> {
        let lattice = self.world.scene().lattice();
        let index = lattice.index(pose.node)? * HEADINGS + pose.heading.index();
        Some(self.cache.views[index].get_or_init(|| self.look(lattice, pose, index)))
    }

    fn look(&self, lattice: &Lattice, pose: LatticePose, index: usize) -> Seen {
        thread_local! {
            static SCRATCH: RefCell<(Frame, Vec<Vec3>)> = RefCell::default();
        }
        let (world, pose) = (self.world, lattice.pose(pose));
        let scratch = || self.cache.scratch.lock().unwrap_or_else(PoisonError::into_inner);
        let mut coverage = scratch().pop().unwrap_or_else(|| Coverage::new(world.surface()));
        let seen = SCRATCH.with_borrow_mut(|(frame, points)| {
            let camera = world.sensor().camera();
            world.sensor().capture(world.scene(), &pose, frame);
            if self.cache.keep < 1.0 {
                let mut rng = SeedTree::new(0).child("glimpse", index as u64).rng();
                *points = Kept::draw(camera, &pose, frame, self.cache.keep, &mut rng).points;
            } else {
                points.clear();
                points.extend(frame.points(camera.at(&pose)));
            }
            self.sparse(&coverage.glance(world.surface(), points))
        });
        scratch().push(coverage);
        seen
    }

    fn sparse(&self, points: &[u32]) -> Seen {
        let mut ranks: Vec<u32> = points.iter().map(|&point| self.cache.rank[point as usize]).collect();
        ranks.sort_unstable();
        let (mut words, mut bits): (Vec<u32>, Vec<u64>) = Default::default();
        for rank in ranks {
            if words.last() != Some(&(rank / 64)) {
                words.push(rank / 64);
                bits.push(0);
            }
            if let Some(last) = bits.last_mut() {
                *last |= 1 << (rank % 64);
            }
        }
        Seen { words: words.into(), bits: bits.into() }
    }
}

/// Place of each point along a Morton curve through their box.
fn morton_ranks(points: &[Vec3]) -> Vec<u32> {
    let first = points.first().copied().unwrap_or_default();
    let [low, high] = points.iter().fold([first; 2], |[low, high], &p| [low.min(p), high.max(p)]);
    // One scale for all axes: neighbours in space are to be neighbours on the curve.
    let scale = ((1_u32 << MORTON_BITS) - 1) as f32 / (high - low).max_element().max(f32::MIN_POSITIVE);
    let code = |p: Vec3| {
        let [x, y, z] = ((p - low) * scale).to_array().map(|v| spread_bits(v as u64));
        x << 2 | y << 1 | z
    };
    let mut order: Vec<u32> = (0..points.len() as u32).collect();
    order.sort_by_cached_key(|&point| (code(points[point as usize]), point));
    let mut rank = vec![0; points.len()];
    order.iter().enumerate().for_each(|(place, &point)| rank[point as usize] = place as u32);
    rank
}

/// The lowest bits of a number, two zero bits between each two of them.
fn spread_bits(value: u64) -> u64 {
    (0..MORTON_BITS).map(|bit| (value >> bit & 1) << (3 * bit)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::SimConfig;
    use crate::pose::{Heading, Node};
    use crate::scene::Scene;
    use crate::sensor::Camera;
    use rayon::prelude::*;
    use std::sync::Arc;

    fn world() -> Arc<World> {
        let camera = Camera { width: 112, height: 64, ..Camera::default() };
        let config = SimConfig { camera, keep: 1.0, captures: 1, ..SimConfig::default() };
        Arc::new(World::new(Scene::two_rooms(), &config).unwrap())
    }

    #[test]
    fn gains_are_those_of_the_episode() {
        let world = world();
        let visibility = world.visibility();
        let start = LatticePose { node: Node { i: 1, k: 2 }, heading: Heading::new(0) };
        let mut episode = crate::Episode::new(Arc::clone(&world), start, 8, crate::SeedTree::new(1)).unwrap();
        let mut covered = visibility.nothing();
        assert_eq!(visibility.cover(start, &mut covered), episode.covered()[0]);
        for heading in (1..=8).map(Heading::new) {
            let pose = LatticePose { heading, ..start };
            let gain = visibility.gain(pose, &covered);
            episode.step(crate::Action { direction: None, heading });
            assert_eq!(visibility.cover(pose, &mut covered), gain);
            assert_eq!(covered.len(), episode.covered()[episode.steps()]);
            assert_eq!(covered, visibility.covered_by(episode.coverage()));
        }
    }

    #[test]
    fn order_of_questions_and_threads_do_not_matter() {
        let (lazy, eager) = (world(), world());
        let nodes = lazy.scene().graph().largest_component();
        let poses: Vec<LatticePose> =
            nodes.iter().flat_map(|&node| Heading::all().map(move |heading| LatticePose { node, heading })).collect();
        let nothing = eager.visibility().nothing();
        let gains: Vec<usize> = poses.par_iter().map(|&pose| eager.visibility().gain(pose, &nothing)).collect();
        let mut seen = lazy.visibility().nothing();
        for &pose in poses.iter().rev() {
            lazy.visibility().cover(pose, &mut seen);
        }
        assert!(poses.iter().zip(gains).all(|(&pose, gain)| lazy.visibility().gain(pose, &nothing) == gain));
        assert_eq!(lazy.visibility().bytes(), eager.visibility().bytes());
        let share = seen.len() as f32 / lazy.surface().len() as f32;
        assert!((0.95..=1.0).contains(&share), "{share}");
        let outside = LatticePose { node: Node { i: -1, k: 0 }, heading: Heading::new(0) };
        assert_eq!(lazy.visibility().gain(outside, &lazy.visibility().nothing()), 0);
    }

    #[test]
    fn a_glimpse_is_what_the_kept_share_of_a_frame_covers() {
        let with = |keep| {
            let config = SimConfig { keep, ..world().config().clone() };
            Arc::new(World::new(Scene::two_rooms(), &config).unwrap())
        };
        let pose = LatticePose { node: Node { i: 1, k: 2 }, heading: Heading::new(1) };
        let (all, few) = (with(1.0), with(0.01));
        let count = |visibility: Visibility<'_>| visibility.gain(pose, &visibility.nothing());
        assert_eq!(count(all.glimpses()), count(all.visibility()));
        assert_eq!(count(few.visibility()), count(all.visibility()));
        let (mut seen, mut glimpsed) = (few.visibility().nothing(), few.glimpses().nothing());
        few.visibility().cover(pose, &mut seen);
        assert_eq!(few.glimpses().cover(pose, &mut glimpsed), few.glimpses().gain(pose, &few.glimpses().nothing()));
        assert_eq!(few.glimpses().gain(pose, &seen), 0, "what is glimpsed is seen");
        assert!(
            glimpsed.len() > seen.len() / 10 && glimpsed.len() < seen.len(),
            "{} of {}",
            glimpsed.len(),
            seen.len()
        );
    }

    #[test]
    fn ranks_are_a_permutation_and_neighbours_stay_near() {
        let points: Vec<Vec3> =
            (0..512).map(|n| Vec3::new((n % 8) as f32, (n / 8 % 8) as f32, (n / 64) as f32)).collect();
        let ranks = morton_ranks(&points);
        let mut sorted = ranks.clone();
        sorted.sort_unstable();
        assert!(sorted.iter().enumerate().all(|(n, &rank)| n == rank as usize));
        let block: Vec<u32> = (0..512).filter(|&n| points[n].max_element() < 4.0).map(|n| ranks[n]).collect();
        assert_eq!(block.iter().max().unwrap() - block.iter().min().unwrap(), 63, "an octant is one word");
        assert!(morton_ranks(&[]).is_empty());
    }
}
