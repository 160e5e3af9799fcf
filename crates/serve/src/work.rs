//! Execution of queries, with limits for concurrency and time. A job is cancelled once no client
//! waits for it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use spinney_base::Progress;
use tokio::sync::Semaphore;
use tokio::time::{Instant, timeout_at};

use crate::failure::Failure;

/// Executor with limited concurrency.
pub(crate) struct Executor {
    permits: Arc<Semaphore>,
    pub(crate) timeout: Duration,
    /// Whether all jobs are cancelled.
    is_over: Arc<AtomicBool>,
}

/// Cancellation flag of a job.
pub(crate) struct CancellationFlag {
    is_stopped: AtomicBool,
    is_over: Arc<AtomicBool>,
}

impl Progress for CancellationFlag {
    fn interrupted(&self) -> bool {
        self.is_stopped.load(Ordering::Relaxed) || self.is_over.load(Ordering::Relaxed)
    }
}

/// Cancels a job when its request is dropped, by the client or by the timeout.
struct CancelOnDrop(Arc<CancellationFlag>);

impl Drop for CancelOnDrop {
    fn drop(&mut self) {
        self.0.is_stopped.store(true, Ordering::Relaxed);
    }
}

impl Executor {
    /// Executor for at most `permits` concurrent jobs.
    pub(crate) fn new(permits: usize, timeout: Duration) -> Executor {
        Executor { permits: Arc::new(Semaphore::new(permits)), timeout, is_over: Arc::default() }
    }

    /// Cancels all jobs as soon as possible.
    pub(crate) fn end(&self) {
        self.is_over.store(true, Ordering::Relaxed);
    }

    /// Runs a job on a blocking thread once a permit is free.
    pub(crate) async fn run<T: Send + 'static>(
        &self,
        job: impl FnOnce(&CancellationFlag) -> Result<T, Failure> + Send + 'static,
    ) -> Result<T, Failure> {
        let seconds = self.timeout.as_secs_f64();
        let deadline = Instant::now() + self.timeout;
        let Ok(permit) = timeout_at(deadline, self.permits.clone().acquire_owned()).await else {
            return Err(Failure::busy(format!(
                "other requests kept the server busy for {seconds} seconds; try again later"
            )));
        };
        let watch =
            Arc::new(CancellationFlag { is_stopped: AtomicBool::new(false), is_over: self.is_over.clone() });
        let _guard = CancelOnDrop(watch.clone());
        // The job holds its permit until it returns, even if it ignores cancellation.
        let task = tokio::task::spawn_blocking(move || {
            let _permit = permit;
            job(&watch)
        });
        match timeout_at(deadline, task).await {
            Ok(Ok(made)) => made,
            Ok(Err(_)) => Err(Failure::new(
                axum::http::StatusCode::INTERNAL_SERVER_ERROR,
                "the server failed to compute the response; its standard error has the reason",
            )),
            Err(_) => Err(Failure::busy(format!(
                "the response took more than {seconds} seconds; request less, or raise --timeout of the server"
            ))),
        }
    }
}
