//! Options of `spinney build` for files of points.

use std::path::PathBuf;

use anyhow::{Result, bail};
use spinney::points::{BuildOptions, ImportOptions, PointImport, is_las_file, plan_las};

use super::super::points::conditions;
use super::Common;
use super::features::FeatureArgs;
use super::pictures::PictureArgs;
use super::solids::SolidArgs;

/// Whether some inputs are files of points.
pub(super) fn are_points(inputs: &[PathBuf]) -> bool {
    inputs.iter().any(|input| is_las_file(input))
}

/// Looks at the points, and plans what is made of them.
pub(super) fn plan(
    inputs: &[PathBuf],
    (common, pictures, solids, features): (&Common, &PictureArgs, &SolidArgs, &FeatureArgs),
) -> Result<PointImport> {
    if let Some(other) = inputs.iter().find(|input| !is_las_file(input)) {
        bail!("{}: is no LAS or LAZ file, as others are; build a tree of each kind", other.display());
    }
    let given = [
        ("--depth", common.depth.is_some()),
        ("--grid", common.grid.is_some()),
        ("--share", common.share),
        ("--time", common.time.is_some()),
        ("options for pictures", pictures.are_given()),
    ];
    let given = given.into_iter().chain(common.packing.given());
    let given = { given }.find(|(_, is_given)| *is_given).map(|(name, _)| name);
    if let Some(option) = given.or(solids.not_of_points()).or(features.not_of_points()) {
        bail!("{option}: means nothing for points");
    }
    let mut options = ImportOptions { crs: common.crs.clone(), ..ImportOptions::default() };
    options.build = BuildOptions { memory: common.memory.bytes, ..BuildOptions::default() };
    options.build.leaf_size = solids.leaf_size.unwrap_or(options.build.leaf_size);
    let names = solids.attribute.as_deref();
    options.attributes = names.map(|names| names.split(',').map(|name| name.trim().to_string()).collect());
    let filter = features.filter.clone().unwrap_or_default();
    Ok(plan_las(inputs, &mut |attributes| conditions(&filter, attributes), &options)?)
}
