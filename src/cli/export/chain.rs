//! Freeman chain codes of class regions, and of lines.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context as _, Result, ensure};
use spinney::import::feature::FeatureOptions;
use spinney::raw::export::{ChainDirections, ChainWriter, export_chain_code};
use spinney::raw::import::feature::{FeatureGeometry, open_features};
use spinney::{CellLocator, Coordinates, Dataset, Progress as _};

use super::super::args::{check_output, level_of};
use super::super::features::check_features;
use super::super::report::{Work, report_output};
use super::super::{Global, exact};
use super::Args;

/// Options of chain codes.
#[derive(clap::Args)]
pub(super) struct ChainOptions {
    /// Chain directions: 4 (along the sides of cells) or 8 (from cell to cell along the borders of
    /// regions) [default: 4; for lines 8]
    #[arg(long, value_name = "4|8")]
    directions: Option<ChainDirections>,
    /// Lines of a feature file instead of regions, as chains of their nearest cells, of class 1;
    /// the tree defines the grid
    #[arg(long, value_name = "FILE")]
    lines: Option<PathBuf>,
}

impl ChainOptions {
    /// Returns the first given option.
    pub(super) fn given(&self) -> Option<&'static str> {
        let given = [("--directions", self.directions.is_some()), ("--lines", self.lines.is_some())];
        given.into_iter().find(|(_, given)| *given).map(|(name, _)| name)
    }
}

/// Writes the chains.
pub(super) fn run(args: &Args, global: &Global) -> Result<()> {
    let start = Instant::now();
    if exact::open(&args.tree.file, global)?.is_some() {
        exact::refuse(&args.tree.file, &[(".chain", true)])?;
    }
    let tree = args.tree.open(global)?;
    let ChainOptions { directions, lines } = &args.chain;
    let inputs = [Some(&args.tree.file), lines.as_ref()];
    check_output(inputs.into_iter().flatten().map(PathBuf::as_path), args.output.path())?;
    let level = level_of(&tree, args.mesh.level)?;
    if let Some(file) = lines {
        ensure!(args.polygons.given().is_none(), "--class and --connect: have no effect on --lines");
        let writer = |work: &Work| -> Result<ChainWriter> {
            let output = global.access().create(args.output.path())?;
            let directions = directions.unwrap_or(ChainDirections::Eight);
            Ok(ChainWriter::create(output, &tree, level, directions, work)?)
        };
        let (count, chains) = write_lines(file, &tree, level, writer, global)?;
        global.report("chains", format_args!("{chains} of {count} lines"));
    } else {
        let request = args.polygons.request(&tree, level)?;
        let work = Work::start(global, "cells")?;
        let output = global.access().create(args.output.path())?;
        let directions = directions.unwrap_or(ChainDirections::Four);
        let summary = export_chain_code(&tree, &request, directions, output, &work)
            .with_context(|| format!("{}: cannot write", args.output.path().display()))?;
        work.finish();
        global.report("chains", format_args!("{} of {} regions", summary.rings, summary.count));
    }
    report_output(global, args.output.path(), start);
    Ok(())
}

/// Writes the lines of a file. Returns the number of lines and of chains.
fn write_lines(
    file: &Path,
    tree: &Dataset,
    level: u8,
    writer: impl FnOnce(&Work) -> Result<ChainWriter>,
    global: &Global,
) -> Result<(u64, u64)> {
    check_features(file, "--lines")?;
    let frame = tree.metadata().frame.coarser(tree.depth() - level);
    let (attributes, check_degrees) = (Some(Vec::new()), frame.crs.is_some());
    let options = FeatureOptions { attributes, check_degrees, ..FeatureOptions::default() };
    let mut reader = open_features(file, &options)?;
    // (If one of both has no coordinate system, both are assumed to have the same.)
    let crs_of_lines = reader.schema().crs.clone().filter(|_| frame.crs.is_some());
    let coordinates = crs_of_lines.map_or(Coordinates::World, Coordinates::System);
    let locator = CellLocator::new(&coordinates, &frame, tree.extent_at(level).max)?;
    let work = Work::start(global, "features")?;
    locator.remarks().iter().for_each(|remark| work.warn(file, remark));
    let mut writer = writer(&work)?;
    let (mut count, mut chains, mut others) = (0, 0, 0u64);
    let total = reader.schema().count.unwrap_or(0);
    while let Some(feature) = reader.next()? {
        work.check()?;
        let mut open: Vec<FeatureGeometry> = feature.geometry.into_iter().collect();
        while let Some(geometry) = open.pop() {
            match geometry {
                FeatureGeometry::Lines(lines) => {
                    for line in lines {
                        count += 1;
                        // (A line is split where the tree's system cannot represent its points.)
                        let cells: Vec<_> = line.iter().map(|[x, y]| locator.cell([*x, *y, 0.0])).collect();
                        for part in cells.split(Option::is_none).filter(|part| !part.is_empty()) {
                            let corners: Vec<[f64; 2]> =
                                part.iter().flatten().map(|[x, y, _]| [*x, *y]).collect();
                            chains += writer.line(1u64.into(), &corners)? as u64;
                        }
                    }
                }
                FeatureGeometry::Collection(members) => open.extend(members),
                FeatureGeometry::Points(_) | FeatureGeometry::Polygons(_) => others += 1,
            }
        }
        work.advance(1, total);
    }
    if others > 0 {
        work.warn(file, &format!("{others} points and polygons are ignored: chains are made of lines"));
    }
    writer.finish()?;
    work.finish();
    Ok((count, chains))
}
