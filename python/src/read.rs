//! Reads of windows as NumPy arrays.

use std::time::{Duration, Instant};

use numpy::{PyArrayMethods, PyUntypedArray, PyUntypedArrayMethods};
use pyo3::exceptions::{PyIndexError, PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{IntoPyDict, PyInt, PyList, PySlice, PyString, PyTuple};
use spinney::export::{Detail, WindowRequest};
use spinney::raw::export::window_rows;
use spinney::{Bounds, Dataset, Number, Rule};

use crate::error::{OrRaise, invalid};
use crate::index;
use crate::index::Along;
use crate::jobs::{self, Terms};
use crate::numbers::PyNumber;
use crate::queries::values_at;
use crate::region::{are_cells, at_level, is_fractional, level_of, region_of};
use crate::samples::{dtype, empty, flags, with_bytes};
use crate::tree::{Opened, Tree};

/// Selected bands.
pub(crate) enum Bands {
    All,
    /// One band; the result has no band axis.
    One(usize),
    Some(Vec<usize>),
}

impl Bands {
    fn of(given: Option<&Bound<'_, PyAny>>, count: usize) -> PyResult<Bands> {
        let Some(given) = given else { return Ok(Bands::All) };
        let check = |band: i64| {
            usize::try_from(band - 1)
                .ok()
                .filter(|index| *index < count)
                .ok_or_else(|| PyIndexError::new_err(format!("bands: got {band}, expected 1 to {count}")))
        };
        if let Ok(band) = given.extract::<i64>() {
            return check(band).map(Bands::One);
        }
        let bands: Vec<i64> = given.extract().map_err(|_| {
            PyTypeError::new_err("bands: expected a number, counted from 1, or a list of numbers")
        })?;
        bands.into_iter().map(check).collect::<PyResult<_>>().map(Bands::Some)
    }
}

/// Pixels of a window before bands are selected: bands last, without a band axis if there is only
/// one.
pub(crate) struct Pixels<'py> {
    pub(crate) array: Bound<'py, PyAny>,
    /// `true` where a cell is VOID.
    pub(crate) void: Option<Bound<'py, PyAny>>,
}

/// Cells read between checks for signals: the maximum, and the initial value for a view, each of
/// whose cells may be expensive.
const MAX_READ_CELLS: u64 = 1 << 24;
const FIRST: u64 = 1 << 18;
/// Duration of a read after which the next one is not larger.
const LONG: Duration = Duration::from_millis(50);
/// Pixels that are resampled in a fraction of a second.
const SHORT: u64 = 1 << 18;

/// Reads a box of cells of a level into an array (into `out` if that fits).
pub(crate) fn cells<'py>(
    py: Python<'py>,
    opened: &Opened,
    level: u8,
    bounds: &Bounds,
    fill: Number,
    masked: bool,
    out: Option<&Bound<'py, PyAny>>,
) -> PyResult<Pixels<'py>> {
    let tree = &opened.tree;
    let value = tree.header().form.value;
    let count = opened.count();
    // (Columns, then bands, are last.)
    let [width, height, depth] = bounds.size().map(|size| size as usize);
    let sizes = [depth, height, width, count];
    let shape = &sizes[3 - opened.axes()..if count > 1 { 4 } else { 3 }];
    let array = match out {
        Some(out) => out.clone(),
        None => empty(py, value.sample, shape)?,
    };
    let void = masked.then(|| flags(py, &shape[..opened.axes()])).transpose()?;
    with_bytes(&array, value.sample, |bytes| {
        let mut lent = void.as_ref().map(|void| void.readwrite());
        let mut valid = lent.as_mut().map(|lent| lent.as_slice_mut()).transpose()?;
        let mut max_cells = if opened.is_view { FIRST } else { MAX_READ_CELLS };
        let mut next = (!bounds.is_empty()).then_some(bounds.min);
        while let Some(start) = next {
            let part = block(bounds, start, max_cells);
            next = after(bounds, &part);
            let first = (part.min[0] - bounds.min[0])
                + width as u64
                    * (part.min[1] - bounds.min[1] + height as u64 * (part.min[2] - bounds.min[2]));
            let range = first as usize..first as usize + part.volume() as usize;
            let bytes = bytes.get_mut(range.start * value.size()..range.end * value.size());
            let bytes = bytes.ok_or_else(|| invalid("out: has too few cells"))?;
            let valid = valid.as_mut().and_then(|valid| valid.get_mut(range));
            let begin = Instant::now();
            py.detach(|| read(tree, level, &part, fill, bytes, valid)).or_raise()?;
            if begin.elapsed() < LONG {
                // (Larger reads are faster, since they traverse fewer nodes twice.)
                max_cells = MAX_READ_CELLS.min(4 * max_cells);
            }
            if part.volume() < bounds.volume() {
                py.check_signals()?;
            }
        }
        Ok(())
    })?;
    Ok(Pixels { array, void: void.map(|void| void.into_any()) })
}

