//! The targets, and a macro that makes a program of one.

#[path = "targets/mod.rs"]
pub mod targets;

/// Makes everything happen in the thread that calls: what a case covers does not depend on others, and nobody waits.
pub fn use_one_thread() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread();
    pool.build_global().expect("nobody has used the pool");
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
