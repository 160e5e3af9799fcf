//! `spinney build` of the text of trees of cells: DF-expressions (`.df`), bintrees (`.bintree`),
//! and BSP trees of the plane (`.bsp`).

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use spinney::raw::partitions::{Bintree, DfText, PlaneText};
use spinney::raw::store::build_tree;
use spinney::tree::{Source as _, build_source};
use spinney::{BuildOptions, DataKind, Dimension, Output, Progress, SampleType, TreeType, ValueType};

use super::rasters::RasterArgs;
use super::{Common, Lines};

/// An expression that was read, and the options for its tree.
pub(super) struct ExpressionImport {
    cells: Cells,
    options: BuildOptions,
    description: Lines,
}

enum Cells {
    Df(DfText),
    Bintree(Bintree),
    Bsp(PlaneText),
}

impl Cells {
    fn read(input: &Path, memory: u64) -> spinney::Result<Cells> {
        if has_ending(input, "df") {
            return DfText::read(input, memory).map(Cells::Df);
        }
        match has_ending(input, "bsp") {
            true => PlaneText::read(input, memory).map(Cells::Bsp),
            false => Bintree::read(input, memory).map(Cells::Bintree),
        }
    }

    fn form(&self) -> TreeType {
        match self {
            Cells::Df(df) => df.tree.form(),
            Cells::Bintree(bintree) => bintree.form(),
            Cells::Bsp(_) => TreeType::new(Dimension::Quad, ValueType::new(SampleType::U8, 1)),
        }
    }

    fn depth(&self) -> u8 {
        match self {
            Cells::Df(df) => df.depth(),
            Cells::Bintree(bintree) => bintree.depth(),
            Cells::Bsp(bsp) => bsp.depth,
        }
    }
}

fn has_ending(input: &Path, name: &str) -> bool {
    input.extension().is_some_and(|ending| ending.eq_ignore_ascii_case(name))
}

impl ExpressionImport {
    /// Whether a file's name has the extension of expressions of cells.
    pub(super) fn is_one(input: &Path) -> bool {
        ["bintree", "df", "bsp"].into_iter().any(|name| has_ending(input, name))
    }

    /// Reads the expression. It must be the only input.
    pub(super) fn plan(
        inputs: &[PathBuf],
        rasters: &RasterArgs,
        common: &Common,
    ) -> Result<ExpressionImport> {
        let [input] = inputs else {
            bail!("got {} inputs, expected one expression; `spinney combine over` merges trees", inputs.len())
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
                "{option}: has no effect on {name}, which is an expression; use it when building from the resulting tree"
            )
        }
        let cells = Cells::read(input, common.memory.bytes)?;
        let (kind, rule) = rasters.kind_and_rule();
        let depth = cells.depth();
        let mut options =
            BuildOptions::new(kind.unwrap_or(DataKind::Continuous), depth).memory(common.memory.bytes);
        options.rule = rule.unwrap_or(options.rule);
        options.kind.check_rule(options.rule, input)?;
        (options.share, options.time) = (common.share, common.time);
        options.packing = common.packing.choice();
        let form = cells.form();
        let what = match &cells {
            Cells::Df(df) => format!("{name}: a tree of {} inner nodes, {form}", df.tree.inner_nodes()),
            Cells::Bintree(bintree) => {
                format!("{name}: a bintree of {} nodes, {form}", bintree.nodes().len())
            }
            Cells::Bsp(bsp) => format!("{name}: a BSP tree of {} nodes, {form}", bsp.tree.nodes().len()),
        };
        let description = vec![
            ("input", what),
            ("kind", options.kind.to_string()),
            ("rule", options.rule.to_string()),
            ("depth", format!("{depth} levels, {0} x {0} cells", 1u64 << depth)),
        ];
        Ok(ExpressionImport { cells, options, description })
    }

    pub(super) fn description(&self) -> &[(&'static str, String)] {
        &self.description
    }

    pub(super) fn build(self, output: Output, progress: &dyn Progress) -> Result<()> {
        match &self.cells {
            Cells::Df(df) => build_tree(&df.tree, df.extent, &self.options, output, progress)?,
            Cells::Bintree(bintree) => {
                build_source(bintree, bintree.extent(), &self.options, output, progress)?
            }
            Cells::Bsp(bsp) => {
                build_source(&bsp.tree.blocks(bsp.depth)?, bsp.extent, &self.options, output, progress)?
            }
        };
        Ok(())
    }
}
