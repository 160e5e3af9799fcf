//! Recycled array memory: pages that are already mapped need not be allocated and zeroed by the
//! kernel again.

use std::sync::{Mutex, PoisonError};

use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyByteArray;

/// Size range, in bytes, of the buffers that are recycled. The allocator recycles smaller ones
/// itself; larger ones take longer to read than to allocate.
const LEAST: usize = 1 << 15;
const MOST: usize = 4 << 20;
/// Maximum number of buffers.
const KEPT: usize = 8;

/// All buffers, including those in use: an array holds a reference to its buffer, too.
static BUFFERS: Mutex<Vec<Py<PyByteArray>>> = Mutex::new(Vec::new());

/// Returns an uninitialized buffer of at least `bytes` bytes; `None` if the size is out of range or
/// all buffers are in use.
pub(crate) fn buffer(py: Python<'_>, bytes: usize) -> PyResult<Option<Bound<'_, PyByteArray>>> {
    static REFERENCES: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    if !(LEAST..=MOST).contains(&bytes) {
        return Ok(None);
    }
    let references = REFERENCES.import(py, "sys", "getrefcount")?;
    let mut buffers = BUFFERS.lock().unwrap_or_else(PoisonError::into_inner);
    let mut free = None;
    for (index, buffer) in buffers.iter().enumerate() {
        let buffer = buffer.bind(py);
        // Invariant: an array, and any view of it, holds a reference to its buffer. Two references
        // are the list's and this call's own. No other can appear meanwhile, since the
        // interpreter's lock is held.
        if references.call1((buffer,))?.extract::<usize>()? <= 2 {
            if (bytes..=2 * bytes).contains(&buffer.len()) {
                return Ok(Some(buffer.clone()));
            }
            free = Some(index);
        }
    }
    if buffers.len() >= KEPT && free.is_none() {
        return Ok(None);
    }
    let made = PyByteArray::new_with(py, bytes.next_multiple_of(1 << 12), |_| Ok(()))?;
    match free.filter(|_| buffers.len() >= KEPT) {
        Some(index) => buffers[index] = made.clone().unbind(),
        None => buffers.push(made.clone().unbind()),
    }
    Ok(Some(made))
}
