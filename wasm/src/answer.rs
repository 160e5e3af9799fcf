//! Answers, as JavaScript takes them.

use serde_json::Value;
use spinney_base::value::{Number, SampleType};
use spinney_report::JsonNumbers;
use wasm_bindgen::prelude::wasm_bindgen;

/// The answer to a question: what it is, or what it lacks, or why there is none.
#[wasm_bindgen]
pub struct Answer {
    text: String,
    buffers: Vec<Vec<u8>>,
    missing: Vec<f64>,
    is_failure: bool,
}

#[wasm_bindgen]
impl Answer {
    /// JSON: the answer, or the error.
    #[wasm_bindgen(getter)]
    pub fn text(&self) -> String {
        self.text.clone()
    }

    /// Whether the text is an error.
    #[wasm_bindgen(getter, js_name = isFailure)]
    pub fn is_failure(&self) -> bool {
        self.is_failure
    }

    /// Ranges that the question lacks: three numbers each, of the file, the first byte and the one behind the last. If there are any, there is
    /// no answer yet.
    #[wasm_bindgen(getter)]
    pub fn missing(&self) -> Vec<f64> {
        self.missing.clone()
    }

    /// Takes one of the arrays of bytes that belong to the answer.
    pub fn take(&mut self, number: usize) -> Vec<u8> {
        self.buffers.get_mut(number).map_or_else(Vec::new, std::mem::take)
    }
}

impl Answer {
    /// An answer that lacks ranges.
    pub(crate) fn missing_ranges(missing: Vec<f64>) -> Answer {
        Answer { text: String::new(), buffers: Vec::new(), missing, is_failure: false }
    }

    /// An error.
    pub(crate) fn failed(error: &Value) -> Answer {
        Answer { text: error.to_string(), buffers: Vec::new(), missing: Vec::new(), is_failure: true }
    }
}

/// An answer as it was found: JSON, and bytes beside it.
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

impl From<Found> for Answer {
    fn from(found: Found) -> Answer {
        let (text, buffers) = (found.json.to_string(), found.buffers);
        Answer { text, buffers, missing: Vec::new(), is_failure: false }
    }
}

/// A sample, as JavaScript reads it.
pub(crate) fn sample(number: Number, of: SampleType) -> Value {
    JsonNumbers::Marked.sample(number, of)
}

/// A count, as JavaScript reads it.
pub(crate) fn count(count: u64) -> Value {
    JsonNumbers::Marked.count(count)
}

/// Numbers as little-endian bytes.
pub(crate) fn bytes_of<const N: usize, T: Copy>(numbers: &[T], to: fn(T) -> [u8; N]) -> Vec<u8> {
    numbers.iter().flat_map(|number| to(*number)).collect()
}