/// Reads cells, and flags those that are VOID.
fn read(
    tree: &Dataset,
    level: u8,
    part: &Bounds,
    fill: Number,
    bytes: &mut [u8],
    flags: Option<&mut [bool]>,
) -> spinney::Result<()> {
    let Some(flags) = flags else { return tree.window(level, part, fill, bytes, None) };
    tree.window(level, part, fill, bytes, Some(flags))?;
    // In occupancy trees VOID is a number, too: an empty cell.
    let is_occupancy = tree.header().rule == Rule::Occupancy;
    flags.iter_mut().for_each(|flag| *flag = !*flag && !is_occupancy);
    Ok(())
}

/// Returns a fragment of a box that starts at row `y` of plane `z`, with about `max_cells` cells
/// that are contiguous in memory: planes of the box, or rows of one plane.
fn block(bounds: &Bounds, [_, y, z]: [u64; 3], max_cells: u64) -> Bounds {
    let [width, height, _] = bounds.size();
    let (mut block, rows) = (*bounds, (max_cells / width).max(1));
    block.min = [bounds.min[0], y, z];
    if y == bounds.min[1] && rows >= height {
        block.max[2] = bounds.max[2].min(z + rows / height);
    } else {
        (block.max[1], block.max[2]) = (bounds.max[1].min(y + rows), z + 1);
    }
    block
}

/// Returns the row and plane that follow a fragment of a box.
fn after(bounds: &Bounds, block: &Bounds) -> Option<[u64; 3]> {
    let [x, first, _] = bounds.min;
    if block.max[1] < bounds.max[1] {
        return Some([x, block.max[1], block.min[2]]);
    }
    (block.max[2] < bounds.max[2]).then_some([x, first, block.max[2]])
}

/// Returns pixels of a raster at any size, averaged or sampled at their centres.
pub(crate) fn resampled<'py>(
    py: Python<'py>,
    opened: &Opened,
    request: &WindowRequest,
    [rows, columns]: [u64; 2],
    masked: bool,
) -> PyResult<Pixels<'py>> {
    let value = opened.tree.header().form.value;
    let too_large = || invalid(format!("out_shape: got {rows} x {columns} pixels, which are too many"));
    let bytes = rows.checked_mul(columns).and_then(|pixels| pixels.checked_mul(value.size() as u64 + 1));
    bytes.filter(|bytes| *bytes < 1 << 40).ok_or_else(too_large)?;
    let sizes = [rows as usize, columns as usize, opened.count()];
    let array = empty(py, value.sample, &sizes[..if opened.count() > 1 { 3 } else { 2 }])?;
    let void = masked.then(|| flags(py, &sizes[..2])).transpose()?;
    // (Reads too short to be cancelled need no thread of their own.)
    let is_short = rows * columns <= SHORT && !opened.is_view && !matches!(request.detail, Detail::Exact(..));
    with_bytes(&array, value.sample, |bytes| {
        let mut lent = void.as_ref().map(|void| void.readwrite());
        let mut void = lent.as_mut().map(|lent| lent.as_slice_mut()).transpose()?;
        let (mut at, mut flag) = (0, 0);
        let mut take = |pixels: &[u8], valid: &[bool]| {
            bytes[at..at + pixels.len()].copy_from_slice(pixels);
            at += pixels.len();
            if let Some(void) = &mut void {
                let flags = &mut void[flag..flag + valid.len()];
                flags.iter_mut().zip(valid).for_each(|(flag, valid)| *flag = !*valid);
            }
            flag += valid.len();
            Ok(())
        };
        match is_short {
            true => py.detach(|| window_rows(&opened.tree, request, &(), &mut take)).or_raise(),
            false => {
                jobs::run(py, Terms::default(), |work| window_rows(&opened.tree, request, work, &mut take))
            }
        }
    })?;
    Ok(Pixels { array, void: void.map(|void| void.into_any()) })
}

