//! Jobs that wait for remote files, on threads of their own.

use std::sync::Mutex;
use std::sync::PoisonError;
use std::sync::atomic::{AtomicUsize, Ordering};

use crate::Result;

/// Maximum number of threads. They wait most of the time.
const MAX_THREADS: usize = 128;

/// Runs a job once for each number from 0 to `count - 1`, on up to 128 threads: for jobs that wait
/// for responses of servers. After an error, no other job starts.
///
/// # Errors
/// The error of the job with the lowest number.
pub fn run_waiting(count: usize, job: &(dyn Fn(usize) -> Result<()> + Sync)) -> Result<()> {
    let (next, failed) = (AtomicUsize::new(0), Mutex::new(None));
    // All numbers below that of an error have started, so the lowest error is the same in each run.
    let work = || {
        while let number = next.fetch_add(1, Ordering::Relaxed)
            && number < count
        {
            if let Err(error) = job(number) {
                next.store(count, Ordering::Relaxed);
                let mut failed = failed.lock().unwrap_or_else(PoisonError::into_inner);
                if failed.as_ref().is_none_or(|(lowest, _)| number < *lowest) {
                    *failed = Some((number, error));
                }
            }
        }
    };
    std::thread::scope(|scope| {
        for _ in 1..count.min(MAX_THREADS) {
            scope.spawn(work);
        }
        work();
    });
    match failed.into_inner().unwrap_or_else(PoisonError::into_inner) {
        Some((_, error)) => Err(error),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Error;

    #[test]
    fn each_job_runs_once() {
        for count in [0, 1, 5, 100] {
            let runs: Vec<AtomicUsize> = (0..count).map(|_| AtomicUsize::new(0)).collect();
            run_waiting(count, &|number| {
                runs[number].fetch_add(1, Ordering::Relaxed);
                Ok(())
            })
            .unwrap();
            assert!(runs.iter().all(|runs| runs.load(Ordering::Relaxed) == 1));
        }
    }

    #[test]
    fn the_first_error_is_returned_and_ends_the_run() {
        let runs = AtomicUsize::new(0);
        let job = |number| {
            runs.fetch_add(1, Ordering::Relaxed);
            match number {
                3 | 4 => Err(Error::invalid("job", format!("{number}"), "another")),
                _ => Ok(()),
            }
        };
        let error = run_waiting(1_000_000, &job).unwrap_err().to_string();
        assert!(error.contains('3'), "{error}");
        assert!(runs.load(Ordering::Relaxed) < 1_000_000);
    }
}
