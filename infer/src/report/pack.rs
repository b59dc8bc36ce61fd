//! Walks and curves as short texts: what makes a report of thousands of episodes a file that can be mailed.

use nbp_env::{Direction, LatticePose};
use std::fmt::Write as _;

/// Digits of base 64, none of which means anything in JSON or HTML.
const DIGITS: &[u8; 64] = b"0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz-_";

/// Shares of 0 to 1 as numbers of `places` digits each, full scale for 1.
pub(super) fn shares(values: impl IntoIterator<Item = f32>, places: u32) -> String {
    let full = (64_u32.pow(places) - 1) as f32;
    let mut text = String::new();
    for value in values {
        let number = (value.clamp(0.0, 1.0) * full).round() as u32;
        text.extend((0..places).rev().map(|place| char::from(DIGITS[(number >> (6 * place) & 63) as usize])));
    }
    text
}

/// `i,k,heading:` of the first pose, then a digit for each step, `8 · move + heading`, where move 0 stays and the others are
/// [`Direction::ALL`]. A step to somewhere else is `.di,dk,heading;`.
pub(super) fn walk(poses: &[LatticePose]) -> String {
    let Some(first) = poses.first() else { return String::new() };
    let mut text = format!("{},{},{}:", first.node.i, first.node.k, first.heading.index());
    for pair in poses.windows(2) {
        let ([from, to], heading) = ([pair[0].node, pair[1].node], pair[1].heading.index());
        let direction = Direction::between(from, to).and_then(|d| Direction::ALL.iter().position(|&other| other == d));
        match direction {
            Some(direction) => text.push(char::from(DIGITS[8 * (direction + 1) + heading])),
            None if from == to => text.push(char::from(DIGITS[heading])),
            None => {
                let _ = write!(text, ".{},{},{heading};", to.i - from.i, to.k - from.k);
            }
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use nbp_env::{Heading, Node};

    #[test]
    fn shares_take_two_characters_and_stay_in_their_range() {
        assert_eq!(shares([0.0, 1.0, 0.5, -3.0, 7.0, f32::NAN], 2), "00__W000__00");
        assert_eq!(shares([1.0, 64.0 / 262_143.0], 3), "___010");
        assert_eq!(shares([], 2), "");
    }

    #[test]
    fn a_step_is_one_character_and_a_jump_a_few() {
        let pose = |i, k, heading| LatticePose { node: Node { i, k }, heading: Heading::new(heading) };
        let poses = [pose(3, -1, 2), pose(3, 0, 1), pose(4, 0, 0), pose(4, 0, 7), pose(6, 1, 4), pose(5, 1, 4)];
        assert_eq!(walk(&poses), "3,-1,2:9G7.2,1,4;a");
        assert_eq!((walk(&poses[..1]), walk(&[])), ("3,-1,2:".into(), String::new()));
    }
}
