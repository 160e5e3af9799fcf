//! Queries: windows, points, statistics.

use std::cmp::Ordering;
use std::ffi::c_void;
use std::slice;

use engine::Bounds;
use engine::query::PointSamples;

use crate::dataset::{level_of, opened, spinney_dataset};
use crate::status::{Failure, guarded, spinney_status};

/// A box of cells of a level. In quadtrees z starts at 0 and has size 1.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct spinney_box {
    /// First cell along x, y and z.
    pub start: [u64; 3],
    /// Cells along x, y and z.
    pub size: [u64; 3],
}

impl From<Bounds> for spinney_box {
    fn from(bounds: Bounds) -> Self {
        let size = std::array::from_fn(|axis| bounds.max[axis] - bounds.min[axis]);
        spinney_box { start: bounds.min, size }
    }
}

/// Returns the box at a pointer; `None` for NULL.
pub(crate) unsafe fn bounds_at(cells: *const spinney_box) -> Result<Option<Bounds>, Failure> {
    // SAFETY: it is NULL, or points to the caller's box.
    let Some(cells) = (unsafe { cells.as_ref() }) else { return Ok(None) };
    let mut max = [0; 3];
    for (axis, max) in max.iter_mut().enumerate() {
        let end = cells.start[axis].checked_add(cells.size[axis]).filter(|end| *end <= 1 << 40);
        *max =
            end.ok_or_else(|| Failure::invalid(format!("box: got {cells:?}, expected cells up to 2^40")))?;
    }
    Ok(Some(Bounds { min: cells.start, max }))
}

/// Returns the box at a pointer that must not be NULL.
pub(crate) unsafe fn some_bounds_at(cells: *const spinney_box) -> Result<Bounds, Failure> {
    // SAFETY: see `bounds_at`.
    unsafe { bounds_at(cells) }?.ok_or_else(|| Failure::invalid("box: got NULL, expected a box"))
}

/// Returns the caller's buffer of `count` items. Fails if another number is expected.
pub(crate) unsafe fn buffer<'a, T>(
    name: &str,
    items: *mut T,
    count: usize,
    expected: Option<u64>,
) -> Result<&'a mut [T], Failure> {
    if expected.is_some_and(|expected| count as u64 != expected) || (items.is_null() && count > 0) {
        let found = if items.is_null() { "NULL".into() } else { count.to_string() };
        let expected = expected.map_or("a pointer".into(), |expected| expected.to_string());
        return Err(Failure::invalid(format!("{name}: got a capacity of {found}, expected {expected}")));
    }
    if items.is_null() {
        return Ok(&mut []);
    }
    // SAFETY: the caller has `count` items there, which no other thread uses during the call.
    Ok(unsafe { slice::from_raw_parts_mut(items, count) })
}

/// Returns the caller's array of `count` items.
pub(crate) unsafe fn items<'a, T>(name: &str, items: *const T, count: usize) -> Result<&'a [T], Failure> {
    if count == 0 {
        return Ok(&[]);
    }
    if items.is_null() || !items.is_aligned() || count > isize::MAX as usize / size_of::<T>() {
        let found = if items.is_null() { "NULL".into() } else { format!("{count} at {items:?}") };
        return Err(Failure::invalid(format!("{name}: got {found}, expected an array in memory")));
    }
    // SAFETY: the caller has `count` items there.
    Ok(unsafe { slice::from_raw_parts(items, count) })
}

/// Returns a box's cell count and its size in bytes, unless they overflow.
pub(crate) fn sizes(bounds: &Bounds, width: usize) -> Result<(u64, u64), Failure> {
    let extents = (0..3).map(|axis| bounds.max[axis] - bounds.min[axis]);
    let cells = extents.into_iter().try_fold(1u64, u64::checked_mul);
    let bytes = cells.and_then(|cells| cells.checked_mul(width as u64));
    cells.zip(bytes).ok_or_else(|| {
        Failure::invalid("box: got more than 2^64 cells, expected a box that fits into memory")
    })
}

