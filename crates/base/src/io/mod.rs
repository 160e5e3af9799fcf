//! Files: read where they are mapped, at positions, or in ranges from elsewhere, written whole or not at all, locked, sorted beyond
//! memory.

mod access;
pub mod batch;
mod cache;
mod faults;
mod file_id;
mod input;
mod lock;
mod lock_file;
mod output;
mod output_folder;
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
mod write;

pub use crate::url::{local_path, split_query, url_of, without_query};
pub use access::FileAccess;
pub use cache::{CachedBytes, RangeCache};
pub use faults::Faults;
pub use file_id::FileId;
pub use input::{InputFile, beside};
pub use lock::{LockedFile, ReplaceLock};
pub use lock_file::LockFile;
pub use output::Output;
pub use output::folder;
pub use output::{Unfinished, already_exists_error, partial_of, sidecar_of, sync_folder};
pub use output_folder::OutputFolder;
pub use ranges::{DEFAULT_GAP, Fetch, RangeFile};
pub use read::FileBytes;
pub use read::{Mapped, Positioned, ReadBackend, Stamp, open_input};
pub use regular::{ClosedFolder, open_regular};
pub use remote::{RemoteFiles, RemoteWriter};
pub use sorter::Sorter;
pub use spool::{Spool, SpooledWords, WordSpooler};
pub use stat::{FileStat, FileVersion};
pub use unpacked::Unpacked;
pub use write::FileBackend;
pub use write::WriteBackend;
