//! Work that answers are made by: so much at a time, for so long, and no longer than somebody waits for it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use spinney_base::Progress;
use tokio::sync::Semaphore;
use tokio::time::{Instant, timeout_at};

use crate::failure::Failure;

/// Room for work.
pub(crate) struct Work {
    places: Arc<Semaphore>,
    pub(crate) timeout: Duration,
    /// Whether all work is to end.
    is_over: Arc<AtomicBool>,
}

/// Watch over a piece of work, by which it learns that nobody waits for it any more.
pub(crate) struct Watch {
    is_stopped: AtomicBool,
    is_over: Arc<AtomicBool>,
}

impl Progress for Watch {
    fn interrupted(&self) -> bool {
        self.is_stopped.load(Ordering::Relaxed) || self.is_over.load(Ordering::Relaxed)
    }
}

/// Stops work when its request is given up: by its client, or by the time that it took.
struct StopWhenDropped(Arc<Watch>);

impl Drop for StopWhenDropped {
    fn drop(&mut self) {
        self.0.is_stopped.store(true, Ordering::Relaxed);
    }
}

impl Work {
    /// Room for so many pieces of work at the same time.
    pub(crate) fn new(places: usize, timeout: Duration) -> Work {
        Work { places: Arc::new(Semaphore::new(places)), timeout, is_over: Arc::default() }
    }

    /// Ends all work as soon as possible.
    pub(crate) fn end(&self) {
        self.is_over.store(true, Ordering::Relaxed);
    }

    /// Does a piece of work when there is room for it, on a thread that may wait.
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
        // (Work that does not heed its end has its place until then.)
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
