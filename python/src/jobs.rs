//! Long jobs: they run on a thread of their own, while the calling thread handles Ctrl-C and
//! reports progress.

use std::cell::{Cell, RefCell};
use std::fs;
use std::num::NonZeroUsize;
use std::path::Path;
use std::process;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, LazyLock, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use pyo3::exceptions::{PyRuntimeError, PyUserWarning};
use pyo3::prelude::*;
use rayon::ThreadPoolBuilder;
use spinney::raw::io::redacted;
use spinney::raw::store::create_tree_file;
use spinney::remote::{RemoteOptions, client};
use spinney::{Error, FileAccess, Output, Progress};

use crate::error::raised;

/// Time between checks for signals.
const TICK: Duration = Duration::from_millis(50);

thread_local! {
    /// Set when the work of this thread should stop.
    static STOP: RefCell<Option<Arc<AtomicBool>>> = const { RefCell::new(None) };
    /// Files that this thread refuses.
    static REFUSED: Cell<Refused> = const { Cell::new(Refused::NOTHING) };
}

/// Refused files, as with the program's `--no-remote` and `--no-external`.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) struct Refused {
    pub(crate) remote: bool,
    pub(crate) external: bool,
}

impl Refused {
    pub(crate) const NOTHING: Refused = Refused { remote: false, external: false };

    /// Returns the files that this object or the calling thread refuses.
    pub(crate) fn or_thread(self) -> Refused {
        let of_thread = REFUSED.get();
        Refused { remote: self.remote || of_thread.remote, external: self.external || of_thread.external }
    }

    /// Returns how files are opened and created.
    pub(crate) fn access(self) -> &'static FileAccess {
        &ACCESSES[usize::from(self.remote) + 2 * usize::from(self.external)]
    }
}

/// Changes what the calling thread, and work that it starts, refuses; returns what it refused
/// before.
#[pyfunction]
pub(crate) fn refuse(remote: bool, external: bool) -> (bool, bool) {
    let before = REFUSED.replace(Refused { remote, external });
    (before.remote, before.external)
}

/// How the module opens and creates files. A thread that waits for a remote file is cancelled when
/// its work should stop, or when Python has a signal for it.
static ACCESS: LazyLock<FileAccess> = LazyLock::new(|| {
    let mut options = RemoteOptions::default();
    options.is_stopped = || match STOP.with_borrow(Clone::clone) {
        Some(stop) => stop.load(Ordering::Relaxed),
        None => Python::attach(|py| py.check_signals().is_err()),
    };
    // (The program reads the same variable.)
    let seconds = std::env::var("SPINNEY_REMOTE_TIMEOUT").ok().and_then(|text| text.trim().parse().ok());
    if let Some(limit) = seconds.and_then(|seconds| Duration::try_from_secs_f64(seconds).ok()) {
        (options.limit, options.timeout) = (limit, limit / 2);
    }
    if let Some(text) = std::env::var_os("SPINNEY_SIGNED_URLS").and_then(|path| fs::read_to_string(path).ok())
    {
        options.signed_urls = text.lines().map(|line| line.trim().to_string()).collect();
    }
    // (Files are read by threads that have released the interpreter's lock, so none that holds it
    // waits for this one.)
    let warn = |file: &Path, text: &str| {
        let line = redacted(&format!("{}: {text}", file.display())).into_owned();
        Python::attach(|py| {
            // Python's filter may make it an exception, which a read cannot raise.
            warn(py, &line).unwrap_or_else(|exception| exception.write_unraisable(py, None));
        });
    };
    // (Own caches, so that `set_cache_memory` changes their limit, and not that of other users of
    // the library.)
    let access = FileAccess::new().unpacked_cache(FileAccess::new().unpacked().limit());
    let access = access.on_warning(Arc::new(warn));
    // (This fails if there is no directory for the cache and none is configured.)
    client(options).map_or(access.clone(), |client| access.remote(client))
});

