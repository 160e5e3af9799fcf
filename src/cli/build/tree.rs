//! `spinney build` from a tree: the same cells, with the changes of the options.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use spinney::raw::dataset::Rebuild;
use spinney::raw::ops::only_layer;
use spinney::raw::shards::JobSpec;
use spinney::{BuildOptions, Dataset, Frame, Output, Progress};

use super::super::open;
use super::rasters::{RasterArgs, Transform};
use super::{Common, Lines};

/// An open tree, and the options for the new one.
pub(super) struct TreeImport {
    tree: Dataset,
    options: BuildOptions,
    description: Lines,
}

/// Returns the job of rebuilding a tree, which must be the only input.
pub(in super::super) fn spec(inputs: &[PathBuf], rasters: &RasterArgs, common: &Common) -> Result<JobSpec> {
    let input = only_tree(inputs, rasters, common)?;
    let other = rebuild(input, open(input, &common.access)?.header().form.axes(), rasters, common)?;
    Ok(JobSpec::Rebuild { input: input.into(), other, packing: common.packing.choice() })
}

/// Returns the path of the tree, which must be the only input. Fails for options that trees reject.
fn only_tree<'a>(inputs: &'a [PathBuf], rasters: &RasterArgs, common: &Common) -> Result<&'a Path> {
    let [input] = inputs else {
        bail!("got {} inputs, expected one tree; `spinney combine over` merges trees", inputs.len())
    };
    let name = input.display();
    if let Some(option) = rasters.of_cells() {
        bail!("{option}: works only with rasters and volumes; {name} is a tree")
    }
    if common.grid.is_some() || rasters.of_warping().is_some() {
        bail!("--grid: {name} is a tree; `spinney transform {name} grid=xyz -o OUT` or `like=TREE` warps it")
    }
    let fitting = [
        "--kind",
        "--rule",
        "--depth",
        "--transform",
        "--crs",
        "--share",
        "--time",
        "--codec",
        "--max-error",
        "--shards",
    ];
    common.given.check("a tree that is built again", &fitting)?;
    only_layer(input, &common.access)?;
    Ok(input)
}

/// Returns the properties to change in a tree with so many axes.
fn rebuild(input: &Path, axes: usize, rasters: &RasterArgs, common: &Common) -> Result<Rebuild> {
    let name = input.display();
    let matrix = match (rasters.transform, axes) {
        (None, _) => None,
        (Some(Transform::Raster(numbers)), 2) => Some(Frame::planar(numbers).matrix),
        (Some(Transform::Volume(matrix)), 3) => Some(matrix),
        (Some(_), 2) => bail!("--transform: {name} is a quadtree, expected 6 numbers"),
        (Some(_), _) => bail!("--transform: {name} is an octree, expected 3 or 12 numbers"),
    };
    let (kind, rule, depth) = (rasters.kind, rasters.rule, common.depth);
    Ok(Rebuild { kind, rule, depth, matrix, crs: common.crs.clone() })
}

impl TreeImport {
    /// Opens the tree, which must be the only input.
    pub(super) fn plan(inputs: &[PathBuf], rasters: &RasterArgs, common: &Common) -> Result<TreeImport> {
        let input = only_tree(inputs, rasters, common)?;
        let name = input.display();
        let tree = open(input, &common.access)?;
        let other = rebuild(input, tree.header().form.axes(), rasters, common)?;
        let mut options = tree.rebuild_options(&other, common.memory.bytes)?;
        (options.share, options.time) = (common.share, common.time);
        options.packing = common.packing.choice();
        let description = vec![
            ("input", format!("{name}: {} file, {}", tree.format().name(), tree.header().form)),
            ("kind", options.kind.to_string()),
            ("rule", options.rule.to_string()),
            ("depth", format!("{} levels, {1} x {1} cells", options.depth, 1u64 << options.depth.min(63))),
        ];
        Ok(TreeImport { tree, options, description })
    }

    pub(super) fn description(&self) -> &[(&'static str, String)] {
        &self.description
    }

    pub(super) fn build(self, output: Output, progress: &dyn Progress) -> Result<()> {
        Ok(self.tree.build(&self.options, output, progress)?)
    }
}
