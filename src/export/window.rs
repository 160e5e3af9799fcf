//! A window of a tree as a picture, at any level or size, streamed in bands of rows.

use super::image::{Format, ImageSpec, create, write_beside};
use super::stretch::Stretch;
use crate::dataset::Dataset;
use crate::io::Output;
use crate::query::PixelGrid;
use crate::space::{Bounds, Frame};
use crate::store::Metadata;
use crate::value::{Kind, Rule, SampleType, Value, ValueType};
use crate::{Error, Progress, Result};

/// A window of a tree, and its level of detail.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct WindowRequest {
    /// Cells of the deepest level; those beyond the picture are VOID. Along `across` the first counts.
    pub bounds: Bounds,
    /// The axis that the picture does not have: 2 for quadtrees and level slices of octrees, 0 or 1 for
    /// upright slices. Columns are then y or x, and rows z; pictures have the highest row at the top, arrays
    /// the lowest first.
    pub across: usize,
    /// Level or size of the output.
    pub detail: Detail,
    /// The number for VOID cells where the format needs one; chosen if not given: see [`fill_for`].
    pub nodata: Option<f64>,
    /// The numbers that become black and white in a PNG of 8 bits; without them PNG takes values of u8 and u16
    /// alone, as they are. See [`window_range`].
    pub range: Option<[f64; 2]>,
    /// Bytes to hold at a time; what one row of the output needs must fit.
    pub memory: u64,
}

/// Bytes that exports hold at a time if nothing is said.
pub(super) const DEFAULT_MEMORY: u64 = 64 << 20;

impl WindowRequest {
    /// A window seen from above, written with 64 MiB of memory.
    pub fn new(bounds: Bounds, detail: Detail) -> WindowRequest {
        WindowRequest { bounds, across: 2, detail, nodata: None, range: None, memory: DEFAULT_MEMORY }
    }
}

/// Resolution of the output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Detail {
    /// One pixel per cell of this level.
    Level(u8),
    /// So many columns and rows: from the level whose cells are the pixels, if there is one; else, where pixels are
    /// averaged, from the coarsest level that has at least four cells along each side of a pixel, and where they
    /// are not, from the coarsest that is fine enough.
    ///
    /// Each cell at a pixel's edge counts by the part of it that is in the pixel, as if it were alike all over: an average
    /// is off by at most a quarter of what values differ by within such a cell, mostly by far less.
    Size(u64, u64),
    /// So many columns and rows, averaged exactly: down to the deepest cells wherever a pixel's edge cuts a node.
    Exact(u64, u64),
}

/// Writes a window of a tree to a picture or array file. An octree gives a slice, at `bounds.min[across]`.
///
/// With [`Detail::Size`] and [`Detail::Exact`], trees of means and of occupancy are averaged over the area of each pixel, others
/// give the value at its centre. In trees of occupancy, VOID cells are 0.
///
/// ```
/// use spinney::export::image::Format;
/// use spinney::export::{Detail, WindowRequest, export_window};
/// use spinney::{io::Output, space::Bounds};
///
/// # let folder = tempfile::tempdir().unwrap();
/// # let path = folder.path().join("part.png");
/// let map = spinney::open("fixtures/v1/classes.goblin")?;
/// let bounds = Bounds { min: [8, 8, 0], max: [40, 40, 1] };
/// let request = WindowRequest::new(bounds, Detail::Size(16, 16));
/// export_window(&map, &request, Output::create(&path)?, Format::Png, &())?;
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// If the window is empty or outside of the tree, one row needs more memory than is allowed, the format cannot
/// hold the values, the tree is damaged or was changed meanwhile, or on interruption.
pub fn export_window(
    tree: &Dataset,
    request: &WindowRequest,
    output: Output,
    format: Format,
    progress: &dyn Progress,
) -> Result<()> {
    let grid = Grid::of(tree, request)?;
    let rows = rows_at_a_time(tree, request, &grid)?;
    let void = VoidCells::of(tree, request)?;
    let mut spec = image_spec(tree, &grid, &void);
    let stretch = request.range.map(|ends| Stretch::new(spec.value, spec.alpha, ends));
    if stretch.is_some() {
        if format != Format::Png {
            return Err(Error::invalid("range", "an output other than PNG", "PNG: others hold the values"));
        }
        spec.value.sample = SampleType::U8;
        (spec.metadata.palette, spec.metadata.nodata) = (None, None);
    }
    let path = output.path().to_path_buf();
    let mut writer = create(output, format, &spec)?;
    // Pictures of upright slices begin with the highest row, which is the last along the axis.
    let is_upright = grid.across != 2 && !matches!(format, Format::Npy | Format::Raw);
    let (width, height) = (grid.width, grid.height);
    let sampler = Sampler { tree, grid, fill: void.fill.unwrap_or(0.0) };
    sampler.bands(rows, is_upright, progress, &mut |bytes, valid| {
        let stretched = stretch.as_ref().map(|stretch| stretch.apply(bytes));
        writer.write_rows(stretched.as_deref().unwrap_or(bytes), void.may_be.then_some(valid))?;
        progress.advance(valid.len() as u64, height.saturating_mul(width));
        Ok(())
    })?;
    tree.check_unchanged()?;
    writer.finish()?;
    write_beside(&path, format, &spec.metadata, progress)
}