/// Accesses that refuse nothing, remote files, external files, and both. They share their caches.
static ACCESSES: LazyLock<[FileAccess; 4]> = LazyLock::new(|| {
    let all = ACCESS.clone();
    let (remote, external) = (all.clone().no_remote(), all.clone().no_external());
    [all, remote.clone(), external, remote.no_external()]
});

/// Returns how the calling thread opens and creates files.
pub(crate) fn access() -> &'static FileAccess {
    REFUSED.get().access()
}

/// Process that owns the default thread pool.
static HOME: AtomicU32 = AtomicU32::new(0);

/// Records the process that imports the module.
pub(crate) fn remember_process() {
    HOME.store(process::id(), Ordering::Relaxed);
}

/// Terms of a long job: progress callback (completed and total work), number of threads, and
/// maximum size of the output in bytes. An omitted term has the program's default.
#[derive(Default, FromPyObject)]
pub(crate) struct Terms(Option<Py<PyAny>>, Option<NonZeroUsize>, Option<u64>);

/// Maximum number of threads; a larger request would only take memory.
const MAX_THREADS: usize = 256;

/// Runs a job on `threads` threads, or on the default pool. A forked process has a copy of its
/// parent's pool but none of its threads, and would wait for them forever: it gets its own pool.
fn on_threads<R: Send>(
    threads: Option<NonZeroUsize>,
    job: impl FnOnce() -> spinney::Result<R> + Send,
) -> spinney::Result<R> {
    if threads.is_none() && process::id() == HOME.load(Ordering::Relaxed) {
        return job();
    }
    // (0 is one per processor.)
    let threads = threads.map_or(0, |threads| threads.get().min(MAX_THREADS));
    let pool = ThreadPoolBuilder::new().num_threads(threads).build().map_err(|cause| {
        let cause = std::io::Error::other(cause);
        Error::Io { path: "threads".into(), doing: "start", cause }
    })?;
    pool.install(job)
}

/// Progress of a job, and whether it should stop.
#[derive(Default)]
pub(crate) struct Work {
    done: AtomicU64,
    total: AtomicU64,
    stop: Arc<AtomicBool>,
    max_bytes: Option<u64>,
    warnings: Mutex<Vec<String>>,
    /// Exception raised by a Python function that the job called.
    failure: Mutex<Option<PyErr>>,
}

impl Work {
    /// Creates an output file, limited to `max_bytes`.
    pub(crate) fn create(&self, path: &Path) -> spinney::Result<Output> {
        access().create(path).map(|output| output.with_limit(self.max_bytes))
    }

    /// Returns the maximum size of the output in bytes.
    pub(crate) fn max_bytes(&self) -> Option<u64> {
        self.max_bytes
    }

    /// Creates a tree file.
    pub(crate) fn create_tree(&self, path: &Path) -> spinney::Result<Output> {
        create_tree_file(path, access()).map(|output| output.with_limit(self.max_bytes))
    }

    /// Records an exception, and returns the error that ends the work.
    pub(crate) fn fail(&self, exception: PyErr) -> Error {
        self.failure.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(exception);
        Error::Interrupted
    }

    /// Raises pending Python signals, and calls the callback if there is new progress.
    fn attend(&self, py: Python<'_>, callback: Option<&Py<PyAny>>, reported: &mut u64) -> PyResult<()> {
        py.check_signals()?;
        let (done, total) = (self.done.load(Ordering::Relaxed), self.total.load(Ordering::Relaxed));
        if let Some(callback) = callback
            && done != *reported
        {
            *reported = done;
            callback.call1(py, (done, total))?;
        }
        Ok(())
    }
}

impl Progress for Work {
    fn advance(&self, done: u64, total: u64) {
        self.done.fetch_add(done, Ordering::Relaxed);
        self.total.store(total, Ordering::Relaxed);
    }

    fn warn(&self, file: &Path, text: &str) {
        let line = redacted(&format!("{}: {text}", file.display())).into_owned();
        self.warnings.lock().unwrap_or_else(PoisonError::into_inner).push(line);
    }

