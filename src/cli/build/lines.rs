//! Plans of `spinney build` for features that become trees of lines.

use std::path::PathBuf;

use anyhow::{Result, bail};
use spinney::lines::LineBuildOptions;

use super::super::lines::{LineImport, names};
use super::Common;
use super::features::FeatureArgs;
use super::pictures::PictureArgs;
use super::solids::SolidArgs;

/// Looks at the features, and plans the tree of their lines.
pub(super) fn plan(
    inputs: &[PathBuf],
    (common, pictures, solids, features): (&Common, &PictureArgs, &SolidArgs, &FeatureArgs),
) -> Result<LineImport> {
    let given = [
        ("--depth", common.depth.is_some()),
        ("--grid", common.grid.is_some()),
        ("--share", common.share),
        ("--time", common.has_time()),
        ("options for pictures", pictures.not_of_features().is_some()),
    ];
    let given = given.into_iter().chain(common.packing.given());
    let mut given = given.filter(|(_, is_given)| *is_given).map(|(name, _)| name);
    if let Some(option) = given.next().or(solids.not_of_points()).or(features.not_of_points()) {
        bail!("{option}: means nothing for lines");
    }
    let mut options = LineBuildOptions { memory: common.memory.bytes, ..LineBuildOptions::default() };
    options.leaf_size = solids.leaf_size.unwrap_or(options.leaf_size);
    let mut read = features.kept(pictures.layer.clone());
    read.attributes = names(solids.attribute.as_deref());
    LineImport::plan(inputs, &read, common.crs.clone(), options)
}
