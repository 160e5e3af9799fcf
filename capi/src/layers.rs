//! Layers of a file: trees of one space, each with its own type, depth and name.

use std::ffi::{CStr, c_char};

use crate::dataset::{opened, spinney_dataset};
use crate::status::{Failure, guarded, spinney_status};

/// For spinney_open_layer(): resample the layer to the cells of the given dataset.
pub const SPINNEY_ALIGNED: u32 = 1;

/// Writes the layer count of the dataset's file to `count`; 1 for a view.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_layer_count(
    dataset: *const spinney_dataset,
    count: *mut usize,
) -> spinney_status {
    guarded(|| {
        // SAFETY: see `opened`.
        let dataset = unsafe { opened(dataset) }?;
        // SAFETY: it is NULL, or points to the caller's variable.
        let count = unsafe { count.as_mut() }
            .ok_or_else(|| Failure::invalid("count: got NULL, expected a pointer"))?;
        *count = dataset.layers()?.len();
        Ok(())
    })
}

/// Returns the name of a layer of the dataset's file, by its index from 0. The name may be empty if
/// the file has one layer. The string belongs to the dataset, and is valid until the dataset is
/// closed or refreshed. NULL if there is no layer with that index, or no dataset.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_layer_name(dataset: *const spinney_dataset, number: usize) -> *const c_char {
    let mut name = std::ptr::null();
    guarded(|| {
        // SAFETY: see `opened`.
        let layers = unsafe { opened(dataset) }?.layers()?;
        let layer = layers.get(number).ok_or_else(|| {
            let expected = format!("less than {}", layers.len());
            Failure::invalid(format!("layer: got number {number}, expected {expected}"))
        })?;
        name = layer.as_ptr();
        Ok(())
    });
    name
}

/// Opens another layer of a dataset's file, at the same commit. `layer` is its name, or else its
/// index from 0 in digits. The file is not opened again. Close each of the two datasets with
/// spinney_close(), in any order. `flags` is 0 or SPINNEY_ALIGNED: the layer then has the dataset's
/// size and depth, and larger cells are repeated. SPINNEY_UNSUPPORTED for a view: name the layer in
/// spinney_open() instead.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_open_layer(
    dataset: *const spinney_dataset,
    layer: *const c_char,
    flags: u32,
    opened_layer: *mut *mut spinney_dataset,
) -> spinney_status {
    guarded(|| {
        // SAFETY: see `opened`.
        let dataset = &unsafe { opened(dataset) }?.dataset;
        if layer.is_null() || opened_layer.is_null() {
            return Err(Failure::invalid(
                "spinney_open_layer: got NULL, expected a layer, and a pointer to the dataset",
            ));
        }
        if flags & !SPINNEY_ALIGNED != 0 {
            return Err(Failure::invalid(format!(
                "spinney_open_layer: got flags {flags}, expected 0 or SPINNEY_ALIGNED"
            )));
        }
        // SAFETY: the caller passes a zero-terminated string.
        let layer = unsafe { CStr::from_ptr(layer) };
        let layer = layer.to_str().map_err(|_| Failure::invalid("layer: got other bytes, expected UTF-8"))?;
        let found =
            if flags == SPINNEY_ALIGNED { dataset.aligned_layer(layer) } else { dataset.layer(layer) }?;
        // SAFETY: `opened_layer` is not NULL, and points to the caller's pointer.
        unsafe { spinney_dataset::write_handle(found, opened_layer) };
        Ok(())
    })
}
