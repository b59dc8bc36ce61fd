//! Random streams: one for each *thing* (scene, trajectory, epoch), never one for each thread.
//!
//! A [`SeedTree`] hashes labels and indices into a 64-bit key; [`SeedTree::rng`] opens the stream of that key. The same
//! root seed gives the same bytes whatever the thread count.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// The generator used everywhere.
pub type Rng = ChaCha8Rng;

/// A node in the tree of random streams.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SeedTree(u64);

impl SeedTree {
    /// The root of a run.
    pub fn new(seed: u64) -> Self {
        Self(mix(seed ^ 0x6e62_705f_7365_6564))
    }

    /// The child with a label and an index.
    #[must_use]
    pub fn child(&self, label: &str, index: u64) -> Self {
        let named = label.bytes().fold(mix(self.0), |key, byte| mix(key ^ u64::from(byte)));
        Self(mix(named ^ mix(index)))
    }

    /// The stream of this node.
    pub fn rng(&self) -> Rng {
        Rng::seed_from_u64(self.0)
    }

    /// The key, to seed what takes a number.
    pub fn key(&self) -> u64 {
        self.0
    }
}

/// SplitMix64's finaliser with its increment: a bijection without fixed structure.
fn mix(x: u64) -> u64 {
    let x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::Rng as _;

    #[test]
    fn labels_and_indices_open_different_streams() {
        let root = SeedTree::new(7);
        let keys = [root, root.child("a", 0), root.child("a", 1), root.child("b", 0), root.child("a", 0).child("a", 0)]
            .map(|tree| tree.key());
        let unique: std::collections::BTreeSet<_> = keys.into_iter().collect();
        assert_eq!(unique.len(), keys.len());
    }

    #[test]
    fn streams_repeat() {
        let draw = || SeedTree::new(3).child("scene", 5).rng().next_u64();
        assert_eq!(draw(), draw());
    }
}
