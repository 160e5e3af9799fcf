//! Results of queries, for JavaScript.

use serde_json::Value;
use spinney_base::value::{Number, SampleType};
use spinney_report::JsonNumbers;
use wasm_bindgen::prelude::wasm_bindgen;

/// The result of a query: its value, the ranges that it lacks, or an error.
#[wasm_bindgen]
pub struct QueryResult {
    text: String,
    buffers: Vec<Vec<u8>>,
    missing: Vec<f64>,
    is_failure: bool,
}

#[wasm_bindgen]
impl QueryResult {
    /// JSON: the value, or the error.
    #[wasm_bindgen(getter)]
    pub fn text(&self) -> String {
        self.text.clone()
    }

    /// Whether the text is an error.
    #[wasm_bindgen(getter, js_name = isFailure)]
    pub fn is_failure(&self) -> bool {
        self.is_failure
    }

    /// Ranges that the query lacks, three numbers each: file, first byte, exclusive end. If there
    /// are any, there is no result yet.
    #[wasm_bindgen(getter)]
    pub fn missing(&self) -> Vec<f64> {
        self.missing.clone()
    }

    /// Moves one of the result's byte arrays out.
    pub fn take(&mut self, number: usize) -> Vec<u8> {
        self.buffers.get_mut(number).map_or_else(Vec::new, std::mem::take)
    }
}

impl QueryResult {
    /// Creates a result that lacks ranges.
    pub(crate) fn missing_ranges(missing: Vec<f64>) -> QueryResult {
        QueryResult { text: String::new(), buffers: Vec::new(), missing, is_failure: false }
    }

    /// Creates a result from an error.
    pub(crate) fn failed(error: &Value) -> QueryResult {
        QueryResult { text: error.to_string(), buffers: Vec::new(), missing: Vec::new(), is_failure: true }
    }
}

/// The value of a query: JSON, and separate byte arrays.
#[derive(Default)]
pub(crate) struct Found {
    pub(crate) json: Value,
    pub(crate) buffers: Vec<Vec<u8>>,
}

impl From<Value> for Found {
    fn from(json: Value) -> Found {
        Found { json, buffers: Vec::new() }
    }
}

impl From<Found> for QueryResult {
    fn from(found: Found) -> QueryResult {
        let (text, buffers) = (found.json.to_string(), found.buffers);
        QueryResult { text, buffers, missing: Vec::new(), is_failure: false }
    }
}

/// Returns a sample as JSON for JavaScript.
pub(crate) fn sample(number: Number, of: SampleType) -> Value {
    JsonNumbers::Marked.sample(number, of)
}

/// Returns a count as JSON for JavaScript.
pub(crate) fn count(count: u64) -> Value {
    JsonNumbers::Marked.count(count)
}

/// Returns numbers as little-endian bytes.
pub(crate) fn bytes_of<const N: usize, T: Copy>(numbers: &[T], to: fn(T) -> [u8; N]) -> Vec<u8> {
    numbers.iter().flat_map(|number| to(*number)).collect()
}
