//! Import of volumes: three-dimensional arrays, which become octrees.

mod array;
mod input;
mod npy;
mod nrrd;
mod raw;
mod section_names;
mod sections;
mod spill;
#[cfg(test)]
mod tests;

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use self::array::{Array, ArrayLayout};
pub use self::input::VolumeInput;
pub(crate) use self::nrrd::nrrd_head;
pub use self::raw::RawLayout;
use self::sections::Sections;
use crate::import::{DEFAULT_MEMORY, RasterOptions, as_stored, depth_of, listed, nodata_text};
use serde::{Deserialize, Serialize};
use spinney_base::TreeType;
use spinney_base::io::{FileAccess, Output, directory_of};
use spinney_base::space::{Bounds, Dimension};
use spinney_base::value::{DataKind, Number, Rule, ValueType};
use spinney_base::{Error, Progress, Result};
use spinney_container::Metadata;
use spinney_crs::{Crs, Frame};
use spinney_engine::store::{BuildOptions, Packing, TreeWriter, WantedCells};
use spinney_records::npy::MAGIC;

/// Options for the import of a volume.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct VolumeOptions {
    /// Kind of the samples; continuous by default.
    pub kind: Option<DataKind>,
    /// Rule for the representatives of inner nodes; the default depends on the kind.
    pub rule: Option<Rule>,
    /// The number that means VOID. NaN always means VOID.
    #[serde(with = "spinney_base::text_fields")]
    pub nodata: Option<Number>,
    /// Depth of the tree; by default the minimum that holds the volume.
    pub depth: Option<u8>,
    /// Transform from cells to the world: see [`Frame::matrix`]. The default is cells of unit width
    /// at the origin.
    #[serde(with = "spinney_base::text_fields")]
    pub transform: Option<[[f64; 4]; 3]>,
    /// The coordinate reference system.
    pub crs: Option<Crs>,
    /// Memory budget in bytes, half of it for reading; the default is [`DEFAULT_MEMORY`].
    #[serde(skip)]
    pub memory: Option<u64>,
    /// Whether Autumnal files store equal subtrees once.
    #[serde(skip)]
    pub share: bool,
    /// Time of the first commit of an Autumnal file, in seconds since the beginning of 1970.
    #[serde(skip)]
    pub time: Option<i64>,
    /// Compression of the file, and the loss that it may cause.
    pub packing: Packing,
    /// File access for images that are planes of a volume. (Other volumes are local files.)
    #[serde(skip)]
    pub access: FileAccess,
}

impl VolumeOptions {
    /// Default options: cells of unit width.
    pub fn new() -> VolumeOptions {
        VolumeOptions::default()
    }
}

