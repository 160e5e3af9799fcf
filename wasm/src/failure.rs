//! Errors and panics, for JavaScript.

use std::error::Error as _;
use std::sync::Mutex;

use serde_json::{Value, json};
use spinney_base::Error;

static LAST: Mutex<Option<String>> = Mutex::new(None);

/// Installs a hook that stores the message of a panic, after which the module cannot run any more.
pub(crate) fn keep_panics() {
    std::panic::set_hook(Box::new(|panic| {
        if let Ok(mut last) = LAST.try_lock() {
            *last = Some(panic.to_string());
        }
    }));
}

/// Returns the message of the last panic.
pub(crate) fn last_panic() -> Option<String> {
    LAST.try_lock().ok().and_then(|mut last| last.take())
}

/// Returns an error as JSON: its kind, its message, and the fields of the message.
pub(crate) fn as_json(error: &Error) -> Value {
    let mut message = error.to_string();
    if let Some(cause) = error.source() {
        message.push_str(&format!(": {cause}"));
    }
    let mut json = match error {
        Error::Io { path, doing, .. } => json!({ "code": "io", "file": path, "doing": doing }),
        Error::Corrupt { path, location: place, found, expected } => {
            json!({ "code": "corrupt", "file": path, "place": place, "found": found, "expected": expected })
        }
        Error::Unsupported { path, found, advice } => {
            json!({ "code": "unsupported", "file": path, "found": found, "advice": advice })
        }
        Error::NotATree { path, found, advice } => {
            json!({ "code": "no-tree", "file": path, "found": found, "advice": advice })
        }
        Error::NotASolid { path, what, advice, .. } => {
            json!({ "code": "no-body", "file": path, "found": what, "advice": advice })
        }
        Error::TooLarge { path, what, needed, limit, advice } => {
            let (found, expected) = (format!("{what}: {needed} bytes"), format!("at most {limit} bytes"));
            json!({ "code": "too-large", "file": path, "found": found, "expected": expected, "advice": advice })
        }
        Error::Changed { path, what } => json!({ "code": "changed", "file": path, "found": what }),
        Error::Invalid { what, found, expected } => {
            json!({ "code": "invalid", "place": what, "found": found, "expected": expected })
        }
        _ => json!({ "code": "other" }),
    };
    json["message"] = message.into();
    json
}

/// Returns the error for a result with too many bytes.
pub(crate) fn too_large(path: &std::path::Path, what: &str, needed: u64, limit: u64) -> Error {
    let advice = "request a smaller region or a coarser level".into();
    Error::TooLarge { path: path.into(), what: what.into(), needed, limit, advice }
}
