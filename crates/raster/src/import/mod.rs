//! Raster files as input: one trait, one reader per format, mosaics of several.

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
mod sidecar;
mod slabs;
mod spill;
mod stack;
mod tiff;
mod validity;
mod vrt;
mod whole_image;
mod worldfile;
mod xml;

use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;

pub use self::bands::{Band, BandInfo, select, value_type};
pub use self::build::{TargetGrid, WarpedBuilt};
pub use self::files::files_of;
pub use self::mosaic::{MosaicPlan, mosaic};
pub use self::plan::{DEFAULT_MEMORY, ImportOptions, RasterImport, plan, plan_part};
pub(super) use self::plan::{depth_of, listed, nodata_text};
pub use self::slabs::RasterSlabs;
pub use self::spill::spill;
pub use self::stack::{Stack, StackLayer, StackOptions, needs_layers, plan_stack, write_layers, write_stack};
pub(super) use self::tiff::{SampleFormat, page_directories};
pub(super) use self::validity::as_stored;
use crate::chain_code;
use spinney_base::io::{FileAccess, without_query};
use spinney_base::space::Region;
use spinney_base::value::{DataKind, Number, Palette, SampleType};
use spinney_base::{Error, Result};
use spinney_container::{FIRST_BYTES, OtherFormat, ScopedTags};
use spinney_crs::{ControlPoints, Frame};

/// What pixels become whose opacity is 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Transparent {
    /// VOID.
    #[default]
    Void,
    /// Cells with their colours, which count for nothing: see `Mask::Alpha`. Those of zeros alone are VOID.
    Masked,
    /// Cells like all others.
    Plain,
}

/// Properties of a raster, from the header of its file.
#[derive(Clone, Debug, PartialEq)]
pub struct RasterInfo {
    /// Columns.
    pub width: u64,
    /// Rows.
    pub height: u64,
    /// Type of the samples that [`Raster::read`] gives: the file's own, or the next wider one that Spinney
    /// has (1 to 7 bits become u8, half becomes f32).
    pub sample: SampleType,
    /// Type of the samples as the file has them, in words: "uint12", "int8", "half".
    pub stored_sample: String,
    /// Samples per pixel, any number.
    pub channels: usize,
    /// Index of the opacity channel (0 is transparent), if there is one.
    pub alpha: Option<usize>,
    /// What transparent pixels become.
    pub transparent: Transparent,
    /// What each channel has of its own; nothing where they differ in nothing of it.
    pub bands: Vec<BandInfo>,
    /// Map from pixels to the world.
    pub frame: Frame,
    /// The number that marks missing samples.
    pub nodata: Option<Number>,
    /// Colours of the values of a one-channel picture.
    pub palette: Option<Palette>,
    /// A role per channel by GDAL's names ("Red", "NIR") where the file tells it, else empty strings.
    pub colour_roles: Vec<String>,
    /// Names of values, by value.
    pub class_names: Vec<(Number, String)>,
    /// Index of the channel whose values these are.
    pub class_channel: usize,
    /// A name per channel where the file has them, else empty strings.
    pub band_names: Vec<String>,
    /// Scale and offset per channel: factor and summand from samples to physical units.
    pub scale_offset: Vec<(f64, f64)>,
    /// Unit per channel of what scale and offset make; empty where the file does not tell.
    pub units: Vec<String>,
    /// Kind of the samples, continuous or categorical, where the file tells.
    pub kind: Option<DataKind>,
    /// The format and how the pixels lie in the file, in words: "GeoTIFF, 512x512 tiles, zstd".
    pub layout: String,
    /// Other things worth keeping, by name.
    pub tags: BTreeMap<String, String>,
    /// Texts about single channels, and in domains.
    pub scoped_tags: ScopedTags,
    /// Ground control points.
    pub control_points: Option<ControlPoints>,
    /// A remark on contents of the file that are not read, and on sidecars that contradict it.
    pub remark: Option<String>,
    /// Pictures of their own in the file, besides overviews and masks, of which this is one.
    pub pages: usize,
    /// Order in which regions are cheap to read.
    pub order: Order,
}

/// Order in which regions of a raster are cheap to read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// Full-width bands from the top down, each row asked for once; for some formats nothing else is
    /// possible.
    Bands,
    /// Any region at any time.
    Anywhere,
}

