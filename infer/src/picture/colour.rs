//! The pictures' colours.

/// Behind everything.
pub(super) const BACKGROUND: [u8; 3] = [17, 20, 26];
/// Known to be free.
pub(super) const FREE: [u8; 3] = [33, 39, 50];
/// A wall that was seen.
pub(super) const SEEN: [u8; 3] = [226, 232, 242];
/// A wall that was not.
pub(super) const UNSEEN: [u8; 3] = [132, 66, 62];
/// Text.
pub(super) const TEXT: [u8; 3] = [222, 227, 236];
/// Text of less weight.
pub(super) const FAINT: [u8; 3] = [138, 147, 163];
/// What is planned.
pub(super) const PLAN: [u8; 3] = [120, 220, 255];
/// Found where there is one.
pub(super) const HIT: [u8; 3] = [236, 240, 246];
/// Not found where there is one.
pub(super) const MISS: [u8; 3] = [244, 96, 84];
/// Found where there is none.
pub(super) const FALSE_ALARM: [u8; 3] = [72, 136, 232];

/// A colour for a share of the time: blue, teal, yellow, red. All stand out from a dark ground.
pub(super) fn time(t: f32) -> [u8; 3] {
    between(&[[84, 148, 255], [52, 211, 190], [180, 222, 88], [255, 205, 74], [255, 128, 66], [255, 70, 92]], t)
}

/// Black to pale yellow, even in lightness (after matplotlib's `inferno`).
pub(super) fn heat(t: f32) -> [u8; 3] {
    const STOPS: [[u8; 3]; 9] = [
        [0, 0, 4],
        [31, 12, 72],
        [85, 15, 109],
        [136, 34, 106],
        [186, 54, 85],
        [227, 89, 51],
        [249, 140, 10],
        [249, 201, 50],
        [252, 255, 164],
    ];
    between(&STOPS, t)
}

/// Violet to yellow, even in lightness (after matplotlib's `viridis`): heights in the cloud.
pub(crate) fn height(t: f32) -> [u8; 3] {
    const STOPS: [[u8; 3]; 9] = [
        [68, 1, 84],
        [71, 44, 122],
        [59, 81, 139],
        [44, 113, 142],
        [33, 144, 141],
        [39, 173, 129],
        [92, 200, 99],
        [170, 220, 50],
        [253, 231, 37],
    ];
    between(&STOPS, t)
}

/// Points per pixel, from the ground's colour to near white.
pub(super) fn density(t: f32) -> [u8; 3] {
    between(&[FREE, [60, 74, 98], [112, 131, 160], [178, 194, 216], [228, 236, 248]], t)
}

/// `from` at 0, `to` at 1.
pub(super) fn mix(from: [u8; 3], to: [u8; 3], t: f32) -> [u8; 3] {
    between(&[from, to], t)
}

fn between(stops: &[[u8; 3]], t: f32) -> [u8; 3] {
    let last = stops.len() - 1;
    let at = if t.is_nan() { 0.0 } else { t.clamp(0.0, 1.0) * last as f32 };
    let (index, share) = ((at as usize).min(last), at.fract());
    let (a, b) = (stops[index], stops[(index + 1).min(last)]);
    [0, 1, 2].map(|c| (f32::from(a[c]) + (f32::from(b[c]) - f32::from(a[c])) * share).round() as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_meet_their_ends_and_take_any_number() {
        assert_eq!(heat(0.0), [0, 0, 4]);
        assert_eq!(heat(1.0), [252, 255, 164]);
        assert_eq!(heat(7.0), heat(1.0));
        assert_eq!(heat(f32::NAN), heat(0.0));
        assert_eq!(mix([0; 3], [100; 3], 0.25), [25; 3]);
    }
}
