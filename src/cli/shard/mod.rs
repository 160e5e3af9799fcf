//! `spinney shard`: trees that are built by many processes, on one machine or on many.

mod build;
mod merge;
mod plan;

use anyhow::Result;
use clap::Subcommand;

use super::Global;

/// Build a tree of pictures, of a volume, of models, of points, or of other trees, in shards, by many processes, on one machine or on many.
///
/// `plan` looks at the inputs and makes a folder, the job, which says what each shard is made of; no cell is read. `build` makes one shard, in any
/// order, anywhere where the same paths lead to job and inputs; it can be run again, and stops where inputs have changed since.
/// `merge` puts the shards together. The file has the bytes that `spinney build`, `transform` or `combine` would have written.
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    #[command(subcommand)]
    step: Step,
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

/// Steps, in their order.
#[derive(Subcommand)]
enum Step {
    Plan(Box<plan::Args>),
    PlanTransform(Box<plan::TransformArgs>),
    PlanCombine(Box<plan::CombineArgs>),
    Build(build::Args),
    Merge(merge::Args),
}

pub(crate) fn run(args: Args, global: &Global) -> Result<()> {
    match args.step {
        Step::Plan(args) => plan::run(*args, global),
        Step::PlanTransform(args) => plan::transform(&args, global),
        Step::PlanCombine(args) => plan::combine(&args, global),
        Step::Build(args) => build::run(&args, global),
        Step::Merge(args) => merge::run(&args, global),
    }
}
