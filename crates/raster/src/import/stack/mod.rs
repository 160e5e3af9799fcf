//! Stacks: bands, files and pages as the layers of one file, which share a place in the world and not much else.

mod grid;
mod layer;
mod name;
mod raster;
mod shared;
mod time;
mod write;

use std::path::{Path, PathBuf};

use self::grid::Grid;
pub use self::layer::StackLayer;
use self::layer::divide;
pub use self::write::{write_layers, write_stack};
use super::plan::{DEFAULT_MEMORY, ImportOptions, depth_of, listed, tell};
use super::{RasterInfo, RasterOptions, open, tiff};
use serde::{Deserialize, Serialize};
use spinney_base::space::Dimension;
use spinney_base::{Error, Result};
use spinney_crs::{Crs, Frame};
use spinney_engine::ops::Resampling;
use spinney_engine::store::Packing;

/// Options for a stack.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct StackOptions {
    /// Options that are those of an import; the bands are those of each file.
    pub import: ImportOptions,
    /// Names of the layers; the files decide if there are none.
    pub names: Option<Vec<String>>,
    /// Times of what the layers show, as ISO 8601 writes them: of each layer, or of each file.
    pub times: Option<Vec<String>>,
    /// Whether each page of a TIFF file makes layers.
    pub every_page: bool,
    /// The way to the grid for files that lie on another one, which are refused otherwise.
    pub resampling: Option<Resampling>,
    /// Takes datums for WGS 84 whose shift to it is unknown or needs a grid: may be off by some hundred metres.
    pub allow_ballpark: bool,
}

impl StackOptions {
    /// All that the files say.
    pub fn new() -> StackOptions {
        StackOptions::default()
    }
}

