//! A window of a tree as a picture, at any level or size, streamed in bands of rows.

use super::image::{Format, ImageSpec, create};
use crate::dataset::Dataset;
use crate::io::Output;
use crate::space::{Bounds, Frame};
use crate::value::{Kind, Rule, SampleType, ValueType};
use crate::{Error, Progress, Result};

/// Which part of a tree, and how fine.
#[derive(Clone, Debug, PartialEq)]
pub struct WindowRequest {
    /// Cells of the deepest level; those beyond the picture are VOID. Along `across` the first counts.
    pub bounds: Bounds,
    /// The axis that the picture does not have: 2 for quadtrees and level slices of octrees, 0 or 1 for upright slices.
    /// Columns are then y or x, and rows z; pictures have the highest row at the top, arrays the lowest first.
    pub across: usize,
    /// Level or size of the output.
    pub detail: Detail,
    /// The number for VOID cells where the format needs one; chosen if not given: see [`fill_for`].
    pub nodata: Option<f64>,
    /// Bytes to hold at a time; what one row of the output needs must fit.
    pub memory: u64,
}

/// How fine the output is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Detail {
    /// One pixel per cell of this level.
    Level(u8),
    /// So many columns and rows, from the coarsest level that is fine enough.
    Size(u64, u64),
}

/// Writes a window of a tree to a picture or array file. An octree gives a slice, at `bounds.min[across]`.
///
/// With [`Detail::Size`], trees of means and of occupancy are averaged over the area of each pixel, others give the value
/// at its centre. In trees of occupancy, VOID cells are 0.
///
/// # Errors
/// If the window is empty, one row needs more memory than is allowed, the format cannot hold the values, the tree is
/// damaged, or on interruption.
pub fn export_window(
    tree: &Dataset,
    request: &WindowRequest,
    output: Output,
    format: Format,
    progress: &dyn Progress,
) -> Result<()> {
    let depth = tree.depth();
    let across = request.across;
    let (u, v) = match across {
        0 => (1, 2),
        1 => (0, 2),
        _ => (0, 1),
    };
    let size = request.bounds.size();
    let size = [size[u], size[v]];
    if request.bounds.is_empty() {
        return Err(Error::invalid(
            "window",
            format!("{} x {} cells", size[0], size[1]),
            "at least one cell",
        ));
    }
    let level = match request.detail {
        Detail::Level(level) if level <= depth => level,
        Detail::Level(level) => {
            return Err(Error::invalid("level", level.to_string(), format!("0 to {depth}")));
        }
        Detail::Size(width, height) => {
            if width == 0 || height == 0 {
                return Err(Error::invalid("size", format!("{width}x{height}"), "at least 1x1"));
            }
            let fine =
                |level: u8| size[0] >> (depth - level) >= width && size[1] >> (depth - level) >= height;
            (0..=depth).find(|level| fine(*level)).unwrap_or(depth)
        }
    };
    let shift = depth - level;
    let scale = (1u64 << shift) as f64;
    let mut source = request.bounds;
    for axis in 0..3 {
        source.min[axis] >>= shift;
        source.max[axis] = source.max[axis].div_ceil(1 << shift);
    }
    source.max[across] = source.min[across] + 1;
    // The output's grid in cells of the level: whole cells, or any box divided evenly.
    let (width, height, origin, step) = match request.detail {
        Detail::Level(_) => {
            let size = source.size();
            (size[u], size[v], [source.min[u] as f64, source.min[v] as f64], [1.0, 1.0])
        }
        Detail::Size(width, height) => {
            let origin = [request.bounds.min[u] as f64 / scale, request.bounds.min[v] as f64 / scale];
            (
                width,
                height,
                origin,
                [size[0] as f64 / scale / width as f64, size[1] as f64 / scale / height as f64],
            )
        }
    };
    let header = tree.header();
    let metadata = tree.metadata();
    let row_bytes = row_bytes(header.form.value, source.size()[u], request.detail, step[1]);
    if row_bytes > request.memory {
        return Err(Error::TooLarge {
            path: tree.path().to_path_buf(),
            what: format!("a row of {width} pixels of the output"),
            needed: row_bytes,
            limit: request.memory,
            advice: "ask for fewer columns or a coarser level".into(),
        });
    }
    let is_graded = header.rule == Rule::Occupancy;
    let may_be_void = !is_graded && tree.may_have_void(request.bounds)?;
    let fill =
        if is_graded { Some(request.nodata.unwrap_or(0.0)) } else { request.nodata.or(fill_for(tree)?) };
    let mut frame = metadata.frame.coarser(shift).shifted([origin[0], origin[1], source.min[2] as f64]);
    for row in &mut frame.matrix {
        row[0] *= step[0];
        row[1] *= step[1];
    }
    let has_frame = across == 2 && metadata.frame != Frame::identity();
    let spec = ImageSpec {
        width,
        height,
        value: header.form.value,
        alpha: metadata.alpha.is_some_and(|alpha| alpha.checked_add(1) == Some(header.form.value.channels)),
        void: may_be_void,
        frame: has_frame.then_some(frame),
        nodata: fill.filter(|_| may_be_void || metadata.nodata.is_some()),
        palette: metadata.palette.clone(),
        band_names: metadata.band_names.clone(),
    };
    let mut writer = create(output, format, &spec)?;
    let is_upright = across != 2 && !matches!(format, Format::Npy | Format::Raw);
    let sampler =
        Sampler { tree, level, source, axes: [u, v], origin, step, fill: fill.unwrap_or(0.0), width };
    let rows = (request.memory / row_bytes / 2).clamp(1, 256).min(height);
    let mut row = 0;
    while row < height {
        progress.check()?;
        let count = rows.min(height - row);
        let first = if is_upright { height - row - count } else { row };
        let (mut bytes, mut valid) = match request.detail {
            Detail::Level(_) => sampler.copy(first, count)?,
            Detail::Size(..) => sampler.resample(first, count)?,
        };
        if is_upright {
            turn_rows(&mut bytes, width as usize * header.form.value.size());
            turn_rows(&mut valid, width as usize);
        }
        writer.write_rows(&bytes, may_be_void.then_some(&valid))?;
        progress.advance(count * width, height.saturating_mul(width));
        row += count;
    }
    writer.finish()
}