/// Returns a slice of an octree at a level; bands, if there are several, come first.
pub(crate) fn resampled_slice<'py>(
    py: Python<'py>,
    opened: &Opened,
    request: &WindowRequest,
    level: u8,
    masked: bool,
) -> PyResult<Bound<'py, PyAny>> {
    let extent = opened.tree.extent_at(level).max;
    let shape = match request.across {
        0 => [extent[2], extent[1]],
        1 => [extent[2], extent[0]],
        _ => [extent[1], extent[0]],
    };
    let Pixels { array, void } = resampled(py, opened, request, shape, masked)?;
    let bands = if opened.count() == 1 { Bands::One(0) } else { Bands::All };
    let array = arranged(py, array, opened.count(), 2, &bands)?;
    match void {
        None => Ok(array),
        Some(void) => masked_array(py, opened, array, void),
    }
}

/// Moves the bands to the front, and selects the requested ones.
fn arranged<'py>(
    py: Python<'py>,
    array: Bound<'py, PyAny>,
    count: usize,
    axes: usize,
    bands: &Bands,
) -> PyResult<Bound<'py, PyAny>> {
    if count == 1 {
        return match bands {
            Bands::One(_) => Ok(array),
            Bands::All => array.get_item(py.None()),
            Bands::Some(bands) => array.get_item(py.None())?.get_item(PyList::new(py, bands)?),
        };
    }
    let order = PyTuple::new(py, [&[axes][..], &[0, 1, 2][..axes]].concat())?;
    let array = array.call_method1("transpose", order)?;
    match bands {
        Bands::All => Ok(array),
        Bands::One(band) => array.get_item(*band),
        Bands::Some(bands) => array.get_item(PyList::new(py, bands)?),
    }
}

