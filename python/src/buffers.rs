//! Memory of arrays that nobody has any more, for the next ones: pages that are there already need not be asked for and cleared.

use std::sync::{Mutex, PoisonError};

use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyByteArray;

/// Bytes of an array that is worth it: smaller ones the allocator keeps itself, larger ones take longer to read than to allocate.
const LEAST: usize = 1 << 15;
const MOST: usize = 4 << 20;
/// Buffers that are kept.
const KEPT: usize = 8;

/// Buffers, those in use among them: whoever has an array holds its buffer, too.
static BUFFERS: Mutex<Vec<Py<PyByteArray>>> = Mutex::new(Vec::new());

/// A buffer of at least so many bytes, which may be anything; `None` where there is none to be had.
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
        // Invariant: an array holds a reference to its buffer for as long as it, or any view of it, is there. Two references are
        // ours and that of the question, and no other can come meanwhile: the interpreter's lock is held.
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
