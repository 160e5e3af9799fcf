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

/// Reads parts of a file: `count` of them, the first from `offsets[0]` on, `lengths[0]` bytes to `buffers[0]`, and so on; `user` is what
/// spinney_open_parts() was given. Returns 0, or another number if one of them cannot be read. All parts of a call are needed before
/// anything goes on, so that they are best asked for at the same time. May be called by any thread, and by several at once.
pub type spinney_fetch = Option<
    unsafe extern "C" fn(
        user: *mut c_void,
        count: usize,
        offsets: *const u64,
        lengths: *const usize,
        buffers: *const *mut u8,
    ) -> i32,
>;

/// Called when nothing of a file is read any more, with what spinney_open_parts() was given.
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

// SAFETY: the caller has said that its functions may be called by any thread.
unsafe impl Send for CallersFile {}
// SAFETY: and by several at once.
unsafe impl Sync for CallersFile {}

impl Drop for CallersFile {
    fn drop(&mut self) {
        if let Some(release) = self.release {
            // SAFETY: the caller has given both, and nobody calls `fetch` any more.
            unsafe { release(self.user) };
        }
    }
}

/// The way to its bytes.
struct Reader(Arc<CallersFile>);

impl Fetch for Reader {
    fn fetch(&self, ranges: &[Range<u64>]) -> Result<Vec<Vec<u8>>> {
        let CallersFile { user, fetch, path, .. } = &*self.0;
        let offsets: Vec<u64> = ranges.iter().map(|range| range.start).collect();
        let lengths: Vec<usize> = ranges.iter().map(|range| (range.end - range.start) as usize).collect();
        let mut parts: Vec<Vec<u8>> = lengths.iter().map(|length| vec![0; *length]).collect();
        let buffers: Vec<*mut u8> = parts.iter_mut().map(Vec::as_mut_ptr).collect();
        // SAFETY: there are as many offsets, lengths and buffers as it is told, each buffer as long as its length says.
        let status =
            unsafe { fetch(*user, ranges.len(), offsets.as_ptr(), lengths.as_ptr(), buffers.as_ptr()) };
        match status {
            0 => Ok(parts),
            status => {
                let cause = std::io::Error::other(format!("the caller's function has returned {status}"));
                Err(Error::Io { path: path.clone(), doing: "read a part", cause })
            }
        }
    }
}

/// Opens a tree file that the caller reads, of `length` bytes; `name` is for messages, and says which commit is read if it ends with one
/// (`map.autumn@12`). What an answer needs is asked for in few calls of `fetch`, and held. `release` (which may be NULL) is called once
/// when the dataset and all others of the file are closed, also if opening fails. The dataset is to be closed by spinney_close().
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
                "spinney_open_parts: got NULL, expected a name, a function and a place for the dataset",
            )
        };
        let fetch = fetch.filter(|_| !name.is_null() && !dataset.is_null()).ok_or_else(missing)?;
        // SAFETY: the caller passes a zero-terminated text.
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
        let opened = dataset::open(&path, &OpenOptions::new().source(source))?;
        // SAFETY: it is not NULL, and the caller's.
        unsafe { spinney_dataset::hand_out(opened, dataset) };
        Ok(())
    })
}
