//! Connections of a client: its request threads and its open stores.

use std::collections::HashMap;
use std::future::Future;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use object_store::ObjectStore;
use object_store::list::PaginatedListStore;
use object_store::memory::InMemory;
use spinney_base::{Error, Result};
use tokio::runtime::{Builder, Runtime};
use tokio::task::JoinHandle;

use super::RemoteOptions;
use super::error;
use super::secrets::Secrets;

/// Interval between two checks for cancellation.
const PATIENCE: Duration = Duration::from_millis(100);

/// Threads that run requests. Few are enough: they nearly always wait.
const THREADS: usize = 2;

/// Maximum number of buckets whose connections are kept.
const MAX_BUCKETS: usize = 64;

/// Key of a bucket: process id, bucket URL, settings, and whether the environment disables request
/// signing.
pub(super) type BucketKey = (u32, String, Vec<(String, String)>, bool);

/// The store of a bucket.
#[derive(Clone)]
pub(super) struct Bucket {
    pub(super) store: Arc<dyn ObjectStore>,
    /// Lister of the files of a prefix, page by page; `None` if the store has none.
    pub(super) pages: Option<Arc<dyn PaginatedListStore>>,
}

impl Bucket {
    /// A store that lists its files.
    pub(super) fn new(store: impl ObjectStore + PaginatedListStore) -> Bucket {
        let store = Arc::new(store);
        Bucket { store: store.clone(), pages: Some(store) }
    }
}

/// Connections of a client, shared by its files.
pub(super) struct Connections {
    pub(super) options: RemoteOptions,
    /// The runtime and the id of the process that owns it. A forked process has a copy of its
    /// parent's memory but none of its threads, and starts its own runtime.
    runtime: Mutex<Option<(u32, Arc<Runtime>)>>,
    /// Stores of recently used buckets, which keep their connections open. The key contains the
    /// process id, so a forked process opens its own connections.
    buckets: Mutex<HashMap<BucketKey, Bucket>>,
    /// Query and user info for URLs that are given without them.
    pub(super) secrets: Secrets,
    /// In-memory store, for tests.
    pub(super) memory: Arc<InMemory>,
}

impl Connections {
    pub(super) fn new(options: RemoteOptions) -> Connections {
        let (runtime, buckets, memory) = Default::default();
        let secrets = Secrets::new(options.signed_urls.iter().map(String::as_str));
        Connections { options, runtime, buckets, secrets, memory }
    }

    fn runtime(&self, path: &Path) -> Result<Arc<Runtime>> {
        let mut known = self.runtime.lock().unwrap_or_else(PoisonError::into_inner);
        let process = std::process::id();
        match &*known {
            Some((of, runtime)) if *of == process => return Ok(runtime.clone()),
            _ => {}
        }
        let made = Builder::new_multi_thread()
            .worker_threads(THREADS)
            .enable_all()
            .thread_name("spinney-remote")
            .build();
        let made = Arc::new(made.map_err(Error::io(path, "start threads for requests"))?);
        // Invariant: a process drops only its own runtime. To drop the parent's, which the fork has
        // copied, would wait for threads that exist only in the parent.
        std::mem::forget(known.replace((process, made.clone())));
        Ok(made)
    }

    /// Returns the store of a bucket, and creates it with `make` on first use.
    pub(super) fn bucket(&self, key: BucketKey, make: impl FnOnce() -> Result<Bucket>) -> Result<Bucket> {
        let buckets = || self.buckets.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(store) = buckets().get(&key) {
            return Ok(store.clone());
        }
        let store = make()?;
        let mut known = buckets();
        if known.len() >= MAX_BUCKETS {
            known.clear();
        }
        known.insert(key, store.clone());
        Ok(store)
    }

    /// Starts a task, which also makes progress while no thread waits for it. `path` is for
    /// messages.
    ///
    /// # Errors
    /// If the threads cannot be started.
    pub(super) fn spawn<T: Send + 'static>(
        &self,
        path: &Path,
        work: impl Future<Output = T> + Send + 'static,
    ) -> Result<JoinHandle<T>> {
        Ok(self.runtime(path)?.spawn(work))
    }

    /// Runs a request with a time limit that includes all retries. `path` and `doing` are for
    /// messages.
    pub(super) async fn limited<T>(
        &self,
        (path, doing): (&Path, &'static str),
        request: impl Future<Output = Result<T>>,
    ) -> Result<T> {
        let limit = self.options.limit;
        match tokio::time::timeout(limit, request).await {
            Ok(done) => done,
            Err(_) => Err(error::late(path, doing, limit)),
        }
    }

    /// Waits for a future, which is dropped on cancellation. `path` is for messages.
    ///
    /// # Errors
    /// On cancellation, or if the threads cannot be started.
    pub(super) fn wait<T>(&self, path: &Path, work: impl Future<Output = T>) -> Result<T> {
        self.wait_unless(self.options.is_stopped, path, work)
    }

    /// Waits for a future and ignores cancellation. `path` is for messages.
    ///
    /// # Errors
    /// If the threads cannot be started.
    pub(super) fn finish<T>(&self, path: &Path, work: impl Future<Output = T>) -> Result<T> {
        self.wait_unless(|| false, path, work)
    }

    fn wait_unless<T>(
        &self,
        is_stopped: fn() -> bool,
        path: &Path,
        work: impl Future<Output = T>,
    ) -> Result<T> {
        let stopped = async {
            while !is_stopped() {
                tokio::time::sleep(PATIENCE).await;
            }
        };
        let work = std::pin::pin!(work);
        let stopped = std::pin::pin!(stopped);
        self.runtime(path)?.block_on(async {
            match futures_util::future::select(work, stopped).await {
                futures_util::future::Either::Left((done, _)) => Ok(done),
                futures_util::future::Either::Right(_) => Err(Error::Interrupted),
            }
        })
    }
}

impl Drop for Connections {
    /// Stops the threads without waiting for them: the last file may be dropped on a thread that
    /// must not block.
    fn drop(&mut self) {
        let known = self.runtime.get_mut().unwrap_or_else(PoisonError::into_inner).take();
        let Some((process, runtime)) = known else { return };
        match Arc::try_unwrap(runtime) {
            Ok(runtime) if process == std::process::id() => runtime.shutdown_background(),
            others => std::mem::forget(others),
        }
    }
}
