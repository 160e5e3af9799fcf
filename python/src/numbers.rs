//! Single samples, converted from and to Python; integers stay exact.

use std::collections::BTreeMap;

use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyFloat, PyInt};
use spinney::{Number, SampleType};

/// Number from Python: an int (also NumPy's), or a float.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct PyNumber(pub(crate) Number);

impl<'py> FromPyObject<'_, 'py> for PyNumber {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        if !object.is_instance_of::<PyFloat>() {
            // (An object with `__index__` is an integer.)
            if let Ok(number) = object.extract::<u64>() {
                return Ok(PyNumber(number.into()));
            }
            if let Ok(number) = object.extract::<i64>() {
                return Ok(PyNumber(number.into()));
            }
        }
        let number: f64 = object.extract().map_err(|_| {
            let kind =
                object.get_type().name().map_or_else(|_| "something else".into(), |name| name.to_string());
            PyTypeError::new_err(format!("expected a number, got {kind}"))
        })?;
        // (An integer of more than 64 bits is rounded to a float, but must not become one that
        // fits: -2^63 - 1 is not -2^63.)
        let is_wide = object.is_instance_of::<PyInt>();
        Ok(PyNumber(if is_wide && number == i64::MIN as f64 { number.next_down() } else { number }.into()))
    }
}

/// Converts a number for Python: to an int if samples are integers and it is one (as `1e3` in a
/// file), else to a float.
pub(crate) fn to_python<'py>(
    py: Python<'py>,
    number: Number,
    sample: SampleType,
) -> PyResult<Bound<'py, PyAny>> {
    Ok(match number.to_integer().filter(|_| !sample.is_float()) {
        Some(number) => number.into_pyobject(py)?.into_any(),
        None => number.to_f64().into_pyobject(py)?.into_any(),
    })
}

/// Converts a number for Python: to an int if it is one, else to a float.
pub(crate) fn plain(py: Python<'_>, number: Number) -> PyResult<Bound<'_, PyAny>> {
    Ok(match number {
        Number::Unsigned(number) => number.into_pyobject(py)?.into_any(),
        Number::Signed(number) => number.into_pyobject(py)?.into_any(),
        number => number.to_f64().into_pyobject(py)?.into_any(),
    })
}

/// Returns class names for Python, by value.
pub(crate) fn names_to_python<'py>(
    py: Python<'py>,
    names: &BTreeMap<Number, String>,
    sample: SampleType,
) -> PyResult<Vec<(Bound<'py, PyAny>, String)>> {
    names.iter().map(|(value, name)| Ok((class_to_python(py, *value, sample)?, name.clone()))).collect()
}

/// Converts a class value for Python: to an int if it is one, whatever the sample type.
fn class_to_python<'py>(py: Python<'py>, number: Number, sample: SampleType) -> PyResult<Bound<'py, PyAny>> {
    match number.to_integer() {
        Some(number) => Ok(number.into_pyobject(py)?.into_any()),
        None => to_python(py, number, sample),
    }
}

/// Converts class names from Python.
pub(crate) fn names_of(names: &BTreeMap<PyNumber, String>) -> BTreeMap<Number, String> {
    names.iter().map(|(value, name)| (value.0, name.clone())).collect()
}
