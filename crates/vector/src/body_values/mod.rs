//! Values within bodies: octrees of an exact model's inside, interpolated from samples in space.

mod samples;
mod source;

pub use samples::{BodySamples, read_samples};

use std::path::{Path, PathBuf};

use self::source::{BodyTree, Interpolation};
use spinney_base::io::Output;
use spinney_base::value::{DataKind, Rule, SampleType};
use spinney_base::{Error, Progress, Result};
use spinney_brep::{ExactModel, Faces as _};
use spinney_container::{Metadata, Tag, Unit};
use spinney_crs::{Crs, Frame};
use spinney_engine::store::{BuildOptions, Packing, build_with};

/// Cells and interpolation of values within a body.
#[derive(Clone, Debug)]
pub struct BodyValueOptions {
    /// Frame of the cells.
    pub frame: Frame,
    /// Depth of their tree.
    pub depth: u8,
    /// Number of cells along each axis; those beyond are VOID.
    pub extent: [u64; 3],
    /// Number of nearest samples that make up a value.
    pub nearest: usize,
    /// Maximum distance of these samples, in the unit of the model.
    pub radius: f64,
    /// Type of the cells: `f32` or `f64`.
    pub sample: SampleType,
    /// Name of the value.
    pub name: String,
    /// Path of the body's file, for messages.
    pub body: PathBuf,
    /// Lines for the provenance.
    pub provenance: Vec<String>,
    /// Memory limit in bytes.
    pub memory: u64,
    /// Codec of the file.
    pub packing: Packing,
    /// Whether equal subtrees are stored once (Autumnal files).
    pub share: bool,
    /// Time of an Autumnal file's first commit, in seconds since the beginning of 1970.
    pub time: Option<i64>,
}

/// Builds an octree of the cells whose centres are inside of a body; other cells are VOID. A centre
/// on the surface counts as moved by up to a thousandth of the cell width to larger coordinates, so
/// that bodies that touch share no cell.
///
/// The value of a cell is the mean of the samples that are nearest to its centre, weighted by the
/// inverse squares of their distances; a cell without a sample within the radius is VOID. Samples
/// at the centre itself replace all others. Coarser levels have means.
///
/// Takes memory for the samples and for building. Boxes of cells outside of the body are left out
/// as a whole. Returns the number of cells that are not VOID.
///
/// # Errors
/// If samples and model have different coordinate systems or units, the body includes infinity, the
/// samples exceed the memory, the model is corrupt, the output cannot be written, or on
/// cancellation.
pub fn build_body_values(
    model: &ExactModel,
    samples: &BodySamples,
    options: &BodyValueOptions,
    output: Output,
    progress: &dyn Progress,
) -> Result<u64> {
    if model.is_unbounded() {
        let found = format!("{}: a body that includes infinity", options.body.display());
        return Err(Error::invalid("body", found, "a bounded body"));
    }
    if !matches!(options.sample, SampleType::F32 | SampleType::F64) {
        return Err(Error::invalid("type", options.sample.name(), "f32 or f64: values are means"));
    }
    if options.nearest == 0 || options.radius.is_nan() || options.radius < 0.0 {
        let found = format!("{} samples within {}", options.nearest, options.radius);
        return Err(Error::invalid("nearest samples", found, "at least one, and a distance of at least 0"));
    }
    let limit = if options.sample == SampleType::F32 { f32::MAX.into() } else { f64::MAX };
    if let Some(value) = samples.values.iter().find(|value| value.abs() > limit) {
        return Err(Error::invalid("value", value.to_string(), "numbers in the range of f32, or --type f64"));
    }
    samples.check_memory(options.memory / 2)?;
    let crs = common_crs(model, &options.body, samples)?;
    let mut frame = options.frame.clone();
    frame.crs = crs;
    let mut metadata = Metadata {
        frame,
        band_names: vec![options.name.clone()],
        provenance: options.provenance.clone(),
        ..Metadata::default()
    };
    if let Some(unit) = model.metadata().tag(Tag::Unit) {
        metadata.set_tag(Tag::Unit, unit);
    }
    let build = BuildOptions::new(DataKind::Continuous, options.depth)
        .rule(Rule::Mean)
        .memory(options.memory / 4)
        .metadata(metadata)
        .share(options.share)
        .time(options.time)
        .packing(options.packing);
    let interpolation = Interpolation::new(samples, options.nearest, options.radius);
    let tree = BodyTree { model, interpolation, options, progress };
    Ok(build_with(&tree, options.extent, &build, output.into(), progress, &mut |_| {})?.cells)
}

/// The coordinate system of a model and samples, of which one may be unknown.
fn common_crs(model: &ExactModel, body: &Path, samples: &BodySamples) -> Result<Option<Crs>> {
    let own = model.metadata().frame.crs.as_ref();
    let Some(other) = &samples.crs else { return Ok(own.cloned()) };
    let (name, samples_name) = (body.display().to_string(), samples.path.display().to_string());
    if own.is_some() {
        Crs::check_same((&name, own), (&samples_name, Some(other)))?;
    }
    let metres = |unit: Option<&str>| Unit::parse(unit?)?.metres();
    let units = (metres(model.metadata().tag(Tag::Unit)), metres(other.unit()));
    if let (Some(unit), Some(found)) = units
        && unit != found
    {
        let found = format!("{}, in {other}", other.unit().unwrap_or_default());
        let unit = model.metadata().tag(Tag::Unit).unwrap_or_default();
        let expected = format!("{unit}, as {name} has; convert one with `spinney transform scale=`");
        return Err(Error::invalid(format!("unit of {samples_name}"), found, expected));
    }
    Ok(Some(other.clone()))
}
