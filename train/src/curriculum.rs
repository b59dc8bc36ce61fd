//! Which samples are learnt from when: easy ones first, new and old ones in balance (paper, Algorithm 1).

use crate::config::CurriculumConfig;
use crate::memory::{Memory, PackedSample};
use nbp_env::SeedTree;
use rand::seq::SliceRandom;

/// Keeps what the iteration may learn from: in the first `easy_iterations`, only samples of steps `t ≥ easy_step`, since
/// an agent that has seen little cannot be asked much.
pub fn admit(samples: Vec<PackedSample>, iteration: usize, config: &CurriculumConfig) -> Vec<PackedSample> {
    let is_easy_phase = iteration < config.easy_iterations;
    samples.into_iter().filter(|sample| !is_easy_phase || sample.step >= config.easy_step).collect()
}

/// Indices of the iteration's training set: all its new samples and as many of the older ones, drawn at random.
pub fn balanced(memory: &Memory, iteration: usize, seed: SeedTree) -> Vec<usize> {
    let is_new = |&index: &usize| memory.iteration(index) == Some(iteration);
    let (mut set, mut old): (Vec<usize>, Vec<usize>) = (0..memory.len()).partition(is_new);
    old.shuffle(&mut seed.rng());
    old.truncate(set.len());
    set.extend(old);
    set
}

/// The set in this epoch's order.
pub fn shuffled(set: &[usize], seed: SeedTree) -> Vec<usize> {
    let mut order = set.to_vec();
    order.shuffle(&mut seed.rng());
    order
}

#[cfg(test)]
mod tests {
    use super::*;
    use nbp_env::EncoderInput;
    use nbp_env::label::Sample;
    use nbp_env::window::{Window, WindowSize};

    fn samples(steps: std::ops::Range<usize>) -> Vec<PackedSample> {
        let window = Window { size: WindowSize { pixels: 16, metres: 10.0 }, centre: [0, 0], height: 1.65 };
        let input = EncoderInput { window, channels: 1, counts: vec![0; 256] };
        let sample = |step| Sample { input: input.clone(), step, labels: Vec::new(), obstacles: vec![0; 256] };
        steps.map(|step| PackedSample::new(&sample(step))).collect()
    }

    #[test]
    fn early_steps_wait_for_later_iterations() {
        let config = CurriculumConfig { easy_iterations: 1, easy_step: 10 };
        assert_eq!(admit(samples(0..25), 0, &config).len(), 15);
        assert_eq!(admit(samples(0..25), 1, &config).len(), 25);
    }

    #[test]
    fn new_and_replayed_samples_are_in_balance() {
        let folder = tempfile::tempdir().unwrap();
        let mut memory = Memory::open(&folder.path().join("memory.bin")).unwrap();
        memory.append(0, &samples(0..30)).unwrap();
        memory.append(1, &samples(0..12)).unwrap();
        let set = balanced(&memory, 1, SeedTree::new(1));
        assert_eq!((set.len(), set.iter().filter(|&&i| i >= 30).count()), (24, 12));
        assert_eq!(balanced(&memory, 0, SeedTree::new(1)).len(), 42, "all of the new, as many old as there are");
        let unique: std::collections::BTreeSet<_> = set.iter().collect();
        assert_eq!(unique.len(), set.len());
        assert_ne!(shuffled(&set, SeedTree::new(1)), shuffled(&set, SeedTree::new(2)));
    }
}
