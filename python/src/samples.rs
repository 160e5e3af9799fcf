//! Samples in NumPy arrays.

use numpy::{PyArrayDyn, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use spinney::SampleType;
use zerocopy::IntoBytes;

use crate::buffers::buffer;
use crate::error::invalid;

/// Evaluates an expression with the Rust type of a sample bound to a name.
macro_rules! with_sample {
    ($sample:expr, $S:ident => $body:expr) => {
        match $sample {
            spinney::SampleType::U8 => {
                type $S = u8;
                $body
            }
            spinney::SampleType::U16 => {
                type $S = u16;
                $body
            }
            spinney::SampleType::I16 => {
                type $S = i16;
                $body
            }
            spinney::SampleType::U32 => {
                type $S = u32;
                $body
            }
            spinney::SampleType::I32 => {
                type $S = i32;
                $body
            }
            spinney::SampleType::F32 => {
                type $S = f32;
                $body
            }
            spinney::SampleType::F64 => {
                type $S = f64;
                $body
            }
            spinney::SampleType::I8 => {
                type $S = i8;
                $body
            }
            spinney::SampleType::U64 => {
                type $S = u64;
                $body
            }
            spinney::SampleType::I64 => {
                type $S = i64;
                $body
            }
        }
    };
}

/// Returns the NumPy dtype of samples.
pub(crate) fn dtype(py: Python<'_>, sample: SampleType) -> Bound<'_, PyAny> {
    with_sample!(sample, S => numpy::dtype::<S>(py)).into_any()
}

/// Returns the sample type with this NumPy name; `None` if the library has no such type.
pub(crate) fn sample_of(name: &str) -> Option<SampleType> {
    let names =
        ["uint8", "uint16", "int16", "uint32", "int32", "float32", "float64", "int8", "uint64", "int64"];
    names.iter().position(|known| *known == name).map(|index| SampleType::ALL[index])
}

/// Returns a new, uninitialized array of samples.
pub(crate) fn empty<'py>(
    py: Python<'py>,
    sample: SampleType,
    shape: &[usize],
) -> PyResult<Bound<'py, PyAny>> {
    static EMPTY: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    static FROM_BUFFER: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let count = shape.iter().fold(1usize, |count, length| count.saturating_mul(*length));
    if let Some(buffer) = buffer(py, count.saturating_mul(sample.size()))? {
        let from_buffer = FROM_BUFFER.import(py, "numpy", "frombuffer")?;
        let array = from_buffer.call1((buffer, dtype(py, sample), count))?;
        return array.call_method1("reshape", (pyo3::types::PyTuple::new(py, shape)?,));
    }
    let shape = pyo3::types::PyTuple::new(py, shape)?;
    EMPTY.import(py, "numpy", "empty")?.call1((shape, dtype(py, sample)))
}

/// Returns a new array of flags, all `false`.
pub(crate) fn flags<'py>(py: Python<'py>, shape: &[usize]) -> PyResult<Bound<'py, PyArrayDyn<bool>>> {
    static ZEROS: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    let shape = pyo3::types::PyTuple::new(py, shape)?;
    let made = ZEROS.import(py, "numpy", "zeros")?.call1((shape, numpy::dtype::<bool>(py)))?;
    Ok(made.cast_into::<PyArrayDyn<bool>>()?)
}

/// Calls a function with the bytes of a contiguous array of samples.
pub(crate) fn with_bytes<R>(
    array: &Bound<'_, PyAny>,
    sample: SampleType,
    visit: impl FnOnce(&mut [u8]) -> PyResult<R>,
) -> PyResult<R> {
    with_sample!(sample, S => {
        let array = array.cast::<PyArrayDyn<S>>()?;
        let mut lent = array.try_readwrite().map_err(|error| invalid(format!("out: {error}")))?;
        let slice = lent.as_slice_mut().map_err(|error| invalid(format!("out: {error}")))?;
        visit(slice.as_mut_bytes())
    })
}

/// Appends the bytes of a contiguous array of samples.
pub(crate) fn copy_bytes(array: &Bound<'_, PyAny>, sample: SampleType, bytes: &mut Vec<u8>) -> PyResult<()> {
    with_sample!(sample, S => {
        let lent = array.cast::<PyArrayDyn<S>>()?.try_readonly().map_err(|error| invalid(error.to_string()))?;
        let slice = lent.as_slice().map_err(|error| invalid(error.to_string()))?;
        bytes.extend_from_slice(slice.as_bytes());
    });
    Ok(())
}
