//! Files of points in `spinney build`.

use std::path::PathBuf;

use anyhow::{Result, bail};
use spinney::import::feature::FeatureFilter;
use spinney::points::{PointImport, PointImportOptions};
use spinney::raw::import::feature::{is_feature_file, plan_point_files};
use spinney::raw::points::{PointBuildOptions, has_points, is_las_file};
use spinney::raw::shards::JobSpec;

use super::Common;
use super::features::{FeatureArgs, Index};
use super::pictures::PictureArgs;
use super::solids::SolidArgs;

/// Whether a tree of points is to be made: of point clouds always, of features if that is said.
pub(super) fn are_points(inputs: &[PathBuf], features: &FeatureArgs) -> bool {
    features.index == Some(Index::Points) || inputs.iter().any(|input| is_las_file(input))
}

/// Looks at the points, and plans what is made of them.
pub(super) fn plan(
    inputs: &[PathBuf],
    (common, pictures, solids, features): (&Common, &PictureArgs, &SolidArgs, &FeatureArgs),
) -> Result<PointImport> {
    let is_of_features = inputs.iter().all(|input| is_feature_file(input));
    if let Some(other) = inputs.iter().find(|input| !is_of_features && !has_points(input)) {
        bail!("{}: has no points, as other files have; build a tree of each kind", other.display());
    }
    let of_files: &[&str] = if is_of_features { &["--index", "--layer"] } else { &["--index"] };
    let options = import_options(common, solids, of_files)?;
    let of_features = features.kept(pictures.layer.clone());
    Ok(plan_point_files(inputs, &of_features, &options)?)
}

/// The job of building points in shards, those for which conditions hold.
pub(in crate::cli) fn job(
    inputs: Vec<PathBuf>,
    (common, solids): (&Common, &SolidArgs),
    filter: Option<&FeatureFilter>,
) -> Result<JobSpec> {
    let options = import_options(common, solids, &["--shards"])?;
    Ok(JobSpec::Points { inputs, options, filter: filter.cloned().unwrap_or_default() })
}

/// Options of an import of points; fails if some were given that mean nothing for them, besides some that do.
fn import_options(common: &Common, solids: &SolidArgs, others: &[&str]) -> Result<PointImportOptions> {
    common.given.check("points", &[&["--crs", "--leaf-size", "--attribute", "--where"], others].concat())?;
    let mut options = PointImportOptions { crs: common.crs.clone(), ..PointImportOptions::default() };
    options.build = PointBuildOptions { memory: common.memory.bytes, ..PointBuildOptions::default() };
    options.build.leaf_size = solids.leaf_size.unwrap_or(options.build.leaf_size);
    let names = solids.attribute.as_deref();
    options.attributes = names.map(|names| names.split(',').map(|name| name.trim().to_string()).collect());
    Ok(options)
}
