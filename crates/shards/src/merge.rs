//! Merging with removal of the job. A call that was aborted at any moment can be repeated.

use std::path::Path;

use spinney_base::io::{FileAccess, url_of};
use spinney_base::{Error, Progress, Result};
use spinney_container::FileHeader;
use spinney_engine::store::goblin::MergeOutput;

use crate::job::Job;

/// Limits of a merge, and whether its job is removed.
#[derive(Clone, Copy, Debug, Default)]
pub struct MergeOptions {
    /// Maximum size of the file in bytes.
    pub limit: Option<u64>,
    /// Whether the shards, and then the job, are removed.
    pub removes: bool,
    /// Bytes of memory for the segment index, beyond which it goes to temporary files.
    pub memory: u64,
}

/// Outcome of a merge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MergeOutcome {
    /// The file was written, from this many bytes of input.
    Made(u64),
    /// The file was complete already, and the remains of the job have been removed.
    Finished,
    /// The tree file exists, and the job does not: the state after a merge that removed its job, or
    /// if the job has another name.
    JobMissing,
}

/// Merges the shards of the job in directory `directory` into a file. If `removes` is set, the job
/// is removed too; after an aborted call, the same call completes the merge and the removal.
///
/// # Errors
/// Those of [`Job::open_with`], [`MergeOutput::create`], [`Job::merge`] and [`Job::remove`].
pub fn merge(
    directory: &Path,
    path: &Path,
    options: MergeOptions,
    access: &FileAccess,
    progress: &dyn Progress,
) -> Result<MergeOutcome> {
    let MergeOptions { limit, removes, memory } = options;
    if removes && let Some((job, mark)) = MergeOutput::finished(path)? {
        Job::remove_if(directory, job, access)?;
        access.remove(&[&mark])?;
        return Ok(MergeOutcome::Finished);
    }
    if removes && is_nothing(directory) && FileHeader::find(path, access)?.is_some() {
        return Ok(MergeOutcome::JobMissing);
    }
    let job = Job::open_with(directory, access)?;
    let bytes = job.input_bytes();
    let mark = job.merge(MergeOutput::create(path, limit, removes, access)?, memory, progress)?;
    if removes {
        job.remove()?;
    }
    // Invariant: the mark is removed last. Until then it records that the file is complete, in case
    // this call is aborted.
    mark.map_or(Ok(()), |mark| access.remove(&[&mark]))?;
    Ok(MergeOutcome::Made(bytes))
}

/// Whether a local directory is missing or empty.
fn is_nothing(directory: &Path) -> bool {
    url_of(directory).is_none()
        && match std::fs::read_dir(directory).map_err(Error::io(directory, "read")) {
            Ok(mut entries) => entries.next().is_none(),
            Err(Error::Io { cause, .. }) => cause.kind() == std::io::ErrorKind::NotFound,
            Err(_) => false,
        }
}
