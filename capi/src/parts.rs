//! Files that the caller reads: on servers, in archives, in memory.

use std::ffi::{CStr, c_char, c_void};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use engine::raw::dataset;
use engine::raw::io::{DEFAULT_GAP, Fetch, RangeCache, RangeFile};
use engine::raw::store::ByteSource;
use engine::{Error, FileAccess, OpenOptions, Result};

use crate::dataset::{path_of, spinney_dataset};
use crate::status::{Failure, guarded, spinney_status};

/// Reads `count` ranges of a file: the first from offset `offsets[0]`, `lengths[0]` bytes to
/// `buffers[0]`, and so on. `user` is the pointer given to spinney_open_parts(). Returns 0, or
/// another number if one of the ranges cannot be read. The query continues when all ranges of a
/// call are read, so that they should be requested concurrently. Any thread may call the function,
/// and several at once.
pub type spinney_fetch = Option<
    unsafe extern "C" fn(
        user: *mut c_void,
        count: usize,
        offsets: *const u64,
        lengths: *const usize,
        buffers: *const *mut u8,
    ) -> i32,
>;

/// Called when the file is not read any more, with the pointer given to spinney_open_parts().
pub type spinney_release = Option<unsafe extern "C" fn(user: *mut c_void)>;

/// A file that the caller reads.
struct CallersFile {
    user: *mut c_void,
    fetch: unsafe extern "C" fn(*mut c_void, usize, *const u64, *const usize, *const *mut u8) -> i32,
    release: spinney_release,
    path: PathBuf,
    length: u64,
    number: u64,
}

// SAFETY: by the contract of spinney_open_parts(), any thread may call the caller's functions.
unsafe impl Send for CallersFile {}
// SAFETY: by the same contract, several threads may call them at once.
unsafe impl Sync for CallersFile {}

impl Drop for CallersFile {
    fn drop(&mut self) {
        if let Some(release) = self.release {
            // SAFETY: both come from the caller, and `fetch` is not called any more.
            unsafe { release(self.user) };
        }
    }
}

/// Fetches ranges through the caller's function.
struct Reader(Arc<CallersFile>);

impl Fetch for Reader {
    fn fetch(&self, ranges: &[Range<u64>]) -> Result<Vec<Vec<u8>>> {
        let CallersFile { user, fetch, path, .. } = &*self.0;
        let offsets: Vec<u64> = ranges.iter().map(|range| range.start).collect();
        let lengths: Vec<usize> = ranges.iter().map(|range| (range.end - range.start) as usize).collect();
        let mut parts: Vec<Vec<u8>> = lengths.iter().map(|length| vec![0; *length]).collect();
        let buffers: Vec<*mut u8> = parts.iter_mut().map(Vec::as_mut_ptr).collect();
        // SAFETY: there are `ranges.len()` offsets, lengths and buffers, and each buffer has its
        // stated length.
        let status =
            unsafe { fetch(*user, ranges.len(), offsets.as_ptr(), lengths.as_ptr(), buffers.as_ptr()) };
        match status {
            0 => Ok(parts),
            status => {
                let cause = std::io::Error::other(format!("the caller's function returned {status}"));
                Err(Error::Io { path: path.clone(), doing: "read a range", cause })
            }
        }
    }
}

/// Opens a tree file of `length` bytes that the caller reads. `name` is for messages; it selects
/// the commit if it ends with one (`map.autumn@12`). Ranges that a query needs are requested in few
/// calls of `fetch`, and cached. `release` (which may be NULL) is called once when the dataset and
/// all others of the file are closed, also if opening fails. Close the dataset with
/// spinney_close().
#[unsafe(no_mangle)]
pub unsafe extern "C" fn spinney_open_parts(
    name: *const c_char,
    length: u64,
    fetch: spinney_fetch,
    release: spinney_release,
    user: *mut c_void,
    dataset: *mut *mut spinney_dataset,
) -> spinney_status {
    guarded(|| {
        let missing = || {
            Failure::invalid(
                "spinney_open_parts: got NULL, expected a name, a function, and a pointer to the dataset",
            )
        };
        let fetch = fetch.filter(|_| !name.is_null() && !dataset.is_null()).ok_or_else(missing)?;
        // SAFETY: the caller passes a zero-terminated string.
        let path = path_of(unsafe { CStr::from_ptr(name) })?;
        let number = RangeCache::file_number();
        let file = Arc::new(CallersFile { user, fetch, release, path: path.clone(), length, number });
        let source = ByteSource::new(move |path: &Path| {
            let cache = (FileAccess::default().ranges().clone(), file.number);
            Ok(Box::new(RangeFile::new(
                path,
                file.length,
                Box::new(Reader(file.clone())),
                cache,
                DEFAULT_GAP,
            )))
        });
        engine::raw::register();
        let opened = dataset::open(&path, &OpenOptions::new().source(source))?;
        // SAFETY: `dataset` is not NULL, and points to the caller's pointer.
        unsafe { spinney_dataset::write_handle(opened, dataset) };
        Ok(())
    })
}
