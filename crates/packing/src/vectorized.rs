//! Functions that are compiled for processors with wider vectors, too.

/// Defines a function that does what its body says, compiled twice on x86-64: for all processors, and for those with AVX2, which are
/// recognized at run time. All arithmetic is that of integers: results are the same. (On AArch64
/// all processors have NEON.)
macro_rules! vectorized {
    (
        $(#[$meta:meta])*
        $visibility:vis fn $name:ident | $baseline:ident | $avx2:ident $(<$lane:ident>)? ($($argument:ident: $type:ty),* $(,)?)
        $body:block
    ) => {
        $(#[$meta])*
        #[inline]
        $visibility fn $name $(<$lane: Lane>)? ($($argument: $type),*) {
            #[cfg(target_arch = "x86_64")]
            if $crate::vectorized::is_wanted() && std::is_x86_feature_detected!("avx2") && std::is_x86_feature_detected!("bmi2") {
                // SAFETY: the processor has both.
                #[allow(unsafe_code, reason = "functions for some processors are unsafe to call; decoding takes a tenth less time for 16 bits, a quarter less for 32")]
                return unsafe { $avx2 $(::<$lane>)? ($($argument),*) };
            }
            $baseline $(::<$lane>)? ($($argument),*)
        }

        #[inline(never)]
        fn $baseline $(<$lane: Lane>)? ($($argument: $type),*) $body

        #[cfg(target_arch = "x86_64")]
        #[target_feature(enable = "avx2,bmi2")]
        fn $avx2 $(<$lane: Lane>)? ($($argument: $type),*) $body
    };
}

pub(crate) use vectorized;

/// Whether functions for some processors are called where they can be.
#[cfg(all(not(test), target_arch = "x86_64"))]
#[inline(always)]
pub(crate) fn is_wanted() -> bool {
    true
}

#[cfg(test)]
pub(crate) use for_tests::{baseline_only, is_wanted};

/// A switch, so that tests compare both ways.
#[cfg(test)]
mod for_tests {
    use std::cell::Cell;

    thread_local! {
        static IS_WANTED: Cell<bool> = const { Cell::new(true) };
    }

    pub(crate) fn is_wanted() -> bool {
        IS_WANTED.get()
    }

    /// Calls with the functions for all processors alone.
    pub(crate) fn baseline_only<R>(call: impl FnOnce() -> R) -> R {
        IS_WANTED.set(false);
        let result = call();
        IS_WANTED.set(true);
        result
    }
}
