//! Stacks: bands, files and pages as the layers of one file. They share a frame, but may differ in
//! type and metadata.

mod grid;
mod layer;
mod name;
mod raster;
mod shared;
pub(crate) mod time;
mod write;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use self::grid::Grid;
pub use self::layer::StackLayer;
use self::layer::divide;
pub use self::write::{write_layers, write_stack};
use super::ahead::open_each;
use super::plan::{DEFAULT_MEMORY, ImportOptions, apply_options, depth_of, listed};
use super::{RasterInfo, RasterOptions, open, tiff};
use crate::index::SourceRecorder;
use serde::{Deserialize, Serialize};
use spinney_base::space::Dimension;
use spinney_base::{Error, Result};
use spinney_crs::{Crs, Frame};
use spinney_engine::ops::Resampling;
use spinney_engine::store::Packing;

/// Options of a stack.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct StackOptions {
    /// Import options; bands are those of each file.
    pub import: ImportOptions,
    /// Names of the layers; by default they are derived from the files.
    pub names: Option<Vec<String>>,
    /// Acquisition times in ISO 8601, one per layer or one per file.
    pub times: Option<Vec<String>>,
    /// Whether each page of a TIFF file makes layers.
    pub every_page: bool,
    /// Resampling of files on other grids, which are rejected by default.
    pub resampling: Option<Resampling>,
    /// Whether datums with an unknown shift, or one that needs a grid, are treated as WGS 84:
    /// positions may be off by some hundred metres.
    pub allow_ballpark: bool,
}

impl StackOptions {
    /// Options with everything taken from the files.
    pub fn new() -> StackOptions {
        StackOptions::default()
    }
}