/// Reads a box of cells of a level: x fastest, then y, then z, with the samples of a cell
/// interleaved. `samples_size` is the size in bytes, `cells * cell_size`; the samples need not be
/// aligned. Cells that are VOID or outside get `fill` in every channel. `valid` may be NULL (with
/// `valid_size` 0); otherwise it gets one byte per cell: 1 if the cell has a value, 0 if not.
///
/// Takes time by the cells of the box, whatever the levels below them have.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_read(
    dataset: *const spinney_dataset,
    level: u32,
    cells: *const spinney_box,
    fill: f64,
    samples: *mut c_void,
    samples_size: usize,
    valid: *mut u8,
    valid_size: usize,
) -> spinney_status {
    guarded(|| {
        // SAFETY: see `opened` and `some_bounds_at`.
        let (dataset, bounds) = unsafe { (&opened(dataset)?.dataset, some_bounds_at(cells)?) };
        let (count, bytes) = sizes(&bounds, dataset.header().form.width())?;
        // SAFETY: see `buffer`.
        let samples = unsafe { buffer("samples", samples.cast(), samples_size, Some(bytes))? };
        let valid = if valid.is_null() && valid_size == 0 {
            None
        } else {
            // SAFETY: see `buffer`.
            Some(flags(unsafe { buffer("valid", valid, valid_size, Some(count))? }))
        };
        Ok(dataset.window(level_of(level), &bounds, fill, samples, valid)?)
    })
}

/// Converts bytes to flags, all `false`.
pub(crate) fn flags(bytes: &mut [u8]) -> &mut [bool] {
    bytes.fill(0);
    // SAFETY: a bool is a byte that is 0 or 1, and all of these are 0.
    unsafe { slice::from_raw_parts_mut(bytes.as_mut_ptr().cast(), bytes.len()) }
}

/// Cells of a box in a mapped file, not copied. None of them is VOID.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct spinney_view {
    /// The first cell; not aligned. Valid until the dataset is closed or refreshed.
    pub samples: *const c_void,
    /// Bytes from a cell to the same cell in the next row.
    pub row_stride: usize,
    /// Bytes from a cell to the same cell in the next slice along z.
    pub layer_stride: usize,
}

/// Returns a pointer to a box of cells of a level in the file, without a copy. Samples of a cell
/// are interleaved, and cells of a row are contiguous. This is possible in a mapped Goblin file,
/// not in a view, if one dense block has the whole box. Where no two cells are alike, dense blocks
/// are aligned boxes of up to 256 x 256 cells (16 x 16 x 16 in octrees). SPINNEY_UNSUPPORTED if
/// not: spinney_read() reads all boxes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_view_of(
    dataset: *const spinney_dataset,
    level: u32,
    cells: *const spinney_box,
    view: *mut spinney_view,
) -> spinney_status {
    guarded(|| {
        // SAFETY: see `opened` and `some_bounds_at`.
        let (dataset, bounds) = unsafe { (&opened(dataset)?.dataset, some_bounds_at(cells)?) };
        // SAFETY: it is NULL, or points to the caller's struct.
        let view =
            unsafe { view.as_mut() }.ok_or_else(|| Failure::invalid("view: got NULL, expected a pointer"))?;
        let stored = dataset.stored_rows(level_of(level), &bounds)?.ok_or_else(Failure::not_stored)?;
        *view = spinney_view {
            samples: stored.bytes.as_ptr().cast(),
            row_stride: stored.row,
            layer_stride: stored.layer,
        };
        Ok(())
    })
}

/// Reads `count` single cells of a level, in any order: `cells` has x, y and z of each. `samples`
/// has a capacity of `count * channels` numbers; `valid` (which may be NULL) of `count` flags, as
/// in spinney_read(). Cells that are VOID or outside get NaN. 64-bit integers are rounded to the
/// nearest doubles: spinney_point_samples() returns them exactly. Much faster than one call per
/// cell.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_points(
    dataset: *const spinney_dataset,
    level: u32,
    cells: *const [u64; 3],
    count: usize,
    samples: *mut f64,
    valid: *mut u8,
) -> spinney_status {
    guarded(|| {
        // SAFETY: see `opened`.
        let dataset = &unsafe { opened(dataset) }?.dataset;
        let channels = usize::from(dataset.header().form.value.channels);
        let numbers = count.checked_mul(channels).filter(|_| !cells.is_null() || count == 0);
        let numbers = numbers
            .ok_or_else(|| Failure::invalid("cells: got NULL or too many, expected x, y, z of each"))?;
        // SAFETY: the caller has `count` cells and flags there, and `count * channels` numbers.
        let (cells, samples, valid) = unsafe {
            let cells = if count == 0 { &[][..] } else { slice::from_raw_parts(cells, count) };
            let valid = if valid.is_null() { &mut [][..] } else { buffer("valid", valid, count, None)? };
            (cells, buffer("samples", samples, numbers, None)?, valid)
        };
        let mut found = PointSamples::default();
        dataset.points(cells, level_of(level), &mut found)?;
        for (index, samples) in samples.chunks_exact_mut(channels).enumerate() {
            let values = found.get(index);
            match values {
                Some(values) => {
                    samples.iter_mut().zip(values.iter()).for_each(|(to, value)| *to = value.to_f64())
                }
                None => samples.fill(f64::NAN),
            }
            if let Some(valid) = valid.get_mut(index) {
                *valid = values.is_some().into();
            }
        }
        Ok(())
    })
}

