//! Packing of trees that are written, and the cache of what is unpacked.

use pyo3::prelude::*;
use spinney::io::RangeCache;
use spinney::store::{Codec, Effort, WriteOptions};

use crate::error::{OrRaise, invalid};

/// Packing of segments: the name of the codec, and that of the effort, if one is said.
#[derive(Clone, Copy)]
pub(crate) struct Packing {
    pub(crate) codec: Codec,
    pub(crate) effort: Effort,
}

impl<'py> FromPyObject<'_, 'py> for Packing {
    type Error = PyErr;

    fn extract(given: Borrowed<'_, 'py, PyAny>) -> PyResult<Packing> {
        let (codec, effort): (String, Option<String>) = given.extract()?;
        let codec: Codec = codec.parse().or_raise()?;
        if codec == Codec::Plain && effort.is_some() {
            return Err(invalid("effort: is for codec=\"packed\""));
        }
        let effort = effort.map(|name| WriteOptions::effort_named(&name)).transpose().or_raise()?;
        Ok(Packing { codec, effort: effort.unwrap_or_default() })
    }
}

impl Packing {
    /// The way in which a tree is written, with so much memory.
    pub(crate) fn with(self, memory: u64) -> WriteOptions {
        WriteOptions::new(memory).packed(self.codec, self.effort)
    }
}

/// Changes how many bytes of packed segments, unpacked, are kept for the next use.
#[pyfunction]
pub(crate) fn set_cache_memory(bytes: u64) {
    RangeCache::unpacked().set_limit(bytes);
}
