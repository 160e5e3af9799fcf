//! Conversion of the library's errors to Python exceptions.

use std::io;

use pyo3::exceptions::{PyKeyboardInterrupt, PyOSError, PyRuntimeError, PyValueError};
use pyo3::prelude::*;
use spinney::Error;
use spinney::raw::io::redacted;

/// Returns the exception for an error: the library's message, in the exception class that Python's
/// own functions raise.
pub(crate) fn raised(error: Error) -> PyErr {
    let text = message(&error);
    match &error {
        Error::Io { path, doing, cause } => match cause.raw_os_error() {
            // (Python selects the class by the error number: FileNotFoundError, PermissionError,
            // ... It prints number and path.)
            Some(number) => {
                let text = cause.to_string();
                let text = text.split(" (os error").next().unwrap_or_default();
                PyOSError::new_err((number, format!("cannot {doing}: {text}"), path.as_os_str().to_owned()))
            }
            None if cause.kind() == io::ErrorKind::NotFound => {
                pyo3::exceptions::PyFileNotFoundError::new_err(text)
            }
            None if cause.kind() == io::ErrorKind::IsADirectory => {
                pyo3::exceptions::PyIsADirectoryError::new_err(text)
            }
            None => PyOSError::new_err(text),
        },
        Error::Corrupt { .. }
        | Error::NotATree { .. }
        | Error::InsufficientSpace { .. }
        | Error::Locked { .. }
        | Error::Changed { .. }
        | Error::Moved { .. }
        | Error::PlanMismatch { .. }
        | Error::Poisoned { .. } => PyOSError::new_err(text),
        Error::Unsupported { .. }
        | Error::TooLarge { .. }
        | Error::NotASolid { .. }
        | Error::Invalid { .. } => PyValueError::new_err(text),
        Error::Interrupted => PyKeyboardInterrupt::new_err(text),
        _ => PyRuntimeError::new_err(text),
    }
}

/// Returns the message, followed by its causes.
fn message(error: &Error) -> String {
    let mut text = error.to_string();
    let mut cause = std::error::Error::source(error);
    while let Some(error) = cause {
        text.push_str(": ");
        text.push_str(&redacted(&error.to_string()));
        cause = error.source();
    }
    text
}

/// Conversion of the library's results to Python's.
pub(crate) trait OrRaise<T> {
    /// Returns the value, or the error's exception.
    fn or_raise(self) -> PyResult<T>;
}

impl<T> OrRaise<T> for spinney::Result<T> {
    #[inline]
    fn or_raise(self) -> PyResult<T> {
        self.map_err(raised)
    }
}

/// Returns a ValueError for an invalid argument.
pub(crate) fn invalid(text: impl Into<String>) -> PyErr {
    PyValueError::new_err(redacted(&text.into()).into_owned())
}
