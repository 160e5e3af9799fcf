//! Files of bytes, for functions that only read files.

use std::cell::OnceCell;
use std::path::Path;

use tempfile::TempDir;

thread_local! {
    static DIRECTORY: OnceCell<TempDir> = const { OnceCell::new() };
}

/// Runs a function with a file of some bytes, under a name, in a directory of this thread.
pub fn in_file(name: &str, bytes: &[u8], run: impl FnOnce(&Path)) {
    DIRECTORY.with(|directory| {
        let directory = directory.get_or_init(|| tempfile::tempdir().unwrap());
        let path = directory.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        run(&path);
    });
}
