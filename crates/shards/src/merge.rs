//! Merging with removal: a call that is cut off, at any moment, is repeated.

use std::path::Path;

use spinney_base::io::{FileAccess, url_of};
use spinney_base::{Error, Progress, Result};
use spinney_container::FileHeader;
use spinney_engine::store::goblin::MergeOutput;

use crate::job::Job;

/// Limits of a merge, and whether its job is removed.
#[derive(Clone, Copy, Debug, Default)]
pub struct MergeOptions {
    /// Most bytes of the file.
    pub limit: Option<u64>,
    /// Whether shards, and then the job, are removed.
    pub removes: bool,
    /// Bytes that the directory may take before it goes to temporary files.
    pub memory: u64,
}

/// Outcome of a merge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Merged {
    /// The file was made of as many bytes of input.
    Made(u64),
    /// The file was whole already, and what was left of the job has been removed.
    Finished,
    /// There is a tree file, and no job: that is so after a merge that removed its job, and if the job has another name.
    JobMissing,
}

/// Puts the shards of the job in a directory together to a file, and removes it if `removes` is set: then the same call succeeds and cleans up
/// whatever was cut off.
///
/// # Errors
/// Those of [`Job::open_with`], [`MergeOutput::create`], [`Job::merge`] and [`Job::remove`].
pub fn merge(
    folder: &Path,
    path: &Path,
    options: MergeOptions,
    access: &FileAccess,
    progress: &dyn Progress,
) -> Result<Merged> {
    let MergeOptions { limit, removes, memory } = options;
    if removes && let Some((job, mark)) = MergeOutput::finished(path)? {
        Job::remove_if(folder, job, access)?;
        access.remove(&[&mark])?;
        return Ok(Merged::Finished);
    }
    if removes && is_nothing(folder) && FileHeader::find(path, access)?.is_some() {
        return Ok(Merged::JobMissing);
    }
    let job = Job::open_with(folder, access)?;
    let bytes = job.input_bytes();
    let mark = job.merge(MergeOutput::create(path, limit, removes, access)?, memory, progress)?;
    if removes {
        job.remove()?;
    }
    // Invariant: last, since it says that the file is whole, for a merge that is cut off before this.
    mark.map_or(Ok(()), |mark| access.remove(&[&mark]))?;
    Ok(Merged::Made(bytes))
}

/// Whether a local directory is missing or empty.
fn is_nothing(folder: &Path) -> bool {
    url_of(folder).is_none()
        && match std::fs::read_dir(folder).map_err(Error::io(folder, "read")) {
            Ok(mut entries) => entries.next().is_none(),
            Err(Error::Io { cause, .. }) => cause.kind() == std::io::ErrorKind::NotFound,
            Err(_) => false,
        }
}
