//! What verification finds.

/// Something that is wrong with a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// The part of the file.
    pub place: String,
    /// What is wrong with it.
    pub problem: String,
}

/// Findings that are collected before verification is given up.
pub(in crate::store) const MAX_FINDINGS: usize = 100;
