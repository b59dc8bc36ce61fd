//! The continuous world as its users see it: episodes of motions, and lattice policies carried out by a pilot.

#![allow(clippy::unwrap_used)] // helpers of tests are tests

use nbp_env::pilot::arrival_distance;
use nbp_env::policy::{Policy, decide, fbe::Fbe, random::Random};
use nbp_env::sensor::Camera;
use nbp_env::{
    Action, Agent, Direction, Episode, Heading, LatticePose, Motion, MotionConfig, Node, Pose, Scene, SeedTree,
    SimConfig, World,
};
use std::sync::Arc;

fn world(motions: MotionConfig) -> Arc<World> {
    let camera = Camera { width: 96, height: 96, hfov_degrees: 90.0, range: 10.0 };
    let config = SimConfig { agent: Agent::Continuous(motions), camera, ..SimConfig::default() };
    Arc::new(World::new(Scene::two_rooms(), &config).unwrap())
}

fn begin(world: &Arc<World>, start: LatticePose, horizon: usize) -> Episode {
    Episode::new(Arc::clone(world), start, horizon, SeedTree::new(1)).unwrap()
}

fn bits(pose: Pose) -> [u32; 4] {
    let [x, y, z] = pose.position.to_array();
    [x, y, z, pose.azimuth].map(f32::to_bits)
}

#[test]
fn a_blocked_motion_changes_nothing_but_the_step() {
    let world = world(MotionConfig::default());
    let start = world.scene().starts()[0];
    let mut episode = begin(&world, start, 300);
    let mut blocked = 0;
    for step in 1..=300 {
        let before = (bits(episode.camera()), episode.path_length(), episode.pose());
        let outcome = episode.move_by(Motion::Forward);
        assert_eq!((episode.steps(), episode.curve().len(), episode.track().len()), (step, step + 1, step + 1));
        assert_eq!(episode.view().history().len(), step + 1);
        if outcome.bumped {
            blocked += 1;
            assert_eq!(before, (bits(episode.camera()), episode.path_length(), episode.pose()));
        } else {
            assert_eq!(blocked, 0, "who was blocked once stays blocked");
        }
    }
    assert!(blocked > 50 && episode.bumps() == blocked, "{blocked}");
    assert!(episode.is_over());
    let after = (bits(episode.camera()), episode.curve().len());
    assert!(!episode.move_by(Motion::Left).bumped);
    assert_eq!(after, (bits(episode.camera()), episode.curve().len()), "nothing happens after the horizon");

    let lattice = Arc::new(World::new(Scene::two_rooms(), &SimConfig::default()).unwrap());
    let mut episode = begin(&lattice, lattice.scene().starts()[0], 3);
    let start = episode.camera();
    assert!(episode.move_by(Motion::Left).bumped, "the lattice agent has no motions");
    assert_eq!((episode.steps(), episode.curve().len(), bits(episode.camera())), (1, 2, bits(start)));
}

#[test]
fn a_pilot_can_take_every_edge_of_the_true_graph() {
    for motions in [
        MotionConfig::default(),
        MotionConfig { radius: 0.1, ..MotionConfig::default() },
        MotionConfig { forward: 0.25, turn_degrees: 30.0, lattice_step: 1.5, ..MotionConfig::default() },
    ] {
        let world = world(motions);
        let scene = world.scene();
        let (mut taken, mut blocked) = (0, 0);
        let edges = scene.graph().largest_component().iter().flat_map(|&node| Direction::ALL.map(|way| (node, way)));
        for (n, (node, way)) in edges.enumerate() {
            let mut episode = begin(&world, LatticePose { node, heading: Heading::new(n) }, 200);
            let heading = Heading::new(n / 8);
            let outcome = episode.step(Action { direction: Some(way), heading });
            let target = node.step(way);
            if scene.graph().is_passable(node, target) {
                assert!(!outcome.bumped, "{node:?} {way:?}");
                let away = episode.camera().position.distance(scene.lattice().position(target));
                assert!(away <= arrival_distance(&motions) && episode.pose() == LatticePose { node: target, heading });
                assert!(episode.view().is_traversed(node, target));
                taken += 1;
            } else if outcome.bumped {
                assert!(episode.pose().node != target && episode.view().bumps(target, node) == 1);
                blocked += 1;
            }
        }
        assert!(taken > 100 && blocked > 10, "{taken} {blocked}");
    }
}

#[test]
fn after_a_bump_the_other_ways_are_still_open() {
    let world = world(MotionConfig::default());
    let graph = world.scene().graph();
    let mut tried = 0;
    for &node in graph.largest_component() {
        let open = Direction::ALL.into_iter().find(|&way| graph.can_move(node, way));
        let shut = Direction::ALL.into_iter().find(|&way| !graph.can_move(node, way));
        let (Some(open), Some(shut)) = (open, shut) else { continue };
        let heading = Heading::new(tried);
        let mut episode = begin(&world, LatticePose { node, heading }, 500);
        if episode.step(Action { direction: Some(shut), heading }).bumped {
            assert_eq!(episode.pose().node, node, "its own side of the wall");
            assert!(!episode.step(Action { direction: Some(open), heading }).bumped, "{node:?} {shut:?} {open:?}");
            assert_eq!(episode.pose(), LatticePose { node: node.step(open), heading });
            tried += 1;
        }
    }
    assert!(tried > 20, "{tried}");
}

