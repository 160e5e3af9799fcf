//! Array indices as in NumPy's basic indexing: integers, slices and `...`.

use pyo3::exceptions::{PyIndexError, PyTypeError};
use pyo3::prelude::*;
use pyo3::types::{PyEllipsis, PySlice, PyTuple};

/// Selected cells along an axis.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Along {
    /// First cell, in the order of the axis; `end` is exclusive.
    pub(crate) first: u64,
    pub(crate) end: u64,
    /// Stride between cells, negative for reversed order.
    pub(crate) step: i64,
    /// Whether this is a single cell; the result has no such axis.
    pub(crate) is_single: bool,
}

impl Along {
    /// Returns the number of cells.
    pub(crate) fn count(&self) -> u64 {
        (self.end - self.first).div_ceil(self.step.unsigned_abs())
    }

    /// Returns a cell by its number in the order of the index.
    pub(crate) fn at(&self, number: u64) -> u64 {
        let away = number * self.step.unsigned_abs();
        if self.step > 0 { self.first + away } else { self.end - 1 - away }
    }

    fn all(length: u64) -> Along {
        Along { first: 0, end: length, step: 1, is_single: false }
    }

    fn of(key: &Bound<'_, PyAny>, axis: usize, length: u64) -> PyResult<Along> {
        if let Ok(slice) = key.cast::<PySlice>() {
            let length = isize::try_from(length).map_err(|_| PyIndexError::new_err("too many cells"))?;
            let found = slice.indices(length)?;
            let (start, step, count) = (found.start as i64, found.step as i64, found.slicelength as i64);
            let last = start + (count - 1) * step;
            let (first, end) = match count {
                0 => (0, 0),
                _ => (start.min(last) as u64, start.max(last) as u64 + 1),
            };
            return Ok(Along { first, end, step, is_single: false });
        }
        let index: i64 = key.extract().map_err(|_| {
            let name = key.get_type().name().map_or_else(|_| "object".into(), |name| name.to_string());
            PyTypeError::new_err(format!(
                "index: got {name}, expected integers, slices and `...`; use `sample` for lists of positions"
            ))
        })?;
        let from_start = if index < 0 { index.checked_add_unsigned(length) } else { Some(index) };
        let cell = from_start.and_then(|index| u64::try_from(index).ok()).filter(|cell| *cell < length);
        let cell = cell.ok_or_else(|| {
            PyIndexError::new_err(format!(
                "index {index} is out of bounds for axis {axis} with size {length}"
            ))
        })?;
        Ok(Along { first: cell, end: cell + 1, step: 1, is_single: true })
    }
}

/// Returns the cells along each axis that an index selects in an array of this shape.
pub(crate) fn parse(key: &Bound<'_, PyAny>, shape: &[u64]) -> PyResult<Vec<Along>> {
    let keys: Vec<Bound<'_, PyAny>> = match key.cast::<PyTuple>() {
        Ok(tuple) => tuple.iter().collect(),
        Err(_) => vec![key.clone()],
    };
    let is_dots = |key: &Bound<'_, PyAny>| key.is_instance_of::<PyEllipsis>();
    let dots = keys.iter().filter(|key| is_dots(key)).count();
    if dots > 1 {
        return Err(PyIndexError::new_err("index: got several `...`, expected at most one"));
    }
    let given = keys.len() - dots;
    let left = shape.len().checked_sub(given).ok_or_else(|| {
        let axes = shape.len();
        PyIndexError::new_err(format!("index: got {given} indices, expected at most {axes}, one per axis"))
    })?;
    let mut parts = Vec::with_capacity(shape.len());
    for key in &keys {
        if is_dots(key) {
            parts.extend((0..left).map(|more| Along::all(shape[parts.len() + more])).collect::<Vec<_>>());
        } else {
            let axis = parts.len();
            parts.push(Along::of(key, axis, shape[axis])?);
        }
    }
    parts.extend(shape[parts.len()..].iter().map(|length| Along::all(*length)));
    Ok(parts)
}
