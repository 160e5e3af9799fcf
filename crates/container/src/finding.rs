//! Findings of verification.

/// A problem found by verification.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// Location in the file.
    pub place: String,
    /// Description of the problem.
    pub problem: String,
}

/// Number of findings after which verification stops.
pub const MAX_FINDINGS: usize = 100;
