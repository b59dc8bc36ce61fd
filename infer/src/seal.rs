//! A text with a fingerprint of what it depends on and a checksum: JSON for other programs, believed only as it was written.

use nbp_env::SeedTree;

const HEAD: [&str; 4] = ["{\"fingerprint\":\"", "\",\"check\":\"", "\",\"content\":", "}"];

/// 64 bits, eight bytes at a time.
pub(crate) fn hash(bytes: &[u8]) -> u64 {
    let word = |chunk: &[u8]| chunk.iter().rev().fold(0_u64, |word, &byte| word << 8 | u64::from(byte));
    let folded = bytes.chunks(8).fold(bytes.len() as u64, |state, chunk| {
        (state ^ word(chunk)).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29)
    });
    SeedTree::new(folded).key()
}

/// JSON `{"fingerprint", "check", "content"}`; `content` is JSON, too.
pub(crate) fn seal(fingerprint: &str, content: &str) -> String {
    let check = format!("{:016x}", hash(content.as_bytes()));
    [HEAD[0], fingerprint, HEAD[1], &check, HEAD[2], content, HEAD[3]].concat()
}

/// Fingerprint and content, if not a letter of the content has changed.
pub(crate) fn unseal(text: &str) -> Option<(&str, &str)> {
    let (fingerprint, rest) = text.strip_prefix(HEAD[0])?.split_once(HEAD[1])?;
    let (check, rest) = rest.split_once(HEAD[2])?;
    let content = rest.strip_suffix(HEAD[3])?;
    (check == format!("{:016x}", hash(content.as_bytes()))).then_some((fingerprint, content))
}
