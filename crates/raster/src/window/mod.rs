//! Export of a window of a tree as an image, at any level or size, streamed in bands of rows.

mod grid;
mod layers;
mod means;
mod painted;
mod sampler;
mod span;
mod void;

pub(super) use self::grid::OutputGrid;
use self::grid::row_bytes;
pub use self::layers::export_layers;
use self::painted::PaintedWindow;
use self::sampler::Sampler;
pub use self::void::void_number;
pub(super) use self::void::{VoidCells, decide};
use super::image::{Format, ImageSpec, create, write_sidecar};
use spinney_base::io::Output;
use spinney_base::space::Bounds;
use spinney_base::value::{Number, SampleType};
use spinney_base::{Error, Progress, Result};
use spinney_container::Metadata;
use spinney_crs::Frame;
use spinney_engine::dataset::Dataset;
use spinney_style::{Style, StylePainter};

/// A window of a tree and its level of detail.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct WindowRequest {
    /// Window in cells of the deepest level; cells outside of the extent are VOID. Along `across`
    /// only the first cell is used.
    pub bounds: Bounds,
    /// The axis that the image lacks: 2 for quadtrees and horizontal slices of octrees, 0 or 1 for
    /// upright slices. In upright slices columns are y or x, and rows are z. Images have the
    /// highest row at the top, arrays have the lowest row first.
    pub across: usize,
    /// Level or size of the output.
    pub detail: Detail,
    /// The number for VOID cells, where the format needs one; an error if it lies within the range
    /// of the layer's values. [`void_number`] chooses the default.
    pub nodata: Option<Number>,
    /// Colours of the values. Without a style outputs have the values themselves, with two
    /// exceptions. WebP is always painted. PNG holds only `u8` and `u16` values whose channels are
    /// grey or red, green and blue, each optionally with opacity; any other values are painted in
    /// the tree's default style.
    pub style: Option<Style>,
    /// Memory budget in bytes; one row of the output must fit.
    pub memory: u64,
}

/// Default memory budget of exports, in bytes.
pub(super) const DEFAULT_MEMORY: u64 = 64 << 20;

impl WindowRequest {
    /// A window seen from above, with a memory budget of 64 MiB.
    pub fn new(bounds: Bounds, detail: Detail) -> WindowRequest {
        WindowRequest { bounds, across: 2, detail, nodata: None, style: None, memory: DEFAULT_MEMORY }
    }

    /// Returns the level of the tree that the output is made of.
    ///
    /// # Errors
    /// If the window is empty or outside of the tree, or there is no such level or size.
    pub fn level(&self, tree: &Dataset) -> Result<u8> {
        OutputGrid::of(tree, self).map(|grid| grid.level)
    }

    /// Returns the style that an output of this format is painted in, or `None` if the output has
    /// the values themselves.
    pub fn painted_style(&self, tree: &Dataset, format: Format) -> Option<Style> {
        let sample = tree.header().form.value.sample;
        let fits = matches!(sample, SampleType::U8 | SampleType::U16) && has_png_channels(tree);
        match &self.style {
            Some(style) => Some(style.clone()),
            None if format == Format::Webp || format == Format::Png && !fits => {
                Some(Style::default_for(tree))
            }
            None => None,
        }
    }
}

/// Resolution of the output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Detail {
    /// One pixel per cell of this level.
    Level(u8),
    /// Columns and rows of the output. Averaged pixels are made of the coarsest level that has at
    /// least two cells along each side of a pixel; a level of similar resolution is used if each
    /// pixel covers an integer number of its cells. Other pixels are made of the coarsest level
    /// with at least one cell per pixel.
    ///
    /// A cell at a pixel's edge is weighted by the share of its area inside the pixel, as if its
    /// value were uniform. An average is off by at most half the range of values within such a
    /// cell, usually by far less. It is exact where pixel edges coincide with cell edges.
    Size(u64, u64),
    /// Columns and rows of the output, averaged exactly: down to the deepest cells wherever a
    /// pixel's edge cuts a node.
    Exact(u64, u64),
}

/// Writes a window of a tree to an image or array file. Of an octree it writes the slice at
/// `bounds.min[across]`.
///
/// With [`Detail::Size`] and [`Detail::Exact`], trees of means and of occupancy are averaged over
/// the area of each pixel; other trees yield the value at its centre. In trees of occupancy, VOID
/// cells are 0.
///
/// ```
/// # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
/// use spinney::raw::export::image::Format;
/// use spinney::export::{Detail, WindowRequest, export_window};
/// use spinney::{Bounds, Output};
///
/// # let directory = tempfile::tempdir().unwrap();
/// # let path = directory.path().join("part.png");
/// let map = spinney::open("fixtures/v1/classes.goblin")?;
/// let bounds = Bounds { min: [8, 8, 0], max: [40, 40, 1] };
/// let request = WindowRequest::new(bounds, Detail::Size(16, 16));
/// export_window(&map, &request, Output::create(&path)?, Format::Png, &())?;
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// If the window is empty or outside of the tree, one row exceeds the memory budget, the format
/// cannot hold the values, the format cannot hold VOID cells and every number is a value, the tree
/// is corrupt or has changed meanwhile, or on cancellation.
pub fn export_window(
    tree: &Dataset,
    request: &WindowRequest,
    output: Output,
    format: Format,
    progress: &dyn Progress,
) -> Result<()> {
    if let Some(style) = request.painted_style(tree, format) {
        let painter = StylePainter::new(&style, tree, progress)?;
        return export_painted_window(tree, request, &painter, output, format, progress);
    }
    let grid = OutputGrid::of(tree, request)?;
    let mut void = VoidCells::of(std::slice::from_ref(tree), request.bounds, request.nodata)?;
    if format == Format::Exr && request.nodata.is_none() {
        void.without_tag(tree);
    }
    let spec = image_spec(tree, &grid, &void);
    let (path, access) = (output.path().to_path_buf(), output.access().clone());
    void.check((&path, spec.value.sample), format, progress)?;
    let rows = rows_at_a_time(tree, request, &grid)?;
    let mut writer = create(output, format, &spec)?;
    // Images of upright slices begin with the highest row, which is the last along the axis.
    let is_upright = grid.across != 2 && !matches!(format, Format::Npy | Format::Raw);
    let (width, height) = (grid.width, grid.height);
    let sampler = Sampler { tree, grid, fill: void.fill.unwrap_or_default() };
    sampler.bands(rows, is_upright, progress, &mut |bytes, valid| {
        writer.write_rows(bytes, void.may_be.then_some(valid))?;
        progress.advance(valid.len() as u64, height.saturating_mul(width));
        Ok(())
    })?;
    tree.check_unchanged()?;
    writer.finish()?;
    write_sidecar((&path, &access), format, &spec.metadata, progress)
}