impl<'py> Pixels<'py> {
    /// Returns the array that the caller gets.
    fn finish(self, py: Python<'py>, opened: &Opened, bands: &Bands) -> PyResult<Bound<'py, PyAny>> {
        let array = arranged(py, self.array, opened.count(), opened.axes(), bands)?;
        match self.void {
            None => Ok(array),
            Some(void) => masked_array(py, opened, array, void),
        }
    }
}

/// Returns a masked array; `void` has no band axis, and is `true` where cells are VOID.
fn masked_array<'py>(
    py: Python<'py>,
    opened: &Opened,
    array: Bound<'py, PyAny>,
    void: Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyAny>> {
    static MASKED: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let missing = opened.missing().map(|number| opened.to_python(py, number)).transpose()?;
    let masked = MASKED.import(py, "spinney._arrays", "masked")?;
    masked.call1((array, void, missing, opened.to_python(py, opened.void()?)?))
}

/// Copies a result to the caller's array `out`, if there is one, or returns it.
fn delivered<'py>(array: Bound<'py, PyAny>, out: Option<&Bound<'py, PyAny>>) -> PyResult<Bound<'py, PyAny>> {
    let Some(out) = out else { return Ok(array) };
    let shape =
        |array: &Bound<'_, PyAny>| array.getattr("shape").and_then(|shape| shape.extract::<Vec<usize>>());
    let (wanted, given) = (shape(&array)?, shape(out)?);
    if wanted != given {
        return Err(invalid(format!("out: got shape {given:?}, expected {wanted:?}")));
    }
    array.py().import("numpy")?.call_method1("copyto", (out, array))?;
    Ok(out.clone())
}

/// Returns whether cells can be written directly to an array.
fn takes_cells(out: &Bound<'_, PyAny>, opened: &Opened, shape: &[usize]) -> bool {
    let Ok(array) = out.cast::<PyUntypedArray>() else { return false };
    opened.count() == 1
        && array.is_c_contiguous()
        && array.shape() == shape
        && array.dtype().as_any().eq(dtype(out.py(), opened.tree.header().form.value.sample)).unwrap_or(false)
        && out.getattr("flags").and_then(|flags| flags.getattr("writeable")?.extract()).unwrap_or(false)
}

#[pymethods]
impl Tree {
    /// Returns cells as a NumPy array: bands first, then planes (of octrees), rows and columns.
    ///
    /// `bands` are numbers counted from 1: an int gives an array without a band axis, a list those
    /// bands, `None` all of them. The region is a `window` of cells of the deepest level, `(column,
    /// row, width, height)` (rasterio's windows and pairs of ranges are accepted, too; octrees take
    /// `(x, y, z, width, height, depth)`), or with other `coordinates` ("world", "lonlat",
    /// "EPSG:3035" ...) `(left, bottom, right, top)`. The default is the whole raster.
    ///
    /// `level` selects coarser cells, down to 0. Alternatively `out_shape`, `(rows, columns)`, is
    /// the size of the result: continuous values are averaged over each pixel (with `exact` from
    /// the deepest cells), classes are sampled at pixel centres.
    ///
    /// A window with fractional bounds is read as by rasterio: it is divided equally into pixels,
    /// each of which is the cell at its centre. Their number is the window's lengths, rounded, or
    /// `out_shape`.
    ///
    /// VOID cells have the number `fill` (by default `fill_value`); with `masked` the result is a
    /// masked array. With `boundless` a window may extend beyond the raster, where all is VOID. If
    /// `out` is given, the result is written to it. The bands of a pixel are contiguous in memory:
    /// `numpy.ascontiguousarray` makes planes of them.
    ///
    /// `layers` are names of layers of the file; their cells are concatenated along the first axis.
    ///
    /// Raises ValueError or IndexError for a region that does not exist, OSError if the file is
    /// corrupt there.
    #[pyo3(signature = (bands=None, *, layers=None, window=None, coordinates=None, level=None, out_shape=None, exact=false, masked=false, fill=None, boundless=false, out=None))]
    #[allow(clippy::too_many_arguments)] // as in Python
    fn read<'py>(
        slf: &Bound<'py, Tree>,
        py: Python<'py>,
        bands: Option<&Bound<'py, PyAny>>,
        layers: Option<&Bound<'py, PyAny>>,
        window: Option<&Bound<'py, PyAny>>,
        coordinates: Option<&Bound<'py, PyAny>>,
        level: Option<i64>,
        out_shape: Option<&Bound<'py, PyAny>>,
        exact: bool,
        masked: bool,
        fill: Option<PyNumber>,
        boundless: bool,
        out: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let opened = slf.get().get()?;
        let opened = &*opened;
        let fill_value = if masked { opened.fill(fill)? } else { opened.plain_fill(fill)? };
        if masked && out.is_some() {
            return Err(invalid("masked, out: got both, expected one of them; masked arrays are always new"));
        }
        if let Some(layers) = layers {
            let options = [
                ("bands", bands),
                ("window", window),
                ("coordinates", coordinates),
                ("out_shape", out_shape),
            ];
            let options = options.into_iter().filter_map(|(name, value)| Some((name, value?.clone())));
            let options: Vec<(&str, Bound<'py, PyAny>)> = options.collect();
            let options = options.into_py_dict(py)?;
            options.set_item("level", level)?;
            options.set_item("exact", exact)?;
            options.set_item("masked", masked)?;
            options.set_item("boundless", boundless)?;
            if let Some(fill) = fill {
                options.set_item("fill", opened.to_python(py, fill.0)?)?;
            }
            let helper = py.import("spinney._arrays")?.getattr("of_layers")?;
            return delivered(helper.call1((slf, layers, options))?, out);
        }
        if boundless && !are_cells(coordinates)? {
            return Err(invalid("boundless: is for windows of cells; omit coordinates"));
        }
        let is_fractional = |window| is_fractional(&opened.tree, window, coordinates);
        if let Some(window) = window
            && (boundless || is_fractional(window)?)
        {
            let name = if is_fractional(window)? { "fractional" } else { "boundless" };
            let helper = py.import("spinney._arrays")?.getattr(name)?;
            let fill_value = fill.map(|fill| opened.to_python(py, fill.0)).transpose()?;
            let sizes = (level, out_shape, exact);
            let array = helper.call1((slf, bands, window, sizes, masked, fill_value, boundless))?;
            return delivered(array, out);
        }
        let tree = &opened.tree;
        let bands = Bands::of(bands, opened.count())?;
        let part = region_of(tree, window, coordinates)?;
        let pixels = match out_shape {
            Some(shape) => {
                if level.is_some() {
                    return Err(invalid("out_shape, level: got both, expected one of them"));
                }
                if opened.axes() == 3 {
                    return Err(invalid(
                        "out_shape: got an octree, expected a quadtree; read octrees by level, or see `slice`",
                    ));
                }
                let shape = out_size(shape, &bands, opened.count())?;
                let bounds = part.unwrap_or(tree.header().extent_bounds());
                let [height, width] = shape;
                let detail = if exact { Detail::Exact(width, height) } else { Detail::Size(width, height) };
                let mut request = WindowRequest::new(bounds, detail);
                request.nodata = Some(fill_value);
                resampled(py, opened, &request, shape, masked)?
            }
            None => {
                let level = level_of(tree, level)?;
                let bounds = part.map_or_else(|| tree.extent_at(level), |part| at_level(tree, part, level));
                let straight = out.filter(|out| {
                    let [width, height, depth] = bounds.size().map(|size| size as usize);
                    let sizes = [1, depth, height, width];
                    let shape = &sizes[4 - opened.axes()..];
                    match bands {
                        Bands::One(_) => takes_cells(out, opened, shape),
                        Bands::All => {
                            let shape: Vec<_> = std::iter::once(1).chain(shape.iter().copied()).collect();
                            takes_cells(out, opened, &shape)
                        }
                        Bands::Some(_) => false,
                    }
                });
                let pixels = cells(py, opened, level, &bounds, fill_value, masked, straight)?;
                if straight.is_some() {
                    return Ok(pixels.array);
                }
                pixels
            }
        };
        delivered(pixels.finish(py, opened, &bands)?, out)
    }

