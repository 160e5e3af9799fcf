//! A temporary directory for one test.

use std::fs;
use std::path::{Path, PathBuf};

use super::command::command;

/// A directory that is removed when it is dropped.
pub struct TestDirectory(tempfile::TempDir);

impl TestDirectory {
    pub fn new() -> TestDirectory {
        TestDirectory(tempfile::tempdir().unwrap())
    }

    pub fn root(&self) -> &Path {
        self.0.path()
    }

    /// Returns the path of a name in it.
    pub fn path(&self, name: &str) -> PathBuf {
        self.root().join(name)
    }

    /// Returns the path of a name in it, as an argument of the program.
    pub fn name(&self, name: &str) -> String {
        self.path(name).to_str().unwrap().into()
    }

    /// Writes a file, and returns its path.
    pub fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> String {
        fs::write(self.path(name), bytes).unwrap();
        self.name(name)
    }

    /// Copies a file, and returns its path.
    pub fn copy(&self, source: &str, name: &str) -> String {
        fs::copy(source, self.path(name)).unwrap();
        self.name(name)
    }

    /// Builds a file from an input, and returns its path.
    pub fn built(&self, input: &str, name: &str, options: &[&str]) -> String {
        let file = self.name(name);
        command(&["build", "-q", input, "-o", &file]).args(options).assert().success().stderr("");
        file
    }

    /// Returns the names in it, sorted.
    pub fn files(&self) -> Vec<String> {
        let entries = fs::read_dir(self.root()).unwrap();
        let mut names: Vec<String> =
            entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }
}