/// Puts the last row first.
fn turn_rows<T>(cells: &mut [T], width: usize) {
    cells.reverse();
    cells.chunks_mut(width).for_each(<[T]>::reverse);
}

/// What a row of the output needs: the cells it is made of, `step` rows of them if it is resampled, and its pixels.
fn row_bytes(value: ValueType, cells: u64, detail: Detail, step: f64) -> u64 {
    // A flag tells whether there is a value.
    let pixel = value.size() as u64 + 1;
    let row = cells.saturating_mul(pixel);
    match detail {
        Detail::Level(_) => row,
        Detail::Size(width, _) => {
            let lines = step.ceil() as u64 + 1;
            row.saturating_mul(lines).saturating_add(width.saturating_mul(pixel + size_of::<Span>() as u64))
        }
    }
}

/// A number for VOID cells: the file's own, NaN for floating samples, or one that no cell has; `None` if every number
/// is in use.
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

/// Rows of a window, straight or resampled.
struct Sampler<'a> {
    tree: &'a Dataset,
    level: u8,
    source: Bounds,
    /// Which of the tree's axes columns and rows are.
    axes: [usize; 2],
    origin: [f64; 2],
    step: [f64; 2],
    fill: f64,
    width: u64,
}

impl Sampler<'_> {
    fn rows(&self, first: u64, end: u64) -> Result<(Vec<u8>, Vec<bool>)> {
        let mut bounds = self.source;
        let rows = self.axes[1];
        (bounds.min[rows], bounds.max[rows]) = (first, end);
        let cells = bounds.volume() as usize;
        let mut bytes = vec![0; cells * self.tree.header().form.value.size()];
        let mut valid = vec![true; cells];
        self.tree.window(self.level, &bounds, self.fill, &mut bytes, Some(&mut valid))?;
        if self.tree.header().rule == Rule::Occupancy {
            // Nothing is a number, too: how full the cell is.
            valid.fill(true);
        }
        Ok((bytes, valid))
    }

    fn copy(&self, row: u64, count: u64) -> Result<(Vec<u8>, Vec<bool>)> {
        let first = self.source.min[self.axes[1]] + row;
        self.rows(first, first + count)
    }

    fn resample(&self, row: u64, count: u64) -> Result<(Vec<u8>, Vec<bool>)> {
        let ValueType { sample, channels } = self.tree.header().form.value;
        let header = self.tree.header();
        let mean = matches!(header.rule, Rule::Mean | Rule::Occupancy) && header.kind == Kind::Continuous;
        let [u, v] = self.axes;
        let spans = |axis: usize, first: u64, count: u64, min: u64, max: u64| -> Vec<Span> {
            (first..first + count)
                .map(|i| {
                    Span::new(self.origin[axis] + i as f64 * self.step[axis], self.step[axis], mean, min, max)
                })
                .collect()
        };
        let columns = spans(0, 0, self.width, self.source.min[u], self.source.max[u]);
        let lines = spans(1, row, count, self.source.min[v], self.source.max[v]);
        let (first, end) = (lines[0].first, lines[lines.len() - 1].end);
        let (bytes, valid) = self.rows(first, end)?;
        let source_width = self.source.size()[u];
        let (size, channels) = (sample.size(), channels as usize);
        let mut out = Vec::with_capacity(count as usize * self.width as usize * size * channels);
        let mut out_valid = Vec::with_capacity(count as usize * self.width as usize);
        for line in &lines {
            for column in &columns {
                let mut sums = [0.0; 4];
                let mut weight = 0.0;
                for y in line.first..line.end {
                    for x in column.first..column.end {
                        let place = ((y - first) * source_width + x - self.source.min[u]) as usize;
                        if valid[place] {
                            let share = line.share(y) * column.share(x);
                            weight += share;
                            for (channel, sum) in sums.iter_mut().enumerate().take(channels) {
                                *sum += share * number(sample, &bytes[(place * channels + channel) * size..]);
                            }
                        }
                    }
                }
                out_valid.push(weight > 0.0);
                for sum in &sums[..channels] {
                    push_number(sample, if weight > 0.0 { sum / weight } else { self.fill }, &mut out);
                }
            }
        }
        Ok((out, out_valid))
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

    /// How much of a cell is covered.
    fn share(&self, cell: u64) -> f64 {
        if self.from == self.to {
            return 1.0;
        }
        (self.to.min(cell as f64 + 1.0) - self.from.max(cell as f64)).max(1e-12)
    }
}

fn number(sample: SampleType, bytes: &[u8]) -> f64 {
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
