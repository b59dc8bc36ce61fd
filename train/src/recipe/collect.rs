//! Walks through all maps with the networks as they are, in parallel.

use super::sample;
use crate::interrupt;
use crate::memory::PackedSample;
use nbp_env::nbv::{CollectConfig, NbvConfig, NbvPredictor, NbvSample, collect_samples};
use nbp_env::parallel::try_map;
use nbp_env::{PredictError, SeedTree, World};
use std::sync::Arc;

/// Why there are no samples.
#[derive(Debug, thiserror::Error)]
pub enum CollectError {
    /// The network failed.
    #[error(transparent)]
    Predict(#[from] PredictError),
    /// Ctrl-C.
    #[error("interrupted")]
    Interrupted,
}

/// The samples of `walks` walks through each world, packed, in order; they do not depend on the number of threads.
///
/// # Errors
/// When the predictor fails or the user interrupts.
pub fn samples(
    worlds: &[Arc<World>],
    walks: usize,
    predictor: Option<&dyn NbvPredictor>,
    nbv: &NbvConfig,
    collect: &CollectConfig,
    seed: SeedTree,
    on_done: impl Fn(&World, usize) + Sync,
) -> Result<Vec<PackedSample>, CollectError> {
    let jobs: Vec<(usize, usize)> = (0..worlds.len()).flat_map(|w| (0..walks).map(move |n| (w, n))).collect();
    let found = try_map(&jobs, |&(w, n)| {
        if interrupt::asked() {
            return Err(CollectError::Interrupted);
        }
        let seed = seed.child("world", w as u64).child("walk", n as u64);
        let samples = collect_samples(&worlds[w], predictor, nbv, collect, seed)?;
        let useful: Vec<PackedSample> = samples.iter().filter(|sample| is_useful(sample)).map(packed).collect();
        on_done(&worlds[w], useful.len());
        Ok(useful)
    })?;
    Ok(found.into_iter().flatten().collect())
}

/// Whether there is anything to learn from it.
fn is_useful(sample: &NbvSample) -> bool {
    sample.occupancy.iter().any(|input| !input.queries.is_empty()) || sample.gains.len() > 1
}

fn packed(whole: &NbvSample) -> PackedSample {
    PackedSample::of_bytes(&sample::pack(whole))
}
