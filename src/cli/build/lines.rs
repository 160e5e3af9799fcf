//! `spinney build` of trees of lines from features, or from the edges of a mesh.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use spinney::lines::LineBuildOptions;

use spinney::raw::import::feature::{is_feature_file, open_feature_lines};
use spinney::raw::import::mesh::{EdgeOptions, is_model, open_mesh_edges, open_with};
use spinney::raw::lines::LineSource;
use spinney::raw::space::Up;

use super::super::lines::{LineImport, names};
use super::Common;
use super::features::FeatureArgs;
use super::rasters::RasterArgs;
use super::solids::SolidArgs;

/// Options of trees of lines.
const FITTING: [&str; 3] = ["--crs", "--leaf-size", "--index"];

/// Reads the features' schema or the edges of the mesh, and plans the tree of their lines.
pub(super) fn plan(
    inputs: &[PathBuf],
    (common, rasters, solids, features): (&Common, &RasterArgs, &SolidArgs, &FeatureArgs),
    output: &Path,
) -> Result<LineImport> {
    let [input] = inputs else {
        bail!("--index: got {} inputs, expected one; build a tree of each", inputs.len())
    };
    let mut options = LineBuildOptions { memory: common.memory.bytes, ..LineBuildOptions::default() };
    options.leaf_size = solids.leaf_size.unwrap_or(options.leaf_size);
    let crs = common.crs.clone();
    let source: Box<dyn LineSource> = if is_feature_file(input) {
        common.given.check("lines", &[&FITTING[..], &["--attribute", "--where", "--layer"]].concat())?;
        let mut read = features.kept(rasters.layer.clone());
        read.attributes = names(solids.attribute.as_deref());
        Box::new(open_feature_lines(input, &read, crs.as_ref(), &())?)
    } else if is_model(input, &common.access)? {
        common.given.check("edges of a mesh", &[&FITTING[..], &["--up"]].concat())?;
        let edges = EdgeOptions {
            up: solids.up.unwrap_or(Up::Z),
            crs,
            memory: common.memory.bytes,
            output: output.to_path_buf(),
        };
        let mut model = open_with(input, common.memory.bytes, &common.access)?;
        Box::new(open_mesh_edges(&mut *model, &edges, &())?)
    } else {
        bail!("--index lines: {} is neither a feature file nor a mesh", input.display());
    };
    Ok(LineImport::plan(input, source, options))
}