/// The least and the greatest finite number of a window's pixels, opacity aside, between which a picture may be
/// stretched; `None` if there is none.
///
/// # Errors
/// If [`export_window`] could not read the window either.
pub fn window_range(
    tree: &Dataset,
    request: &WindowRequest,
    progress: &dyn Progress,
) -> Result<Option<[f64; 2]>> {
    let grid = Grid::of(tree, request)?;
    let rows = rows_at_a_time(tree, request, &grid)?;
    let value = tree.header().form.value;
    let stretch = Stretch::new(value, has_opacity(tree), [0.0; 2]);
    let mut range = None;
    Sampler { tree, grid, fill: 0.0 }.bands(rows, false, progress, &mut |bytes, valid| {
        let pixels = bytes.chunks_exact(value.size()).zip(valid).filter(|(_, valid)| **valid);
        pixels.for_each(|(pixel, _)| stretch.extend(&mut range, pixel));
        Ok(())
    })?;
    Ok(range)
}

/// Rows of the output that memory is for.
fn rows_at_a_time(tree: &Dataset, request: &WindowRequest, grid: &Grid) -> Result<u64> {
    let row_bytes = row_bytes(tree.header().form.value, grid);
    if row_bytes > request.memory {
        return Err(Error::TooLarge {
            path: tree.path().to_path_buf(),
            what: format!("a row of {} pixels of the output", grid.width),
            needed: row_bytes,
            limit: request.memory,
            advice: "ask for fewer columns or a coarser level".into(),
        });
    }
    Ok((request.memory / row_bytes / 2).clamp(1, 256).min(grid.height))
}

/// Whether the last channel is opacity.
fn has_opacity(tree: &Dataset) -> bool {
    let channels = tree.header().form.value.channels;
    tree.metadata().alpha.is_some_and(|alpha| alpha.checked_add(1) == Some(channels))
}

/// The output's pixels in cells of the level that they are made of.
struct Grid {
    level: u8,
    /// Cells of the level that the pixels are made of: one layer of them.
    source: Bounds,
    /// The tree's axis that the output does not have, and those of its columns and rows.
    across: usize,
    axes: [usize; 2],
    width: u64,
    height: u64,
    /// First corner of the first pixel, and size of a pixel, along columns and rows.
    origin: [f64; 2],
    step: [f64; 2],
    /// Whether pixels are other than whole cells.
    is_resampled: bool,
    /// Whether pixels are means of the deepest cells.
    is_exact: bool,
}

