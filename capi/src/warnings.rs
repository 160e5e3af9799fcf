//! Warnings of calls that make files, as strings for the calling thread.

use std::cell::RefCell;
use std::ffi::{CString, c_char};
use std::path::Path;
use std::sync::{Mutex, PoisonError};

use engine::Progress;

use crate::status::text_of;

thread_local! {
    static LAST: RefCell<CString> = RefCell::default();
}

/// Warnings of a call. When it ends, also with an error, they are stored for its thread.
pub(crate) struct Warnings(Mutex<Vec<String>>);

impl Warnings {
    /// Begins a call, and clears the warnings of the previous one.
    pub(crate) fn begin() -> Warnings {
        LAST.with(|last| *last.borrow_mut() = CString::default());
        Warnings(Mutex::default())
    }
}

impl Progress for Warnings {
    fn warn(&self, file: &Path, text: &str) {
        // (One line each, also if the file's name has line breaks.)
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

/// Returns the warnings of this thread's last call of spinney_model_build() or
/// spinney_model_combine(), one line each, which begins with the file's name. They concern files
/// that were made nevertheless: for example a repair that changes the volume by more than a
/// hundredth, or values of faces that are lost. Empty if there were none. Valid until the thread's
/// next such call.
#[unsafe(no_mangle)]
pub extern "C" fn spinney_warnings() -> *const c_char {
    LAST.with(|last| last.borrow().as_ptr())
}
