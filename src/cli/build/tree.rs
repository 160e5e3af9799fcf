//! `spinney build` of a tree: the same cells, with what options say.

use std::path::PathBuf;

use anyhow::{Result, bail};
use spinney::Progress;
use spinney::dataset::Dataset;
use spinney::io::Output;
use spinney::ops::only_layer;
use spinney::space::Frame;
use spinney::store::BuildOptions;

use super::super::open;
use super::pictures::{PictureArgs, Transform};
use super::{Common, Lines};

/// A tree that is open, and what is to be made of it.
pub(super) struct TreeImport {
    tree: Dataset,
    options: BuildOptions,
    description: Lines,
}

impl TreeImport {
    /// Opens the tree among the inputs, which has to be the only one.
    pub(super) fn plan(inputs: &[PathBuf], pictures: &PictureArgs, common: &Common) -> Result<TreeImport> {
        let [input] = inputs else {
            bail!("a tree as an input is the only one; `spinney combine` lays trees over each other")
        };
        let name = input.display();
        if let Some(option) = pictures.of_cells() {
            bail!("{option} is for pictures and volumes; {name} is a tree, whose cells are taken as they are")
        }
        if common.grid.is_some() || pictures.of_warping().is_some() {
            bail!(
                "--grid: {name} is a tree; `spinney transform {name} grid=xyz -o OUT` or `like=TREE` warps it"
            )
        }
        only_layer(input)?;
        let tree = open(input)?;
        let mut options = tree.build_options(common.memory.bytes);
        (options.share, options.time) = (common.share, common.time);
        options.packing = common.packing.choice()?;
        if let Some(kind) = pictures.kind
            && kind != options.kind
        {
            (options.kind, options.rule) = (kind, kind.default_rule());
        }
        options.rule = pictures.rule.unwrap_or(options.rule);
        options.depth = common.depth.unwrap_or(options.depth);
        let frame = &mut options.metadata.frame;
        match (pictures.transform, tree.header().form.axes()) {
            (None, _) => {}
            (Some(Transform::Picture(numbers)), 2) => frame.matrix = Frame::planar(numbers).matrix,
            (Some(Transform::Volume(matrix)), 3) => frame.matrix = matrix,
            (Some(_), 2) => bail!("--transform: {name} is a quadtree, six numbers are expected"),
            (Some(_), _) => bail!("--transform: {name} is an octree, three or twelve numbers are expected"),
        }
        if frame.matrix.iter().flatten().any(|number| !number.is_finite())
            || frame.to_cells([0.0; 3]).is_none()
        {
            bail!("--transform: numbers that have no inverse")
        }
        if let Some(crs) = &common.crs {
            frame.crs = Some(crs.clone());
        }
        let description = vec![
            ("input", format!("{name}: a {} file, {}", tree.format().name(), tree.header().form)),
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