    /// Returns the cells of an index. A name selects another layer of the file, as a dataset; a
    /// list of names selects several, as the channels of one dataset.
    fn __getitem__<'py>(
        slf: &Bound<'py, Tree>,
        py: Python<'py>,
        key: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        match key.cast::<PyString>() {
            Ok(name) => slf.get().other_layer(slf, name),
            Err(_) => match key.cast::<PyList>().ok().and_then(|names| names.extract::<Vec<String>>().ok()) {
                Some(names) if !names.is_empty() => slf.get().composite(slf, &names),
                _ => slf.get().at_index(py, None, key),
            },
        }
    }

    /// Returns the cells of a level that an index selects.
    #[pyo3(name = "_at_index")]
    fn at_index<'py>(
        &self,
        py: Python<'py>,
        level: Option<i64>,
        key: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let opened = self.get()?;
        let level = level_of(&opened.tree, level)?;
        let axes = opened.axes();
        let extent = opened.tree.extent_at(level).max;
        let shape: Vec<u64> = extent[..axes].iter().rev().copied().collect();
        let along = index::parse(key, &shape)?;
        if let Some(array) = picked(py, &opened, level, &along)? {
            return Ok(array);
        }
        let mut bounds = Bounds { min: [0; 3], max: [1; 3] };
        for (axis, along) in along.iter().rev().enumerate() {
            (bounds.min[axis], bounds.max[axis]) = (along.first, along.end);
        }
        let mut array = if bounds.is_empty() {
            let sizes: Vec<usize> = along.iter().map(|along| (along.end - along.first) as usize).collect();
            let bands = (opened.count() > 1).then_some(opened.count());
            let shape: Vec<usize> = sizes.into_iter().chain(bands).collect();
            empty(py, opened.tree.header().form.value.sample, &shape)?
        } else {
            cells(py, &opened, level, &bounds, opened.void()?, false, None)?.array
        };
        if along.iter().any(|along| along.is_single || along.step != 1) {
            let keys = along.iter().map(|along| {
                if along.is_single {
                    return Ok(PyInt::new(py, 0).into_any());
                }
                // (Reversed, starting at the last cell of the ascending read.)
                py.get_type::<PySlice>().call1((py.None(), py.None(), along.step))
            });
            array = array.get_item(PyTuple::new(py, keys.collect::<PyResult<Vec<_>>>()?)?)?;
        }
        if opened.count() > 1 {
            let last: isize = -1;
            array = py.import("numpy")?.call_method1("moveaxis", (array, last, 0))?;
        }
        Ok(array)
    }
}