impl Grid {
    /// The grid that a request asks for.
    ///
    /// # Errors
    /// If the window is empty or outside of the tree, the tree has no such level, or the output would have no pixels.
    fn of(tree: &Dataset, request: &WindowRequest) -> Result<Grid> {
        let depth = tree.depth();
        let across = request.across;
        let axes = match across {
            0 => [1, 2],
            1 => [0, 2],
            _ => [0, 1],
        };
        let size = axes.map(|axis| request.bounds.size()[axis]);
        if request.bounds.is_empty() {
            return Err(Error::invalid(
                "window",
                format!("{} x {} cells", size[0], size[1]),
                "at least one cell",
            ));
        }
        if request.bounds.intersect(&tree.header().picture()).is_empty() {
            let [x, y, z] = request.bounds.min;
            let [width, height, depth] = tree.header().extent;
            let expected = format!("one that is at least partly in its {width} x {height} x {depth} cells");
            return Err(Error::invalid(
                "window",
                format!("one outside of the tree, from {x},{y},{z} on"),
                expected,
            ));
        }
        let level = match request.detail {
            Detail::Level(level) if level <= depth => level,
            Detail::Level(level) => {
                return Err(Error::invalid("level", level.to_string(), format!("0 to {depth}")));
            }
            Detail::Size(width, height) | Detail::Exact(width, height) if width == 0 || height == 0 => {
                return Err(Error::invalid("size", format!("{width}x{height}"), "at least 1x1"));
            }
            Detail::Exact(..) if !is_averaged(tree) => {
                let found = "exact means of values that are not averaged";
                return Err(Error::invalid("detail", found, "a size: pixels are the cells at their centres"));
            }
            Detail::Exact(..) => depth,
            Detail::Size(width, height) => {
                let first = axes.map(|axis| request.bounds.min[axis]);
                level_for(tree, (first, size), (width, height))
            }
        };
        let shift = depth - level;
        let mut source = request.bounds;
        for axis in 0..3 {
            source.min[axis] >>= shift;
            source.max[axis] = source.max[axis].div_ceil(1 << shift);
        }
        source.max[across] = source.min[across] + 1;
        let (width, height, origin, step) = match request.detail {
            Detail::Level(_) => {
                let [width, height] = axes.map(|axis| source.size()[axis]);
                (width, height, axes.map(|axis| source.min[axis] as f64), [1.0, 1.0])
            }
            // The window need not begin or end at cells of the level: its own corners count, divided evenly.
            Detail::Size(width, height) | Detail::Exact(width, height) => {
                let scale = (1u64 << shift) as f64;
                let origin = axes.map(|axis| request.bounds.min[axis] as f64 / scale);
                let step = [size[0] as f64 / scale / width as f64, size[1] as f64 / scale / height as f64];
                (width, height, origin, step)
            }
        };
        let is_exact = matches!(request.detail, Detail::Exact(..));
        let is_resampled = is_exact || matches!(request.detail, Detail::Size(..));
        Ok(Grid { level, source, across, axes, width, height, origin, step, is_resampled, is_exact })
    }
}

/// Whether pixels of any size are means of the cells that they cover; else they are the cells at their centres.
fn is_averaged(tree: &Dataset) -> bool {
    let header = tree.header();
    matches!(header.rule, Rule::Mean | Rule::Occupancy) && header.kind == Kind::Continuous
}

/// Cells of the level that is averaged along each side of a pixel, at least: with so many, what the cells at a
/// pixel's edges are off by matters little.
const CELLS_PER_PIXEL: u64 = 4;

/// The level that pixels of a window are made of, given its first cell and its size along columns and rows: the
/// coarsest whose cells are the pixels, or of which each pixel has enough.
fn level_for(tree: &Dataset, (first, size): ([u64; 2], [u64; 2]), (width, height): (u64, u64)) -> u8 {
    let depth = tree.depth();
    let are_pixels = |shift: u8| {
        let is_whole = |cells: u64| cells & ((1 << shift) - 1) == 0;
        first.into_iter().all(is_whole) && size == [width, height].map(|pixels| pixels << shift)
    };
    let enough = if is_averaged(tree) { CELLS_PER_PIXEL } else { 1 };
    let has_enough = |shift: u8| {
        size.into_iter()
            .zip([width, height])
            .all(|(cells, pixels)| cells >> shift >= pixels.saturating_mul(enough))
    };
    (0..=depth).find(|level| are_pixels(depth - level) || has_enough(depth - level)).unwrap_or(depth)
}

/// VOID cells of a window, and the number that stands for them.
struct VoidCells {
    may_be: bool,
    /// `None` if every number is in use.
    fill: Option<f64>,
}

