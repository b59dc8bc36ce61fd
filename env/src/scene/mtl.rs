//! MTL files: the colours and images that the faces of an OBJ file name.
//!
//! Not with `tobj`, whose MTL reader panics on a `Kd` of one number and knows no options of `map_Kd`.

use glam::Vec2;

/// What is kept of a material.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Material {
    pub(super) name: String,
    /// `Kd`, taken as it is for a displayed colour.
    pub(super) colour: Option<[u8; 3]>,
    /// `map_Kd`; where there is one, `Kd` does not count, as in PyTorch3D.
    pub(super) map: Option<Map>,
}

/// A `map_Kd` statement.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Map {
    /// As written.
    pub(super) file: String,
    /// From 1.
    pub(super) line: usize,
    /// `-s`: texture coordinates are multiplied by it …
    pub(super) scale: Vec2,
    /// `-o`: … and then this is added.
    pub(super) offset: Vec2,
}

/// The materials of a file, in order; of a fault, its line from 1 and the reason.
pub(super) fn parse(bytes: &[u8]) -> Result<Vec<Material>, (usize, String)> {
    let mut materials: Vec<Material> = Vec::new();
    for (number, line) in bytes.split(|&b| b == b'\n').enumerate() {
        let line = String::from_utf8_lossy(line);
        let (key, rest) = line.trim().split_once(char::is_whitespace).unwrap_or((line.trim(), ""));
        let (rest, number) = (rest.trim(), number + 1);
        match (key.to_ascii_lowercase().as_str(), materials.last_mut()) {
            ("newmtl", _) => materials.push(Material { name: rest.into(), ..Material::default() }),
            ("kd" | "map_kd", None) => return Err((number, format!("{key} before the first newmtl"))),
            ("kd", _) if rest.starts_with("spectral") || rest.starts_with("xyz") => {}
            ("kd", Some(material)) => {
                let colour = colour(rest);
                material.colour =
                    Some(colour.ok_or_else(|| (number, format!("Kd needs numbers from 0 to 1, found {rest:?}")))?);
            }
            ("map_kd", Some(material)) => {
                let map = map(rest, number);
                material.map = Some(map.ok_or_else(|| (number, format!("map_Kd names no image: {rest:?}")))?);
            }
            _ => {}
        }
    }
    Ok(materials)
}

/// One number is grey.
fn colour(text: &str) -> Option<[u8; 3]> {
    let numbers: Option<Vec<f32>> =
        text.split_whitespace().take(3).map(|word| word.parse().ok().filter(|n: &f32| n.is_finite())).collect();
    let byte = |share: f32| (255.0 * share.clamp(0.0, 1.0)).round() as u8;
    match *numbers? {
        [grey] => Some([byte(grey); 3]),
        [r, g, b] => Some([r, g, b].map(byte)),
        _ => None,
    }
}

/// Options, each with its arguments, and then a file name, which may contain spaces.
fn map(text: &str, line: usize) -> Option<Map> {
    let mut map = Map { file: String::new(), line, scale: Vec2::ONE, offset: Vec2::ZERO };
    let mut rest = text;
    while rest.starts_with('-') {
        let (option, mut after) = split_word(rest);
        let (least, most) = match option {
            "-o" | "-s" | "-t" => (1, 3),
            "-mm" => (2, 2),
            _ => (1, 1),
        };
        let mut values = Vec::new();
        for n in 0..most {
            let (word, next) = split_word(after);
            let value = word.parse::<f32>().ok().filter(|value| value.is_finite());
            if n >= least && value.is_none() {
                break;
            }
            values.extend(value);
            after = next;
        }
        let pair = |default: f32| {
            Vec2::new(values.first().copied().unwrap_or(default), values.get(1).copied().unwrap_or(default))
        };
        match option {
            "-s" => map.scale = pair(1.0),
            "-o" => map.offset = pair(0.0),
            _ => {}
        }
        rest = after;
    }
    map.file = rest.into();
    (!rest.is_empty()).then_some(map)
}

fn split_word(text: &str) -> (&str, &str) {
    let (word, rest) = text.split_once(char::is_whitespace).unwrap_or((text, ""));
    (word, rest.trim_start())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_and_maps_are_found_among_other_statements() {
        let text = "# by hand\nnewmtl wall of brick\r\nNs 10\nKd 0 0.5 1\nmap_Kd -s 2 3 1 -blendu on -o 0.5 my wall.png\n\
            newmtl plain\n\tKd 1\nmap_Bump x.png\nnewmtl spectral\nKd spectral a.rfl 1\n";
        let found = parse(text.as_bytes()).unwrap();
        let map = Map { file: "my wall.png".into(), line: 5, scale: Vec2::new(2.0, 3.0), offset: Vec2::new(0.5, 0.0) };
        assert_eq!(found[0], Material { name: "wall of brick".into(), colour: Some([0, 128, 255]), map: Some(map) });
        assert_eq!(found[1], Material { name: "plain".into(), colour: Some([255; 3]), map: None });
        assert_eq!(found[2].colour, None);
    }

    #[test]
    fn faults_have_a_line() {
        assert_eq!(parse(b"newmtl a\nKd 1 nan 0\n").unwrap_err().0, 2);
        assert_eq!(parse(b"Kd 1 1 1").unwrap_err().0, 1);
        assert_eq!(parse(b"newmtl a\n\nmap_Kd -s 1 1 1").unwrap_err().0, 3);
        assert_eq!(parse(b"newmtl a\nmap_Kd").unwrap_err().0, 2);
    }
}
