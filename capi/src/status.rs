//! Status codes, and the last error message of each thread.

use std::any::Any;
use std::cell::RefCell;
use std::ffi::{CString, c_char};
use std::io::ErrorKind;
use std::panic::{self, AssertUnwindSafe};
use std::sync::Once;

use engine::Error;
use engine::raw::io::redacted;

/// The outcome of a call.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum spinney_status {
    /// Success.
    SPINNEY_OK = 0,
    /// An argument is invalid, by itself or for this file. Includes NULL, and buffers of the wrong
    /// size.
    SPINNEY_INVALID = 1,
    /// The file does not exist.
    SPINNEY_NOT_FOUND = 2,
    /// The system refused an operation on a file.
    SPINNEY_IO = 3,
    /// The file is corrupt, or has another type than expected.
    SPINNEY_CORRUPT = 4,
    /// The file, or the call, needs a feature that is not supported.
    SPINNEY_UNSUPPORTED = 5,
    /// Another program changed the file while it was read.
    SPINNEY_CHANGED = 6,
    /// Out of memory, or over the memory limit.
    SPINNEY_MEMORY = 7,
    /// A function of the caller stopped the call.
    SPINNEY_STOPPED = 8,
    /// A bug in the library. The dataset can still be closed.
    SPINNEY_INTERNAL = 9,
}

/// A status code with its message.
pub(crate) struct Failure {
    status: spinney_status,
    text: String,
}

impl Failure {
    pub(crate) fn invalid(text: impl Into<String>) -> Failure {
        Failure { status: spinney_status::SPINNEY_INVALID, text: text.into() }
    }

    pub(crate) fn stopped() -> Failure {
        Failure {
            status: spinney_status::SPINNEY_STOPPED,
            text: "the caller's function stopped the call".into(),
        }
    }

    pub(crate) fn memory(bytes: u64) -> Failure {
        Failure { status: spinney_status::SPINNEY_MEMORY, text: format!("no memory for {bytes} bytes") }
    }

    pub(crate) fn unsupported(text: impl Into<String>) -> Failure {
        Failure { status: spinney_status::SPINNEY_UNSUPPORTED, text: text.into() }
    }

    pub(crate) fn not_stored() -> Failure {
        let text = "the file does not have this box in rows; read it instead".into();
        Failure { status: spinney_status::SPINNEY_UNSUPPORTED, text }
    }

    fn panicked(cause: &(dyn Any + Send)) -> Failure {
        let text = cause.downcast_ref::<&str>().map(|text| (*text).to_owned());
        let text = text.or_else(|| cause.downcast_ref::<String>().cloned()).unwrap_or_default();
        Failure { status: spinney_status::SPINNEY_INTERNAL, text: format!("bug in the library: {text}") }
    }
}

impl From<Error> for Failure {
    fn from(error: Error) -> Failure {
        use spinney_status::*;
        let status = match &error {
            Error::Io { cause, .. } if cause.kind() == ErrorKind::NotFound => SPINNEY_NOT_FOUND,
            Error::Io { .. }
            | Error::InsufficientSpace { .. }
            | Error::Locked { .. }
            | Error::Poisoned { .. } => SPINNEY_IO,
            Error::Corrupt { .. } | Error::NotATree { .. } => SPINNEY_CORRUPT,
            Error::Unsupported { .. } => SPINNEY_UNSUPPORTED,
            Error::Changed { .. } | Error::Moved { .. } | Error::PlanMismatch { .. } => SPINNEY_CHANGED,
            Error::TooLarge { .. } => SPINNEY_MEMORY,
            Error::Interrupted => SPINNEY_STOPPED,
            _ => SPINNEY_INVALID,
        };
        let mut text = error.to_string();
        let mut cause = std::error::Error::source(&error);
        while let Some(next) = cause {
            text += &format!(": {}", redacted(&next.to_string()));
            cause = next.source();
        }
        Failure { status, text }
    }
}

thread_local! {
    static LAST: RefCell<CString> = RefCell::default();
}

/// Runs the body of a call: stores the error message for the thread, and catches panics.
pub(crate) fn guarded(work: impl FnOnce() -> Result<(), Failure>) -> spinney_status {
    // Panics print nothing. (The hook is that of this library's own runtime, not of the program
    // that uses it.)
    static SILENT: Once = Once::new();
    SILENT.call_once(|| panic::set_hook(Box::new(|_| {})));
    let done = panic::catch_unwind(AssertUnwindSafe(work));
    let failure = match done {
        Ok(Ok(())) => return spinney_status::SPINNEY_OK,
        Ok(Err(failure)) => failure,
        Err(cause) => Failure::panicked(&*cause),
    };
    LAST.with(|last| *last.borrow_mut() = text_of(failure.text));
    failure.status
}

/// Converts to a C string, without zero bytes.
pub(crate) fn text_of(text: String) -> CString {
    let text: Vec<u8> = text.into_bytes().into_iter().filter(|byte| *byte != 0).collect();
    CString::new(text).unwrap_or_default()
}

/// Returns the message of the thread's last failure: which file, what was found, what was expected.
/// Empty if there was none. Valid until the thread's next call that fails.
#[unsafe(no_mangle)]
pub extern "C" fn spinney_error() -> *const c_char {
    LAST.with(|last| last.borrow().as_ptr())
}

/// Returns the library's version.
#[unsafe(no_mangle)]
pub extern "C" fn spinney_version() -> *const c_char {
    concat!(env!("CARGO_PKG_VERSION"), "\0").as_ptr().cast()
}