impl VoidCells {
    fn of(tree: &Dataset, request: &WindowRequest) -> Result<VoidCells> {
        if tree.header().rule == Rule::Occupancy {
            // VOID is a number there: an empty cell.
            return Ok(VoidCells { may_be: false, fill: Some(request.nodata.unwrap_or(0.0)) });
        }
        let may_be = tree.may_have_void(request.bounds)?;
        // Where the last channel is opacity, VOID cells are those without any: any other number would be a colour.
        let fill = if has_opacity(tree) { Some(0.0) } else { fill_for(tree)? };
        Ok(VoidCells { may_be, fill: request.nodata.or(fill) })
    }
}

fn image_spec(tree: &Dataset, grid: &Grid, void: &VoidCells) -> ImageSpec {
    let (value, metadata) = (tree.header().form.value, tree.metadata());
    let first = [grid.origin[0], grid.origin[1], grid.source.min[2] as f64];
    // Pixels in a frame of the deepest level's cells.
    let pixels_in = |cells: &Frame| {
        let mut frame = cells.coarser(tree.depth() - grid.level).shifted(first);
        for row in &mut frame.matrix {
            row[0] *= grid.step[0];
            row[1] *= grid.step[1];
        }
        frame
    };
    // Upright slices have no frame: those of pictures are maps of x and y.
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

/// Reverses the order of rows.
fn flip_rows<T>(cells: &mut [T], width: usize) {
    // Reversing all cells reverses rows, too; reversing each row puts its own cells right again.
    cells.reverse();
    cells.chunks_mut(width).for_each(<[T]>::reverse);
}

/// Bytes of memory for a row of the output: the cells it is made of, `step` rows of them if it is resampled,
/// and its pixels.
fn row_bytes(value: ValueType, grid: &Grid) -> u64 {
    // One byte more than the value: whether the cell has one.
    let pixel = value.size() as u64 + 1;
    let row = grid.source.size()[grid.axes[0]].saturating_mul(pixel);
    if !grid.is_resampled {
        return row;
    }
    if grid.is_exact {
        // Sums of four channels, and an area.
        return grid.width.saturating_mul(pixel + 5 * size_of::<f64>() as u64);
    }
    let lines = grid.step[1].ceil() as u64 + 1;
    row.saturating_mul(lines).saturating_add(grid.width.saturating_mul(pixel + size_of::<Span>() as u64))
}

/// A number for VOID cells: the file's own, NaN for floating samples, or one that no cell has; `None` if
/// every number is in use.
///
/// # Errors
/// If the tree's statistics are damaged.
pub fn fill_for(tree: &Dataset) -> Result<Option<f64>> {
    let sample = tree.header().form.value.sample;
    let (low, high) = match sample {
        SampleType::U8 => (0.0, u8::MAX as f64),
        SampleType::U16 => (0.0, u16::MAX as f64),
        SampleType::I16 => (i16::MIN as f64, i16::MAX as f64),
        SampleType::U32 => (0.0, u32::MAX as f64),
        SampleType::I32 => (i32::MIN as f64, i32::MAX as f64),
        SampleType::F32 | SampleType::F64 => return Ok(Some(tree.metadata().nodata.unwrap_or(f64::NAN))),
    };
    if let Some(nodata) = tree.metadata().nodata.filter(|n| n.fract() == 0.0 && (low..=high).contains(n)) {
        return Ok(Some(nodata));
    }
    let channels = tree.value_bounds()?;
    let free = |number: f64| channels.iter().any(|(min, max)| number < *min || number > *max);
    Ok([low, high].into_iter().find(|number| channels.is_empty() || free(*number)))
}

/// A function that takes pixels, and whether each has a value.
type Take<'a> = dyn FnMut(&[u8], &[bool]) -> Result<()> + 'a;

/// Rows of a window, straight or resampled.
struct Sampler<'a> {
    tree: &'a Dataset,
    grid: Grid,
    /// The number that stands for VOID.
    fill: f64,
}

