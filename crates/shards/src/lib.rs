//! Trees that are built in *shards*, by many processes, on one machine or on many: a job is planned, each of its shards is built by itself, and
//! shards are merged. The bytes are those of a file that is built in one go.
//!
//! ```
//! # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
//! use spinney::import::raster::ImportOptions;
//! use spinney::{FileAccess, Output};
//! use spinney::raw::shards::{Job, JobSpec, plan};
//!
//! # let folder = tempfile::tempdir().unwrap();
//! # let (job, merged) = (folder.path().join("job"), folder.path().join("island.goblin"));
//! let inputs = vec!["fixtures/island_elevation.tif".into()];
//! plan(&JobSpec::Pictures { inputs, options: ImportOptions::new() }, &job, Some(2), &FileAccess::default(), &())?;
//! // Each of these may be another process, and may be run again.
//! for number in 0..2 {
//!     Job::open(&job)?.build(number, 256 << 20, &())?;
//! }
//! Job::open(&job)?.merge(Output::create(&merged)?.into(), 256 << 20, &())?;
//! assert_eq!(spinney::open(&merged)?.depth(), 8);
//! # Ok::<(), spinney::Error>(())
//! ```
//!
//! A job is a folder. `plan.json` says what is made of what, and by which shards; it appears last, so that without it there is no job.
//! `head.goblin` is a tree file with all that is told of the layers, and no cells. `shards/` has two kinds of files of each shard that
//! is made: its segments of each layer, and what merging has to know of them, which appears last.

mod balance;
mod build;
mod job;
mod merge;
mod plan;
mod stamp;
mod work;

pub use build::Built;
pub use job::Job;
pub use merge::{MergeOptions, Merged, merge};
pub use plan::{GivenLayers, Planned, plan, plan_given};
pub use work::JobSpec;
