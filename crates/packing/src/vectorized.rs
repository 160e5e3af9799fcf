//! Functions that are also compiled for processors with wider vectors.

/// Defines a function that is compiled twice on x86-64: for all processors, and for those with AVX2
/// and BMI2, which are detected at run time. All arithmetic is on integers, so results are equal.
/// (On AArch64, all processors have NEON.)
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
                // SAFETY: the processor has both features.
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

/// Returns whether the function for AVX2 is used if the processor supports it.
#[cfg(all(not(test), target_arch = "x86_64"))]
#[inline(always)]
pub(crate) fn is_wanted() -> bool {
    true
}

#[cfg(test)]
pub(crate) use for_tests::{baseline_only, is_wanted};

/// Switch with which tests compare both functions.
#[cfg(test)]
mod for_tests {
    use std::cell::Cell;

    thread_local! {
        static IS_WANTED: Cell<bool> = const { Cell::new(true) };
    }

    pub(crate) fn is_wanted() -> bool {
        IS_WANTED.get()
    }

    /// Calls with only the functions for all processors.
    pub(crate) fn baseline_only<R>(call: impl FnOnce() -> R) -> R {
        IS_WANTED.set(false);
        let result = call();
        IS_WANTED.set(true);
        result
    }
}