/// A planned stack: layers whose files were inspected, and are opened again when the layer is
/// written.
#[derive(Debug)]
#[non_exhaustive]
pub struct Stack {
    /// Frame of the finest cells.
    pub frame: Frame,
    /// Finest cells along each axis: the union of all layers.
    pub extent: [u64; 3],
    /// Depth of the tree of a layer with the finest cells.
    pub depth: u8,
    /// The layers, in order.
    pub layers: Vec<StackLayer>,
    /// Whether Autumnal files store equal subtrees once.
    pub share: bool,
    /// Time of the first commit of an Autumnal file.
    pub time: Option<i64>,
    /// Compression of the file, and the loss that it may cause.
    pub packing: Packing,
    /// Levels between the cells and the finest stored level, if the cells stay in the files.
    pub(super) referenced: Option<u8>,
    /// Records of the files, if the cells stay in these.
    pub(super) recorder: Option<Arc<SourceRecorder>>,
    /// Memory budget in bytes.
    pub memory: u64,
    /// Files with content that is not read, and a description of that.
    pub remarks: Vec<(PathBuf, String)>,
    description: Vec<(&'static str, String)>,
}

impl Stack {
    /// Description of the plan: pairs of heading and text.
    pub fn description(&self) -> &[(&'static str, String)] {
        &self.description
    }
}

/// An input image: a file, or a page of one.
struct InputImage {
    path: PathBuf,
    options: RasterOptions,
    /// Number of the page, if each page makes layers.
    page: Option<usize>,
    info: RasterInfo,
}

/// Plans a stack of files: one layer per band, or a single layer for a colour image. Only headers
/// are read, and no file stays open.
///
/// The stack covers the union of the files' boxes; cells outside of a file's box are VOID. All
/// files must begin at corners of the finest cells. Their pixel width must be an integer number of
/// finest cells. If pixels and offset of a layer consist of cells 2^k times as large as the finest,
/// its tree has k levels fewer. Otherwise each pixel becomes several cells, of the largest such
/// size that divides it. Files on other grids are warped to cells about as large as their pixels,
/// if a resampling method is given.
///
/// # Errors
/// If a file cannot be read, the files are not on such grids, or the options do not fit them; if
/// two layers have the same name.
pub fn plan_stack(inputs: &[PathBuf], options: &StackOptions) -> Result<Stack> {
    let import = &options.import;
    let memory = import.memory.unwrap_or(DEFAULT_MEMORY);
    let mut overruled = None;
    let recorder = import.referenced.map(|_| Arc::new(SourceRecorder::default()));
    let read = |input: &PathBuf| read_headers(input, options, (memory / 2, &recorder));
    let mut images: Vec<InputImage> = open_each(inputs, &read)?.into_iter().flatten().collect();
    let mut remarks = Vec::new();
    for image in &mut images {
        apply_options(&mut image.info, import, &mut overruled);
        remarks.extend(image.info.remark.take().map(|remark| (image.path.clone(), remark)));
    }
    let Some(grid) = Grid::of(&images, options.resampling.is_some())? else {
        return Err(Error::invalid("inputs", "none", "at least one raster"));
    };
    let mut frame = grid.frame.clone();
    if let Some(transform) = import.transform {
        frame.matrix = Frame::planar(transform).matrix;
        if transform.iter().any(|number| !number.is_finite()) || frame.to_cells([0.0; 3]).is_none() {
            let expected = "six numbers that map columns and rows to a plane: a,b,c,d,e,f";
            return Err(Error::invalid("transform", format!("{transform:?}"), expected));
        }
    }
    let [width, height] = grid.extent;
    let extent = [width, height, 1];
    let size = format!("{width} x {height} of the finest cells");
    let depth = depth_of(Dimension::Quad, extent, (&images[0].path, &size), import.depth)?;
    let mut layers = Vec::new();
    // There may be many bands: each layer gets its own.
    let of_layers = ImportOptions { bands: None, ..import.clone() };
    for (image, alignment) in images.iter().zip(&grid.alignments) {
        let divided = divide(&image.path, &image.info, import.bands.as_deref())?;
        let several = image.info.channels > divided.first().map_or(1, |parts| parts.channels.len());
        for parts in &divided {
            let mut layer = StackLayer::plan(image, parts, several, *alignment, &frame, &of_layers)?;
            if alignment.repeat == 0 {
                // In the file's own cells, whatever coordinate system the options declare.
                layer.warp_to(&grid.frame, extent, options)?;
            }
            layers.push(layer);
        }
    }
    name::give(&mut layers, options.names.as_deref())?;
    if let Some(times) = &options.times {
        time::give(&mut layers, inputs, times)?;
    }
    let description = describe(inputs, &images, &layers, &size, depth, &frame, overruled);
    let ImportOptions { share, time, packing, referenced, .. } = *import;
    Ok(Stack {
        frame,
        extent,
        depth,
        layers,
        share,
        time,
        packing,
        referenced,
        recorder,
        memory,
        remarks,
        description,
    })
}

/// Whether the bands of a single file become layers without the option. That is the case if trees
/// have no value type of so many such samples, such as 13 of `u16`, and no band is selected.
///
/// # Errors
/// If the file cannot be read.
pub fn needs_layers(inputs: &[PathBuf], options: &ImportOptions) -> Result<bool> {
    let ([input], None) = (inputs, &options.bands) else { return Ok(false) };
    let ImportOptions { layer, page, access, memory, .. } = options;
    let memory = memory.unwrap_or(DEFAULT_MEMORY) / 2;
    let (layer, access) = (layer.clone(), access.clone());
    let raster =
        open(input, &RasterOptions { memory, layer, page: *page, access, ..RasterOptions::default() })?;
    let info = raster.info();
    Ok(info.channels > 1 && super::bands::value_type(input, info).is_err())
}

/// Reads the headers of a file's pages.
fn read_headers(
    path: &Path,
    options: &StackOptions,
    (memory, recorder): (u64, &Option<Arc<SourceRecorder>>),
) -> Result<Vec<InputImage>> {
    let ImportOptions { layer, page, access, .. } = &options.import;
    let (layer, access) = (layer.clone(), access.clone());
    let recorder = recorder.clone();
    let how = RasterOptions { memory, layer, page: *page, access, recorder, ..RasterOptions::default() };
    let raster = open(path, &how)?;
    let pages = raster.info().pages;
    if pages < 2 || !options.every_page {
        super::plan::check_pages(&*raster)?;
        return Ok(vec![InputImage {
            path: path.into(),
            options: how,
            page: None,
            info: raster.info().clone(),
        }]);
    }
    let mut images = Vec::new();
    for (number, directory) in tiff::page_directories(path, &how)?.into_iter().enumerate() {
        let how = RasterOptions { page: Some(number), directory: Some(directory), ..how.clone() };
        let info = open(path, &how)?.info().clone();
        images.push(InputImage { path: path.into(), options: how, page: Some(number), info });
    }
    Ok(images)
}

/// Lines of [`Stack::description`].
fn describe(
    inputs: &[PathBuf],
    images: &[InputImage],
    layers: &[StackLayer],
    size: &str,
    depth: u8,
    frame: &Frame,
    overruled: Option<Crs>,
) -> Vec<(&'static str, String)> {
    const LISTED: usize = 40;
    let crs = match (&frame.crs, overruled) {
        (None, _) => "none".into(),
        (Some(crs), None) => crs.to_string(),
        (Some(crs), Some(input)) => format!("{crs}, as requested; the input has {input}"),
    };
    let affine = frame.affine().map(|number| number.to_string()).join(", ");
    let mut lines = vec![
        ("input", listed(inputs)),
        ("layout", images.first().map_or(String::new(), |image| image.info.layout.clone())),
        ("size", size.to_string()),
        ("CRS", crs),
        ("transform", if frame.is_identity() { "none".into() } else { affine }),
        ("depth", format!("{depth} levels, {0} x {0} cells", 1u64 << depth)),
    ];
    lines.extend(layers.iter().take(LISTED).map(|layer| ("layer", layer.to_string())));
    if layers.len() > LISTED {
        lines.push(("layers", format!("{} in all", layers.len())));
    }
    if let ([image], true) = (images, layers.len() > 1) {
        let text = format!(
            "a layer of each, since one value cannot have {} bands of this type",
            image.info.channels
        );
        if super::bands::value_type(&image.path, &image.info).is_err() {
            lines.push(("bands", text));
        }
    }
    lines
}
