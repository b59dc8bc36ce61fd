//! Whether a policy forgets what it must, takes its chance from where it must, and learns from walls.

use super::Fault;
use crate::episode::{Action, Decision, Episode};
use crate::motion::Agent;
use crate::policy::{Policy, PolicyError, decide};
use crate::seed::{Rng, SeedTree};
use crate::world::World;
use std::sync::Arc;

/// Episodes for which a policy is tried.
const EPISODES: u64 = 2;

/// Their steps: actions, or in the continuous world motions, of which an action takes about ten.
const STEPS: usize = 40;
const MOTIONS: usize = 400;

/// How a policy is asked.
type Ask = fn(&mut dyn Policy, &Episode, &mut Rng) -> Result<Decision, PolicyError>;

/// What is wrong with a policy, tried for a few episodes in a world; empty if nothing. Where the agent is continuous it is
/// tried twice: as [`decide`] asks it, and by its actions alone, which it must have for the lattice world.
pub fn check_policy(policy: &mut dyn Policy, world: &Arc<World>) -> Vec<Fault> {
    let act: Ask = |policy, episode, rng| policy.act(&episode.view(), rng).map(Decision::Action);
    let ways: &[Ask] = if is_continuous(world) { &[decide, act] } else { &[decide] };
    let mut faults = Vec::new();
    for (&ask, number) in ways.iter().flat_map(|ask| (0..EPISODES).map(move |number| (ask, number))) {
        let seed = SeedTree::new(number).child("check", 0);
        let first = match rollout(policy, ask, world, seed, &mut faults) {
            Ok(actions) => actions,
            Err(fault) => return vec![fault],
        };
        let second = match rollout(policy, ask, world, seed, &mut Vec::new()) {
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
    ask: Ask,
    world: &Arc<World>,
    seed: SeedTree,
    faults: &mut Vec<Fault>,
) -> Result<Vec<Decision>, Fault> {
    let steps = if is_continuous(world) { MOTIONS } else { STEPS };
    let mut episode = Episode::random(Arc::clone(world), steps, seed);
    let (mut rng, mut decisions) = (seed.child("policy", 0).rng(), Vec::new());
    policy.begin();
    while !episode.is_over() {
        let step = episode.steps();
        let decision =
            ask(policy, &episode, &mut rng).map_err(|error| Fault::Failed { step, reason: error.to_string() })?;
        let pose = episode.pose();
        let bumped = episode.follow(decision).bumped;
        if let (true, Decision::Action(Action { direction: Some(direction), .. })) = (bumped, decision) {
            // Three are the common rule's limit for one edge.
            let count = episode.view().bumps(pose.node, pose.node.step(direction));
            if count == 4 {
                faults.push(Fault::RepeatedBumps { pose, count });
            }
        }
        decisions.push(decision);
    }
    Ok(decisions)
}

fn is_continuous(world: &World) -> bool {
    matches!(world.config().agent, Agent::Continuous(_))
}

#[cfg(test)]
mod tests {
    use super::super::tests::SMALL;
    use super::*;
    use crate::config::SimConfig;
    use crate::map::MapView;
    use crate::motion::{Motion, MotionConfig};
    use crate::policy::{fbe::Fbe, random::Random};
    use crate::pose::{Direction, Heading};
    use crate::predict::PredictError;
    use crate::scene::Scene;

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

    /// Walks at random, but its motions go wrong.
    struct Stumbling(fn(usize) -> Result<Option<Motion>, PolicyError>, usize);

    impl Policy for Stumbling {
        fn name(&self) -> &'static str {
            "stumbling"
        }

        fn begin(&mut self) {}

        fn act(&mut self, view: &MapView<'_>, rng: &mut Rng) -> Result<Action, PolicyError> {
            Random.act(view, rng)
        }

        fn motion(&mut self, _: &MapView<'_>, _: &mut Rng) -> Result<Option<Motion>, PolicyError> {
            self.1 += 1;
            self.0(self.1)
        }
    }

    #[test]
    fn motions_are_tried_in_the_continuous_world_and_actions_as_well() {
        let [lattice, continuous] = [Agent::Lattice {}, Agent::Continuous(MotionConfig::default())].map(|agent| {
            let config = SimConfig { agent, camera: SMALL, ..SimConfig::default() };
            Arc::new(World::new(Scene::two_rooms(), &config).unwrap())
        });
        assert_eq!(check_policy(&mut Random, &continuous), []);
        assert_eq!(check_policy(&mut Fbe::default(), &continuous), []);
        let remembers: fn(usize) -> _ = |asked| Ok(Some(Motion::ALL[asked % 3]));
        assert_eq!(check_policy(&mut Stumbling(remembers, 0), &lattice), []);
        let faults = check_policy(&mut Stumbling(remembers, 0), &continuous);
        assert!(matches!(faults[..], [Fault::PolicyVaries { first: Decision::Motion(_), .. }, ..]), "{faults:?}");
        let faults = check_policy(&mut Stumbling(|_| Err(PredictError::Backend("no".into()).into()), 0), &continuous);
        assert!(matches!(faults[..], [Fault::Failed { step: 0, .. }]), "{faults:?}");
        // Good motions do not hide bad actions.
        let faults = check_policy(&mut Turning(Stubborn { remembers: false, taken: 1 }), &continuous);
        assert!(faults.iter().any(|fault| matches!(fault, Fault::RepeatedBumps { .. })), "{faults:?}");
    }

    /// Turns on the spot as long as it is asked for motions.
    struct Turning(Stubborn);

    impl Policy for Turning {
        fn name(&self) -> &'static str {
            "turning"
        }

        fn begin(&mut self) {
            self.0.begin();
        }

        fn act(&mut self, view: &MapView<'_>, rng: &mut Rng) -> Result<Action, PolicyError> {
            self.0.act(view, rng)
        }

        fn motion(&mut self, _: &MapView<'_>, _: &mut Rng) -> Result<Option<Motion>, PolicyError> {
            Ok(Some(Motion::Left))
        }
    }
}
