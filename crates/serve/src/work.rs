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
pub(crate) struct Work {
    places: Arc<Semaphore>,
    pub(crate) timeout: Duration,
    /// Whether all jobs are cancelled.
    is_over: Arc<AtomicBool>,
}

/// Cancellation flag of a job.
pub(crate) struct Watch {
    is_stopped: AtomicBool,
    is_over: Arc<AtomicBool>,
}

impl Progress for Watch {
    fn interrupted(&self) -> bool {
        self.is_stopped.load(Ordering::Relaxed) || self.is_over.load(Ordering::Relaxed)
    }
}

/// Cancels a job when its request is dropped, by the client or by the timeout.
struct StopWhenDropped(Arc<Watch>);

impl Drop for StopWhenDropped {
    fn drop(&mut self) {
        self.0.is_stopped.store(true, Ordering::Relaxed);
    }
}

impl Work {
    /// Executor for at most `places` concurrent jobs.
    pub(crate) fn new(places: usize, timeout: Duration) -> Work {
        Work { places: Arc::new(Semaphore::new(places)), timeout, is_over: Arc::default() }
    }

    /// Cancels all jobs as soon as possible.
    pub(crate) fn end(&self) {
        self.is_over.store(true, Ordering::Relaxed);
    }

    /// Runs a job on a blocking thread once a permit is free.
    pub(crate) async fn run<T: Send + 'static>(
        &self,
        job: impl FnOnce(&Watch) -> Result<T, Failure> + Send + 'static,
    ) -> Result<T, Failure> {
        let seconds = self.timeout.as_secs_f64();
        let deadline = Instant::now() + self.timeout;
        let Ok(place) = timeout_at(deadline, self.places.clone().acquire_owned()).await else {
            return Err(Failure::busy(format!("too much other work for {seconds} seconds; ask again later")));
        };
        let watch = Arc::new(Watch { is_stopped: AtomicBool::new(false), is_over: self.is_over.clone() });
        let _guard = StopWhenDropped(watch.clone());
        // The job holds its permit until it returns, even if it ignores cancellation.
        let task = tokio::task::spawn_blocking(move || {
            let _place = place;
            job(&watch)
        });
        match timeout_at(deadline, task).await {
            Ok(Ok(made)) => made,
            Ok(Err(_)) => Err(Failure::new(
                axum::http::StatusCode::INTERNAL_SERVER_ERROR,
                "the work ended in a panic; what is wrong is told where the server runs",
            )),
            Err(_) => Err(Failure::busy(format!(
                "the answer would take more than {seconds} seconds; ask for less (--timeout allows more)"
            ))),
        }
    }
}
