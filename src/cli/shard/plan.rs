//! `spinney shard plan`: the inputs of a job, and its shards.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use spinney::import::feature::FeatureFilter;
use spinney::raw::csg::Csg;
use spinney::raw::import::feature::is_feature_file;
use spinney::raw::import::mesh;
use spinney::raw::io::any_file;
use spinney::raw::points::is_las_file;
use spinney::raw::reconstruction::is_views_name;
use spinney::raw::shards::{JobSpec, plan};
use spinney::raw::store::{TreeFormat, file_is_tree};

use super::super::args::{Packing, check_output, expand_lists};
use super::super::build::{Common, RasterArgs, SolidArgs, check_kinds, points as scans, tree_spec};
use super::super::combine::MergingArgs;
use super::super::index::parse_levels;
use super::super::report::{Work, quantity};
use super::super::transform::ChainArgs;
use super::super::{Global, exact, points};

/// Directory of a job, and its shards.
#[derive(clap::Args)]
struct JobArgs {
    /// File to write: the directory of the job, which is created if it does not exist
    #[arg(short, long, value_name = "JOB")]
    output: PathBuf,
    /// Number of shards; each is a region with about the same number of input bytes [default: one
    /// for each GiB of input]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    shards: Option<u32>,
}

/// Plan a job of building a tree
///
/// Inspects rasters, a volume, models, scans or a tree, and records the input of each shard. The
/// options are those of `spinney build`. The surface of models must be closed, and is read as a
/// whole. The same plan can be made again; a directory with another plan is not changed.
#[derive(clap::Args)]
pub(super) struct Args {
    /// Raster files (the last is on top, or with --stack all are layers), a volume, models, LAS and
    /// LAZ files, or a tree; @FILE reads paths from a file, one a line
    #[arg(required = true, value_name = "INPUT")]
    inputs: Vec<PathBuf>,
    #[command(flatten)]
    job: JobArgs,
    #[command(flatten)]
    common: Common,
    #[command(flatten)]
    rasters: RasterArgs,
    #[command(flatten)]
    solids: SolidArgs,
    /// Make an index of TIFF files, whose cells stay in these: see `spinney index`
    #[arg(long)]
    index: bool,
    /// Levels between the cells and the finest stored level of an index: 1, 2 or 4 [default: 2]
    #[arg(long, value_name = "LEVELS", requires = "index", value_parser = parse_levels)]
    stored_level: Option<u8>,
    /// Only features for which all conditions hold; here points of LAS and LAZ files, as in
    /// 'classification=2,intensity>100'
    #[arg(long = "where", value_name = "CONDITION,...", help_heading = "Points")]
    filter: Option<FeatureFilter>,
}

/// Plan a job of transforming a tree
///
/// Files and operations are those of `spinney transform`, except operations that first scan all
/// cells (components=, sieve=).
#[derive(clap::Args)]
pub(super) struct TransformArgs {
    #[command(flatten)]
    chain: ChainArgs,
    #[command(flatten)]
    job: JobArgs,
    #[command(flatten)]
    packing: Packing,
}

/// Plan a job of combining trees
///
/// Operations, files and options are those of `spinney combine` for trees of cells.
#[derive(clap::Args)]
pub(super) struct CombineArgs {
    #[command(flatten)]
    merging: MergingArgs,
    #[command(flatten)]
    job: JobArgs,
    #[command(flatten)]
    packing: Packing,
}

/// Returns the kind of an input that `build` accepts and shards do not.
fn other_kind(input: &Path) -> Option<&'static str> {
    let kinds = [
        ("standard input", input == Path::new("-")),
        ("a solid of primitives", Csg::is_name(input)),
        ("views of a solid", is_views_name(input)),
        ("a feature file", is_feature_file(input)),
    ];
    kinds.into_iter().find(|(_, is_one)| *is_one).map(|(kind, _)| kind)
}

