//! What the fuzz targets share with `env/dataset/tests/broken`: the readers, and the files that lie beside a damaged one.

#[path = "../../env/dataset/tests/broken/examples.rs"]
#[allow(dead_code)]
mod examples;
#[path = "../../env/dataset/tests/broken/readers.rs"]
mod all;

/// The readers by name.
pub mod readers {
    pub use super::all::*;
}

/// Runs a reader in a folder that holds the other files of a scene.
pub fn run(read: readers::Read, bytes: &[u8]) {
    thread_local! {
        static FOLDER: tempfile::TempDir = {
            let folder = tempfile::tempdir().expect("a folder for damaged files");
            examples::write_folder(folder.path());
            folder
        };
    }
    FOLDER.with(|folder| drop(read(folder.path(), bytes)));
}
