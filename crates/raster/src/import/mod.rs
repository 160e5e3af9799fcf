//! Import of raster files: one trait, one reader per format, and mosaics of several files.

mod ahead;
mod bands;
mod build;
mod exr;
#[cfg(test)]
mod fake;
mod files;
mod gdal;
mod hgt;
mod info;
mod jpeg;
mod lazy;
mod mask_file;
mod mosaic;
mod plan;
mod png;
mod provenance;
mod sidecar;
mod slabs;
mod spill;
pub(crate) mod stack;
mod tiff;
mod validity;
mod vrt;
mod whole_image;
mod worldfile;
mod xml;

use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;
use std::sync::Arc;

pub use self::bands::{Band, BandInfo, select, value_type};
pub use self::build::{TargetGrid, WarpedBuilt};
pub use self::files::files_of;
pub(crate) use self::mosaic::grid_offset;
pub use self::mosaic::{MosaicPlan, mosaic};
pub use self::plan::{DEFAULT_MEMORY, ImportOptions, RasterImport, plan, plan_part};
pub(crate) use self::plan::{apply_options_to_input, check_pages, kind, masked_value_type, metadata};
pub(super) use self::plan::{depth_of, listed, nodata_text};
pub(crate) use self::provenance::{ImportHistory, mosaic_layout, provenance};
pub use self::slabs::RasterSlabs;
pub use self::spill::spill;
pub use self::stack::{Stack, StackLayer, StackOptions, needs_layers, plan_stack, write_layers, write_stack};
pub(super) use self::tiff::{SampleFormat, page_directories};
pub(crate) use self::validity::Validity;
pub(super) use self::validity::as_stored;
use crate::chain_code;
use crate::index::{SourceRecorder, SourceWindow};
use spinney_base::io::{FileAccess, InputFile, sibling_path, sidecar_of, without_query};
use spinney_base::space::Region;
use spinney_base::value::{DataKind, Number, Palette, SampleType};
use spinney_base::{Error, Result};
use spinney_container::{FIRST_BYTES, OtherFormat, ScopedTags};
use spinney_crs::{ControlPoints, Frame};

/// Treatment of pixels whose opacity is 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Transparent {
    /// They become VOID.
    #[default]
    Void,
    /// They become cells that keep their colours but have no weight: see `Mask::Alpha`. Only pixels
    /// of zeros become VOID.
    Masked,
    /// They become ordinary cells.
    Plain,
}

/// Properties of a raster, from the header of its file.
#[derive(Clone, Debug, PartialEq)]
pub struct RasterInfo {
    /// Columns.
    pub width: u64,
    /// Rows.
    pub height: u64,
    /// Type of the samples returned by [`Raster::read`]: the file's own, or the next wider type
    /// that Spinney supports (1 to 7 bits become u8, half becomes f32).
    pub sample: SampleType,
    /// Name of the sample type in the file: "uint12", "int8", "half".
    pub stored_sample: String,
    /// Samples per pixel; not limited.
    pub channels: usize,
    /// Index of the opacity channel (0 is transparent), if there is one.
    pub alpha: Option<usize>,
    /// Treatment of transparent pixels.
    pub transparent: Transparent,
    /// Properties of each channel; empty if the channels do not differ in these.
    pub bands: Vec<BandInfo>,
    /// Transform from pixels to the world.
    pub frame: Frame,
    /// The number that marks missing samples.
    pub nodata: Option<Number>,
    /// Colours of the values of a one-channel image.
    pub palette: Option<Palette>,
    /// Role per channel by GDAL's names ("Red", "NIR"); empty if the file has none.
    pub colour_roles: Vec<String>,
    /// Names of values, by value.
    pub class_names: Vec<(Number, String)>,
    /// Index of the channel that they belong to.
    pub class_channel: usize,
    /// Name per channel; empty if the file has none.
    pub band_names: Vec<String>,
    /// Scale and offset per channel, from samples to physical values.
    pub scale_offset: Vec<(f64, f64)>,
    /// Unit per channel of the scaled values; empty if the file has none.
    pub units: Vec<String>,
    /// Kind of the samples, continuous or categorical, if the file has it.
    pub kind: Option<DataKind>,
    /// Format and pixel layout of the file: "GeoTIFF, 512x512 tiles, zstd".
    pub layout: String,
    /// Other metadata, by name.
    pub tags: BTreeMap<String, String>,
    /// Metadata of single channels, and in domains.
    pub scoped_tags: ScopedTags,
    /// Ground control points.
    pub control_points: Option<ControlPoints>,
    /// A remark on contents of the file that are not read, and on sidecars that contradict it.
    pub remark: Option<String>,
    /// Number of independent images in the file, this one included, without overviews and masks.
    pub pages: usize,
    /// Order in which regions are cheap to read.
    pub order: Order,
}

