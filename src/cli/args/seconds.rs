//! Durations in seconds.

/// Parses a duration between 1 ms and 1,000,000 s.
pub(crate) fn parse_seconds(text: &str) -> Result<f64, String> {
    let seconds: Option<f64> = text.trim().parse().ok();
    seconds
        .filter(|seconds| (0.001..=1e6).contains(seconds))
        .ok_or_else(|| "expected 0.001 to 1000000 seconds, such as 30 or 0.5".into())
}
