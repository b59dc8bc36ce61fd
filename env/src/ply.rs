//! Point clouds as PLY files, which every viewer opens.

use glam::Vec3;

/// Points as binary little-endian PLY, metres with `y` up, each with the sRGB colour that `colour` gives to its number.
pub fn cloud(points: &[Vec3], mut colour: impl FnMut(usize) -> [u8; 3]) -> Vec<u8> {
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\ncomment metres, y up\nelement vertex {}\nproperty float x\nproperty float y\n\
         property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n",
        points.len()
    )
    .into_bytes();
    bytes.reserve(points.len() * 15);
    for (number, point) in points.iter().enumerate() {
        bytes.extend(point.to_array().into_iter().flat_map(f32::to_le_bytes));
        bytes.extend(colour(number));
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ply_has_its_header_and_fifteen_bytes_a_point() {
        let colours = [[1, 2, 3], [40, 50, 60]];
        let bytes = cloud(&[Vec3::new(1.0, 0.0, -2.5), Vec3::new(0.0, 3.0, 0.0)], |number| colours[number]);
        let end = b"end_header\n";
        let at = bytes.windows(end.len()).position(|w| w == end).unwrap() + end.len();
        assert!(std::str::from_utf8(&bytes[..at]).unwrap().contains("element vertex 2\n"));
        assert_eq!(bytes.len() - at, 30);
        assert_eq!(bytes[at + 8..at + 12], (-2.5_f32).to_le_bytes());
        assert_eq!((&bytes[at + 12..at + 15], &bytes[at + 27..]), (&colours[0][..], &colours[1][..]));
        assert!(cloud(&[], |_| [0; 3]).ends_with(end));
    }
}
