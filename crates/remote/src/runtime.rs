//! Waiting for requests.

use std::future::Future;
use std::path::Path;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use spinney_base::{Error, Result};
use tokio::runtime::{Builder, Runtime};
use tokio::task::JoinHandle;

/// Time between two questions whether to give up.
const PATIENCE: Duration = Duration::from_millis(100);

/// Threads that requests run on: they wait nearly always.
const THREADS: usize = 2;

/// The threads of this process. A forked process has a copy of its parent's memory but none of its threads, and gets its own.
fn runtime(path: &Path) -> Result<&'static Runtime> {
    static RUNTIME: Mutex<Option<(u32, &'static Runtime)>> = Mutex::new(None);
    let mut known = RUNTIME.lock().unwrap_or_else(PoisonError::into_inner);
    let process = std::process::id();
    if let Some((_, runtime)) = known.filter(|(of, _)| *of == process) {
        return Ok(runtime);
    }
    let made = Builder::new_multi_thread()
        .worker_threads(THREADS)
        .enable_all()
        .thread_name("spinney-remote")
        .build();
    let made = made.map_err(Error::io(path, "start threads for requests"))?;
    // (For as long as the process is there.)
    let runtime: &'static Runtime = Box::leak(Box::new(made));
    *known = Some((process, runtime));
    Ok(runtime)
}

/// Starts some work, which goes on while nobody waits for it; the path is for messages.
///
/// # Errors
/// If the system gives no threads.
pub(super) fn spawn<T: Send + 'static>(
    path: &Path,
    work: impl Future<Output = T> + Send + 'static,
) -> Result<JoinHandle<T>> {
    Ok(runtime(path)?.spawn(work))
}

/// Waits for some work, which is dropped if somebody wants to stop; the path is for messages.
///
/// # Errors
/// On interruption, or if the system gives no threads.
pub(super) fn wait<T>(path: &Path, is_stopped: fn() -> bool, work: impl Future<Output = T>) -> Result<T> {
    let stopped = async {
        while !is_stopped() {
            tokio::time::sleep(PATIENCE).await;
        }
    };
    let work = std::pin::pin!(work);
    let stopped = std::pin::pin!(stopped);
    runtime(path)?.block_on(async {
        match futures_util::future::select(work, stopped).await {
            futures_util::future::Either::Left((done, _)) => Ok(done),
            futures_util::future::Either::Right(_) => Err(Error::Interrupted),
        }
    })
}
