//! `spinney shard plan`: what is built of what, and by which shards.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use spinney::csg::Csg;
use spinney::import::{mesh, volume};
use spinney::reconstruction::is_views_name;
use spinney::shards::{ShardedImport, plan};
use spinney::store::{TreeFormat, file_is_tree};

use super::super::Global;
use super::super::args::expand_lists;
use super::super::build::{Common, PictureArgs};
use super::super::report::{Work, quantity};

/// Plan a job: look at pictures, and write down what each shard is made of
///
/// The options are those of `spinney build` for pictures. The same plan can be made again; a folder that has another one is left as it is.
#[derive(clap::Args)]
pub(super) struct Args {
    /// Raster files (of several, the last lies on top, or with --stack all are layers); @FILE stands for the paths in a file, one a line
    #[arg(required = true, value_name = "INPUT")]
    inputs: Vec<PathBuf>,
    /// File to write: a folder, which has the job, and is made if there is none
    #[arg(short, long, value_name = "JOB")]
    output: PathBuf,
    /// Shards to make; each is a part of the space with about as many bytes of input [default: one for each GiB of input]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    shards: Option<u32>,
    #[command(flatten)]
    common: Common,
    #[command(flatten)]
    pictures: PictureArgs,
}

/// The name of what is no picture, if an input is something that `build` takes and shards do not.
fn other_kind(input: &Path) -> Option<&'static str> {
    let kinds = [
        ("a tree", file_is_tree(input)),
        ("a solid of primitives", Csg::is_name(input)),
        ("views of a solid", is_views_name(input)),
        ("a model of a solid", mesh::is_model(input)),
        ("a volume", volume::is_volume(input)),
    ];
    kinds.into_iter().find(|(_, is_one)| *is_one).map(|(kind, _)| kind)
}

impl Args {
    fn import(&self) -> Result<ShardedImport> {
        let Args { common, pictures, .. } = self;
        if let Some(option) = common.not_of_shards().or(pictures.not_of_shards()) {
            bail!("{option} is not for shards: `spinney build` has it")
        }
        Ok(match pictures.stack_options(common)? {
            Some(stack) => ShardedImport::Stack(stack),
            None => match pictures.of_warping() {
                Some(option) => {
                    bail!("{option} is for other grids, which shards do not have: `spinney build` has it")
                }
                None => ShardedImport::Pictures(pictures.import_options(common)?),
            },
        })
    }
}

pub(super) fn run(mut args: Args, global: &Global) -> Result<()> {
    args.inputs = expand_lists(args.inputs)?;
    let job = &args.output;
    if TreeFormat::of(job) == TreeFormat::Autumnal || job.extension().is_some_and(|ending| ending == "goblin")
    {
        bail!(
            "{}: is the name of a tree; -o is the folder of a job, and `spinney shard merge` writes the tree, a .goblin file",
            job.display()
        )
    }
    if let Some((input, kind)) = args.inputs.iter().find_map(|input| Some((input, other_kind(input)?))) {
        bail!(
            "{}: is {kind}; shards are of pictures, `spinney build` makes the tree in one go",
            input.display()
        )
    }
    let work = Work::start(global, "files")?;
    let planned = plan(&args.inputs, &args.import()?, job, args.shards, &work)?;
    work.finish();
    for (heading, text) in &planned.description {
        global.report(heading, text);
    }
    let (busy, all) = (planned.job.busy_shards(), planned.job.shards());
    let bytes = quantity::bytes(planned.job.input_bytes());
    let empty =
        if busy < all { format!(", {} of which have nothing to do", all - busy) } else { String::new() };
    let was_there = if planned.was_there { ", as it was planned before" } else { "" };
    global
        .report("job", format_args!("{}: {all} shards of {bytes} of input{empty}{was_there}", job.display()));
    let name = job.display();
    global.report(
        "next",
        format_args!(
            "spinney shard build {name} 0 and so on to {}; spinney shard merge {name} -o OUT.goblin",
            all - 1
        ),
    );
    Ok(())
}
