//! `spinney build` of values within bodies, from samples.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail, ensure};
use spinney::brep::Faces as _;
use spinney::import::feature::{FeatureOptions, FeatureValue};
use spinney::import::mesh::{ExactOptions, import_exact};
use spinney::raw::body_values::{BodySamples, BodyValueOptions, build_body_values, read_samples};
use spinney::raw::import::feature::is_feature_file;
use spinney::raw::import::mesh;
use spinney::raw::store::Tag;
use spinney::{ExactModel, Output, Progress, SampleType};

use super::super::args::check_output;
use super::super::exact;
use super::features::FeatureArgs;
use super::rasters::RasterArgs;
use super::solids::SolidArgs;
use super::{Common, Grid, Lines};

/// Number of samples of an interpolated value.
const NEAREST: usize = 12;

/// Options for values within bodies only.
#[derive(clap::Args, Debug)]
pub(super) struct BodyArgs {
    /// Exact model whose inside gets values, interpolated from samples: points with a third
    /// coordinate and an attribute (--value), or mouths of vertical holes with depths in attributes
    /// from and to
    #[arg(long, value_name = "MODEL", conflicts_with_all = ["tin", "heights", "index", "brep"])]
    pub(super) body: Option<PathBuf>,
    /// Name of the object of an exact model whose inside gets values [default: the entire model]
    #[arg(long, value_name = "NAME", requires = "body")]
    object: Option<String>,
    /// Find the nearest K samples for a cell: its value is their mean, weighted by inverse squares
    /// of distances; 1 takes the value of the nearest sample [default: 12]
    #[arg(long, value_name = "K", requires = "body")]
    nearest: Option<usize>,
    /// Maximum distance of these samples; cells without one are VOID [default: any]
    #[arg(long, value_name = "DISTANCE", requires = "body")]
    radius: Option<f64>,
}

/// Samples and a body that were read, and the cells to build.
pub(super) struct BodyValueImport {
    body: Body,
    samples: BodySamples,
    options: BodyValueOptions,
    description: Lines,
}

/// An exact model, perhaps in a temporary directory.
struct Body {
    model: ExactModel,
    /// That of the entire model.
    provenance: Vec<String>,
    /// Removed after the model is closed.
    _directory: Option<tempfile::TempDir>,
}

impl BodyArgs {
    /// Reads samples and model.
    pub(super) fn plan(
        &self,
        path: &Path,
        inputs: &[PathBuf],
        output: &Path,
        (common, rasters, solids, features): (&Common, &RasterArgs, &SolidArgs, &FeatureArgs),
    ) -> Result<BodyValueImport> {
        let [input] = inputs else {
            bail!("--body: got {} inputs, expected one file of samples", inputs.len())
        };
        if !is_feature_file(input) {
            bail!("--body: works only with point features as samples, {} has none", input.display());
        }
        check_output([path], output)?;
        let fitting = [
            "--body",
            "--object",
            "--nearest",
            "--radius",
            "--value",
            "--type",
            "--where",
            "--layer",
            "--crs",
            "--cell",
            "--cells",
            "--depth",
            "--grid",
            "--share",
            "--time",
            "--codec",
            "--max-error",
        ];
        common.given.check("values within bodies", &fitting)?;
        if common.grid == Some(Grid::Xyz) {
            bail!("--grid xyz: works only with rasters and features, not with bodies");
        }
        let name = match &features.value {
            Some(FeatureValue::Attribute(name)) => name.clone(),
            _ => bail!(
                "--body: needs --value with the attribute of the samples that becomes the value of cells"
            ),
        };
        let sample = features.sample.unwrap_or(SampleType::F64);
        let nearest = self.nearest.unwrap_or(NEAREST);
        ensure!(nearest > 0, "--nearest: got 0, expected at least 1");
        let radius = self.radius.unwrap_or(f64::INFINITY);
        ensure!(radius >= 0.0, "--radius: got {radius}, expected a distance of at least 0");
        let body = self.body(path, output, common)?;
        let unit = body.model.metadata().tag(Tag::Unit);
        let reading = FeatureOptions {
            layer: rasters.layer.clone(),
            filter: features.filter.clone().unwrap_or_default(),
            check_degrees: common.crs.is_none(),
            ..FeatureOptions::default()
        };
        let mut samples = read_samples(input, &name, &reading, common.memory.bytes / 2)?;
        if common.crs.is_some() {
            samples.crs.clone_from(&common.crs);
        }
        let bounds = body.model.bounds()?;
        let cells = mesh::fit_cells(bounds, &solids.options(unit, output, common)?)?;
        let object = self.object.as_ref().map_or(String::new(), |object| format!(", {object}"));
        let method = match nearest {
            1 => "the nearest sample".to_string(),
            _ => format!("the nearest {nearest} samples, weighted by inverse squares of distances"),
        };
        let within = if radius < f64::INFINITY { format!(", within {radius}") } else { String::new() };
        let [x, y, z] = cells.extent;
        let width = cells.frame.linear().col(0).length();
        let suffix = unit.map_or(String::new(), |unit| format!(" {unit}"));
        let mut description = vec![("samples", format!("{}: {}", input.display(), counts(&samples)))];
        description.push(("body", format!("{}{object}", path.display())));
        description.push((
            "cells",
            format!("{x} x {y} x {z} in a tree of depth {}, each {width}{suffix} wide", cells.depth),
        ));
        description.push(("values", format!("{name} of {method}{within}")));
        let mut provenance = body.provenance.clone();
        provenance.push(format!(
            "{}: {name} within {}{object}, of {method}{within}",
            input.display(),
            path.display()
        ));
        let options = BodyValueOptions {
            frame: cells.frame,
            depth: cells.depth,
            extent: cells.extent,
            nearest,
            radius,
            sample,
            name,
            body: path.to_path_buf(),
            provenance,
            memory: common.memory.bytes,
            packing: common.packing.choice(),
            share: common.share,
            time: common.time,
        };
        Ok(BodyValueImport { body, samples, options, description })
    }

