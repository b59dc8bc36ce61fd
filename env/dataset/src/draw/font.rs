//! A small stroke font: letters are lines, so they scale and need no file.

use super::Rgb;
use glam::Vec2;

/// Strokes of a character on a grid with capitals from row 0 to the base line at row 6, lower case from row 2, tails to
/// row 8. A stroke is a row of `xy` digit pairs; strokes are parted by commas; those that begin with `~` are rounded.
fn strokes(character: char) -> &'static str {
    match character {
        ' ' => "",
        '0' => "~20 40 46 06 00 20",
        '1' => "12 20 26",
        '2' => "~01 00 40 43 06,06 46",
        '3' => "~01 00 40 43 23,~23 43 46 06 05",
        '4' => "36 30 04 44",
        '5' => "40 00 03,~03 12 42 46 06 05",
        '6' => "~22 42 46 06 02 22,~30 00 04",
        '7' => "00 40 16",
        '8' => "~20 40 43 03 00 20,~23 43 46 06 03 23",
        '9' => "~24 04 00 40 44 24,~16 46 42",
        'A' => "06 20 46,14 34",
        'B' => "00 06,~00 40 43 03,~03 43 46 06",
        'C' => "~41 40 00 06 46 45",
        'D' => "00 06,~00 40 46 06",
        'E' => "40 00 06 46,03 33",
        'F' => "40 00 06,03 33",
        'G' => "~41 40 00 06 46 43,43 23",
        'H' => "00 06,40 46,03 43",
        'I' => "00 06",
        'J' => "~30 35 36 06 05",
        'K' => "00 06,40 03 46",
        'L' => "00 06 46",
        'M' => "06 00 24 40 46",
        'N' => "06 00 46 40",
        'O' => "~20 40 46 06 00 20",
        'P' => "00 06,~00 40 43 03",
        'Q' => "~20 40 46 06 00 20,24 46",
        'R' => "00 06,~00 40 43 03,23 46",
        'S' => "~41 40 00 03 43 46 06 05",
        'T' => "00 40,20 26",
        'U' => "~00 04 06 46 44 40",
        'V' => "00 26 40",
        'W' => "00 16 22 36 40",
        'X' => "00 46,40 06",
        'Y' => "00 23 40,23 26",
        'Z' => "00 40 06 46",
        'a' => "~03 02 32 33,33 36,~34 04 06 36 35",
        'b' => "00 06,~04 06 36 32 02 04",
        'c' => "~33 32 02 06 36 35",
        'd' => "30 36,~04 06 36 32 02 04",
        'e' => "~04 34,~34 32 02 06 36 35",
        'f' => "~30 10 13,13 16,02 22",
        'g' => "~04 06 36 32 02 04,32 36,~36 38 08 07",
        'h' => "00 06,~04 02 32 34,34 36",
        'i' => "02 06,00 00",
        'j' => "12 16,~16 18 08,10 10",
        'k' => "00 06,32 04 36",
        'l' => "00 06",
        'm' => "02 06,~04 02 22 24,24 26,~24 22 42 44,44 46",
        'n' => "02 06,~04 02 32 34,34 36",
        'o' => "~04 06 36 32 02 04",
        'p' => "02 08,~04 06 36 32 02 04",
        'q' => "32 38,~04 06 36 32 02 04",
        'r' => "02 06,~04 02 22",
        's' => "~33 32 02 04 34 36 06 05",
        't' => "~10 15 16 26,02 22",
        'u' => "~02 04 06 36 34,32 36",
        'v' => "02 26 42",
        'w' => "02 16 23 36 42",
        'x' => "02 36,32 06",
        'y' => "02 26,42 18",
        'z' => "02 32 06 36",
        '.' => "06 06",
        ',' => "16 07",
        ':' => "03 03,06 06",
        '-' => "04 24",
        '+' => "04 44,22 26",
        '/' => "40 06",
        '%' => "40 06,~00 20 22 02 00,~24 44 46 26 24",
        '(' => "~10 01 05 16",
        ')' => "~00 11 15 06",
        '_' => "07 47",
        '=' => "03 43,05 45",
        '±' => "02 42,20 24,06 46",
        '·' => "04 04",
        '²' => "00 20 21 03 23",
        _ => "00 40 46 06 00",
    }
}

