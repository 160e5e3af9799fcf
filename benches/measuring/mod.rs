//! Common code of benches that print tables: random numbers, processor time, medians.

use std::error::Error;
use std::time::Instant;

pub(crate) type Outcome<T> = Result<T, Box<dyn Error>>;

/// Deterministic pseudorandom numbers.
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn below(&mut self, end: u64) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((u128::from(z ^ (z >> 31)) * u128::from(end)) >> 64) as u64
    }
}

/// Nanoseconds of this thread's processor time, so that other processes do not count.
fn processor_time() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    text.split(' ').next()?.parse().ok()
}

/// Returns the seconds that work takes: processor time if the system reports it, otherwise wall
/// time.
pub(crate) fn seconds(work: impl FnOnce() -> Outcome<()>) -> Outcome<f64> {
    let (processor, clock) = (processor_time(), Instant::now());
    work()?;
    Ok(match (processor, processor_time()) {
        (Some(start), Some(end)) if end > start => (end - start) as f64 * 1e-9,
        _ => clock.elapsed().as_secs_f64(),
    })
}

pub(crate) fn median(numbers: &mut [f64]) -> f64 {
    quantile(numbers, 0.5)
}

pub(crate) fn quantile(numbers: &mut [f64], share: f64) -> f64 {
    numbers.sort_by(f64::total_cmp);
    numbers[((numbers.len() - 1) as f64 * share).round() as usize]
}
