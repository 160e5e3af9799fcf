//! Verification of a tile directory.

use std::fs;
use std::path::Path;

use super::pending::{Pending, UPDATE};
use super::{DOCUMENT, LOCK, TileFolder};
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
    let (names, own, document) = TileFolder::open(base)?;
    if let Some(pending) = Pending::of(base)? {
        let problem = format!(
            "an update {} was interrupted while it changed tiles: the next `spinney export --update` finishes it",
            pending.states()
        );
        return Ok(vec![Finding { place: UPDATE.into(), problem }]);
    }
    let mut check =
        Walked { names: &names, tiles: 0, digest: Digest::default(), total: own.tiles, findings: Vec::new() };
    check.folder(base, &mut Vec::new(), progress)?;
    if (check.tiles, Some(check.digest)) != (own.tiles, Digest::parse(&own.digest)) {
        let problem = format!(
            "not the tiles that were written: there are {}, there were {}; or the hash of their bytes is another one",
            check.tiles, own.tiles
        );
        check.findings.push(Finding { place: "tiles".into(), problem });
    }
    // Changes by a concurrent update are not corruption.
    if !check.findings.is_empty() {
        check_lock()?;
        if TileFolder::open(base)?.2 != document {
            return Err(Error::Changed { path: base.to_path_buf(), what: "was updated" });
        }
    }
    Ok(check.findings)
}

struct Walked<'a> {
    names: &'a TileFolder,
    tiles: u64,
    digest: Digest,
    total: u64,
    findings: Vec<Finding>,
}

impl Walked<'_> {
    fn folder(&mut self, path: &Path, above: &mut Vec<String>, progress: &dyn Progress) -> Result<()> {
        let failed = || Error::io(path, "read the folder");
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
                let problem = "left by an update that was interrupted before it changed any tile: the next one removes it";
                self.findings.push(Finding { place: above[0].clone(), problem: problem.into() });
            } else if kind.is_dir() && above.len() < parts {
                self.folder(&path, above, progress)?;
            } else if kind.is_file() && above.len() == parts {
                match self.names.tile_of(&above.join("/")) {
                    Some(tile) => {
                        let bytes = fs::read(&path).map_err(Error::io(&path, "read"))?;
                        self.digest.add(tile.number(), 1, xxhash_rust::xxh3::xxh3_128(&bytes));
                        self.tiles += 1;
                        progress.advance(1, self.total);
                    }
                    None => self.stranger(&path),
                }
            } else if !(above.len() == 1 && above[0] == DOCUMENT) {
                self.stranger(&path);
            }
            above.pop();
        }
        Ok(())
    }

    fn stranger(&mut self, path: &Path) {
        if self.findings.len() < 100 {
            let problem = "no tile, and nothing that an export writes".into();
            self.findings.push(Finding { place: path.display().to_string(), problem });
        }
    }
}
