//! Files: read where they are mapped or at positions, written whole or not at all, locked, sorted beyond
//! memory.

mod faults;
mod file_id;
mod lock;
mod output;
#[cfg(feature = "mesh")]
mod output_folder;
pub(crate) mod platform;
mod read;
mod sorter;
#[cfg(feature = "mesh")]
mod spool;
mod write;

pub use faults::Faults;
pub use file_id::FileId;
pub(crate) use lock::LockedFile;
pub use output::Output;
pub(crate) use output::folder;
#[cfg(feature = "raster")]
pub(crate) use output::{Unfinished, partial_of, sidecar_of, sync_folder};
#[cfg(feature = "mesh")]
pub use output_folder::OutputFolder;
pub(crate) use read::FileBytes;
pub(crate) use read::positioned_reads_are_preferred;
pub use read::{Mapped, Positioned, ReadBackend, Stamp, prefer_positioned_reads};
pub(crate) use sorter::Sorter;
#[cfg(feature = "mesh")]
pub(crate) use spool::{Spool, SpooledWords, WordSpooler};
pub(crate) use write::FileBackend;
pub use write::WriteBackend;
