//! Options of `spinney build` for features.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use spinney::SampleType;
use spinney::import::feature::{
    FeatureFilter, FeatureImport, FeatureOptions, FeatureValue, RasterizeOptions, plan_features,
};
use spinney::raw::import::feature::is_feature_file;
use spinney::raw::import::rasterize::{FeatureGrid, LineWidth, Overlaps};

use super::super::{args::check_output, open};
use super::rasters::RasterArgs;
use super::solids::SolidArgs;
use super::{Common, Grid, grid_of};

/// Options for features only.
#[derive(clap::Args, Clone, Debug)]
pub(super) struct FeatureArgs {
    /// Value that features give their cells: a number, or an attribute, whose strings become
    /// classes with names [default: 1]
    #[arg(long, value_name = "NUMBER|ATTRIBUTE", allow_hyphen_values = true)]
    pub(super) value: Option<FeatureValue>,
    /// Value of cells where features overlap: last, first, min, max, sum, count or mean [default:
    /// last]
    #[arg(long, value_name = "RULE")]
    overlaps: Option<Overlaps>,
    /// Sample type of the cells: u8, i8, u16, i16, u32, i32, u64, i64, f32 or f64 [default: for an
    /// integer attribute i32 or i64, for others f64]
    #[arg(long = "type", value_name = "TYPE", value_parser = parse_type)]
    pub(super) sample: Option<SampleType>,
    /// Width of lines in units of the tree's coordinates: a number, or an attribute; a line covers
    /// the cells whose centres are within half its width [default: none, the cells that contain its
    /// points]
    #[arg(long, value_name = "NUMBER|ATTRIBUTE")]
    width: Option<LineWidth>,
    /// Give each cell the fraction of its area that features cover: from 0 to 1; overlapping
    /// polygons count once
    #[arg(long)]
    fractions: bool,
    /// Only features for which all conditions hold, as in 'type=Building,height>=10': an
    /// attribute, one of =, !=, <, <=, > and >=, and a value; with --brep objects of models, and
    /// their parts: id and type count as attributes
    #[arg(long = "where", value_name = "CONDITION,...")]
    pub(super) filter: Option<FeatureFilter>,
    /// Attribute with the height of polygons (sections of a solid): make an octree, interpolating
    /// between sections by their shape
    #[arg(long, value_name = "ATTRIBUTE", conflicts_with = "tin")]
    pub(super) heights: Option<String>,
    /// Make an index of the features, which are kept unchanged: a tree of points or lines, instead
    /// of rasterizing them
    #[arg(long, value_name = "KIND")]
    pub(super) index: Option<Index>,
}

/// A kind of tree that keeps features unchanged.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(super) enum Index {
    /// A tree of points.
    Points,
    /// A tree of lines.
    Lines,
}

fn parse_type(text: &str) -> Result<SampleType, String> {
    let found = SampleType::ALL.into_iter().find(|sample| sample.name() == text);
    let names = SampleType::ALL.map(SampleType::name).join(", ");
    found.ok_or_else(|| format!("expected {names}"))
}

impl FeatureArgs {
    /// Returns the first given option for features, which other inputs reject.
    pub(super) fn given(&self) -> Option<&'static str> {
        let given = [
            ("--value", self.value.is_some()),
            ("--overlaps", self.overlaps.is_some()),
            ("--type", self.sample.is_some()),
            ("--width", self.width.is_some()),
            ("--fractions", self.fractions),
            ("--where", self.filter.is_some()),
            ("--heights", self.heights.is_some()),
            ("--index", self.index.is_some()),
        ];
        given.into_iter().find(|(_, given)| *given).map(|(name, _)| name)
    }

    /// Returns options for reading features that are kept unchanged.
    pub(super) fn kept(&self, layer: Option<String>) -> FeatureOptions {
        FeatureOptions { layer, filter: self.filter.clone().unwrap_or_default(), ..FeatureOptions::default() }
    }

    /// Whether some of the inputs are feature files.
    pub(super) fn are_features(inputs: &[PathBuf]) -> bool {
        inputs.iter().any(|input| is_feature_file(input))
    }

    /// Reads the features' schema, and plans the import.
    pub(super) fn plan(
        &self,
        inputs: &[PathBuf],
        output: &Path,
        (common, rasters, solids): (&Common, &RasterArgs, &SolidArgs),
    ) -> Result<FeatureImport> {
        let fitting = [
            "--cells",
            "--cell",
            "--grid",
            "--max-zoom",
            "--depth",
            "--edge",
            "--value",
            "--type",
            "--overlaps",
            "--width",
            "--fractions",
            "--where",
            "--layer",
            "--kind",
            "--rule",
            "--crs",
            "--share",
            "--time",
            "--codec",
            "--max-error",
        ];
        common.given.check("cells of features", &fitting)?;
        let Common { depth, crs, memory, share, time, grid, .. } = common;
        let (cells, cell, edge) = solids.of_features()?;
        let grid = match (grid, cells, cell) {
            (Some(Grid::Xyz), ..) => {
                let Some(zoom) = rasters.max_zoom else {
                    bail!("--grid xyz: needs --max-zoom, the deepest zoom, for features");
                };
                FeatureGrid::web_mercator(zoom)?
            }
            (Some(Grid::Like(path)), ..) => {
                check_output([path.as_path()], output)?;
                FeatureGrid::Extended(grid_of(&open(path, &common.access)?, 2, path)?)
            }
            (None, _, Some(cell)) => FeatureGrid::Cell(cell),
            (None, Some(cells), None) => FeatureGrid::Cells(cells),
            (None, None, None) => bail!(
                "{}: features need cells: give their width with --cell, in units of the features' coordinates, their number along the longer side with --cells, or another tree's with --grid",
                inputs[0].display()
            ),
        };
        if !matches!(grid, FeatureGrid::Like(_)) && rasters.max_zoom.is_some() {
            bail!("--max-zoom: works only with --grid xyz");
        }
        let mut options = RasterizeOptions::new(grid);
        options.value = self.value.clone().unwrap_or_default();
        options.overlaps = self.overlaps.unwrap_or_default();
        (options.width, options.sample) = (self.width.clone(), self.sample);
        (options.edge, options.fractions) = (edge.unwrap_or_default(), self.fractions);
        (options.kind, options.rule) = rasters.kind_and_rule();
        (options.depth, options.crs, options.share, options.time) = (*depth, crs.clone(), *share, *time);
        options.packing = common.packing.choice();
        options.memory = memory.bytes;
        options.features = FeatureOptions {
            layer: rasters.layer.clone(),
            filter: self.filter.clone().unwrap_or_default(),
            ..FeatureOptions::default()
        };
        Ok(plan_features(inputs, &options, &())?)
    }
}