/// Writes a window as [`export_window`] does, in a style that was prepared for the tree.
/// [`WindowRequest::style`] is ignored.
///
/// # Errors
/// Those of [`export_window`].
pub fn export_painted_window(
    tree: &Dataset,
    request: &WindowRequest,
    painter: &StylePainter,
    output: Output,
    format: Format,
    progress: &dyn Progress,
) -> Result<()> {
    let grid = OutputGrid::of(tree, request)?;
    let spec = image_spec(tree, &grid, &VoidCells::painted(tree, request.bounds)?);
    let (path, access) = (output.path().to_path_buf(), output.access().clone());
    let painted = PaintedWindow::new(tree, &grid, painter, spec, format);
    painted.export(request, output, format, progress)?;
    tree.check_unchanged()?;
    write_sidecar((&path, &access), format, painted.metadata(), progress)
}

/// Whether a tree's channels match PNG: grey, or red, green and blue, each optionally with opacity.
fn has_png_channels(tree: &Dataset) -> bool {
    let in_order = tree.metadata().rgb_channels() == [0, 1, 2];
    match tree.header().form.value.channels {
        1 => true,
        2 => has_opacity(tree),
        3 => in_order,
        _ => in_order && has_opacity(tree),
    }
}

/// A function that receives pixels and their validity flags.
pub type RowSink<'a> = dyn FnMut(&[u8], &[bool]) -> Result<()> + 'a;

/// Yields a window's pixels as [`export_window`] writes them to arrays, in bands of whole rows from
/// the first row on. Each pixel has a flag that is `false` if the pixel is VOID. VOID pixels have
/// the number [`WindowRequest::nodata`], which here may also be a value; the default is
/// [`void_number`], or 0 where no number is free. [`WindowRequest::style`] is ignored.
///
/// # Errors
/// If [`export_window`] could not read the window either, or `each` fails.
pub fn window_rows(
    tree: &Dataset,
    request: &WindowRequest,
    progress: &dyn Progress,
    each: &mut RowSink<'_>,
) -> Result<()> {
    let grid = OutputGrid::of(tree, request)?;
    let rows = rows_at_a_time(tree, request, &grid)?;
    let fill = match request.nodata {
        Some(number) => number,
        None => void_number(tree)?.unwrap_or_default(),
    };
    Sampler { tree, grid, fill }.bands(rows, false, progress, each)?;
    tree.check_unchanged()
}

/// Returns the number of output rows that fit the memory budget.
fn rows_at_a_time(tree: &Dataset, request: &WindowRequest, grid: &OutputGrid) -> Result<u64> {
    let row_bytes = row_bytes(tree.header().form.value, grid);
    if row_bytes > request.memory {
        return Err(Error::TooLarge {
            path: tree.name().to_path_buf(),
            what: format!("a row of {} pixels of the output", grid.width),
            needed: row_bytes,
            limit: request.memory,
            advice: "request fewer columns or a coarser level".into(),
        });
    }
    Ok((request.memory / row_bytes / 2).clamp(1, 256).min(grid.height))
}

/// Whether the last channel is opacity.
fn has_opacity(tree: &Dataset) -> bool {
    let channels = tree.header().form.value.channels;
    tree.metadata().alpha.is_some_and(|alpha| alpha.checked_add(1) == Some(channels))
}

/// The specification of a grid's image.
pub(super) fn image_spec(tree: &Dataset, grid: &OutputGrid, void: &VoidCells) -> ImageSpec {
    let (value, metadata) = (tree.header().form.value, tree.metadata());
    let first = [grid.origin[0], grid.origin[1], grid.source.min[2] as f64];
    // The frame of the pixels, given the frame of the deepest level's cells.
    let pixels_in = |cells: &Frame| {
        let mut frame = cells.coarser(tree.depth() - grid.level).shifted(first);
        for row in &mut frame.matrix {
            row[0] *= grid.step[0];
            row[1] *= grid.step[1];
        }
        frame
    };
    // Upright slices have no frame: frames of images map x and y.
    let is_flat = grid.across == 2;
    let has_frame = is_flat && metadata.frame != Frame::identity();
    let points = metadata.control_points.as_ref().filter(|_| is_flat);
    let nodata = void.fill.filter(|_| !has_opacity(tree) && (void.may_be || metadata.nodata.is_some()));
    ImageSpec {
        width: grid.width,
        height: grid.height,
        value,
        alpha: has_opacity(tree),
        void: void.may_be,
        metadata: Metadata {
            frame: if has_frame { pixels_in(&metadata.frame) } else { Frame::identity() },
            control_points: points.and_then(|points| points.seen_through(&pixels_in(&Frame::identity()))),
            nodata,
            ..metadata.clone()
        },
    }
}
