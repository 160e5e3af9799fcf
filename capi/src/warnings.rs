//! Warnings of calls that make files, as texts for the thread that has called.

use std::cell::RefCell;
use std::ffi::{CString, c_char};
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use engine::Progress;

use crate::status::text_of;

thread_local! {
    static LAST: RefCell<CString> = RefCell::default();
}

/// Warnings of a call, which are kept for its thread at the end, also where it fails.
pub(crate) struct Warnings(Mutex<Vec<String>>);

impl Warnings {
    /// Begins a call: what the one before has told is forgotten.
    pub(crate) fn begin() -> Warnings {
        LAST.with(|last| *last.borrow_mut() = CString::default());
        Warnings(Mutex::default())
    }
}

impl Progress for Warnings {
    fn warn(&self, file: &Path, text: &str) {
        // (A line each, whatever names of files have in them.)
        let line = format!("{}: {text}", file.display()).replace(['\n', '\r'], " ");
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(line);
    }
}

impl Drop for Warnings {
    fn drop(&mut self) {
        let lines = self.0.get_mut().unwrap_or_else(PoisonError::into_inner);
        LAST.with(|last| *last.borrow_mut() = text_of(lines.join("\n")));
    }
}

/// Warnings of this thread's last call of spinney_model_build() or spinney_model_combine(), a line for each, beginning with the file that it is
/// about: what users should know of a file that was made all the same, such as a repair that changes the volume by more than a hundredth, or values of
/// faces that are not kept. Empty if there was nothing; it is there until the thread's next such call.
#[unsafe(no_mangle)]
pub extern "C" fn spinney_warnings() -> *const c_char {
    LAST.with(|last| last.borrow().as_ptr())
}
