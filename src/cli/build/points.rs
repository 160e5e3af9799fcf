//! `spinney build` of trees of points.

use std::path::PathBuf;

use anyhow::{Result, bail};
use spinney::import::feature::FeatureFilter;
use spinney::points::{PointImport, PointImportOptions};
use spinney::raw::import::feature::{is_feature_file, plan_point_files};
use spinney::raw::points::{PointBuildOptions, has_points, is_las_file};
use spinney::raw::shards::JobSpec;

use super::Common;
use super::features::{FeatureArgs, Index};
use super::rasters::RasterArgs;
use super::solids::SolidArgs;

/// Whether to build a tree of points: always for point clouds, for features if `--index points` is
/// given.
pub(super) fn are_points(inputs: &[PathBuf], features: &FeatureArgs) -> bool {
    features.index == Some(Index::Points) || inputs.iter().any(|input| is_las_file(input))
}

/// Reads the points' schema, and plans the import.
pub(super) fn plan(
    inputs: &[PathBuf],
    (common, rasters, solids, features): (&Common, &RasterArgs, &SolidArgs, &FeatureArgs),
) -> Result<PointImport> {
    let is_of_features = inputs.iter().all(|input| is_feature_file(input));
    if let Some(other) = inputs.iter().find(|input| !is_of_features && !has_points(input)) {
        let advice = match inputs {
            [_] => "expected LAS, LAZ, PLY, NPY or features",
            _ => "unlike other inputs; build a tree of each kind",
        };
        bail!("{}: has no points, {advice}", other.display());
    }
    let of_files: &[&str] = if is_of_features { &["--index", "--layer"] } else { &["--index"] };
    let options = import_options(common, solids, of_files)?;
    let of_features = features.kept(rasters.layer.clone());
    Ok(plan_point_files(inputs, &of_features, &options)?)
}

/// Returns the job of a sharded build of points that satisfy the conditions.
pub(in crate::cli) fn job(
    inputs: Vec<PathBuf>,
    (common, solids): (&Common, &SolidArgs),
    filter: Option<&FeatureFilter>,
) -> Result<JobSpec> {
    let options = import_options(common, solids, &["--shards"])?;
    Ok(JobSpec::Points { inputs, options, filter: filter.cloned().unwrap_or_default() })
}

/// Returns options for importing points. Fails for options that have no meaning for points and are
/// not in `others`.
fn import_options(common: &Common, solids: &SolidArgs, others: &[&str]) -> Result<PointImportOptions> {
    common.given.check("points", &[&["--crs", "--leaf-size", "--attribute", "--where"], others].concat())?;
    let mut options = PointImportOptions { crs: common.crs.clone(), ..PointImportOptions::default() };
    options.build = PointBuildOptions { memory: common.memory.bytes, ..PointBuildOptions::default() };
    options.build.leaf_size = solids.leaf_size.unwrap_or(options.build.leaf_size);
    let names = solids.attribute.as_deref();
    options.attributes = names.map(|names| names.split(',').map(|name| name.trim().to_string()).collect());
    Ok(options)
}