impl Sampler<'_> {
    /// Hands out all pixels of the output, and whether each has a value, in bands of so many rows; from the last row
    /// on if it is upright.
    fn bands(&self, rows: u64, is_upright: bool, progress: &dyn Progress, each: &mut Take<'_>) -> Result<()> {
        let Grid { width, height, is_resampled, .. } = self.grid;
        let mut row = 0;
        while row < height {
            progress.check()?;
            let count = rows.min(height - row);
            let first = if is_upright { height - row - count } else { row };
            let (mut bytes, mut valid) = match (is_resampled, self.grid.is_exact) {
                (_, true) => self.average(first, count, progress)?,
                (true, _) => self.resample(first, count)?,
                _ => self.copy(first, count)?,
            };
            if is_upright {
                flip_rows(&mut bytes, width as usize * self.tree.header().form.value.size());
                flip_rows(&mut valid, width as usize);
            }
            each(&bytes, &valid)?;
            row += count;
        }
        Ok(())
    }

    /// The cells of some rows of the level, and whether each has a value.
    fn rows(&self, first: u64, end: u64) -> Result<(Vec<u8>, Vec<bool>)> {
        let mut bounds = self.grid.source;
        let rows = self.grid.axes[1];
        (bounds.min[rows], bounds.max[rows]) = (first, end);
        let cells = bounds.volume() as usize;
        let mut bytes = vec![0; cells * self.tree.header().form.value.size()];
        let mut valid = vec![true; cells];
        self.tree.window(self.grid.level, &bounds, self.fill, &mut bytes, Some(&mut valid))?;
        if self.tree.header().rule == Rule::Occupancy {
            // VOID is a number, too: an empty cell.
            valid.fill(true);
        }
        Ok((bytes, valid))
    }

    /// Rows of the output that are rows of cells.
    fn copy(&self, row: u64, count: u64) -> Result<(Vec<u8>, Vec<bool>)> {
        let first = self.grid.source.min[self.grid.axes[1]] + row;
        self.rows(first, first + count)
    }

    /// Rows of the output whose pixels are means of the cells that they cover, weighted by area, or the cells
    /// at their centres.
    fn resample(&self, row: u64, count: u64) -> Result<(Vec<u8>, Vec<bool>)> {
        let Grid { source, axes: [u, v], origin, step, width, .. } = self.grid;
        let value_type = self.tree.header().form.value;
        let ValueType { sample, channels, .. } = value_type;
        let missing = value_type.all_missing().map_or(self.fill, |value| value_type.first_sample(value));
        let mean = is_averaged(self.tree);
        let spans = |axis: usize, first: u64, count: u64, min: u64, max: u64| -> Vec<Span> {
            (first..first + count)
                .map(|i| Span::new(origin[axis] + i as f64 * step[axis], step[axis], mean, min, max))
                .collect()
        };
        let columns = spans(0, 0, width, source.min[u], source.max[u]);
        let lines = spans(1, row, count, source.min[v], source.max[v]);
        let (first, end) = (lines[0].first, lines[lines.len() - 1].end);
        let (bytes, valid) = self.rows(first, end)?;
        let source_width = source.size()[u];
        let (size, channels) = (sample.size(), channels as usize);
        let mut out = Vec::with_capacity(count as usize * width as usize * size * channels);
        let mut out_valid = Vec::with_capacity(count as usize * width as usize);
        for line in &lines {
            for column in &columns {
                let mut sums = [0.0; 4];
                // (Of each channel, since its sample may be missing.)
                let mut weights = [0.0; 4];
                for y in line.first..line.end {
                    for x in column.first..column.end {
                        let index = ((y - first) * source_width + x - source.min[u]) as usize;
                        if valid[index] {
                            let share = line.share(y) * column.share(x);
                            let pixel = &bytes[index * channels * size..][..channels * size];
                            let present = value_type.present(Value::from_bytes(pixel));
                            for channel in (0..channels).filter(|channel| present[*channel]) {
                                weights[channel] += share;
                                sums[channel] += share * number(sample, &pixel[channel * size..]);
                            }
                        }
                    }
                }
                let is_valid = weights.iter().any(|weight| *weight > 0.0);
                out_valid.push(is_valid);
                let none = if is_valid { missing } else { self.fill };
                for (sum, weight) in sums.iter().zip(weights).take(channels) {
                    push_number(sample, if weight > 0.0 { sum / weight } else { none }, &mut out);
                }
            }
        }
        Ok((out, out_valid))
    }

    /// Rows of the output whose pixels are exact means of the deepest cells.
    fn average(&self, row: u64, count: u64, progress: &dyn Progress) -> Result<(Vec<u8>, Vec<bool>)> {
        let Grid { source, axes, origin, step, width, .. } = self.grid;
        let value_type = self.tree.header().form.value;
        let ValueType { sample, channels, .. } = value_type;
        let missing = value_type.all_missing().map_or(self.fill, |value| value_type.first_sample(value));
        let first = origin[1] + row as f64 * step[1];
        let grid =
            PixelGrid { axes, origin: [origin[0], first], step, size: [width as usize, count as usize] };
        let mut bounds = source;
        let rows = axes[1];
        bounds.min[rows] = (first as u64).clamp(source.min[rows], source.max[rows] - 1);
        let end = (first + count as f64 * step[1]).ceil() as u64;
        bounds.max[rows] = end.clamp(bounds.min[rows] + 1, source.max[rows]);
        let sums = self.tree.pixel_sums(&bounds, grid, progress)?;
        let is_occupancy = self.tree.header().rule == Rule::Occupancy;
        let mut bytes = Vec::with_capacity(sums.sums.len() * sample.size() * usize::from(channels));
        let mut valid = Vec::with_capacity(sums.sums.len());
        for (sums, areas) in sums.sums.iter().zip(&sums.areas) {
            let is_valid = is_occupancy || areas.iter().any(|area| *area > 0.0);
            valid.push(is_valid);
            let none = if is_valid { missing } else { self.fill };
            for (sum, area) in sums.iter().zip(areas).take(usize::from(channels)) {
                // VOID is a number in trees of occupancy: an empty cell.
                let weight = if is_occupancy { step[0] * step[1] } else { *area };
                let void = if is_occupancy { (weight - area).max(0.0) * self.fill } else { 0.0 };
                push_number(sample, if weight > 0.0 { (sum + void) / weight } else { none }, &mut bytes);
            }
        }
        Ok((bytes, valid))
    }
}

