//! The module behind the JavaScript package: questions about files whose bytes others fetch.
//!
//! A question is a text (JSON), and so is most of an answer; samples and meshes are bytes beside it. Nothing in here waits: what a question lacks
//! is told, whoever asks fetches it, [supplies](supply) it and asks again. One thread, and no memory that it shares.

mod answer;
mod failure;
mod files;
mod header;
mod history;
mod model;
mod part;
mod pictures;
mod points;
mod question;
mod search;
mod solid;
mod statistics;
mod windows;
mod zones;

use wasm_bindgen::prelude::wasm_bindgen;

pub use answer::Answer;

/// Says what is to be done where code panics: the message is kept, for whoever calls the module, and which cannot be used any more.
#[wasm_bindgen(start)]
pub fn start() {
    failure::keep_panics();
}

/// The message of the panic that has ended the module.
#[wasm_bindgen(js_name = lastPanic)]
pub fn last_panic() -> Option<String> {
    failure::last_panic()
}

/// Takes up a file of so many bytes, which come in ranges; returns its number. The name is for messages.
#[wasm_bindgen(js_name = addFile)]
pub fn add_file(name: &str, length: f64) -> f64 {
    files::add_ranges(name, length as u64) as f64
}

/// Takes up a file whose bytes are all there; returns its number. The name is for messages.
#[wasm_bindgen(js_name = addBytes)]
pub fn add_bytes(name: &str, bytes: Vec<u8>) -> f64 {
    files::add_bytes(name, bytes) as f64
}

/// Forgets a file. Trees of it that are open stay so.
#[wasm_bindgen(js_name = removeFile)]
pub fn remove_file(file: f64) {
    files::remove(file as u64);
}

/// Takes bytes of a file that were fetched, from an offset on.
#[wasm_bindgen]
pub fn supply(file: f64, offset: f64, bytes: Vec<u8>) {
    files::supply(file as u64, offset as u64, bytes);
}

/// Changes how many bytes of files that come in ranges are held.
#[wasm_bindgen(js_name = setCache)]
pub fn set_cache(bytes: f64) {
    files::set_cache(bytes as u64);
}

/// Closes a tree or a model.
#[wasm_bindgen]
pub fn close(opened: u32) {
    files::close(opened);
}

/// Asks a question with what is there. Coordinates of many places stand beside it.
#[wasm_bindgen]
pub fn ask(question: &str, places: &[f64]) -> Answer {
    question::ask(question, places)
}
