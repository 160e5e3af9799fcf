//! `spinney build` from images with known view directions, and from outlines at heights.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use spinney::raw::import::feature::is_feature_file;
use spinney::raw::reconstruction::{ReconstructionImport, plan_outlines, plan_views};

use super::features::FeatureArgs;
use super::rasters::RasterArgs;
use super::solids::{OF_CELLS, SolidArgs};
use super::{Common, Grid};

/// Fails for options that have no meaning for such solids.
fn check(input: &Path, solids: &SolidArgs, common: &Common) -> Result<()> {
    if common.grid == Some(Grid::Xyz) {
        bail!("{}: becomes a solid; --grid xyz works only with rasters", input.display());
    }
    if solids.brep || solids.stats {
        bail!("{}: becomes cells; --brep and --stats work only with models that have faces", input.display());
    }
    if let Some(option) = solids.of_exact_models() {
        bail!("{option}: works only with exact models, not with views and outlines");
    }
    Ok(())
}

/// Reads the views file, which must be the only input, and the images.
pub(super) fn views(
    inputs: &[PathBuf],
    output: &Path,
    (common, rasters, solids): (&Common, &RasterArgs, &SolidArgs),
) -> Result<ReconstructionImport> {
    let [input] = inputs else {
        bail!("got {} inputs, expected one .views file, which names the images", inputs.len())
    };
    rasters.refuse(input)?;
    check(input, solids, common)?;
    common.given.check("views of a solid", &OF_CELLS)?;
    Ok(plan_views(input, &solids.options(None, output, common)?, &common.access)?)
}

/// Reads polygons whose height is an attribute.
pub(super) fn outlines(
    inputs: &[PathBuf],
    output: &Path,
    height: &str,
    (common, rasters, solids, features): (&Common, &RasterArgs, &SolidArgs, &FeatureArgs),
) -> Result<ReconstructionImport> {
    let [input] = inputs else { bail!("--heights: got {} inputs, expected one file", inputs.len()) };
    if !is_feature_file(input) {
        bail!("--heights: works only with polygon features, {} has none", input.display());
    }
    check(input, solids, common)?;
    let of_outlines = &["--heights", "--where", "--layer"];
    common.given.check("the outlines of a solid", &[&OF_CELLS[..], of_outlines].concat())?;
    let options = solids.options(None, output, common)?;
    Ok(plan_outlines(input, height, &features.kept(rasters.layer.clone()), &options)?)
}
