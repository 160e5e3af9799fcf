//! `spinney build` of trees of lines from features.

use std::path::PathBuf;

use anyhow::Result;
use spinney::lines::LineBuildOptions;

use super::super::lines::{LineImport, names};
use super::Common;
use super::features::FeatureArgs;
use super::rasters::RasterArgs;
use super::solids::SolidArgs;

/// Reads the features' schema, and plans the tree of their lines.
pub(super) fn plan(
    inputs: &[PathBuf],
    (common, rasters, solids, features): (&Common, &RasterArgs, &SolidArgs, &FeatureArgs),
) -> Result<LineImport> {
    let fitting = ["--crs", "--leaf-size", "--attribute", "--where", "--index", "--layer"];
    common.given.check("lines", &fitting)?;
    let mut options = LineBuildOptions { memory: common.memory.bytes, ..LineBuildOptions::default() };
    options.leaf_size = solids.leaf_size.unwrap_or(options.leaf_size);
    let mut read = features.kept(rasters.layer.clone());
    read.check_degrees = common.crs.is_none();
    read.attributes = names(solids.attribute.as_deref());
    LineImport::plan(inputs, &read, common.crs.clone(), options)
}
