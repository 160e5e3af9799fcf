//! Findings of verification.

/// Something that is wrong with a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// The part of the file.
    pub place: String,
    /// Description of what is wrong with it.
    pub problem: String,
}

/// Number of findings that are collected before verification is given up.
pub const MAX_FINDINGS: usize = 100;
