//! Whether a policy forgets what it must, takes its chance from where it must, and learns from walls.

use super::Fault;
use crate::episode::{Action, Episode};
use crate::policy::Policy;
use crate::seed::SeedTree;
use crate::world::World;
use std::sync::Arc;

/// Episodes for which a policy is tried, and their steps.
const EPISODES: u64 = 2;
const STEPS: usize = 40;

/// What is wrong with a policy, tried for a few episodes in a world; empty if nothing.
pub fn check_policy(policy: &mut dyn Policy, world: &Arc<World>) -> Vec<Fault> {
    let mut faults = Vec::new();
    for number in 0..EPISODES {
        let seed = SeedTree::new(number).child("check", 0);
        let first = match rollout(policy, world, seed, &mut faults) {
            Ok(actions) => actions,
            Err(fault) => return vec![fault],
        };
        let second = match rollout(policy, world, seed, &mut Vec::new()) {
            Ok(actions) => actions,
            Err(fault) => return vec![fault],
        };
        if let Some(step) = first.iter().zip(&second).position(|(a, b)| a != b) {
            faults.push(Fault::PolicyVaries { step, first: first[step], second: second[step] });
        }
    }
    faults
}

fn rollout(
    policy: &mut dyn Policy,
    world: &Arc<World>,
    seed: SeedTree,
    faults: &mut Vec<Fault>,
) -> Result<Vec<Action>, Fault> {
    let mut episode = Episode::random(Arc::clone(world), STEPS, seed);
    let (mut rng, mut actions) = (seed.child("policy", 0).rng(), Vec::new());
    policy.begin();
    while !episode.is_over() {
        let step = episode.steps();
        let action =
            policy.act(&episode.view(), &mut rng).map_err(|error| Fault::Failed { step, reason: error.to_string() })?;
        let pose = episode.pose();
        if let (true, Some(direction)) = (episode.step(action).bumped, action.direction) {
            // Three are the common rule's limit for one edge.
            let count = episode.view().bumps(pose.node, pose.node.step(direction));
            if count == 4 {
                faults.push(Fault::RepeatedBumps { pose, count });
            }
        }
        actions.push(action);
    }
    Ok(actions)
}

#[cfg(test)]
mod tests {
    use super::super::tests::SMALL;
    use super::*;
    use crate::config::SimConfig;
    use crate::map::MapView;
    use crate::policy::{PolicyError, fbe::Fbe, random::Random};
    use crate::pose::{Direction, Heading};
    use crate::scene::Scene;
    use crate::seed::Rng;

    /// Walks north, and never looks where it goes; may remember how many actions it took.
    struct Stubborn {
        remembers: bool,
        taken: usize,
    }

    impl Policy for Stubborn {
        fn name(&self) -> &'static str {
            "stubborn"
        }

        fn begin(&mut self) {
            self.taken *= usize::from(self.remembers);
        }

        fn act(&mut self, _: &MapView<'_>, _: &mut Rng) -> Result<Action, PolicyError> {
            self.taken += 1;
            Ok(Action { direction: Some(Direction::PlusZ), heading: Heading::new(self.taken % 7) })
        }
    }

    #[test]
    fn policies_that_forget_nothing_or_learn_nothing_are_found_out() {
        let config = SimConfig { camera: SMALL, ..SimConfig::default() };
        let world = Arc::new(World::new(Scene::two_rooms(), &config).unwrap());
        assert_eq!(check_policy(&mut Random, &world), []);
        assert_eq!(check_policy(&mut Fbe::default(), &world), []);
        let faults = |remembers| check_policy(&mut Stubborn { remembers, taken: 1 }, &world);
        assert!(faults(false).iter().all(|fault| matches!(fault, Fault::RepeatedBumps { .. })));
        assert!(faults(true).iter().any(|fault| matches!(fault, Fault::PolicyVaries { step: 0, .. })));
    }
}
