//! Conversion of store errors to file errors.

use std::error::Error as _;
use std::io;
use std::path::Path;
use std::time::Duration;

use object_store::Error as StoreError;
use spinney_base::Error;
use spinney_base::io::redacted;

/// Converts the error of a store operation on a file.
pub(super) fn of_store(path: &Path, doing: &'static str, error: StoreError) -> Error {
    match &error {
        StoreError::NotSupported { .. } => {
            let advice = "download the file, or copy it to a host that serves byte ranges";
            return Error::unsupported(path, "a host that sends whole files only", advice);
        }
        StoreError::Precondition { .. } => {
            return Error::Changed { path: path.to_path_buf(), what: "was overwritten" };
        }
        _ => {}
    }
    let kind = match &error {
        StoreError::NotFound { .. } => io::ErrorKind::NotFound,
        StoreError::PermissionDenied { .. } | StoreError::Unauthenticated { .. } => {
            io::ErrorKind::PermissionDenied
        }
        _ => io::ErrorKind::Other,
    };
    Error::io(path, doing)(io::Error::new(kind, text(&error)))
}

/// The error for a request that exceeded its time limit.
pub(super) fn late(path: &Path, doing: &'static str, limit: Duration) -> Error {
    let text = format!(
        "no response within {} s, including all retries (--remote-timeout and SPINNEY_REMOTE_TIMEOUT set the limit)",
        limit.as_secs_f64()
    );
    Error::io(path, doing)(io::Error::new(io::ErrorKind::TimedOut, text))
}

/// Joins the messages of an error and of its causes, without repetitions and secrets in URLs.
fn text(error: &StoreError) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(next) = cause {
        let more = next.to_string();
        if !text.contains(&more) {
            text = format!("{text}: {more}");
        }
        cause = next.source();
    }
    redacted(&text).into_owned()
}
