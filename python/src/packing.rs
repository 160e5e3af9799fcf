//! Packing of new trees, and the cache of unpacked segments.

use pyo3::prelude::*;
use spinney::raw::store;
use spinney::{Codec, WriteOptions};

use crate::error::{OrRaise, invalid};
use crate::jobs::access;

/// Packing of segments: name of the codec, and optionally the maximum error.
#[derive(Clone, Copy)]
pub(crate) struct Packing(pub(crate) store::Packing);

impl<'py> FromPyObject<'_, 'py> for Packing {
    type Error = PyErr;

    fn extract(given: Borrowed<'_, 'py, PyAny>) -> PyResult<Packing> {
        let (codec, max_error): (String, Option<f64>) = given.extract()?;
        let packing = match codec.parse().or_raise()? {
            Codec::Plain => store::Packing::default(),
            Codec::Packed | Codec::Reference => store::Packing::packed(),
        };
        Ok(Packing(packing.max_error(max_error)))
    }
}

impl Packing {
    /// Returns the write options for a tree, with `memory` bytes.
    pub(crate) fn with(self, memory: u64) -> WriteOptions {
        WriteOptions::new(memory).packing(self.0)
    }

    /// Returns the codec for an exact model, which allows no rounding.
    pub(crate) fn of_model(self) -> PyResult<Codec> {
        match self.0.max_error {
            None => Ok(self.0.codec),
            Some(_) => Err(invalid("max_error: does not apply to exact models")),
        }
    }
}

/// Sets the size in bytes of the cache of unpacked segments.
#[pyfunction]
pub(crate) fn set_cache_memory(bytes: u64) {
    access().unpacked().set_limit(bytes);
}
