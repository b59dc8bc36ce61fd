//! What the end-to-end tests share: the built programs, run in folders of their own.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

/// Root of the workspace.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().map(Path::to_path_buf).unwrap_or_default()
}

/// A program of the workspace, built with this very profile.
///
/// # Panics
/// When it cannot be built.
pub fn program(name: &str) -> Command {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    let folder = FOLDER.get_or_init(|| {
        let built = Command::new(env!("CARGO"))
            .args(["build", "--quiet", "--offline", "-p", "train", "-p", "infer", "-p", "dataset"])
            .current_dir(root())
            .status();
        assert!(built.is_ok_and(|status| status.success()), "the programs do not build");
        // Tests run from target/PROFILE/deps.
        let test = std::env::current_exe().unwrap_or_default();
        test.ancestors().nth(2).map(Path::to_path_buf).unwrap_or_default()
    });
    let mut command = Command::new(folder.join(name));
    command.current_dir(root());
    command
}

/// Runs a program to its end: exit code, standard output, standard error.
///
/// # Panics
/// When it cannot be started.
pub fn run(name: &str, arguments: &[&str]) -> (i32, String, String) {
    match program(name).args(arguments).output() {
        Ok(Output { status, stdout, stderr }) => {
            let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
            (status.code().unwrap_or(-1), text(&stdout), text(&stderr))
        }
        Err(error) => panic!("{name} cannot be started: {error}"),
    }
}

/// Runs a program that must succeed, and returns its standard output.
///
/// # Panics
/// When it fails.
pub fn succeed(name: &str, arguments: &[&str]) -> String {
    let (code, stdout, stderr) = run(name, arguments);
    assert_eq!(code, 0, "{name} {arguments:?}\n{stdout}\n{stderr}");
    stdout
}

/// Runs a program that must fail with code 1 and an error that says what a user needs.
///
/// # Panics
/// When it succeeds, panics, or leaves out one of `needles`.
pub fn refuse(name: &str, arguments: &[&str], needles: &[&str]) {
    let (code, stdout, stderr) = run(name, arguments);
    assert_eq!(code, 1, "{name} {arguments:?}\n{stdout}\n{stderr}");
    assert!(!stderr.contains("panicked"), "{stderr}");
    for needle in needles {
        assert!(stderr.contains(needle), "{name} {arguments:?} does not say {needle:?}:\n{stderr}");
    }
}

/// The folder of real Doom maps, if there is one: `NBP_DOOM_MAPS`, or `shared/data` beside the checkout.
pub fn doom_maps() -> Option<PathBuf> {
    let named = std::env::var_os("NBP_DOOM_MAPS").map(PathBuf::from);
    let folder = named.unwrap_or_else(|| root().join("../shared/data"));
    folder.join("obsidian").is_dir().then_some(folder)
}
