//! Files in directories that other users may write to, without following symbolic links.

use std::fs::{self, File, OpenOptions};
use std::io;
use std::path::{Path, PathBuf};

use crate::{Error, Result};

/// Opens or creates a regular file, not a symbolic link, device or directory.
///
/// # Errors
/// If the path is one of these, or the file cannot be opened.
pub fn open_regular(options: &mut OpenOptions, path: &Path) -> Result<File> {
    check(path, fs::Metadata::is_file, "a symbolic link or other non-regular file")?;
    #[cfg(unix)]
    {
        // The path may have become a link since, or a pipe, which must not block.
        use std::os::unix::fs::OpenOptionsExt;
        let flags = rustix::fs::OFlags::NOFOLLOW | rustix::fs::OFlags::NONBLOCK;
        options.custom_flags(flags.bits() as i32);
    }
    options.open(path).map_err(Error::io(path, "open"))
}

fn check(path: &Path, is_right: fn(&fs::Metadata) -> bool, wrong: &str) -> Result<()> {
    match fs::symlink_metadata(path) {
        Ok(there) if !is_right(&there) => {
            let advice = "links are not followed here; remove it, or replace it by its target";
            Err(Error::unsupported(path, wrong, advice))
        }
        Err(cause) if cause.kind() != io::ErrorKind::NotFound => Err(Error::io(path, "stat")(cause)),
        _ => Ok(()),
    }
}

/// Directory whose files are accessed by relative names, without following symbolic links below it.
#[derive(Debug)]
pub struct ConfinedDirectory {
    base: PathBuf,
    /// Subdirectory that was checked last.
    checked: PathBuf,
}

impl ConfinedDirectory {
    /// Creates it for a directory path, which may itself contain links.
    pub fn new(base: &Path) -> ConfinedDirectory {
        ConfinedDirectory { base: base.to_path_buf(), checked: PathBuf::new() }
    }

    /// Returns the directory's path.
    pub fn base(&self) -> &Path {
        &self.base
    }

    /// Returns the path of a name. Checks that its parent directories are directories, or missing;
    /// `make` creates missing ones.
    fn path(&mut self, name: &str, make: bool) -> Result<PathBuf> {
        let above = Path::new(name).parent().unwrap_or(Path::new(""));
        if above != self.checked {
            let mut path = self.base.clone();
            for part in above.components() {
                path.push(part);
                check(&path, fs::Metadata::is_dir, "a symbolic link or other file in place of a directory")?;
                let made = if make { fs::create_dir(&path) } else { Ok(()) };
                match made {
                    Err(cause) if cause.kind() != io::ErrorKind::AlreadyExists => {
                        return Err(Error::io(&path, "create the directory")(cause));
                    }
                    _ => {}
                }
            }
            self.checked = if make { above.to_path_buf() } else { PathBuf::new() };
        }
        Ok(self.base.join(name))
    }

    /// Returns the path of a file to read or remove.
    ///
    /// # Errors
    /// If one of its directories is a link.
    pub fn checked_path(&mut self, name: &str) -> Result<PathBuf> {
        self.path(name, false)
    }

    /// Returns the path of a file to create, and creates its directories.
    ///
    /// # Errors
    /// If one of them is a link, or cannot be created.
    pub fn path_to_create(&mut self, name: &str) -> Result<PathBuf> {
        self.path(name, true)
    }

    /// Writes a file.
    ///
    /// # Errors
    /// If the file or one of its directories is a link, or the write fails.
    pub fn write(&mut self, name: &str, bytes: &[u8]) -> Result<()> {
        let path = self.path_to_create(name)?;
        let mut file = open_regular(File::options().write(true).create(true).truncate(true), &path)?;
        io::Write::write_all(&mut file, bytes).map_err(Error::io(&path, "write"))
    }

    /// Reads a file of at most `most` bytes; `None` if it is missing.
    ///
    /// # Errors
    /// If the file or one of its directories is a link, if it is longer, or if it cannot be read.
    pub fn read(&mut self, name: &str, most: u64) -> Result<Option<Vec<u8>>> {
        let path = self.checked_path(name)?;
        let file = match open_regular(File::options().read(true), &path) {
            Ok(file) => file,
            Err(Error::Io { cause, .. }) if cause.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(error),
        };
        let mut bytes = Vec::new();
        let read = io::Read::read_to_end(&mut io::Read::take(file, most + 1), &mut bytes);
        let length = read.map_err(Error::io(&path, "read"))? as u64;
        if length > most {
            return Err(Error::corrupt(path, "file", format!("more than {most} bytes"), "at most that"));
        }
        Ok(Some(bytes))
    }

    /// Removes a file, and the parent directories that are then empty. A missing file counts as
    /// removed.
    ///
    /// # Errors
    /// If one of its directories is a link, or the file cannot be removed.
    pub fn remove(&mut self, name: &str) -> Result<()> {
        let path = self.checked_path(name)?;
        match fs::remove_file(&path) {
            Err(cause) if cause.kind() != io::ErrorKind::NotFound => {
                return Err(Error::io(&path, "remove")(cause));
            }
            _ => {}
        }
        for above in Path::new(name).ancestors().skip(1).filter(|above| !above.as_os_str().is_empty()) {
            // A directory with other files stays.
            if fs::remove_dir(self.base.join(above)).is_err() {
                break;
            }
            self.checked = PathBuf::new();
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directories_are_created_and_removed_with_their_files() {
        let directory = tempfile::tempdir().unwrap();
        let mut closed = ConfinedDirectory::new(directory.path());
        closed.write("a/b/c", b"1").unwrap();
        closed.write("a/d", b"22").unwrap();
        assert_eq!(closed.read("a/b/c", 9).unwrap(), Some(b"1".to_vec()));
        assert_eq!(closed.read("a/b/x", 9).unwrap(), None);
        assert_eq!(closed.read("x/y", 9).unwrap(), None);
        assert!(closed.read("a/d", 1).is_err());
        closed.remove("a/b/c").unwrap();
        closed.remove("a/b/c").unwrap();
        assert!(!directory.path().join("a/b").exists() && directory.path().join("a/d").exists());
        closed.write("a/b/c", b"1").unwrap();
        assert!(directory.path().join("a/b/c").exists());
    }

    #[test]
    #[cfg(unix)]
    fn links_are_not_followed() {
        let [directory, outside] = [(); 2].map(|()| tempfile::tempdir().unwrap());
        std::fs::write(outside.path().join("c"), "precious").unwrap();
        std::os::unix::fs::symlink(outside.path(), directory.path().join("a")).unwrap();
        std::os::unix::fs::symlink(outside.path().join("c"), directory.path().join("l")).unwrap();
        let mut closed = ConfinedDirectory::new(directory.path());
        assert!(matches!(closed.write("a/c", b"1"), Err(Error::Unsupported { .. })));
        assert!(matches!(closed.read("a/c", 9), Err(Error::Unsupported { .. })));
        assert!(matches!(closed.remove("a/c"), Err(Error::Unsupported { .. })));
        assert!(matches!(closed.write("l", b"1"), Err(Error::Unsupported { .. })));
        assert!(matches!(closed.read("l", 9), Err(Error::Unsupported { .. })));
        assert_eq!(std::fs::read(outside.path().join("c")).unwrap(), b"precious");
    }
}
