//! The WebAssembly module of the JavaScript package: queries of files whose bytes JavaScript
//! fetches.
//!
//! A query is a JSON string, and so is most of its result; samples and meshes are separate byte
//! arrays. No call waits: a query reports the ranges that it lacks, and the caller fetches and
//! [supplies](supply) them, and repeats the query. There is one thread, and no shared memory.

mod failure;
mod files;
mod header;
mod history;
mod images;
mod model;
mod points;
mod query;
mod region;
mod result;
mod search;
mod solid;
mod sources;
mod statistics;
mod windows;
mod zones;

use wasm_bindgen::prelude::wasm_bindgen;

pub use result::QueryResult;

/// Installs the panic hook, and the reader of cells in other files. The hook stores the message for
/// the caller, who cannot use the module any more.
#[wasm_bindgen(start)]
pub fn start() {
    failure::keep_panics();
    spinney_references::register();
}

/// Returns the message of the panic that has ended the module.
#[wasm_bindgen(js_name = lastPanic)]
pub fn last_panic() -> Option<String> {
    failure::last_panic()
}

/// Adds a file of `length` bytes, which are supplied in ranges; returns its number. The name is for
/// messages.
#[wasm_bindgen(js_name = addFile)]
pub fn add_file(name: &str, length: f64) -> f64 {
    files::add_ranges(name, length as u64) as f64
}

/// Adds a file whose bytes are complete; returns its number. The name is for messages.
#[wasm_bindgen(js_name = addBytes)]
pub fn add_bytes(name: &str, bytes: Vec<u8>) -> f64 {
    files::add_bytes(name, bytes) as f64
}

/// Describes a source of an index, by its number in [`QueryResult::missing`]: JSON with its path or
/// URL, and its length and version when it was indexed; `null` for other files.
#[wasm_bindgen(js_name = describeSource)]
pub fn describe_source(file: f64) -> String {
    sources::describe(file as u64).to_string()
}

/// Removes a file, and its sources if it is an index. Its open trees stay open.
#[wasm_bindgen(js_name = removeFile)]
pub fn remove_file(file: f64) {
    files::remove(file as u64);
}

/// Supplies fetched bytes of a file, starting at an offset.
#[wasm_bindgen]
pub fn supply(file: f64, offset: f64, bytes: Vec<u8>) {
    files::supply(file as u64, offset as u64, bytes);
}

/// Sets the size in bytes of the range cache.
#[wasm_bindgen(js_name = setCache)]
pub fn set_cache(bytes: f64) {
    files::set_cache(bytes as u64);
}

/// Closes a tree or a model.
#[wasm_bindgen]
pub fn close(opened: u32) {
    files::close(opened);
}

/// Runs a query on the available bytes. The coordinates of many points are passed separately.
#[wasm_bindgen]
pub fn query(request: &str, coordinates: &[f64]) -> QueryResult {
    query::run(request, coordinates)
}
