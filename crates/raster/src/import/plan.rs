//! Import plans: from raster files and options to the tree that will be built.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::ahead::open_each;
use super::lazy::{Lazy, MAX_POOL, Pool};
use super::mosaic::{Mosaic, MosaicPlan};
use super::provenance::provenance;
use super::sidecar::DescribedRaster;
use super::validity::as_stored;
use super::{Band, Raster, RasterInfo, RasterOptions, Transparent, bands, mosaic, open};
use crate::index::{IndexPlan, SourceRecorder};
use serde::{Deserialize, Serialize};
use spinney_base::io::FileAccess;
use spinney_base::space::Dimension;
use spinney_base::value::{DataKind, Number, Rule, SampleType, ValueType};
use spinney_base::{Error, Result};
use spinney_container::{Header, Metadata};
use spinney_crs::{Crs, Frame};
use spinney_engine::store::{BuildOptions, Packing, depth_for};

/// Default memory budget in bytes: enough for images of common sizes that are decoded as a whole.
pub const DEFAULT_MEMORY: u64 = 256 << 20;

/// Maximum number of files kept open; if there are more, each is opened when it is read.
pub(super) const MAX_OPEN: usize = 16;

/// Options of an import; the files determine those that are `None`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct ImportOptions {
    /// Kind of the samples: continuous or categorical.
    pub kind: Option<DataKind>,
    /// Rule for the representatives of inner nodes.
    pub rule: Option<Rule>,
    /// Selected channels, by number or name.
    pub bands: Option<Vec<Band>>,
    /// The number that means VOID.
    #[serde(with = "spinney_base::text_fields")]
    pub nodata: Option<Number>,
    /// Depth of the tree; at least the minimum that holds the image.
    pub depth: Option<u8>,
    /// The coordinate reference system.
    pub crs: Option<Crs>,
    /// Affine transform of the pixels, in the order of [`Frame::planar`]; for several inputs, of
    /// the mosaic.
    #[serde(with = "spinney_base::text_fields")]
    pub transform: Option<[f64; 6]>,
    /// Name of the layer of OpenEXR files.
    pub layer: Option<String>,
    /// Number of the page of TIFF files, from 0. By default files with several pages are rejected.
    pub page: Option<usize>,
    /// Memory budget in bytes, half for reading the files, half for building; the default is
    /// [`DEFAULT_MEMORY`].
    #[serde(skip)]
    pub memory: Option<u64>,
    /// Whether pixels of opacity 0 become cells with their colours; otherwise they become VOID.
    pub keep_transparent: bool,
    /// Whether Autumnal files store equal subtrees once.
    #[serde(skip)]
    pub share: bool,
    /// Time of the first commit of an Autumnal file, in seconds since the beginning of 1970.
    #[serde(skip)]
    pub time: Option<i64>,
    /// Compression of the file, and the loss that it may cause.
    pub packing: Packing,
    /// Levels between the cells and the finest stored level, 1, 2 or 4, if the cells stay in the
    /// files, which must be TIFF files or virtual rasters of these: the tree is an index.
    pub referenced: Option<u8>,
    /// Access to the files, and to files that they name or that accompany them.
    #[serde(skip)]
    pub access: FileAccess,
}

impl ImportOptions {
    /// Options with everything taken from the files.
    pub fn new() -> ImportOptions {
        ImportOptions::default()
    }
}

/// Opened files that are ready to be built: see [`RasterImport::build`].
pub struct RasterImport {
    pub(super) raster: Box<dyn Raster>,
    pub(super) value: ValueType,
    pub(super) nodata: Option<Number>,
    pub(super) options: BuildOptions,
    pub(super) memory: u64,
    /// Files with content that is not read, and a description of that.
    pub(super) remarks: Vec<(PathBuf, String)>,
    /// Plan of the mosaic, if there are several files.
    mosaic: Option<MosaicPlan>,
    /// Where the cells of an index are.
    pub(crate) index: Option<IndexPlan>,
    /// The files that are read, if they are recorded for an index.
    pub(super) recorder: Option<Arc<SourceRecorder>>,
    description: Vec<(&'static str, String)>,
}

impl RasterImport {
    /// A complete plan.
    pub(super) fn of(
        raster: Box<dyn Raster>,
        value: ValueType,
        nodata: Option<Number>,
        options: BuildOptions,
        memory: u64,
    ) -> RasterImport {
        let (remarks, mosaic, description) = (Vec::new(), None, Vec::new());
        let (index, recorder) = (None, None);
        RasterImport { raster, value, nodata, options, memory, remarks, mosaic, index, recorder, description }
    }

