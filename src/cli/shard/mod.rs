//! `spinney shard`: trees that many processes build, on one machine or on many.

mod build;
mod merge;
mod plan;

use anyhow::Result;
use clap::Subcommand;

use super::Global;

/// Build a tree in shards: by many processes, on one or many machines
///
/// Inputs are rasters, a volume, models, points, or other trees. `plan` inspects them and makes a
/// directory, the job, which lists the input of each shard; it reads no cells. `build` makes one
/// shard, in any order, on any machine where job and inputs have the same paths; it can be
/// repeated, and fails if inputs have changed since. `merge` merges the shards. The file is
/// byte-identical to that of `spinney build`, `transform` or `combine`.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    #[command(subcommand)]
    task: Task,
}

const EXAMPLES: &str = "\
Examples:
  spinney shard plan @tiles.txt -o job/ --shards 64
  spinney shard plan scan.nrrd -o job/ --codec packed
  spinney shard plan bridge.ply -o job/ --cell 0.01 --edge area
  spinney shard plan scans/*.laz -o job/ --where classification=2
  spinney shard plan-transform country.goblin warp=EPSG:3035,cell=30 -o job/
  spinney shard plan-combine changed 2020.goblin 2025.goblin -o job/
  spinney shard build job/ 0
  seq 0 63 | xargs -P 8 -n 1 spinney shard build job/
  seq 0 63 | parallel spinney shard build job/
  sbatch --array=0-63 --wrap 'spinney shard build job/ $SLURM_ARRAY_TASK_ID'
  spinney shard merge job/ -o country.goblin";

/// The subcommands, in the order of use.
#[derive(Subcommand)]
enum Task {
    Plan(Box<plan::Args>),
    PlanTransform(Box<plan::TransformArgs>),
    PlanCombine(Box<plan::CombineArgs>),
    Build(build::Args),
    Merge(merge::Args),
}

pub(crate) fn run(args: Args, global: &Global) -> Result<()> {
    match args.task {
        Task::Plan(args) => plan::run(*args, global),
        Task::PlanTransform(args) => plan::transform(&args, global),
        Task::PlanCombine(args) => plan::combine(&args, global),
        Task::Build(args) => build::run(&args, global),
        Task::Merge(args) => merge::run(&args, global),
    }
}