#[test]
fn the_horizon_may_cut_an_action_anywhere() {
    let world = world(MotionConfig::default());
    let start = LatticePose { node: Node { i: 4, k: 4 }, heading: Heading::new(0) };
    // 9 turns, 8 motions, 4 turns to within 5° of 135°.
    let action = Action { direction: Some(Direction::PlusX), heading: Heading::new(3) };
    let mut whole = begin(&world, start, 100);
    assert!(!whole.step(action).bumped);
    assert_eq!(whole.steps(), 9 + 8 + 4);
    let off = (whole.camera().azimuth - Heading::new(3).azimuth()).to_degrees().abs();
    assert!((off - 5.0).abs() < 1e-3, "{off}");
    for horizon in 1..whole.steps() {
        let mut cut = begin(&world, start, horizon);
        cut.step(action);
        assert_eq!((cut.steps(), cut.curve().len(), cut.is_over()), (horizon, horizon + 1, true));
        assert_eq!(cut.curve(), &whole.curve()[..=horizon]);
        assert_eq!(bits(cut.camera()), bits(whole.track()[horizon]));
        assert_eq!(cut.view().history(), &whole.view().history()[..=horizon]);
    }
    let before = whole.steps();
    whole.step(Action { direction: None, heading: Heading::new(3) });
    assert_eq!((whole.steps(), whole.track()[before]), (before + 1, whole.camera()), "standing costs a step");
}

#[test]
fn a_camera_at_another_height_maps_the_same_floor() {
    let world = world(MotionConfig::default());
    let scene = world.scene();
    assert_eq!((scene.camera_height(), scene.floor(), scene.lattice().size), (1.25, 0.0, [24, 18]));
    assert_eq!(scene.starts().len(), 5);
    let lattice = Scene::two_rooms();
    for (old, new) in lattice.starts().iter().zip(scene.starts()) {
        let [old, new] = [lattice.lattice().pose(*old), scene.lattice().pose(*new)];
        assert_eq!((new.position.y, old.azimuth), (1.25, new.azimuth));
        assert!(new.position.with_y(0.0).distance(old.position.with_y(0.0)) < 0.4);
    }
    let mut episode = begin(&world, scene.starts()[1], 40);
    (0..36).for_each(|_| assert!(!episode.move_by(Motion::Left).bumped));
    let input = episode.encode();
    for layer in 0..4 {
        let in_layer = |point: &glam::Vec3| (point.y + 0.5).floor() as i32 == layer;
        let counted: usize = input.channel(layer as usize).iter().map(|&n| usize::from(n)).sum();
        assert_eq!(counted, episode.view().cloud().iter().filter(in_layer).count(), "{layer}");
    }
    assert_eq!(episode.view().camera(), episode.camera());

    let far = SimConfig {
        agent: Agent::Continuous(MotionConfig { camera_height: 5.0, ..MotionConfig::default() }),
        ..SimConfig::default()
    };
    let error = World::new(Scene::two_rooms(), &far).unwrap_err().to_string();
    assert!(error.contains("no free lattice pose at height 5 m"), "{error}");
}

#[test]
fn frontiers_lead_through_both_rooms_and_beat_chance() {
    for radius in [0.0, 0.02, 0.1] {
        let world = world(MotionConfig { radius, ..MotionConfig::default() });
        let start = world.scene().starts()[0];
        let run = |policy: &mut dyn Policy| {
            let (mut episode, mut rng) = (begin(&world, start, 600), SeedTree::new(2).rng());
            policy.begin();
            while !episode.is_over() {
                let decision = decide(policy, &episode, &mut rng).unwrap();
                episode.follow(decision);
            }
            assert_eq!(episode.curve().len(), 601);
            episode
        };
        let (fbe, random) = (run(&mut Fbe::default()), run(&mut Random));
        assert!(fbe.curve()[600] > 0.95, "{} with {} bumps", fbe.curve()[600], fbe.bumps());
        assert!(fbe.curve().iter().sum::<f32>() > random.curve().iter().sum::<f32>());
    }
}

#[test]
fn wherever_motions_have_led_actions_lead_on() {
    let world = world(MotionConfig { radius: 0.1, ..MotionConfig::default() });
    for seed in 0..20 {
        let mut episode = Episode::random(Arc::clone(&world), 100_000, SeedTree::new(seed));
        let mut rng = SeedTree::new(seed).rng();
        // Into corners and beside walls: mostly forward.
        for n in 0..150 {
            let motion = Random.motion(&episode.view(), &mut rng).unwrap().unwrap();
            episode.move_by(if n % 3 == 0 { motion } else { Motion::Forward });
        }
        let from = episode.path_length();
        for _ in 0..40 {
            let action = Random.act(&episode.view(), &mut rng).unwrap();
            episode.step(action);
        }
        assert!(episode.path_length() - from > 2.0, "seed {seed}: {} m", episode.path_length() - from);
    }
}