/// Gap between characters and width of a blank, grid units.
const GAP: f32 = 1.9;
const BLANK: f32 = 2.2;

fn polylines(character: char) -> Vec<Vec<Vec2>> {
    let point = |pair: &str| {
        let digit = |n: usize| pair.as_bytes().get(n).map_or(0.0, |b| f32::from(b.saturating_sub(b'0')));
        Vec2::new(digit(0), digit(1))
    };
    let parse = |stroke: &str| {
        let points: Vec<Vec2> = stroke.trim_start_matches('~').split_whitespace().map(point).collect();
        if stroke.starts_with('~') { (0..3).fold(points, |line, _| rounded(&line)) } else { points }
    };
    strokes(character).split(',').filter(|stroke| !stroke.is_empty()).map(parse).collect()
}

/// Chaikin's corner cutting, ends kept.
fn rounded(line: &[Vec2]) -> Vec<Vec2> {
    let cut = line.windows(2).flat_map(|w| [w[0].lerp(w[1], 0.25), w[0].lerp(w[1], 0.75)]);
    let ends = |at: usize| line.get(at).copied();
    ends(0).into_iter().chain(cut).chain(ends(line.len().wrapping_sub(1))).collect()
}

fn advance(lines: &[Vec<Vec2>]) -> f32 {
    let width = lines.iter().flatten().map(|p| p.x).reduce(f32::max);
    width.map_or(BLANK, |width| width + GAP)
}

/// Width of a text whose capitals are `size` pixels high.
pub fn text_width(text: &str, size: f32) -> f32 {
    let units: f32 = text.chars().map(|character| advance(&polylines(character))).sum();
    (units - GAP).max(0.0) * size / 6.0
}

impl Rgb {
    /// Writes a text whose capitals are `size` pixels high, its upper left corner at `at`. Returns its width.
    pub fn text(&mut self, text: &str, at: Vec2, size: f32, colour: [u8; 3]) -> f32 {
        let unit = size / 6.0;
        let mut pen = 0.0;
        for character in text.chars() {
            let lines = polylines(character);
            for line in &lines {
                for pair in line.windows(2) {
                    let [a, b] = [0, 1].map(|n| at + (pair[n] + Vec2::new(pen, 0.0)) * unit);
                    self.line(a, b, (size / 7.5).max(1.15), colour, 1.0);
                }
            }
            pen += advance(&lines);
        }
        (pen - GAP).max(0.0) * unit
    }

    /// The same in the middle of `at.x`, on a block of a ground colour that lets it be read on anything.
    pub fn label(&mut self, text: &str, at: Vec2, size: f32, [colour, ground]: [[u8; 3]; 2]) {
        let low = at - Vec2::new(text_width(text, size) / 2.0, 0.0);
        let (pad, high) = (Vec2::new(5.0, 4.0), low + Vec2::new(text_width(text, size), size));
        self.block(low - pad, high + pad, 4.0, ground, 0.72);
        self.text(text, low, size, colour);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_printable_character_of_titles_has_strokes() {
        let unknown = strokes('\u{1}');
        let known = ('0'..='9').chain('A'..='Z').chain('a'..='z').chain(".,:-+/%()_=±·²".chars());
        for character in known {
            assert_ne!(strokes(character), unknown, "{character}");
            for point in polylines(character).iter().flatten() {
                assert!((0.0..=4.0).contains(&point.x) && (0.0..=8.0).contains(&point.y), "{character} {point}");
            }
        }
    }

    #[test]
    fn width_is_what_is_drawn() {
        let mut image = Rgb::filled(300, 30, [0; 3]);
        let width = image.text("Step 100 %", Vec2::new(4.0, 4.0), 12.0, [255; 3]);
        assert!((width - text_width("Step 100 %", 12.0)).abs() < 1e-3);
        let last = (0..300).filter(|x| (0..30).any(|y| image.data[(y * 300 + x) * 3] > 0)).max().unwrap();
        assert!((last as f32 - 4.0 - width).abs() < 3.0, "{last} {width}");
        assert_eq!(text_width("", 12.0), 0.0);
    }
}