/// Statistics of one channel. The standard deviation is that of the population.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct spinney_channel_statistics {
    /// Cells that have a sample. If there are none, all other fields are NaN.
    pub cells: u64,
    pub min: f64,
    pub max: f64,
    pub mean: f64,
    pub standard_deviation: f64,
}

/// Statistics of a box of cells.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct spinney_statistics {
    /// Cells that are not VOID.
    pub cells: u64,
    /// Cells that are VOID.
    pub void_cells: u64,
    /// Class count, as in spinney_classes().
    pub classes: u64,
    pub channels: [spinney_channel_statistics; 4],
}

/// Computes exact statistics of a box of cells of the deepest level, or of all cells if `cells` is
/// NULL. Takes time by the length of the box's border.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_statistics_of(
    dataset: *const spinney_dataset,
    cells: *const spinney_box,
    statistics: *mut spinney_statistics,
) -> spinney_status {
    guarded(|| {
        // SAFETY: see `opened` and `bounds_at`.
        let (dataset, bounds) = unsafe { (&opened(dataset)?.dataset, bounds_at(cells)?) };
        // SAFETY: it is NULL, or points to the caller's struct.
        let output = unsafe { statistics.as_mut() };
        let output = output.ok_or_else(|| Failure::invalid("statistics: got NULL, expected a pointer"))?;
        let found = dataset.statistics(bounds, &())?;
        let none = f64::NAN;
        let absent = spinney_channel_statistics {
            cells: 0,
            min: none,
            max: none,
            mean: none,
            standard_deviation: none,
        };
        *output = spinney_statistics {
            cells: found.cells,
            void_cells: found.void_cells,
            classes: found.classes.len() as u64,
            channels: [absent; 4],
        };
        for (output, channel) in output.channels.iter_mut().zip(&found.channels) {
            let engine::query::ChannelStatistics { cells, min, max, mean, standard_deviation } = *channel;
            let (min, max) = (min.to_f64(), max.to_f64());
            *output = spinney_channel_statistics { cells, min, max, mean, standard_deviation };
        }
        Ok(())
    })
}

/// Counts the cells of each class in a box, as in spinney_statistics_of(), by ascending value.
/// `values` and `counts` have a capacity of `capacity` items. `count` is set to the class count;
/// only classes within the capacity are written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_classes(
    dataset: *const spinney_dataset,
    cells: *const spinney_box,
    values: *mut f64,
    counts: *mut u64,
    capacity: usize,
    count: *mut usize,
) -> spinney_status {
    guarded(|| {
        // SAFETY: see `opened` and `bounds_at`.
        let (dataset, bounds) = unsafe { (&opened(dataset)?.dataset, bounds_at(cells)?) };
        // SAFETY: these point to the caller's memory, or are NULL, which is detected.
        let (values, counts, count) = unsafe {
            let count =
                count.as_mut().ok_or_else(|| Failure::invalid("count: got NULL, expected a pointer"))?;
            (buffer("values", values, capacity, None)?, buffer("counts", counts, capacity, None)?, count)
        };
        let found = dataset.statistics(bounds, &())?;
        for ((value, cells), (class, found)) in values.iter_mut().zip(counts).zip(&found.classes) {
            (*value, *cells) = (class.to_f64(), *found);
        }
        *count = found.classes.len();
        Ok(())
    })
}

/// Counts the cells of a box (of the deepest level; all if `cells` is NULL) whose first channel
/// lies in each of `count` equal intervals from `low` to `high`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_histogram(
    dataset: *const spinney_dataset,
    cells: *const spinney_box,
    low: f64,
    high: f64,
    bins: *mut u64,
    count: usize,
) -> spinney_status {
    guarded(|| {
        // SAFETY: see `opened` and `bounds_at`.
        let (dataset, bounds) = unsafe { (&opened(dataset)?.dataset, bounds_at(cells)?) };
        // SAFETY: see `buffer`.
        let bins = unsafe { buffer("bins", bins, count, None)? };
        let bounds = bounds.unwrap_or(dataset.header().extent_bounds());
        if bins.is_empty() || low.partial_cmp(&high) != Some(Ordering::Less) {
            let found = format!(
                "histogram: got {count} bins of {low} to {high}, expected at least one, and low < high"
            );
            return Err(Failure::invalid(found));
        }
        bins.copy_from_slice(&dataset.histogram(&bounds, low, high, count, &())?);
        Ok(())
    })
}
