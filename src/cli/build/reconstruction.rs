//! `spinney build` from images with known view directions, and from outlines at heights.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use spinney::raw::import::feature::is_feature_file;
use spinney::raw::reconstruction::{ReconstructionImport, plan_outlines, plan_views};

use super::features::FeatureArgs;
use super::pictures::PictureArgs;
use super::solids::{OF_CELLS, SolidArgs};
use super::{Common, Grid};

/// Fails for options that have no meaning for such solids.
fn check(input: &Path, solids: &SolidArgs, common: &Common) -> Result<()> {
    if common.grid == Some(Grid::Xyz) {
        bail!("{}: becomes a solid; --grid xyz is for pictures", input.display());
    }
    if solids.brep || solids.stats {
        bail!("{}: becomes cells; --brep and --stats are for models with faces", input.display());
    }
    if let Some(option) = solids.of_exact_models() {
        bail!("{option} is for exact models, which views and outlines do not become");
    }
    Ok(())
}

/// Reads the views file, which must be the only input, and the images.
pub(super) fn views(
    inputs: &[PathBuf],
    output: &Path,
    (common, pictures, solids): (&Common, &PictureArgs, &SolidArgs),
) -> Result<ReconstructionImport> {
    let [input] = inputs else {
        bail!("a text that tells views (.views) is the only input; it names the pictures")
    };
    if pictures.are_given() {
        bail!("{}: becomes a solid; the options for pictures and volumes are not for it", input.display());
    }
    check(input, solids, common)?;
    common.given.check("views of a solid", &OF_CELLS)?;
    Ok(plan_views(input, &solids.options(None, output, common)?, &common.access)?)
}

/// Reads polygons whose height is an attribute.
pub(super) fn outlines(
    inputs: &[PathBuf],
    output: &Path,
    height: &str,
    (common, pictures, solids, features): (&Common, &PictureArgs, &SolidArgs, &FeatureArgs),
) -> Result<ReconstructionImport> {
    let [input] = inputs else { bail!("--heights: the outlines of a solid are those of one file") };
    if !is_feature_file(input) {
        bail!("--heights is for features that are polygons, {} has none", input.display());
    }
    check(input, solids, common)?;
    let of_outlines = &["--heights", "--where", "--layer"];
    common.given.check("the outlines of a solid", &[&OF_CELLS[..], of_outlines].concat())?;
    let options = solids.options(None, output, common)?;
    Ok(plan_outlines(input, height, &features.kept(pictures.layer.clone()), &options)?)
}