/// A stack that is planned: layers whose files were looked at, and are opened again when their turn comes.
#[derive(Debug)]
#[non_exhaustive]
pub struct Stack {
    /// Place of the finest cells.
    pub frame: Frame,
    /// Finest cells along each axis, of all layers together.
    pub extent: [u64; 3],
    /// Levels of the tree of a layer that has the finest cells.
    pub depth: u8,
    /// The layers, in order.
    pub layers: Vec<StackLayer>,
    /// Whether equal subtrees are stored once, in Autumnal files.
    pub share: bool,
    /// Time of the commit that an Autumnal file begins with.
    pub time: Option<i64>,
    /// How few bytes the file is to take, and what it may lose for that.
    pub packing: Packing,
    /// Bytes of memory for everything.
    pub memory: u64,
    /// Files of which something is not read, and what that is.
    pub remarks: Vec<(PathBuf, String)>,
    description: Vec<(&'static str, String)>,
}

impl Stack {
    /// Description of the plan: pairs of a heading and its text.
    pub fn description(&self) -> &[(&'static str, String)] {
        &self.description
    }
}

/// A picture among the inputs: a file, or a page of one.
struct Picture {
    path: PathBuf,
    options: RasterOptions,
    /// Number of the page, if each makes layers.
    page: Option<usize>,
    info: RasterInfo,
}

/// Plans a stack of files: a layer of each band, of pictures in colour one of all bands. Headers are read, and no file stays open.
///
/// The stack has the union of their boxes; what a file does not have of it is VOID. All begin at corners of the finest cells, with pixels that are as large
/// as these, or an integer number of times. Layers whose pixels, and what is before them, are made of cells 2^k times as
/// large as the finest have trees of k levels fewer; of others each pixel becomes several cells, of the largest such size that is a whole
/// part of it. Those on other grids are warped to cells about as large as their pixels, if a way of resampling is said.
///
/// # Errors
/// If a file cannot be read, the files do not lie on such grids, or the options do not fit them; if two layers have one name.
pub fn plan_stack(inputs: &[PathBuf], options: &StackOptions) -> Result<Stack> {
    let import = &options.import;
    let memory = import.memory.unwrap_or(DEFAULT_MEMORY);
    let mut overruled = None;
    let (mut pictures, mut remarks) = (Vec::new(), Vec::new());
    for input in inputs {
        look_at(input, options, memory / 2, &mut pictures)?;
    }
    for picture in &mut pictures {
        tell(&mut picture.info, import, &mut overruled);
        remarks.extend(picture.info.remark.take().map(|remark| (picture.path.clone(), remark)));
    }
    let Some(grid) = Grid::of(&pictures, options.resampling.is_some())? else {
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
    let depth = depth_of(Dimension::Quad, extent, &size, import.depth)?;
    let mut layers = Vec::new();
    // (Bands may be many: each layer gets its own.)
    let of_layers = ImportOptions { bands: None, ..import.clone() };
    for (picture, place) in pictures.iter().zip(&grid.places) {
        let divided = divide(&picture.path, &picture.info, import.bands.as_deref())?;
        let several = picture.info.channels > divided.first().map_or(1, |parts| parts.channels.len());
        for parts in &divided {
            let mut layer = StackLayer::plan(picture, parts, several, *place, &frame, &of_layers)?;
            if place.repeat == 0 {
                // (In cells of the files' own map, whatever is said of it.)
                layer.warp_to(&grid.frame, extent, options)?;
            }
            layers.push(layer);
        }
    }
    name::give(&mut layers, options.names.as_deref())?;
    if let Some(times) = &options.times {
        time::give(&mut layers, inputs, times)?;
    }
    let description = describe(inputs, &pictures, &layers, &size, depth, &frame, overruled);
    let ImportOptions { share, time, packing, .. } = *import;
    Ok(Stack { frame, extent, depth, layers, share, time, packing, memory, remarks, description })
}

/// Whether the bands of a single file become layers without the option: trees have no value of so many such samples, such as 13 of `u16`,
/// and no band is chosen.
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
fn look_at(path: &Path, options: &StackOptions, memory: u64, pictures: &mut Vec<Picture>) -> Result<()> {
    let ImportOptions { layer, page, access, .. } = &options.import;
    let (layer, access) = (layer.clone(), access.clone());
    let how = RasterOptions { memory, layer, page: *page, access, ..RasterOptions::default() };
    let raster = open(path, &how)?;
    let pages = raster.info().pages;
    if pages < 2 || !options.every_page {
        super::plan::check_pages(&*raster)?;
        pictures.push(Picture { path: path.into(), options: how, page: None, info: raster.info().clone() });
        return Ok(());
    }
    for (number, directory) in tiff::page_directories(path, &how)?.into_iter().enumerate() {
        let how = RasterOptions { page: Some(number), directory: Some(directory), ..how.clone() };
        let info = open(path, &how)?.info().clone();
        pictures.push(Picture { path: path.into(), options: how, page: Some(number), info });
    }
    Ok(())
}

/// Lines of [`Stack::description`].
fn describe(
    inputs: &[PathBuf],
    pictures: &[Picture],
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
        (Some(crs), Some(told)) => format!("{crs}, as you said; the input says {told}"),
    };
    let affine = frame.affine().map(|number| number.to_string()).join(", ");
    let mut lines = vec![
        ("input", listed(inputs)),
        ("layout", pictures.first().map_or(String::new(), |picture| picture.info.layout.clone())),
        ("size", size.to_string()),
        ("CRS", crs),
        ("transform", if frame.is_identity() { "none".into() } else { affine }),
        ("depth", format!("{depth} levels, {0} x {0} cells", 1u64 << depth)),
    ];
    lines.extend(layers.iter().take(LISTED).map(|layer| ("layer", layer.to_string())));
    if layers.len() > LISTED {
        lines.push(("layers", format!("{} in all", layers.len())));
    }
    if let ([picture], true) = (pictures, layers.len() > 1) {
        let text = format!("a layer of each, as {} bands are no one value", picture.info.channels);
        if super::bands::value_type(&picture.path, &picture.info).is_err() {
            lines.push(("bands", text));
        }
    }
    lines
}
