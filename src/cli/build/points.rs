//! What `spinney build` does with files of points.

use std::path::PathBuf;

use anyhow::{Result, bail};
use spinney::import::feature::{is_feature_file, open_feature_points};
use spinney::points::{BuildOptions, ImportOptions, PointImport, is_las_file, plan_las, plan_points};

use super::super::points::conditions;
use super::super::report::warn;
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
    if let Some(other) = inputs.iter().find(|input| !is_of_features && !is_las_file(input)) {
        bail!("{}: is no LAS or LAZ file, as others are; build a tree of each kind", other.display());
    }
    let given = [
        ("--depth", common.depth.is_some()),
        ("--grid", common.grid.is_some()),
        ("--share", common.share),
        ("--time", common.time.is_some()),
        ("options for pictures", pictures.not_of_features().is_some()),
        ("--layer", pictures.layer.is_some() && !is_of_features),
    ];
    let given = given.into_iter().chain(common.packing.given());
    let mut given = given.filter(|(_, is_given)| *is_given).map(|(name, _)| name);
    if let Some(option) = given.next().or(solids.not_of_points()).or(features.not_of_points()) {
        bail!("{option}: means nothing for points");
    }
    let mut options = ImportOptions { crs: common.crs.clone(), ..ImportOptions::default() };
    options.build = BuildOptions { memory: common.memory.bytes, ..BuildOptions::default() };
    options.build.leaf_size = solids.leaf_size.unwrap_or(options.build.leaf_size);
    let names = solids.attribute.as_deref();
    options.attributes = names.map(|names| names.split(',').map(|name| name.trim().to_string()).collect());
    let filter = features.filter.clone().unwrap_or_default();
    if !is_of_features {
        return Ok(plan_las(inputs, &mut |attributes| conditions(&filter, attributes), &options)?);
    }
    let [input] = inputs else { bail!("--index: a tree has the features of one file; build a tree of each") };
    let found = open_feature_points(input, &features.kept(pictures.layer.clone()))?;
    if !found.left_out.is_empty() {
        warn(&format!(
            "{}: attributes that are no numbers are left out: {}",
            input.display(),
            found.left_out.join(", ")
        ));
    }
    if found.with_heights > 0 {
        let count = found.with_heights;
        warn(&format!(
            "{}: {count} features have heights or measures in their geometries, which are not read; an attribute `z` is",
            input.display()
        ));
    }
    if found.points.is_rounded() {
        warn(&format!(
            "{}: places have more digits than a grid of 32 bits, and are rounded to it",
            input.display()
        ));
    }
    Ok(plan_points(Box::new(found.points), inputs, Vec::new(), &options)?)
}
