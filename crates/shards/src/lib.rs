//! Distributed builds: many processes, on one or more machines, build a tree in *shards*. A job is
//! planned, each shard is built independently, and the shards are merged. The merged file is
//! byte-identical to that of a single-process build.
//!
//! ```
//! # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
//! use spinney::import::raster::ImportOptions;
//! use spinney::{FileAccess, Output};
//! use spinney::raw::shards::{Job, JobSpec, plan};
//!
//! # let directory = tempfile::tempdir().unwrap();
//! # let (job, merged) = (directory.path().join("job"), directory.path().join("island.goblin"));
//! let inputs = vec!["fixtures/island_elevation.tif".into()];
//! plan(&JobSpec::Rasters { inputs, options: ImportOptions::new() }, &job, Some(2), &FileAccess::default(), &())?;
//! // Each of these may be another process, and may be run again.
//! for number in 0..2 {
//!     Job::open(&job)?.build(number, 256 << 20, &())?;
//! }
//! Job::open(&job)?.merge(Output::create(&merged)?.into(), 256 << 20, &())?;
//! assert_eq!(spinney::open(&merged)?.depth(), 8);
//! # Ok::<(), spinney::Error>(())
//! ```
//!
//! A job is a directory. `plan.json` records the inputs, the work and the shards; it is written
//! last, so a directory without it is not a job. `head.goblin` is a tree file with the layers'
//! headers and metadata, but without cells. `shards/` has two kinds of files per finished shard:
//! its segments of each layer, and a summary for merging, which is written last.

mod balance;
mod build;
mod job;
mod merge;
mod plan;
mod stamp;
mod work;

pub use build::ShardOutcome;
pub use job::Job;
pub use merge::{MergeOptions, MergeOutcome, merge};
pub use plan::{ArrayLayers, PlanOutcome, plan, plan_arrays};
pub use work::JobSpec;
