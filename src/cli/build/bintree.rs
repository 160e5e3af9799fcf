//! `spinney build` from a bintree's DF-expression: a tree of the same cells.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use spinney::raw::partitions::Bintree;
use spinney::tree::{Source, build_source};
use spinney::{BuildOptions, DataKind, Output, Progress};

use super::pictures::PictureArgs;
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
    pub(super) fn plan(inputs: &[PathBuf], pictures: &PictureArgs, common: &Common) -> Result<BintreeImport> {
        let [input] = inputs else {
            bail!("a bintree as an input is the only one; `spinney combine` lays trees over each other")
        };
        let name = input.display();
        let of_places = [
            ("--transform", pictures.transform.is_some()),
            ("--crs", common.crs.is_some()),
            ("--depth", common.depth.is_some()),
            ("--grid", common.grid.is_some()),
        ];
        let of_places = of_places.into_iter().find(|(_, given)| *given).map(|(option, _)| option);
        if let Some(option) =
            pictures.of_cells().or(pictures.of_warping()).or(pictures.of_stacks()).or(of_places)
        {
            bail!(
                "{option}: {name} is a bintree, whose cells are taken as they are; `spinney build` of the tree that it becomes takes more"
            )
        }
        let tree = Bintree::read(input, common.memory.bytes)?;
        let (kind, rule) = pictures.kind_and_rule();
        let mut options =
            BuildOptions::new(kind.unwrap_or(DataKind::Continuous), tree.depth()).memory(common.memory.bytes);
        options.rule = rule.unwrap_or(options.rule);
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