/// Samples of a region: rows from the top, pixels from the left, a pixel's channels together, little-endian.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Pixels {
    /// `height * width * channels` samples.
    pub bytes: Vec<u8>,
    /// One flag per pixel where the file has a mask of its own: `false` is VOID. (Opacity and nodata are not
    /// in it: the samples themselves have them.)
    pub valid: Option<Vec<bool>>,
}

/// A raster file that is open for reading, whatever its format.
pub trait Raster: Send {
    /// Properties of the raster.
    fn info(&self) -> &RasterInfo;

    /// The file, for messages.
    fn path(&self) -> &Path;

    /// Reads a region that lies within the raster into `pixels`, replacing what was there.
    ///
    /// With [`Order::Bands`], regions must be full-width and follow each other from the top without a gap.
    ///
    /// # Errors
    /// If the file is damaged there, cannot be read, or decoding would need more memory than `open` allowed.
    fn read(&mut self, region: Region, pixels: &mut Pixels) -> Result<()>;

    /// Leaves only these channels, which count from 0, in this order; `false`, and nothing is done, if all are read anyway.
    fn choose(&mut self, channels: &[usize]) -> bool {
        let _ = channels;
        false
    }

    /// The raster of these channels, which reads from the same open file; nothing if that takes as long as to read all channels, or the
    /// format has no way to do so.
    fn separate_channels(&self, channels: &[usize]) -> Option<Box<dyn Raster>> {
        let _ = channels;
        None
    }

    /// Whether any region can be read at any time, though another order may be cheaper.
    fn reads_anywhere(&self) -> bool {
        self.info().order == Order::Anywhere
    }
}

/// Options for opening a raster.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct RasterOptions {
    /// Bytes that a reader may hold at once, such as decoded strips or a whole picture of a format that has
    /// no other way.
    pub memory: u64,
    /// The layer of an EXR file to read, by name; the first one if not given.
    pub layer: Option<String>,
    /// The page of a TIFF file to read, by its number from 0; the first one if not given.
    pub page: Option<usize>,
    /// How the file, and those that it names or that accompany it, are opened.
    pub access: FileAccess,
    pub(crate) nesting: vrt::Nesting,
    /// The directory of the page in a TIFF file, if that is known.
    pub(crate) directory: Option<u64>,
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
        }
    }
}

impl RasterOptions {
    /// The first layer, read with 192 MiB of memory.
    pub fn new() -> RasterOptions {
        RasterOptions::default()
    }
}

/// Opens a raster file with the metadata of its sidecar (`.aux.xml`) and its mask file (`.msk`). The format is recognized by the first bytes,
/// that of `.hgt` and `.tga` files, which have no signature, by the name.
///
/// # Errors
/// If the file cannot be read, is of no format we know, is damaged, or uses something unsupported.
pub fn open(path: &Path, options: &RasterOptions) -> Result<Box<dyn Raster>> {
    let magic = first_bytes(path, &options.access)?;
    let raster = match magic.as_slice() {
        [b'I', b'I', b'*' | b'+', 0, ..] | [b'M', b'M', 0, b'*' | b'+', ..] => tiff::open(path, options),
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
            None => Err(OtherFormat::refuse_source(path, start)),
        },
    };
    let raster = mask_file::masked(raster?, options)?;
    sidecar::describe(raster, &options.access)
}

/// Enough of a file's start to tell its format.
fn first_bytes(path: &Path, access: &FileAccess) -> Result<Vec<u8>> {
    if path.is_dir() {
        // (Some formats are folders.)
        if OtherFormat::of(path, &[]).is_some() {
            return Err(OtherFormat::refuse_source(path, &[]));
        }
        let name = path.display();
        let advice =
            format!("name its files, as in {name}/*.tif; or, if they are sections of a volume: --pages z");
        return Err(Error::unsupported(path, "a directory", advice));
    }
    let file = access.input(path)?;
    let mut magic = Vec::new();
    file.take(FIRST_BYTES as u64).read_to_end(&mut magic).map_err(Error::io(path, "read"))?;
    if magic.is_empty() {
        return Err(Error::corrupt(path, "the whole file", "no bytes", "a raster"));
    }
    Ok(magic)
}
