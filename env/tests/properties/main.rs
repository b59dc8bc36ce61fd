//! What must hold whatever the input, tried on random cases, and what must be refused.
//!
//! Each property says how many cases it usually runs; `PROPTEST_CASES=10000 cargo test -p env --test properties` runs so many
//! of all of them, and `NBP_CASE=17 cargo test -p env --test properties NAME` the one that failed.

#![allow(clippy::unwrap_used)] // helpers of tests are tests

mod coverage;
mod map;
mod paths;
mod raster;
mod refused;
mod rollouts;
#[allow(dead_code)]
#[path = "../../benches/scenes/mod.rs"]
mod scenes;
mod visibility;
mod watertight;

use glam::Vec3;
use nbp_env::parallel::try_map;
use nbp_env::{Rng, SeedTree};
use rand::RngExt as _;

/// Cases of a property that costs little.
const MANY: u64 = 10_000;

/// Says which case it was when one fails.
struct Case<'a>(&'a str, u64);

impl Drop for Case<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            eprintln!("case {1} of {0}: NBP_CASE={1} cargo test -p env --test properties {0}", self.0, self.1);
        }
    }
}

/// Calls `check` with a stream of its own for each of `usual` cases, or as many as `PROPTEST_CASES` says.
fn for_all(name: &str, usual: u64, check: impl Fn(&mut Rng) + Sync) {
    let number = |variable: &str| std::env::var(variable).ok().and_then(|text| text.parse::<u64>().ok());
    let cases = match number("NBP_CASE") {
        Some(one) => one..one + 1,
        None => 0..number("PROPTEST_CASES").unwrap_or(usual),
    };
    // Not rayon: a case may wait for a pool of its own, and the thread would begin other cases meanwhile, one in another.
    let cases: Vec<u64> = cases.collect();
    let run = |&case: &u64| {
        let _case = Case(name, case);
        check(&mut SeedTree::new(case).child(name, 0).rng());
        Ok::<(), ()>(())
    };
    drop(try_map(&cases, run));
}

/// Uniform in a cube around the origin.
fn point(rng: &mut Rng, reach: f32) -> Vec3 {
    Vec3::from([(); 3].map(|()| rng.random_range(-reach..reach)))
}
