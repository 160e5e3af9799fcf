//! File I/O: mapped, positioned and remote reads, output that appears whole or not at all, locks,
//! and external sorting.

mod access;
pub mod batch;
mod cache;
mod commit_all;
mod completion;
mod expand;
mod faults;
mod file_id;
mod input;
mod lock;
mod lock_file;
mod output;
mod output_directory;
pub mod platform;
mod ranges;
mod read;
mod regular;
mod remote;
mod sorter;
pub mod spill;
mod spool;
mod stat;
mod unpacked;
mod waiting;
mod write;

pub use crate::url::{
    gdal_url, is_redacted, listed_path, local_path, redacted, shown, split_query, url_of, without_query,
};
pub use access::{FileAccess, Warn, any_file};
pub use cache::{CachedBytes, RangeCache};
pub use commit_all::{NewDirectories, commit_all};
pub use completion::{CompletionRecord, MAX_RECORD};
pub use expand::MAX_NAMES;
pub use faults::Faults;
pub use file_id::FileId;
pub use input::{InputFile, sibling_path};
pub use lock::{LockedFile, ReplaceLock};
pub use lock_file::LockFile;
pub use output::Output;
pub use output::directory_of;
pub use output::{Unfinished, already_exists_error, partial_of, sidecar_of, sync_directory};
pub use output_directory::OutputDirectory;
pub use ranges::{DEFAULT_GAP, Fetch, RangeFile};
pub use read::FileBytes;
pub use read::{Mapped, Positioned, ReadBackend, open_input};
pub use regular::{ConfinedDirectory, open_regular};
pub use remote::{RemoteFiles, RemoteWriter};
pub use sorter::Sorter;
pub use spool::{Spool, SpooledWords, WordSpooler};
pub use stat::{FileStat, FileVersion};
pub use unpacked::Unpacked;
pub use waiting::run_waiting;
pub use write::FileBackend;
pub use write::WriteBackend;
