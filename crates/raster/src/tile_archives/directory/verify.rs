//! Verification of a tile directory.

use std::fs;
use std::path::Path;

use super::pending::{PendingUpdate, UPDATE};
use super::{DOCUMENT, LOCK, TileDirectory};
use crate::tile_archives::provenance::Digest;
use spinney_base::io::LockFile;
use spinney_base::{Error, Progress, Result};
use spinney_container::Finding;

/// Checks that a directory has the tiles that were written, with their bytes.
///
/// # Errors
/// If it cannot be read or was not written by Spinney, or on cancellation.
pub(in crate::tile_archives) fn verify(base: &Path, progress: &dyn Progress) -> Result<Vec<Finding>> {
    let lock = base.join(LOCK);
    let check_lock = || match LockFile::holder(&lock) {
        Some(holder) => Err(Error::Locked { path: base.to_path_buf(), holder }),
        None => Ok(()),
    };
    check_lock()?;
    let (names, own, document) = TileDirectory::open(base)?;
    if let Some(pending) = PendingUpdate::of(base)? {
        let problem = format!(
            "an update {} was interrupted while it changed tiles; the next `spinney export --update` completes it",
            pending.states()
        );
        return Ok(vec![Finding { place: UPDATE.into(), problem }]);
    }
    let mut check = DirectoryCheck {
        names: &names,
        tiles: 0,
        digest: Digest::default(),
        total: own.tiles,
        findings: Vec::new(),
    };
    check.directory(base, &mut Vec::new(), progress)?;
    if (check.tiles, Some(check.digest)) != (own.tiles, Digest::parse(&own.digest)) {
        let problem =
            format!("found {} tiles, the export wrote {}, or their bytes differ", check.tiles, own.tiles);
        check.findings.push(Finding { place: "tiles".into(), problem });
    }
    // Changes by a concurrent update are not corruption.
    if !check.findings.is_empty() {
        check_lock()?;
        if TileDirectory::open(base)?.2 != document {
            return Err(Error::Changed { path: base.to_path_buf(), what: "was updated" });
        }
    }
    Ok(check.findings)
}

struct DirectoryCheck<'a> {
    names: &'a TileDirectory,
    tiles: u64,
    digest: Digest,
    total: u64,
    findings: Vec<Finding>,
}

impl DirectoryCheck<'_> {
    fn directory(&mut self, path: &Path, above: &mut Vec<String>, progress: &dyn Progress) -> Result<()> {
        let failed = || Error::io(path, "read the directory");
        for entry in fs::read_dir(path).map_err(failed())? {
            progress.check()?;
            let entry = entry.map_err(failed())?;
            let name = entry.file_name().to_string_lossy().into_owned();
            let kind = entry.file_type().map_err(failed())?;
            let path = entry.path();
            above.push(name);
            let parts = self.names.pattern.split('/').count();
            let is_left = above.len() == 1 && matches!(above[0].as_str(), UPDATE | LOCK);
            if is_left {
                let problem = "left by an update that was interrupted before it changed a tile; the next update removes it";
                self.findings.push(Finding { place: above[0].clone(), problem: problem.into() });
            } else if kind.is_dir() && above.len() < parts {
                self.directory(&path, above, progress)?;
            } else if kind.is_file() && above.len() == parts {
                match self.names.tile_of(&above.join("/")) {
                    Some(tile) => {
                        let bytes = fs::read(&path).map_err(Error::io(&path, "read"))?;
                        self.digest.add(tile.number(), 1, xxhash_rust::xxh3::xxh3_128(&bytes));
                        self.tiles += 1;
                        progress.advance(1, self.total);
                    }
                    None => self.unknown_file(&path),
                }
            } else if !(above.len() == 1 && above[0] == DOCUMENT) {
                self.unknown_file(&path);
            }
            above.pop();
        }
        Ok(())
    }

    fn unknown_file(&mut self, path: &Path) {
        if self.findings.len() < 100 {
            let problem = "neither a tile nor another file of an export".into();
            self.findings.push(Finding { place: path.display().to_string(), problem });
        }
    }
}