    fn interrupted(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

/// Issues a Python warning.
pub(crate) fn warn(py: Python<'_>, text: &str) -> PyResult<()> {
    let text = std::ffi::CString::new(text.replace('\0', ""))?;
    PyErr::warn(py, &py.get_type::<PyUserWarning>(), &text, 1)
}

/// Single-threaded work on the calling thread, which checks for signals from time to time. Most
/// such work ends before a thread could have started.
struct ShortWork {
    /// Number of calls of `interrupted`.
    calls: AtomicU64,
    /// Time of the last check for signals, in milliseconds.
    attended: AtomicU64,
    began: Instant,
    failure: Mutex<Option<PyErr>>,
}

impl Progress for ShortWork {
    fn interrupted(&self) -> bool {
        /// Calls between reads of the clock.
        const OFTEN: u64 = 1 << 4;
        if !self.calls.fetch_add(1, Ordering::Relaxed).is_multiple_of(OFTEN) {
            return false;
        }
        let now = self.began.elapsed().as_millis() as u64;
        if now < self.attended.load(Ordering::Relaxed) + TICK.as_millis() as u64 {
            return false;
        }
        self.attended.store(now, Ordering::Relaxed);
        let failure = Python::attach(|py| py.check_signals().err());
        let mut found = self.failure.lock().unwrap_or_else(PoisonError::into_inner);
        *found = found.take().or(failure);
        found.is_some()
    }
}

/// Runs single-threaded work on the calling thread, without the interpreter's lock. A Python signal
/// cancels it.
pub(crate) fn run_here<R: Send>(
    py: Python<'_>,
    job: impl FnOnce(&dyn Progress) -> spinney::Result<R> + Send,
) -> PyResult<R> {
    let work = ShortWork {
        calls: AtomicU64::new(0),
        attended: AtomicU64::new(0),
        began: Instant::now(),
        failure: Mutex::new(None),
    };
    let outcome = py.detach(|| job(&work));
    match work.failure.into_inner().unwrap_or_else(PoisonError::into_inner) {
        Some(exception) => Err(exception),
        None => outcome.map_err(raised),
    }
}

/// Runs a long job without the interpreter's lock. A Python signal, or an exception of the
/// callback, cancels it.
pub(crate) fn run<R: Send>(
    py: Python<'_>,
    terms: Terms,
    job: impl FnOnce(&Work) -> spinney::Result<R> + Send,
) -> PyResult<R> {
    let Terms(callback, threads, max_bytes) = terms;
    let work = Work { max_bytes, ..Work::default() };
    let (mut reported, mut failure) = (0, None);
    let refused = REFUSED.get();
    let outcome = py.detach(|| {
        thread::scope(|scope| {
            let (done, is_done) = channel::<()>();
            let work = &work;
            let worker = scope.spawn(move || {
                let _done = done;
                STOP.set(Some(work.stop.clone()));
                on_threads(threads, || {
                    REFUSED.set(refused);
                    job(work)
                })
            });
            while let Err(RecvTimeoutError::Timeout) = is_done.recv_timeout(TICK) {
                if failure.is_none() {
                    failure = Python::attach(|py| work.attend(py, callback.as_ref(), &mut reported).err());
                    work.stop.store(failure.is_some(), Ordering::Relaxed);
                }
            }
            worker.join()
        })
    });
    let failure = failure.or(work.failure.lock().unwrap_or_else(PoisonError::into_inner).take());
    for text in work.warnings.lock().unwrap_or_else(PoisonError::into_inner).drain(..) {
        warn(py, &text)?;
    }
    let outcome = outcome.map_err(|_| PyRuntimeError::new_err("a thread has panicked; this is a bug"))?;
    match (outcome, failure) {
        (Err(_), Some(exception)) => Err(exception),
        (Err(error), None) => Err(raised(error)),
        (Ok(result), failure) => {
            // (A signal is still raised if it came after the work was done.)
            failure.map_or(Ok(()), Err)?;
            work.attend(py, callback.as_ref(), &mut reported)?;
            Ok(result)
        }
    }
}
