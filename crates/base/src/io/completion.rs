//! Records that an output is whole, for work of several steps that goes on after its output is in place.

use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use super::access::FileAccess;
use crate::{Error, Result};

/// Bytes of a record, at most.
pub const MAX_RECORD: u64 = 256;

/// Bytes at the end of a file whose hash distinguishes it from others: these have the checksums of all else.
const TAIL: u64 = 4096;

/// A file that says that an output is whole, once that is so: written before the output takes its place, so that work that is
/// cut off after that can find out.
#[derive(Clone, Debug)]
pub struct CompletionRecord {
    /// The file.
    pub path: PathBuf,
    /// Its first line, which names the work.
    pub work: String,
}

impl CompletionRecord {
    /// Writes the record for a file of final bytes.
    pub(super) fn write(&self, file: &mut (impl Read + Seek)) -> Result<()> {
        let failed = || Error::io(&self.path, "record that the output is whole");
        let text = format!("{}\n{}\n", self.work, state(file).map_err(failed())?);
        let mut output = FileAccess::new().create(&self.path)?;
        output.write_all(text.as_bytes()).map_err(failed())?;
        output.commit()
    }

    /// The work that a record at a path says has made a local file as it is; `None` if there is no record, or the file is another one.
    ///
    /// # Errors
    /// If one of both cannot be read.
    pub fn work_of(record: &Path, file: &Path) -> Result<Option<String>> {
        let access = FileAccess::new();
        let Some(text) = access.read_whole(record, MAX_RECORD)? else { return Ok(None) };
        let text = String::from_utf8_lossy(&text);
        let Some((work, recorded)) = text.split_once('\n') else { return Ok(None) };
        let Some(mut file) = access.find(file)? else { return Ok(None) };
        let found = state(&mut file).map_err(Error::io(record, "compare the output with"))?;
        Ok((recorded.trim_end() == found).then(|| work.to_string()))
    }
}

/// Length and hash of the end of a file.
fn state(file: &mut (impl Read + Seek)) -> io::Result<String> {
    let length = file.seek(SeekFrom::End(0))?;
    file.seek(SeekFrom::Start(length.saturating_sub(TAIL)))?;
    let mut tail = Vec::new();
    file.take(TAIL).read_to_end(&mut tail)?;
    Ok(format!("{length} {:032x}", xxhash_rust::xxh3::xxh3_128(&tail)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::Output;

    #[test]
    fn outputs_are_recorded_before_they_are_in_place() {
        let folder = tempfile::tempdir().unwrap();
        let [path, record] = ["out", "record"].map(|name| folder.path().join(name));
        let work_of = || CompletionRecord::work_of(&record, &path).unwrap();
        let start = || {
            let mut output = Output::create(&path).unwrap();
            output.record_completion(CompletionRecord { path: record.clone(), work: "work".into() });
            output.write_all(&[7; 10_000]).unwrap();
            output
        };
        drop(start());
        assert!(!record.exists() && work_of().is_none());
        start().commit().unwrap();
        assert_eq!(work_of().as_deref(), Some("work"));
        // Another file of that name, one that is gone, and records that are none.
        std::fs::write(&path, [7; 10_001]).unwrap();
        assert_eq!(work_of(), None);
        std::fs::remove_file(&path).unwrap();
        assert_eq!(work_of(), None);
        std::fs::write(&record, "work").unwrap();
        assert_eq!(work_of(), None);
    }
}