    /// Description of the plan: pairs of heading and text.
    pub fn description(&self) -> &[(&'static str, String)] {
        &self.description
    }

    /// Properties of the image that will be read.
    pub fn info(&self) -> &RasterInfo {
        self.raster.info()
    }

    /// Plan of the mosaic, if there are several files.
    pub fn mosaic(&self) -> Option<&MosaicPlan> {
        self.mosaic.as_ref()
    }

    /// The files that are read, if they are recorded for an index.
    pub fn recorder(&self) -> Option<Arc<SourceRecorder>> {
        self.recorder.clone()
    }

    /// Options for building the tree.
    pub fn options(&self) -> &BuildOptions {
        &self.options
    }

    /// Type of the tree's values.
    pub fn value_type(&self) -> ValueType {
        self.value
    }
}

/// Opens raster files and plans their tree. Several files become one image: see
/// [`mosaic`](super::mosaic).
///
/// ```
/// # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
/// use spinney::import::raster::{ImportOptions, plan};
/// use spinney::Output;
///
/// # let directory = tempfile::tempdir().unwrap();
/// # let path = directory.path().join("island.goblin");
/// let import = plan(&["fixtures/island_elevation.tif".into()], &ImportOptions::default())?;
/// import.build(Output::create(&path)?, &())?;
/// assert_eq!(spinney::open(&path)?.depth(), 8);
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// If a file cannot be read, the files do not fit together, or the options do not fit them.
pub fn plan(inputs: &[PathBuf], options: &ImportOptions) -> Result<RasterImport> {
    let memory = options.memory.unwrap_or(DEFAULT_MEMORY);
    let mut overruled = None;
    let recorder = options.referenced.map(|_| Arc::new(SourceRecorder::default()));
    let are_several = inputs.len() > 1;
    let rasters = open_inputs(inputs, are_several, (options, memory), &recorder, &mut overruled)?;
    let mut remarks = remarks(&rasters);
    remarks.extend(difference(&rasters));
    let (raster, mosaic) = match rasters.len() {
        0 | 1 => (mosaic(rasters)?, None),
        _ => {
            let mosaic = Mosaic::of(rasters)?;
            let plan = mosaic.plan();
            (Box::new(mosaic) as Box<dyn Raster>, Some(plan))
        }
    };
    let info = raster.info();
    let value = masked_value_type(raster.path(), info)?;
    let frame = frame(info, options)?;
    let (kind, kind_reason) = kind(info, options);
    let rule = options.rule.unwrap_or(kind.default_rule());
    kind.check_rule(rule, raster.path())?;
    let size = format!("{} x {} pixels", info.width, info.height);
    let depth =
        depth_of(Dimension::Quad, [info.width, info.height, 1], (raster.path(), &size), options.depth)?;
    let choices = TreeProperties { value, kind, kind_reason, rule, depth };
    let metadata = metadata(frame, inputs, info, options);
    let description = describe(inputs, info, options, &choices, &metadata, overruled);
    let nodata = info.nodata;
    let index = match &recorder {
        None => None,
        Some(recorder) => {
            let nodata = nodata.and_then(|number| value.splat(number));
            Some(IndexPlan::of(&*raster, (value, nodata), recorder.clone(), &options.access)?)
        }
    };
    let options = BuildOptions::new(kind, choices.depth)
        .rule(rule)
        .memory(memory / 4)
        .metadata(metadata)
        .share(options.share)
        .time(options.time)
        .packing(options.packing)
        .referenced(options.referenced);
    Ok(RasterImport { raster, value, nodata, options, memory, remarks, mosaic, index, recorder, description })
}

/// Opens some inputs, possibly none, of a mosaic that was planned before; `mosaic` has the regions
/// of these inputs. The tree is described by a header and metadata.
///
/// # Errors
/// If a file cannot be read, or its pixels have changed.
pub fn plan_part(
    inputs: &[PathBuf],
    mosaic: &MosaicPlan,
    (header, metadata): (&Header, &Metadata),
    options: &ImportOptions,
) -> Result<RasterImport> {
    let memory = options.memory.unwrap_or(DEFAULT_MEMORY);
    let recorder = options.referenced.map(|_| Arc::new(SourceRecorder::default()));
    let rasters = open_inputs(inputs, true, (options, memory), &recorder, &mut None)?;
    let (remarks, value) = (remarks(&rasters), header.form.value);
    let empty = RasterInfo::plain(mosaic.size, value.sample, usize::from(value.channels));
    let path = inputs.first().map_or(Path::new(""), |first| first);
    let placed = Mosaic::placed(mosaic, rasters, (path, empty))?;
    let info = placed.info();
    if (info.sample, info.channels) != (value.sample, usize::from(value.channels)) {
        return Err(Error::Changed { path: path.to_path_buf(), what: "was overwritten" });
    }
    let build = BuildOptions::new(header.kind, header.depth())
        .rule(header.rule)
        .memory(memory / 4)
        .metadata(metadata.clone())
        .packing(options.packing)
        .referenced(options.referenced);
    let part = RasterImport::of(Box::new(placed), value, mosaic.nodata, build, memory);
    Ok(RasterImport { remarks, recorder, ..part })
}

/// Files with content that is not read, and a description of that.
fn remarks(rasters: &[Box<dyn Raster>]) -> Vec<(PathBuf, String)> {
    let found = rasters
        .iter()
        .filter_map(|raster| Some((raster.path().to_path_buf(), raster.info().remark.clone()?)));
    found.collect()
}

/// Properties of a mosaic that are those of its first file, although another file has others.
fn difference(rasters: &[Box<dyn Raster>]) -> Option<(PathBuf, String)> {
    let (first, others) = rasters.split_first()?;
    let differing = |raster: &dyn Raster| {
        let (a, b) = (first.info(), raster.info());
        let properties = [
            ("units", a.units != b.units),
            ("names of bands", a.band_names != b.band_names),
            ("palette", a.palette != b.palette),
            ("names of classes", a.class_names != b.class_names),
            ("tags", (&a.tags, &a.scoped_tags) != (&b.tags, &b.scoped_tags)),
        ];
        let names: Vec<&str> =
            properties.into_iter().filter(|(_, differs)| *differs).map(|(name, _)| name).collect();
        (!names.is_empty()).then(|| (raster.path().to_path_buf(), names.join(", ")))
    };
    let (path, names) = others.iter().find_map(|raster| differing(&**raster))?;
    Some((path, format!("has other {names} than {}, which are kept for all files", first.path().display())))
}

/// Opens inputs with the user's channels, nodata number and coordinate system. With `are_several`
/// they are layers of a mosaic.
///
/// `overruled` is set to the first coordinate system of a file that differs from the user's.
fn open_inputs(
    inputs: &[PathBuf],
    are_several: bool,
    (options, memory): (&ImportOptions, u64),
    recorder: &Option<Arc<SourceRecorder>>,
    overruled: &mut Option<Crs>,
) -> Result<Vec<Box<dyn Raster>>> {
    // Readers rarely need their share, but all open files together must not exceed half of the
    // memory.
    let at_once = inputs.len().clamp(1, MAX_OPEN);
    let share = memory / 2 / at_once as u64;
    let open_options = RasterOptions {
        memory: share,
        layer: options.layer.clone(),
        page: options.page,
        access: options.access.clone(),
        recorder: recorder.clone(),
        ..RasterOptions::default()
    };
    let pool = Pool::new(MAX_POOL, memory / 2);
    let open_one = |path: &PathBuf| -> Result<Box<dyn Raster>> {
        let raster: Box<dyn Raster> = if inputs.len() > MAX_OPEN {
            Box::new(Lazy::open(path, &open_options, &pool)?)
        } else {
            open(path, &open_options)?
        };
        check_pages(&*raster)?;
        match &options.bands {
            Some(chosen) => bands::select(raster, chosen),
            None => Ok(raster),
        }
    };
    let described = |mut raster: Box<dyn Raster>| -> Box<dyn Raster> {
        let mut info = raster.info().clone();
        // (These are used instead of its own.)
        raster.forget_properties();
        apply_options_to_input(&mut info, are_several, options, overruled);
        Box::new(DescribedRaster { raster, info })
    };
    Ok(open_each(inputs, &open_one)?.into_iter().map(described).collect())
}

/// The treatment of an image's transparent pixels, depending on the option to keep them.
fn transparent(info: &RasterInfo, options: &ImportOptions) -> Transparent {
    let is_last = info.channels > 1 && info.alpha == Some(info.channels - 1);
    match options.keep_transparent {
        true => Transparent::Plain,
        false if is_last => Transparent::Masked,
        false => Transparent::Void,
    }
}

/// Returns the type of a tree's values, with the mask that follows from opacity and nodata.
///
/// # Errors
/// If trees do not support such values.
pub(crate) fn masked_value_type(path: &Path, info: &RasterInfo) -> Result<ValueType> {
    // With opacity no nodata number is needed: missing pixels are transparent.
    let missing = info.nodata.filter(|_| info.alpha.is_none());
    let value = bands::value_type(path, info)?;
    Ok(match info.transparent {
        Transparent::Masked => value.with_alpha(),
        _ => missing.map_or(value, |nodata| value.with_missing(nodata)),
    })
}

/// Overrides properties of an input by the user's options. With `are_several` it is a layer of a
/// mosaic.
pub(crate) fn apply_options_to_input(
    info: &mut RasterInfo,
    are_several: bool,
    options: &ImportOptions,
    overruled: &mut Option<Crs>,
) {
    apply_options(info, options, overruled);
    if are_several && info.transparent == Transparent::Masked {
        // Images below are visible through transparent pixels.
        info.transparent = Transparent::Void;
    }
}

/// Overrides properties of a file by the user's options. `overruled` is set to the first coordinate
/// system of a file that differs from the user's.
pub(super) fn apply_options(info: &mut RasterInfo, options: &ImportOptions, overruled: &mut Option<Crs>) {
    info.nodata = options.nodata.or(info.nodata).and_then(|number| as_stored(number, info.sample));
    info.transparent = transparent(info, options);
    if let Some(chosen) = &options.crs {
        let replaced = match &mut info.control_points {
            Some(points) => points.crs.replace(chosen.clone()),
            None => info.frame.crs.replace(chosen.clone()),
        };
        *overruled = overruled.take().or(replaced.filter(|crs| !crs.is_same(chosen)));
    }
}

/// Rejects a file of several pages if none was selected.
pub(crate) fn check_pages(raster: &dyn Raster) -> Result<()> {
    match raster.info().pages {
        0 | 1 => Ok(()),
        pages => {
            let advice = "select with --pages (in Python pages=): a page number from 0, layers for a layer of each page, z for a \
                          volume";
            Err(Error::unsupported(raster.path(), format!("a raster of {pages} pages"), advice))
        }
    }
}

/// Properties of the tree that follow from the raster and the options.
struct TreeProperties {
    value: ValueType,
    kind: DataKind,
    /// Reason for the kind, for messages.
    kind_reason: &'static str,
    rule: Rule,
    depth: u8,
}

/// Metadata of the tree's file.
pub(crate) fn metadata(
    frame: Frame,
    inputs: &[PathBuf],
    info: &RasterInfo,
    options: &ImportOptions,
) -> Metadata {
    // Control points are kept only if nothing else georeferences the image.
    let control_points = info.control_points.clone().filter(|_| frame.is_identity());
    let mut metadata = Metadata {
        frame,
        control_points,
        nodata: info.nodata,
        palette: info.palette.clone(),
        class_names: info.class_names.iter().cloned().collect(),
        band_names: if info.band_names.iter().all(String::is_empty) {
            Vec::new()
        } else {
            info.band_names.clone()
        },
        scale_offset: if info.scale_offset.iter().all(|pair| *pair == (1.0, 0.0)) {
            Vec::new()
        } else {
            info.scale_offset.clone()
        },
        alpha: info.alpha.map(|alpha| alpha as u8),
        provenance: provenance(inputs, info, options),
        units: if info.units.iter().all(String::is_empty) { Vec::new() } else { info.units.clone() },
        tags: info.tags.clone(),
        scoped_tags: info.scoped_tags.clone(),
        ..Metadata::default()
    };
    metadata.set_colour_roles(&info.colour_roles);
    metadata
}

/// Lines of [`RasterImport::description`].
fn describe(
    inputs: &[PathBuf],
    info: &RasterInfo,
    options: &ImportOptions,
    choices: &TreeProperties,
    metadata: &Metadata,
    overruled: Option<Crs>,
) -> Vec<(&'static str, String)> {
    let TreeProperties { value, kind, kind_reason, rule, depth } = choices;
    let plural = if value.channels == 1 { "" } else { "s" };
    let stored = &info.stored_sample;
    let nodata = nodata_text(options.nodata, info.nodata, value.sample);
    let crs = match (&metadata.frame.crs, overruled) {
        (None, _) => "none".into(),
        (Some(crs), None) => crs.to_string(),
        (Some(crs), Some(input)) => format!("{crs}, as requested; the input has {input}"),
    };
    let affine = metadata.frame.affine().map(|number| number.to_string()).join(", ");
    let mut lines = vec![
        ("input", listed(inputs)),
        ("layout", info.layout.clone()),
        ("size", format!("{} x {} pixels", info.width, info.height)),
        (
            "samples",
            format!("{} channel{plural} of {} (stored as {stored})", value.channels, value.sample.name()),
        ),
        ("CRS", crs),
        ("transform", if metadata.frame.is_identity() { "none".into() } else { affine }),
        ("nodata", nodata),
    ];
    if let Some(points) = &metadata.control_points {
        let crs = points.crs.as_ref().map_or("none".into(), Crs::to_string);
        lines.push(("points", format!("{} ground control points, CRS {crs}", points.points.len())));
    }
    if let Some(palette) = &metadata.palette {
        lines.push(("palette", format!("{} colours", palette.colours.len())));
    }
    lines.push(("kind", format!("{kind}: {kind_reason}")));
    let default = if options.rule.is_some() { "as requested".into() } else { format!("default for {kind}") };
    lines.push(("rule", format!("{rule}, {default}")));
    lines.push(("depth", format!("{depth} levels, {0} x {0} cells", 1u64 << depth)));
    lines
}

/// Lists the paths of files, as many as fit a line.
pub(crate) fn listed(paths: &[PathBuf]) -> String {
    const LISTED: usize = 12;
    let names: Vec<String> = paths.iter().take(LISTED).map(|path| path.display().to_string()).collect();
    match paths.len() - names.len() {
        0 => names.join(", "),
        more => format!("{} and {more} more", names.join(", ")),
    }
}

fn frame(info: &RasterInfo, options: &ImportOptions) -> Result<Frame> {
    let mut frame = info.frame.clone();
    if let Some(transform) = options.transform {
        frame.matrix = Frame::planar(transform).matrix;
        if transform.iter().any(|number| !number.is_finite()) || frame.to_cells([0.0; 3]).is_none() {
            let expected = "six numbers that map columns and rows to a plane: a,b,c,d,e,f";
            return Err(Error::invalid("transform", format!("{transform:?}"), expected));
        }
    }
    Ok(frame)
}

pub(crate) fn kind(info: &RasterInfo, options: &ImportOptions) -> (DataKind, &'static str) {
    let small = matches!(info.sample, SampleType::U8) && info.channels == 1;
    let has_classes = info.channels == 1 && !info.sample.is_float() && !info.class_names.is_empty();
    match (options.kind, info.kind) {
        (Some(kind), _) => (kind, "as requested"),
        (None, Some(kind @ DataKind::Categorical)) if info.palette.is_some() => (kind, "it has a palette"),
        (None, _) if has_classes => (DataKind::Categorical, "its values have names"),
        (None, Some(kind)) => (kind, "declared by the file"),
        (None, None) if small => (DataKind::Continuous, "8-bit grey; for classes use --kind categorical"),
        (None, None) => (DataKind::Continuous, "default for such samples"),
    }
}

/// Describes the nodata number: the requested one, or the file's, as far as samples of the tree's
/// type can hold it.
pub(crate) fn nodata_text(requested: Option<Number>, held: Option<Number>, sample: SampleType) -> String {
    match (requested, held) {
        (Some(number), None) => format!("none: {} cannot hold {number}", sample.name()),
        (Some(_), Some(number)) => format!("{number}, as requested"),
        (None, Some(number)) => number.to_string(),
        (None, None) => "none".into(),
    }
}

/// Returns the depth of a tree: the requested one, or the minimum that holds its cells. `size` is
/// their size, and `path` the file, for messages.
///
/// # Errors
/// If no tree is that large, or the requested depth is too small or too large.
pub(crate) fn depth_of(
    dimension: Dimension,
    extent: [u64; 3],
    (path, size): (&Path, &str),
    requested: Option<u8>,
) -> Result<u8> {
    let (least, most) = (depth_for(extent), dimension.max_depth());
    if least > most {
        let what = format!("{}: size", path.display());
        return Err(Error::invalid(what, size, format!("at most 2^{most} cells per side")));
    }
    match requested {
        None => Ok(least),
        Some(depth) if (least..=most).contains(&depth) => Ok(depth),
        Some(depth) => {
            Err(Error::invalid("depth", depth.to_string(), format!("{least} to {most} for {size}")))
        }
    }
}
