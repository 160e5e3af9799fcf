//! `spinney build` from a bintree's DF-expression: a tree of the same cells.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use spinney::raw::partitions::Bintree;
use spinney::tree::{Source, build_source};
use spinney::{BuildOptions, DataKind, Output, Progress};

use super::rasters::RasterArgs;
use super::{Common, Lines};

/// A bintree that was read, and the options for its tree.
pub(super) struct BintreeImport {
    tree: Bintree,
    options: BuildOptions,
    description: Lines,
}

impl BintreeImport {
    /// Whether a file's name has the extension of bintrees.
    pub(super) fn is_one(input: &Path) -> bool {
        input.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("bintree"))
    }

    /// Reads the bintree. It must be the only input.
    pub(super) fn plan(inputs: &[PathBuf], rasters: &RasterArgs, common: &Common) -> Result<BintreeImport> {
        let [input] = inputs else {
            bail!("got {} inputs, expected one bintree; `spinney combine over` merges trees", inputs.len())
        };
        let name = input.display();
        let of_positions = [
            ("--transform", rasters.transform.is_some()),
            ("--crs", common.crs.is_some()),
            ("--depth", common.depth.is_some()),
            ("--grid", common.grid.is_some()),
        ];
        let of_positions = of_positions.into_iter().find(|(_, given)| *given).map(|(option, _)| option);
        if let Some(option) =
            rasters.of_cells().or(rasters.of_warping()).or(rasters.of_stacks()).or(of_positions)
        {
            bail!(
                "{option}: has no effect on {name}, which is a bintree; use it when building from the resulting tree"
            )
        }
        let tree = Bintree::read(input, common.memory.bytes)?;
        let (kind, rule) = rasters.kind_and_rule();
        let mut options =
            BuildOptions::new(kind.unwrap_or(DataKind::Continuous), tree.depth()).memory(common.memory.bytes);
        options.rule = rule.unwrap_or(options.rule);
        options.kind.check_rule(options.rule, input)?;
        (options.share, options.time) = (common.share, common.time);
        options.packing = common.packing.choice();
        let description = vec![
            ("input", format!("{name}: a bintree of {} nodes, {}", tree.nodes().len(), tree.form())),
            ("kind", options.kind.to_string()),
            ("rule", options.rule.to_string()),
            ("depth", format!("{} levels, {1} x {1} cells", options.depth, 1u64 << options.depth)),
        ];
        Ok(BintreeImport { tree, options, description })
    }

    pub(super) fn description(&self) -> &[(&'static str, String)] {
        &self.description
    }

    pub(super) fn build(self, output: Output, progress: &dyn Progress) -> Result<()> {
        build_source(&self.tree, self.tree.extent(), &self.options, output, progress)?;
        Ok(())
    }
}