/// An opened volume that is ready to be built: see [`VolumeImport::build`].
pub struct VolumeImport {
    samples: Samples,
    /// Cells along x, y and z.
    size: [u64; 3],
    value: ValueType,
    options: BuildOptions,
    memory: u64,
    description: Vec<(&'static str, String)>,
}

/// Source of the samples.
enum Samples {
    Array(Array),
    Sections(Box<Sections>),
    Packed(Box<nrrd::Packed>),
}

/// Description of a volume, from its file or from the caller.
struct OpenedVolume {
    /// Description of its format.
    words: String,
    /// Name of the sample type.
    stored: String,
    layout: ArrayLayout,
    metadata: Metadata,
    kind: Option<DataKind>,
    samples: Samples,
}

/// Whether a file is a volume, by its first bytes.
pub fn is_volume(path: &Path) -> bool {
    let mut start = Vec::new();
    // Only regular files: bytes read from a pipe would be lost.
    path.is_file()
        && File::open(path).is_ok_and(|file| file.take(8).read_to_end(&mut start).is_ok())
        && (start.starts_with(MAGIC) || start.starts_with(nrrd::MAGIC))
}

/// Opens a volume and plans its octree.
///
/// Volumes are NPY or NRRD files. NPY files, as written by `numpy.save`, have arrays of shape (z,
/// y, x) in C order, or (z, y, x, channels) with up to 4 channels. NRRD files are raw or
/// compressed, with samples inside or in a data file. Their frame, units and tags are kept. Sample
/// types that trees do not support become the next wider type: bool becomes u8, half becomes f32.
///
/// ```
/// use spinney::import::volume::{VolumeOptions, plan};
/// use spinney::Output;
///
/// # let directory = tempfile::tempdir().unwrap();
/// # let (array, path) = (directory.path().join("volume.npy"), directory.path().join("volume.goblin"));
/// let mut bytes = b"\x93NUMPY\x01\0\x76\0".to_vec();
/// bytes.extend(
///     format!("{:117}\n", "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3, 4)}")
///         .bytes());
/// bytes.extend((0..24).flat_map(|number| (number as f32).to_le_bytes()));
/// std::fs::write(&array, bytes).unwrap();
///
/// let mut options = VolumeOptions::new();
/// options.nodata = Some(5.into());
/// plan(&array, &options)?.build(Output::create(&path)?, &())?;
/// let tree = spinney::open(&path)?;
/// assert_eq!(tree.header().extent, [4, 3, 2]);
/// assert_eq!(tree.statistics(None, &())?.cells, 23);
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// If the file cannot be read, is no such array or not as long as its header says, or the options
/// do not fit it.
pub fn plan(path: &Path, options: &VolumeOptions) -> Result<VolumeImport> {
    let opened = if nrrd::is_one(path) { nrrd::open(path, &options.access)? } else { npy::open(path)? };
    planned(&[path.to_path_buf()], opened, options)
}

/// Opens a file of raw samples and plans its octree.
///
/// ```
/// use spinney::import::volume::VolumeOptions;
/// use spinney::raw::import::volume::{RawLayout, plan_raw};
/// use spinney::{Output, SampleType};
///
/// # let directory = tempfile::tempdir().unwrap();
/// # let (raw, path) = (directory.path().join("volume.raw"), directory.path().join("volume.goblin"));
/// std::fs::write(&raw, [0, 1, 0, 2, 0, 3, 0, 4]).unwrap();
/// let mut layout = RawLayout::new([2, 2, 1], SampleType::U16);
/// layout.is_big_endian = true;
/// plan_raw(&raw, &layout, &VolumeOptions::new())?.build(Output::create(&path)?, &())?;
/// assert_eq!(spinney::open(&path)?.statistics(None, &())?.channels[0].mean, 2.5);
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// If the file cannot be read or has another length, or the options do not fit it.
pub fn plan_raw(path: &Path, layout: &RawLayout, options: &VolumeOptions) -> Result<VolumeImport> {
    planned(&[path.to_path_buf()], raw::open(path, layout)?, options)
}

/// Opens images that are the planes of a volume, ordered along z, and plans its octree. Inputs are
/// files, pages of TIFF files, and directories of images. All planes must have the same size,
/// number of bands and sample type. Frame, nodata number, colours and tags are those of the first.
///
/// Images of a directory are sorted by the numbers in their names, with signs, decimals and units
/// of length; a warning reports missing numbers. Files that are given in alphabetical order, as by
/// a shell pattern, are sorted in the same way.
///
/// # Errors
/// If a file cannot be read, the images differ or have opacity, or the options do not fit them.
pub fn plan_sections(inputs: &[PathBuf], options: &VolumeOptions) -> Result<VolumeImport> {
    let (memory, access) = (options.memory.unwrap_or(DEFAULT_MEMORY) / 2, options.access.clone());
    let sections = Sections::open(inputs, RasterOptions { memory, access, ..RasterOptions::default() })?;
    let (info, files) = (sections.info.clone(), sections.files.clone());
    let planes = sections.layout.size[2];
    let mut words = match files.len() {
        1 => format!("{planes} pages: {}", info.layout),
        count => format!("{planes} sections in {count} files: {}", info.layout),
    };
    if sections.others > 0 {
        words += &format!("; {} other files in directories are left out", sections.others);
    }
    if let Some(report) = &sections.missing {
        words += &format!("; {report}");
    }
    let volume = OpenedVolume {
        words,
        stored: info.stored_sample,
        layout: sections.layout,
        metadata: Metadata {
            frame: info.frame,
            nodata: info.nodata,
            palette: info.palette,
            class_names: info.class_names.into_iter().collect(),
            tags: info.tags,
            ..Metadata::default()
        },
        kind: info.kind.filter(|kind| *kind == DataKind::Categorical),
        samples: Samples::Sections(Box::new(sections)),
    };
    planned(&files, volume, options)
}

/// Plans a volume from its description.
fn planned(paths: &[PathBuf], volume: OpenedVolume, options: &VolumeOptions) -> Result<VolumeImport> {
    let OpenedVolume { words, stored, layout, metadata, kind: declared_kind, samples } = volume;
    let value = layout.value();
    let nodata = options.nodata.or(metadata.nodata).and_then(|number| as_stored(number, value.sample));
    let value = nodata.map_or(value, |nodata| value.with_missing(nodata));
    let [width, height, planes] = layout.size;
    let text = format!("{width} x {height} x {planes} cells");
    let path = paths.first().map_or(Path::new("volume"), PathBuf::as_path);
    let depth = depth_of(Dimension::Oct, layout.size, (path, &text), options.depth)?;
    let (kind, kind_reason) = match (options.kind, declared_kind) {
        (Some(kind), _) => (kind, "as requested"),
        (None, Some(kind)) => (kind, "declared by the file"),
        (None, None) => (DataKind::Continuous, "default for volumes; for classes use --kind categorical"),
    };
    let rule = options.rule.unwrap_or(kind.default_rule());
    kind.check_rule(rule, path)?;
    let provenance = vec![format!("volume {} ({words})", listed(paths))];
    let frame = frame(&metadata.frame, options)?;
    let metadata = Metadata { frame, nodata, provenance, ..metadata };
    let said = |is: bool| if is { "as requested".into() } else { format!("default for {kind}") };
    let crs = metadata.frame.crs.as_ref().map_or("none".into(), Crs::to_string);
    let placed = !metadata.frame.is_identity();
    let description = vec![
        ("input", listed(paths)),
        ("layout", words),
        ("size", text),
        ("samples", format!("{value} (stored as {stored})")),
        ("CRS", crs),
        ("transform", if placed { format!("{:?}", metadata.frame.matrix) } else { "none".into() }),
        ("nodata", nodata_text(options.nodata, nodata, value.sample)),
        ("kind", format!("{kind}: {kind_reason}")),
        ("rule", format!("{rule}, {}", said(options.rule.is_some()))),
        ("depth", format!("{depth} levels, {0} x {0} x {0} cells", 1u64 << depth)),
    ];
    let memory = options.memory.unwrap_or(DEFAULT_MEMORY);
    let options = BuildOptions::new(kind, depth)
        .rule(rule)
        .memory(memory / 4)
        .metadata(metadata)
        .share(options.share)
        .time(options.time)
        .packing(options.packing);
    Ok(VolumeImport { samples, size: layout.size, value, options, memory, description })
}

/// The frame of the file, with the transform and coordinate system of the options.
fn frame(declared: &Frame, options: &VolumeOptions) -> Result<Frame> {
    let mut frame = declared.clone();
    frame.crs = options.crs.clone().or(frame.crs);
    frame.matrix = options.transform.unwrap_or(frame.matrix);
    let is_finite = frame.matrix.iter().flatten().all(|number| number.is_finite());
    if !is_finite || frame.to_cells([0.0; 3]).is_none() {
        let expected = "an invertible map from cells to the world";
        return Err(Error::invalid("transform", format!("{:?}", frame.matrix), expected));
    }
    Ok(frame)
}

impl VolumeImport {
    /// Description of the plan: pairs of heading and text.
    pub fn description(&self) -> &[(&'static str, String)] {
        &self.description
    }

    /// Options for building the tree.
    pub fn options(&self) -> &BuildOptions {
        &self.options
    }

    /// Type of the tree's values.
    pub fn value_type(&self) -> ValueType {
        self.value
    }

    /// Builds the octree on the threads of the current rayon pool; progress counts cells. Samples
    /// of images and compressed samples are first written to a temporary file in the output's
    /// directory.
    ///
    /// # Errors
    /// If the file cannot be read or was truncated, the output cannot be written, or on
    /// cancellation. Nothing is left then.
    pub fn build(self, output: Output, progress: &dyn Progress) -> Result<()> {
        let scratch_directory = directory_of(output.path()).to_path_buf();
        let mut file = TreeWriter::create(output, (Dimension::Oct, self.options.depth), 1)?;
        self.write(&mut file, &scratch_directory, progress)?;
        file.finish()
    }

    /// Writes the octree, or the requested range of it, as the next layer of a file. Temporary
    /// files are created in the directory `scratch_directory`, and hold only the requested samples.
    ///
    /// # Errors
    /// Those of [`VolumeImport::build`].
    pub fn write(
        self,
        file: &mut TreeWriter,
        scratch_directory: &Path,
        progress: &dyn Progress,
    ) -> Result<()> {
        let VolumeImport { samples, size, value, options, memory, .. } = self;
        let form = TreeType::new(Dimension::Oct, value);
        let Some(run) = file.run() else { return file.write_layer_header(form, size, &options) };
        let cells = run.bounds(form.dimension, options.depth, &Bounds::of_extent(size));
        let array = match samples {
            Samples::Array(array) => array,
            Samples::Sections(sections) => sections.spill(cells, scratch_directory, progress)?,
            Samples::Packed(packed) => packed.unpack(cells, scratch_directory, progress)?,
        };
        let nodata = options.metadata.nodata.and_then(|number| value.splat(number));
        let wanted = WantedCells { dimension: Dimension::Oct, depth: options.depth, run };
        file.slabs(form, &mut array.slabs(wanted, memory / 2), nodata, &options, progress)
    }
}
