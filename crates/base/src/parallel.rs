//! Multithreading with rayon.
//!
//! rayon's code is compiled once, for plain functions, and not once for each use with each of the
//! many tree types.

use std::any::Any;
use std::cell::RefCell;
use std::sync::{Arc, Mutex};

use rayon::prelude::*;

/// State that the threads of an operation share: the batch of reads that they belong to.
///
/// A thread that forks work passes its context to the threads that run it.
pub(crate) type Context = Arc<dyn Any + Send + Sync>;

thread_local! {
    static CONTEXT: RefCell<Option<Context>> = const { RefCell::new(None) };
}

/// Returns the context of this thread's current work.
pub(crate) fn context() -> Option<Context> {
    CONTEXT.with_borrow(Clone::clone)
}

/// Runs a function in a context, or in none.
pub(crate) fn with_context<R>(context: Option<Context>, work: impl FnOnce() -> R) -> R {
    /// Restores the thread's previous context, even if the function panics.
    struct Before(Option<Context>);
    impl Drop for Before {
        fn drop(&mut self) {
            CONTEXT.set(self.0.take());
        }
    }
    let _before = Before(CONTEXT.replace(context));
    work()
}

/// Applies a function to each item on the threads of the current rayon pool. The results have the
/// order of the items.
///
/// # Panics
/// If the function panics for an item.
pub fn map<T: Sync, R: Send>(items: &[T], make: impl Fn(&T) -> R + Sync) -> Vec<R> {
    // Plain loops: this is compiled for very many types.
    let mut made: Vec<Mutex<Option<R>>> = Vec::with_capacity(items.len());
    for _ in items {
        made.push(Mutex::new(None));
    }
    for_each(items.len(), &|index| {
        let result = make(&items[index]);
        if let Ok(mut made) = made[index].lock() {
            *made = Some(result);
        }
    });
    let mut results = Vec::with_capacity(items.len());
    for cell in made {
        if let Ok(Some(result)) = cell.into_inner() {
            results.push(result);
        }
    }
    assert_eq!(results.len(), items.len(), "all items were visited");
    results
}

/// Returns the number of threads of the current rayon pool.
pub fn threads() -> usize {
    rayon::current_num_threads()
}

fn for_each(count: usize, visit: &(dyn Fn(usize) + Sync)) {
    // A thread that waits in rayon may steal a job of another operation, so each job sets its
    // context.
    let context = context();
    (0..count).into_par_iter().for_each(|index| with_context(context.clone(), || visit(index)));
}

/// Runs two functions, in parallel if a thread is free, and returns both results.
pub fn join<A: Send, B: Send>(first: impl FnOnce() -> A + Send, second: impl FnOnce() -> B + Send) -> (A, B) {
    let (mut first, mut second) = (Some(first), Some(second));
    let (mut a, mut b) = (None, None);
    run_both(&mut || a = first.take().map(|run| run()), &mut || b = second.take().map(|run| run()));
    (a.expect("the first has run"), b.expect("the second has run"))
}

fn run_both(first: &mut (dyn FnMut() + Send), second: &mut (dyn FnMut() + Send)) {
    let context = context();
    rayon::join(|| with_context(context.clone(), first), || with_context(context.clone(), second));
}

/// Pool of reusable objects, such as readers with buffers.
///
/// A thread takes an object for one job and returns it afterwards, so that later jobs benefit from
/// what earlier ones have read.
pub struct Pool<T>(Mutex<Vec<T>>);

impl<T> Default for Pool<T> {
    fn default() -> Pool<T> {
        Pool(Mutex::new(Vec::new()))
    }
}

impl<T: Send> Pool<T> {
    /// Runs a job with an object of the pool, or with a new one if all are in use. After a failed
    /// job the object is dropped.
    ///
    /// # Errors
    /// Those of `make` and of `job`.
    pub fn with<R, E>(
        &self,
        make: impl FnOnce() -> Result<T, E>,
        job: impl FnOnce(&mut T) -> Result<R, E>,
    ) -> Result<R, E> {
        let free = self.0.lock().expect("no thread panics while it has this lock").pop();
        let mut thing = free.map_or_else(make, Ok)?;
        let result = job(&mut thing)?;
        self.0.lock().expect("as above").push(thing);
        Ok(result)
    }
}
