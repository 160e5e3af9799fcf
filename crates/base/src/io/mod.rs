//! Files: read where they are mapped or at positions, written whole or not at all, locked, sorted beyond
//! memory.

mod faults;
mod file_id;
mod lock;
mod lock_file;
mod output;
mod output_folder;
pub mod platform;
mod read;
mod regular;
mod sorter;
pub mod spill;
mod spool;
mod write;

pub use faults::Faults;
pub use file_id::FileId;
pub use lock::{LockedFile, ReplaceLock};
pub use lock_file::LockFile;
pub use output::Output;
pub use output::folder;
pub use output::{Unfinished, partial_of, sidecar_of, sync_folder};
pub use output_folder::OutputFolder;
pub use read::FileBytes;
pub use read::positioned_reads_are_preferred;
pub use read::{Mapped, Positioned, ReadBackend, Stamp, open_input, prefer_positioned_reads};
pub use regular::{ClosedFolder, open_regular};
pub use sorter::Sorter;
pub use spool::{Spool, SpooledWords, WordSpooler};
pub use write::FileBackend;
pub use write::WriteBackend;