/// Order in which regions of a raster are cheap to read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// Full-width bands from the top down, each row once. Some formats allow nothing else.
    Bands,
    /// Any region at any time.
    Anywhere,
}

/// Samples of a region: rows from the top, pixels from the left, the channels of a pixel together,
/// little-endian.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pixels {
    /// `height * width * channels` samples.
    pub bytes: Vec<u8>,
    /// One flag per pixel if the file has a mask: `false` is VOID. (Opacity and nodata are not
    /// included, since the samples encode them.)
    pub valid: Option<Vec<bool>>,
}

/// A raster file that is open for reading, independent of its format.
pub trait Raster: Send {
    /// Properties of the raster.
    fn info(&self) -> &RasterInfo;

    /// Path of the file, for messages.
    fn path(&self) -> &Path;

    /// Reads a region within the raster into `pixels`, whose content is replaced.
    ///
    /// With [`Order::Bands`], regions must be full-width and follow each other from the top without
    /// gaps.
    ///
    /// # Errors
    /// If the file is corrupt there or cannot be read, or decoding exceeds the memory budget of
    /// `open`.
    fn read(&mut self, region: Region, pixels: &mut Pixels) -> Result<()>;

    /// Restricts the raster to these channels, by index from 0, in this order. Returns `false`,
    /// without an effect, if all channels are read anyway.
    fn choose(&mut self, channels: &[usize]) -> bool {
        let _ = channels;
        false
    }

    /// Returns a raster of these channels that reads from the same open file. Returns `None` if the
    /// format does not support it.
    fn separate_channels(&self, channels: &[usize]) -> Option<Box<dyn Raster>> {
        let _ = channels;
        None
    }

    /// Whether reading a raster of [`Raster::separate_channels`] takes less time than reading all
    /// channels.
    fn has_separate_channels(&self) -> bool {
        false
    }

    /// Whether any region can be read at any time, even if another order is cheaper.
    fn reads_anywhere(&self) -> bool {
        self.info().order == Order::Anywhere
    }

    /// Announces regions that will be read next: those of remote files are fetched together.
    /// Returns the number of regions that were announced, at least 1; the others should be
    /// announced again when these have been read.
    ///
    /// # Errors
    /// If they cannot be fetched.
    fn prefetch(&mut self, regions: &[Region]) -> Result<usize> {
        Ok(regions.len())
    }

    /// Drops properties that do not affect samples, so that very many rasters take little memory.
    fn forget_properties(&mut self) {}

    /// Returns the windows of files whose pixels are those of this raster, unchanged, from the
    /// bottom to the top.
    fn source_windows(&self) -> SourceWindows {
        Err("a raster whose pixels are not those of a TIFF file".into())
    }
}

/// Windows of recorded files. The error says what the raster is that has none.
pub type SourceWindows = std::result::Result<Vec<SourceWindow>, String>;