pub(super) fn run(mut args: Args, global: &Global) -> Result<()> {
    let inputs = expand_lists(args.inputs)?;
    (args.common.access, args.common.given) = (global.access().clone(), global.given().clone());
    let (job, common, rasters, solids) = (&args.job, &args.common, &args.rasters, &args.solids);
    if let Some(option) = common.not_of_shards() {
        bail!("{option}: works only with `spinney build`, not with shards")
    }
    if let Some((input, kind)) = inputs.iter().find_map(|input| Some((input, other_kind(input)?))) {
        bail!(
            "{}: is {kind}, expected rasters, a volume, models, LAS and LAZ files, or a tree; use `spinney build`",
            input.display()
        )
    }
    check_kinds(&inputs, global.access())?;
    let is_other = |input: &Path| {
        Ok(is_las_file(input)
            || file_is_tree(input, global.access())?
            || mesh::is_model(input, global.access())?)
    };
    if args.index && any_file(&inputs, &is_other)? {
        bail!("--index: works only with TIFF files and virtual rasters of these")
    }
    if inputs.iter().any(|input| is_las_file(input)) {
        return job.plan(&scans::job(inputs, (common, solids), args.filter.as_ref())?, global);
    }
    if args.filter.is_some() {
        bail!("{}: has no points; --where works only with LAS and LAZ files", inputs[0].display())
    }
    if any_file(&inputs, &|input| mesh::is_model(input, global.access()))? {
        return job.plan(&solids.job(inputs, &job.output, rasters, common)?, global);
    }
    solids.refuse(&inputs[0])?;
    if any_file(&inputs, &|input| file_is_tree(input, global.access()))? {
        return job.plan(&tree_spec(&inputs, rasters, common)?, global);
    }
    if let Some(input) = rasters.volume_input(&inputs)? {
        return job.plan(&JobSpec::Volume { input, options: rasters.volume_options(common)? }, global);
    }
    if args.index {
        let mut options = rasters.import_options(common)?;
        options.referenced = Some(args.stored_level.unwrap_or(2));
        if let Some(option) = rasters.of_stacks().or(rasters.of_warping()) {
            bail!(
                "{option}: shards of an index have one layer, on the grid of the files; see `spinney index`"
            )
        }
        if let Some(option) = ["--codec", "--max-error"].into_iter().find(|name| common.given.has(name)) {
            bail!("{option}: has no effect on an index, whose cells stay in the files")
        }
        return job.plan(&JobSpec::Rasters { inputs, options }, global);
    }
    let spec = match rasters.stack_options(&inputs, common)? {
        Some(options) => JobSpec::Stack { inputs, options },
        None => match rasters.of_warping() {
            Some(option) => {
                bail!("{option}: works only with `spinney build`; shards keep the grid of the inputs")
            }
            None => JobSpec::Rasters { inputs, options: rasters.import_options(common)? },
        },
    };
    job.plan(&spec, global)
}

pub(super) fn transform(args: &TransformArgs, global: &Global) -> Result<()> {
    let TransformArgs { chain, job, packing } = args;
    let (chain, packing) = (chain.chain(global)?, packing.choice());
    let name = chain.path.display();
    if points::open(&chain.path, global)?.is_some() {
        bail!("{name}: is a tree of points, which shards do not support; use `spinney transform`")
    }
    if exact::open(&chain.path, global)?.is_some() {
        bail!("{name}: is an exact model, which shards do not support; use `spinney transform`")
    }
    job.plan(&JobSpec::Transform { chain, packing }, global)
}

pub(super) fn combine(args: &CombineArgs, global: &Global) -> Result<()> {
    let CombineArgs { merging, job, packing } = args;
    job.plan(&merging.spec(packing.choice(), global)?, global)
}

impl JobArgs {
    fn plan(&self, spec: &JobSpec, global: &Global) -> Result<()> {
        let directory = &self.output;
        let is_tree_name = TreeFormat::of(directory) == TreeFormat::Autumnal
            || directory.extension().is_some_and(|ending| ending == "goblin");
        if is_tree_name {
            bail!(
                "{}: is the name of a tree file, expected a directory for the job; `spinney shard merge` writes the tree",
                directory.display()
            )
        }
        check_output(spec.inputs().iter().map(PathBuf::as_path), directory)?;
        let work = Work::start(global, "files")?;
        let planned = plan(spec, directory, self.shards, global.access(), &work)?;
        work.finish();
        for (heading, text) in &planned.description {
            global.report(heading, text);
        }
        let (busy, all) = (planned.job.busy_shards(), planned.job.shards());
        let bytes = quantity::bytes(planned.job.input_bytes());
        let empty = if busy < all { format!(", {} of them empty", all - busy) } else { String::new() };
        let was_there = if planned.existed { ", planned before" } else { "" };
        let name = directory.display();
        global.report(
            "job",
            format_args!(
                "{name}: {} of {bytes} of input{empty}{was_there}",
                quantity::counted(all.into(), "shard")
            ),
        );
        global.report(
            "next",
            format_args!(
                "spinney shard build {name} K for K from 0 to {}; spinney shard merge {name} -o OUT.goblin",
                all - 1
            ),
        );
        Ok(())
    }
}
