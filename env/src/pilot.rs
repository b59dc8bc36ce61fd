//! How the continuous agent carries out what a lattice policy says: turn towards the node, go there, turn to the heading.
//!
//! Only every so many azimuths can be taken (10° apart), so a pilot neither walks quite straight nor looks quite where it
//! should: it arrives within half a forward motion of the node (to 3 %), and its heading is off by at most half a turn. With 10°,
//! four of the eight headings are exact, those that differ from the start's by a multiple of 90°, and four are 5° off.

use crate::motion::{Motion, MotionConfig, Walker};
use crate::pose::shorter_arc;
use glam::Vec3;

/// How much more than half of a motion or a turn still counts as half: so that rounding does not turn an agent for ever.
const SLACK: f32 = 1.002;

/// Share of a forward motion by which a way may pass a position without being corrected. More would be overshot, and the
/// agent have to turn round.
const MISS: f32 = 0.125;

/// How near a pilot goes to a position, metres: half a forward motion, and a little more (3 % at 10°) for what it may
/// miss and the angles that it cannot take.
pub fn arrival_distance(config: &MotionConfig) -> f32 {
    let straight = 0.5 / (0.5 * config.turn() * SLACK).cos();
    config.forward * straight.max(0.5_f32.hypot(MISS)) * SLACK
}

/// How far from the straight way between two positions a pilot may come, metres: it begins and ends beside them, and
/// follows an angle that is half a turn off until it is a whole one.
pub fn stray(config: &MotionConfig, distance: f32) -> f32 {
    arrival_distance(config) + 0.5 * distance * (0.5 * config.turn() * SLACK).tan()
}

/// The next motion on the straight way to a position; `None` once there.
///
/// Each forward motion brings it nearer, so the number of motions is bounded.
pub fn towards(walker: &Walker, goal: Vec3) -> Option<Motion> {
    let (config, pose) = (walker.config(), walker.pose());
    let away = goal - pose.position;
    let distance = away.x.hypot(away.z);
    if distance <= arrival_distance(config) {
        return None;
    }
    let error = shorter_arc(away.x.atan2(away.z) - pose.azimuth);
    let brings_nearer = 2.0 * distance * error.cos() > config.forward;
    let turned = (error.abs() - config.turn()).abs();
    let misses = |by: f32| distance * by.sin().abs() > MISS * config.forward;
    // A turn costs a step: none as long as the way passes near enough, or where the next one would have to be undone.
    let is_worth_it = misses(error) && (!misses(turned) || error.abs() > config.turn());
    let is_off = error.abs() > 0.5 * config.turn() * SLACK;
    Some(if is_off && (is_worth_it || !brings_nearer) { turn(error) } else { Motion::Forward })
}

/// The next turn to the azimuth, radians, that is nearest to the one asked for; `None` once taken.
pub fn turn_to(walker: &Walker, azimuth: f32) -> Option<Motion> {
    let error = shorter_arc(azimuth - walker.pose().azimuth);
    (error.abs() > 0.5 * walker.config().turn() * SLACK).then(|| turn(error))
}

fn turn(error: f32) -> Motion {
    if error > 0.0 { Motion::Left } else { Motion::Right }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::{Heading, Pose};
    use crate::scene::Scene;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn it_arrives_and_looks_where_it_should(
            x in -0.7_f32..0.7, z in -0.7_f32..0.7, first in -180.0_f32..180.0, heading in 0_usize..8,
            turn_degrees in prop::sample::select(vec![10.0_f32, 7.0, 30.0, 45.0, 1.0]), forward in 0.02_f32..0.25,
        ) {
            let scene = Scene::two_rooms();
            let config = MotionConfig { turn_degrees, forward, radius: 0.0, ..MotionConfig::default() };
            let position = Vec3::new(3.0, 1.25, 4.5);
            let mut walker = Walker::new(config, Pose { position, azimuth: first.to_radians() });
            let goal = position + Vec3::new(x, 0.0, z);
            let (mut forwards, mut turns) = (0, 0);
            while let Some(motion) = towards(&walker, goal) {
                let before = walker.pose().position.distance(goal);
                prop_assert!(walker.attempt(motion, scene.rays()));
                if motion == Motion::Forward {
                    forwards += 1;
                    prop_assert!(walker.pose().position.distance(goal) < before);
                } else {
                    turns += 1;
                }
                let way = goal - position;
                let along = ((walker.pose().position - position).dot(way) / way.length_squared().max(1e-9)).clamp(0.0, 1.0);
                let aside = walker.pose().position.distance(position + along * way);
                prop_assert!(aside <= stray(&config, way.length()), "{}", aside);
            }
            let distance = walker.pose().position.distance(goal);
            prop_assert!(distance <= arrival_distance(&config) && arrival_distance(&config) < 0.545 * forward);
            let length = goal.distance(position);
            prop_assert!(forwards as f32 <= 1.2 * length / forward + 3.0, "{} motions for {} m", forwards, length);
            prop_assert!(turns as f32 <= 220.0 / turn_degrees + 6.0, "{} turns", turns);

            let wanted = Heading::new(heading).azimuth();
            while let Some(motion) = turn_to(&walker, wanted) {
                walker.attempt(motion, scene.rays());
                turns += 1;
                prop_assert!(turns < 2000);
            }
            let error = shorter_arc(walker.pose().azimuth - wanted).abs();
            prop_assert!(error <= 0.5 * config.turn() * SLACK, "{}", error.to_degrees());
        }
    }

    #[test]
    fn at_half_a_metre_it_is_within_half_a_motion() {
        let config = MotionConfig::default();
        assert!(arrival_distance(&config) < 0.52 * config.forward);
        let scene = Scene::two_rooms();
        let mut walker = Walker::new(config, Pose { position: Vec3::new(3.0, 1.25, 4.5), azimuth: 0.0 });
        let mut count = 0;
        while let Some(motion) = towards(&walker, Vec3::new(3.0, 1.25, 5.0)) {
            assert_eq!(motion, Motion::Forward);
            walker.attempt(motion, scene.rays());
            count += 1;
        }
        assert_eq!(count, 8, "straight on without a turn");
    }
}
