//! How large a bench may be and what its names may be, wherever it comes from: a configuration, scenes, a `bench.json`.

use super::store::file_name;
use std::collections::BTreeSet;

/// Episodes from each start.
pub const MOST_SEEDS: usize = 10_000;
/// Starts of each scene.
pub const MOST_STARTS: usize = 65_535;
/// Maps that a data set generates.
pub const MOST_MAPS: usize = 10_000;
/// Bytes of a name in file names. Disks hold 255 with what goes around it: `coverage-`, `.json`, what makes a name temporary.
const MOST_BYTES: usize = 180;

/// Whether a number is from 1 to `most`.
///
/// # Errors
/// Saying that it is not.
pub fn check_count(what: &str, count: usize, most: usize) -> Result<(), String> {
    match count {
        0 => Err(format!("{what} is 0: it must be at least 1")),
        count if count > most => Err(format!("{what} is {count}: it must be at most {most}")),
        _ => Ok(()),
    }
}

/// Whether there are names, each of which can be shown, names a file and is there once.
///
/// # Errors
/// Saying which is not.
pub fn check_names<'a>(what: &str, names: impl Iterator<Item = &'a str>) -> Result<(), String> {
    // Some disks do not tell large letters from small ones.
    let mut seen = BTreeSet::new();
    for name in names {
        if name.is_empty() {
            return Err(format!("one of the {what} has no name"));
        }
        if name.contains(char::is_control) {
            return Err(format!("one of the {what} is called {name:?}: leave the control characters out"));
        }
        let length = file_name(name).len();
        if length > MOST_BYTES {
            let begin: String = name.chars().take(20).collect();
            return Err(format!(
                "the name of one of the {what}, {begin}…, takes {length} bytes in file names: {MOST_BYTES} is the most"
            ));
        }
        if !seen.insert(name.to_lowercase()) {
            return Err(format!("two {what} are called {name}: give each its own name"));
        }
    }
    if seen.is_empty() { Err(format!("there are no {what}")) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_refused_that_no_file_or_table_can_have() {
        let check = |names: &[&str]| check_names("rows", names.iter().copied());
        let longest = "x".repeat(MOST_BYTES);
        assert_eq!(check(&["fbe", "a|b, <c>", "é", &longest]), Ok(()));
        let message = |names: &[&str]| check(names).unwrap_err();
        assert!(message(&["fbe", "FBE"]).contains("two rows are called FBE"));
        assert!(message(&[""]).contains("one of the rows has no name") && message(&[]).contains("there are no rows"));
        assert!(message(&["a\n\u{1b}[31m"]).contains(r#""a\n\u{1b}[31m": leave the control characters out"#));
        assert!(message(&[&(longest + "x")]).contains("xxx…, takes 181 bytes"));
        // Each of these is two bytes, and each byte three letters.
        assert!(message(&[&"é".repeat(31)]).contains("éé…, takes 186 bytes"));
    }

    #[test]
    fn the_longest_name_leaves_room_for_what_goes_around_it() {
        let dir = tempfile::tempdir().unwrap();
        for name in crate::report::figure_names(&"x".repeat(MOST_BYTES)) {
            nbp_model::weights::write_atomic(&dir.path().join(name), b"").unwrap();
        }
    }
}
