//! Cells of a mapped file as arrays, without a copy.

use std::sync::Arc;

use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyDict, PyTuple};

use crate::error::OrRaise;
use crate::region::{at_level, level_of, region_of};
use crate::tree::{Opened, Tree};

/// Cells of a mapped file. NumPy arrays keep it alive, and with it the mapping.
#[pyclass(frozen, module = "spinney._native")]
pub(crate) struct StoredCells {
    address: usize,
    shape: Vec<usize>,
    strides: Vec<usize>,
    /// Sample type, as in NumPy's array interface.
    type_name: String,
    /// Open file, which owns the mapping.
    _opened: Arc<Opened>,
}

#[pymethods]
impl StoredCells {
    /// NumPy's array interface, version 3: read-only.
    #[getter]
    fn __array_interface__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let interface = PyDict::new(py);
        interface.set_item("version", 3)?;
        interface.set_item("shape", PyTuple::new(py, &self.shape)?)?;
        interface.set_item("strides", PyTuple::new(py, &self.strides)?)?;
        interface.set_item("typestr", &self.type_name)?;
        interface.set_item("data", (self.address, true))?;
        Ok(interface)
    }
}

#[pymethods]
impl Tree {
    /// Returns a region's cells as a read-only array on the mapped file; `None` if they are not
    /// stored as rows.
    #[pyo3(signature = (window=None, coordinates=None, level=None))]
    #[pyo3(name = "_mapped")]
    fn mapped<'py>(
        &self,
        py: Python<'py>,
        window: Option<&Bound<'py, PyAny>>,
        coordinates: Option<&Bound<'py, PyAny>>,
        level: Option<i64>,
    ) -> PyResult<Option<Bound<'py, PyAny>>> {
        static ASARRAY: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
        let opened = self.get()?;
        let level = level_of(&opened.tree, level)?;
        let part = region_of(&opened.tree, window, coordinates)?;
        let bounds =
            part.map_or_else(|| opened.tree.extent_at(level), |part| at_level(&opened.tree, part, level));
        let stored = py.detach(|| opened.tree.stored_rows(level, &bounds)).or_raise()?;
        let Some(stored) = stored else { return Ok(None) };
        let value = opened.tree.header().form.value;
        let [width, height, depth] = bounds.size().map(|size| size as usize);
        let (mut shape, mut strides) =
            (vec![depth, height, width], vec![stored.layer, stored.row, value.size()]);
        if opened.axes() == 2 {
            shape.remove(0);
            strides.remove(0);
        }
        if value.channels > 1 {
            shape.insert(0, value.channels.into());
            strides.insert(0, value.sample.size());
        }
        let name = value.sample.name();
        // (Rust's type name is a letter, followed by bits.)
        let type_name = format!("<{}{}", &name[..1], value.sample.size());
        let address = stored.bytes.as_ptr().addr();
        let cells = StoredCells { address, shape, strides, type_name, _opened: opened };
        ASARRAY.import(py, "numpy", "asarray")?.call1((Bound::new(py, cells)?,)).map(Some)
    }
}
