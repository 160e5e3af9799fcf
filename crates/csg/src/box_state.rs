//! Classification of boxes relative to a solid.

/// Relation of a box to a solid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum BoxState {
    /// The box is outside.
    Void,
    /// The box is inside.
    Full,
    /// The box may be partly inside.
    Mixed,
}

impl BoxState {
    /// Returns the classification of a box that is entirely inside or entirely outside.
    pub(crate) fn uniform(is_inside: bool) -> BoxState {
        if is_inside { BoxState::Full } else { BoxState::Void }
    }

    /// Returns the classification relative to the complement if `is_negated`.
    pub(crate) fn negated_if(self, is_negated: bool) -> BoxState {
        match self {
            BoxState::Mixed => BoxState::Mixed,
            uniform => BoxState::uniform((uniform == BoxState::Full) != is_negated),
        }
    }
}
