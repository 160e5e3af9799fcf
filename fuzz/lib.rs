//! Fuzz targets, and a macro that makes a program of one.

#[path = "targets/mod.rs"]
pub mod targets;

/// Runs all work on the calling thread: the coverage of a case does not depend on other threads,
/// and no thread waits.
pub fn use_one_thread() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread();
    pool.build_global().expect("the pool has not been used");
}

/// Makes a target the program.
#[macro_export]
macro_rules! fuzz {
    ($target:ident) => {
        libfuzzer_sys::fuzz_target!(init: $crate::use_one_thread(), |bytes: &[u8]| {
            $crate::targets::$target(bytes)
        });
    };
}