/// Options to open a raster.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct RasterOptions {
    /// Memory budget of a reader in bytes, such as for decoded strips, or for the whole image if
    /// the format requires that.
    pub memory: u64,
    /// Name of the layer of an EXR file; by default the first one.
    pub layer: Option<String>,
    /// Number of the page of a TIFF file, from 0; by default the first one.
    pub page: Option<usize>,
    /// Access to the file, and to files that it names or that accompany it.
    pub access: FileAccess,
    pub(crate) nesting: vrt::Nesting,
    /// Offset of the page's directory in a TIFF file, if known.
    pub(crate) directory: Option<u64>,
    /// Records the files that are read, for an index.
    pub(crate) recorder: Option<Arc<SourceRecorder>>,
}

impl Default for RasterOptions {
    fn default() -> Self {
        RasterOptions {
            memory: 192 << 20,
            layer: None,
            page: None,
            access: FileAccess::default(),
            nesting: Default::default(),
            directory: None,
            recorder: None,
        }
    }
}

impl RasterOptions {
    /// The first layer, with a memory budget of 192 MiB.
    pub fn new() -> RasterOptions {
        RasterOptions::default()
    }
}

/// Opens a raster file with the metadata of its sidecar (`.aux.xml`) and its mask file (`.msk`).
/// The format is detected by the first bytes, or for `.hgt` and `.tga` files, which have no
/// signature, by the name.
///
/// # Errors
/// If the file cannot be read, has an unknown format, is corrupt, or uses an unsupported feature.
pub fn open(path: &Path, options: &RasterOptions) -> Result<Box<dyn Raster>> {
    let (file, magic) = open_input(path, &options.access)?;
    let is_tiff =
        matches!(magic.as_slice(), [b'I', b'I', b'*' | b'+', 0, ..] | [b'M', b'M', 0, b'*' | b'+', ..]);
    if let Some(page) = options.page.filter(|page| *page > 0 && !is_tiff) {
        let found = format!("page {page} of a file that is not a TIFF file");
        return Err(Error::unsupported(path, found, "omit --pages"));
    }
    let raster = match magic.as_slice() {
        _ if is_tiff => tiff::open(file, path, options),
        [0x89, b'P', b'N', b'G', ..] => png::open(path, options),
        [0xff, 0xd8, 0xff, ..] => jpeg::open(path, options),
        [0x76, 0x2f, 0x31, 0x01, ..] => exr::open(path, options),
        start if start.starts_with(chain_code::MAGIC.as_bytes()) => chain_code::open(path, options),
        start if vrt::is_vrt(start) => vrt::open(path, options),
        _ if without_query(path).extension().is_some_and(|e| e.eq_ignore_ascii_case("hgt")) => {
            hgt::open(path, options)
        }
        start => match whole_image::format_of(path, start) {
            Some(format) => whole_image::open(path, format, start, options),
            None => Err(OtherFormat::refuse_source(path, start, "a raster")),
        },
    };
    let mut raster = raster?;
    // (Both in one request to a host, since most rasters have neither.)
    let [mask, sidecar] = [mask_file::mask_of(path), sibling_path(path, sidecar_of)];
    let found = options.access.stat_companions(&[&mask, &sidecar])?;
    if found[0].is_some() {
        raster = mask_file::masked(raster, options)?;
    }
    sidecar::describe(raster, found[1].is_some(), &options.access)
}

/// Opens a file, and reads enough of its start to detect its format.
fn open_input(path: &Path, access: &FileAccess) -> Result<(InputFile, Vec<u8>)> {
    if path.is_dir() {
        // Some formats are directories.
        if OtherFormat::of(path, &[]).is_some() {
            return Err(OtherFormat::refuse_source(path, &[], "a raster"));
        }
        let name = path.display();
        let advice = format!("give its files, as in {name}/*.tif, or --pages z for sections of a volume");
        return Err(Error::unsupported(path, "a directory", advice));
    }
    let mut file = access.input(path)?;
    let mut magic = Vec::new();
    file.by_ref().take(FIRST_BYTES as u64).read_to_end(&mut magic).map_err(Error::io(path, "read"))?;
    if magic.is_empty() {
        return Err(Error::corrupt(path, "the whole file", "no bytes", "a raster"));
    }
    Ok((file, magic))
}