/// Cells per selected cell from which the selected cells are read one by one.
const SPARSE: u64 = 64;

/// Returns the cells of an index with large strides, read as points; `None` if it is faster to read
/// all cells in between.
fn picked<'py>(
    py: Python<'py>,
    opened: &Opened,
    level: u8,
    along: &[Along],
) -> PyResult<Option<Bound<'py, PyAny>>> {
    let counts: Vec<u64> = along.iter().map(Along::count).collect();
    let all = along.iter().fold(1u64, |all, along| all.saturating_mul(along.end - along.first));
    let total: u64 = counts.iter().product();
    if total == 0 || total.saturating_mul(SPARSE) > all {
        return Ok(None);
    }
    let cell = |number: u64| {
        let (mut rest, mut cell) = (number, [0; 3]);
        // (The array's last axis is x, which varies fastest.)
        for (axis, (along, count)) in along.iter().zip(&counts).rev().enumerate() {
            cell[axis] = along.at(rest % count);
            rest /= count;
        }
        cell
    };
    let (values, _) = values_at(py, opened, level, opened.void()?, total as usize, &mut |numbers| {
        numbers.map(|number| cell(number as u64)).collect()
    })?;
    let shape = along.iter().zip(&counts).filter(|(along, _)| !along.is_single).map(|(_, count)| *count);
    let bands = (opened.count() > 1).then_some(opened.count() as u64);
    let shape = PyTuple::new(py, shape.chain(bands).collect::<Vec<_>>())?;
    let array = values.call_method1("reshape", (shape,))?;
    let last: isize = -1;
    let is_banded = opened.count() > 1;
    Ok(Some(if is_banded { py.import("numpy")?.call_method1("moveaxis", (array, last, 0))? } else { array }))
}

/// Parses the requested rows and columns: `(rows, columns)`, or `(bands, rows, columns)` as in
/// rasterio.
fn out_size(shape: &Bound<'_, PyAny>, bands: &Bands, count: usize) -> PyResult<[u64; 2]> {
    if let Ok(shape) = shape.extract::<[u64; 2]>() {
        return Ok(shape);
    }
    let wanted = match bands {
        Bands::All => count,
        Bands::One(_) => 1,
        Bands::Some(bands) => bands.len(),
    };
    match shape.extract::<[u64; 3]>() {
        Ok([bands, rows, columns]) if bands == wanted as u64 => Ok([rows, columns]),
        _ => Err(PyValueError::new_err(format!(
            "out_shape: expected (rows, columns) or ({wanted}, rows, columns), got {}",
            shape.repr()?
        ))),
    }
}
