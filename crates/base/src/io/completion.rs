//! Records that an output is complete, for operations that continue after the commit of their
//! output.

use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use super::access::FileAccess;
use crate::{Error, Result};

/// Maximum size of a record in bytes.
pub const MAX_RECORD: u64 = 256;

/// Bytes at the end of a file whose hash identifies it: they contain the checksums of the rest.
const TAIL: u64 = 4096;

/// Record that an output is complete.
///
/// It is written when the output's bytes are final, but before the output is renamed. So an
/// operation that was interrupted after the rename can detect that its output is complete.
#[derive(Clone, Debug)]
pub struct CompletionRecord {
    /// Path of the record.
    pub path: PathBuf,
    /// First line of the record, which identifies the operation.
    pub work: String,
}

impl CompletionRecord {
    /// Writes the record for a file whose bytes are final.
    pub(super) fn write(&self, file: &mut (impl Read + Seek)) -> Result<()> {
        let failed = || Error::io(&self.path, "write the completion record");
        let text = format!("{}\n{}\n", self.work, state(file).map_err(failed())?);
        let mut output = FileAccess::new().create(&self.path)?;
        output.write_all(text.as_bytes()).map_err(failed())?;
        output.commit()
    }

    /// Returns the operation that made a local file, if the record matches the file's present
    /// bytes; `None` if there is no such record or file.
    ///
    /// # Errors
    /// If the record or the file cannot be read.
    pub fn work_of(record: &Path, file: &Path) -> Result<Option<String>> {
        let access = FileAccess::new();
        let Some(text) = access.read_whole(record, MAX_RECORD)? else { return Ok(None) };
        let text = String::from_utf8_lossy(&text);
        let Some((work, recorded)) = text.split_once('\n') else { return Ok(None) };
        let Some(mut file) = access.find(file)? else { return Ok(None) };
        let found = state(&mut file).map_err(Error::io(record, "compare it with the output"))?;
        Ok((recorded.trim_end() == found).then(|| work.to_string()))
    }
}

/// Returns length and hash of the end of a file.
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
        let directory = tempfile::tempdir().unwrap();
        let [path, record] = ["out", "record"].map(|name| directory.path().join(name));
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
        // Another file of that name, a removed one, and an invalid record.
        std::fs::write(&path, [7; 10_001]).unwrap();
        assert_eq!(work_of(), None);
        std::fs::remove_file(&path).unwrap();
        assert_eq!(work_of(), None);
        std::fs::write(&record, "work").unwrap();
        assert_eq!(work_of(), None);
    }
}
