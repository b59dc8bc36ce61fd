//! How large a bench may be and what its names may be, wherever it comes from: a configuration, scenes, a `bench.json`.

use super::store::{Manifest, file_name};
use crate::rollout::MOST_STEPS;
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

impl Manifest {
    /// Whether it is one that [`Manifest::new`] makes, as far as can be told without scenes and networks.
    pub(super) fn check(&self) -> Result<(), String> {
        check_count("starts", self.starts, MOST_STARTS)?;
        check_names("rows", self.rows.iter().map(|row| row.name.as_str()))?;
        check_names("data sets", self.sets.iter().map(|set| set.name.as_str()))?;
        let is_row = |name: &String| self.rows.iter().any(|row| row.name == *name);
        if !is_row(&self.reference) {
            return Err(format!("the reference {} is no row", self.reference));
        }
        self.rows
            .iter()
            .try_for_each(|row| check_count(&format!("seeds of row {}", row.name), row.seeds, MOST_SEEDS))?;
        for set in &self.sets {
            let of_set = |reason: String| format!("data set {}: {reason}", set.name);
            check_count("steps", set.steps, MOST_STEPS).map_err(of_set)?;
            check_names("scenes", set.scenes.iter().map(|scene| scene.name.as_str())).map_err(of_set)?;
            if let Some((row, _)) = set.paper.iter().find(|(row, paper)| !is_row(row) || paper.outside().is_some()) {
                return Err(of_set(format!("its published figures of {row} are of no row, or not from 0 to 1")));
            }
            for scene in &set.scenes {
                check_count("starts", scene.starts, self.starts).map_err(of_set)?;
                if scene.cells.len() != self.rows.len() {
                    return Err(of_set(format!("scene {} has not one cell for each row", scene.name)));
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::store::{Published, tests::manifest};

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

    #[test]
    fn what_makes_no_bench_is_not_read_as_one() {
        let dir = tempfile::tempdir().unwrap();
        type Change = fn(&mut Manifest);
        let message = |change: Change| {
            let mut about = manifest();
            change(&mut about);
            about.write(dir.path()).unwrap();
            Manifest::read(dir.path()).unwrap_err().to_string()
        };
        let cases: [(Change, &str); 10] = [
            (|m| m.reference = "nbp".into(), "the reference nbp is no row"),
            (|m| m.rows[1].name = "fbe".into(), "two rows are called fbe"),
            (|m| m.rows[1].seeds = 1_000_000, "seeds of row random is 1000000"),
            (|m| m.sets.clear(), "there are no data sets"),
            (|m| m.sets[0].scenes.clear(), "data set simple: there are no scenes"),
            (|m| m.sets[0].steps = usize::MAX, "data set simple: steps is 18446744073709551615"),
            (|m| m.sets[0].scenes[0].cells.truncate(1), "scene two_rooms has not one cell for each row"),
            (|m| m.sets[0].scenes[0].starts = 3, "starts is 3: it must be at most 2"),
            (|m| m.starts = 0, "starts is 0"),
            (
                |m| {
                    let paper = Published { coverage: 0.5, auc: 2.0, coverage_std: None, auc_std: None };
                    m.sets[0].paper.insert("fbe".into(), paper);
                },
                "published figures of fbe",
            ),
        ];
        for (change, says) in cases {
            assert!(message(change).contains(says), "{}", message(change));
        }
    }
}