/// The cells that an output pixel covers along one axis.
struct Span {
    from: f64,
    to: f64,
    first: u64,
    end: u64,
}

impl Span {
    /// All cells from `from` on for `length`, or only the one in the middle.
    fn new(from: f64, length: f64, all: bool, min: u64, max: u64) -> Span {
        let (from, to) = if all { (from, from + length) } else { (from + length / 2.0, from + length / 2.0) };
        let first = (from.floor() as u64).clamp(min, max - 1);
        Span { from, to, first, end: (to.ceil() as u64).clamp(first + 1, max.max(first + 1)) }
    }

    /// Length of a cell that is covered; 1 for the one in the middle.
    fn share(&self, cell: u64) -> f64 {
        if self.from == self.to {
            return 1.0;
        }
        // Rounding may leave a cell that is in the span by its number without any of its length: it still has
        // to have a weight, or a pixel of such cells alone would be VOID.
        (self.to.min(cell as f64 + 1.0) - self.from.max(cell as f64)).max(1e-12)
    }
}

/// The first sample of some bytes.
pub(super) fn number(sample: SampleType, bytes: &[u8]) -> f64 {
    macro_rules! read {
        ($type:ty) => {
            bytes.first_chunk().map_or(0.0, |bytes| <$type>::from_le_bytes(*bytes) as f64)
        };
    }
    match sample {
        SampleType::U8 => read!(u8),
        SampleType::U16 => read!(u16),
        SampleType::I16 => read!(i16),
        SampleType::U32 => read!(u32),
        SampleType::I32 => read!(i32),
        SampleType::F32 => read!(f32),
        SampleType::F64 => read!(f64),
    }
}

fn push_number(sample: SampleType, number: f64, bytes: &mut Vec<u8>) {
    match sample {
        SampleType::U8 => bytes.push((number + 0.5).floor() as u8),
        SampleType::U16 => bytes.extend(((number + 0.5).floor() as u16).to_le_bytes()),
        SampleType::I16 => bytes.extend(((number + 0.5).floor() as i16).to_le_bytes()),
        SampleType::U32 => bytes.extend(((number + 0.5).floor() as u32).to_le_bytes()),
        SampleType::I32 => bytes.extend(((number + 0.5).floor() as i32).to_le_bytes()),
        SampleType::F32 => bytes.extend((number as f32).to_le_bytes()),
        SampleType::F64 => bytes.extend(number.to_le_bytes()),
    }
}