    /// Opens the model, or makes a model of the object.
    fn body(&self, path: &Path, output: &Path, common: &Common) -> Result<Body> {
        let open =
            |path: &Path| -> Result<ExactModel> { Ok(ExactModel::open(path, &(&common.access).into())?) };
        if !spinney::raw::brep::is_model_file(path, &common.access)? {
            let file = path.display();
            bail!(
                "--body: {file} is not an exact model; make one: `spinney build {file} -o MODEL.goblin --brep`"
            );
        }
        let model = open(path)?;
        let provenance = model.metadata().clean_provenance();
        let Some(name) = &self.object else { return Ok(Body { model, provenance, _directory: None }) };
        let parts: BTreeSet<u32> = exact::parts_named(&model, name)?.into_iter().collect();
        if parts.len() == model.parts().len() {
            return Ok(Body { model, provenance, _directory: None });
        }
        let directory = match output.parent() {
            Some(parent) if parent.is_dir() && output != Path::new("-") => tempfile::tempdir_in(parent),
            Some(parent) if parent == Path::new("") && output != Path::new("-") => tempfile::tempdir_in("."),
            _ => tempfile::tempdir(),
        }?;
        let file = directory.path().join("body.goblin");
        let models = mesh::open_all_with(&[path.to_path_buf()], common.memory.bytes / 2, &common.access)?;
        let mut options = ExactOptions::new();
        (options.parts, options.memory) = (Some(parts), common.memory.bytes / 2);
        let object = || format!("--object {name}: cannot be filled");
        import_exact(models, &options, Output::create(&file)?, &()).with_context(object)?;
        Ok(Body { model: open(&file)?, provenance, _directory: Some(directory) })
    }
}

/// Describes numbers of samples.
fn counts(samples: &BodySamples) -> String {
    let kind = if samples.are_intervals { "intervals, at their middles" } else { "points" };
    let mut text = format!("{} {kind}", samples.positions.len());
    let without = [(samples.without_value, "a value"), (samples.without_position, "a position in space")];
    for (count, what) in without.into_iter().filter(|(count, _)| *count > 0) {
        text += &format!(", {count} features without {what} left out");
    }
    text
}

impl BodyValueImport {
    pub(super) fn description(&self) -> &[(&'static str, String)] {
        &self.description
    }

    /// Builds the tree. Returns lines about it.
    pub(super) fn build(self, output: Output, progress: &dyn Progress) -> Result<Lines> {
        let BodyValueImport { body, samples, options, .. } = self;
        let cells = build_body_values(&body.model, &samples, &options, output, progress)?;
        let nothing =
            "the tree is empty: no cell's centre is in the body, or no sample is near; choose smaller cells";
        Ok(if cells == 0 { vec![("warning", nothing.into())] } else { Lines::new() })
    }
}
