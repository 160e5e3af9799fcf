//! Classification of boxes relative to a solid.

/// Relation of a box to a solid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Place {
    /// The box is outside.
    Void,
    /// The box is inside.
    Full,
    /// The box may be partly inside.
    Mixed,
}

impl Place {
    /// Returns the classification of a box that is entirely inside or entirely outside.
    pub(crate) fn uniform(is_inside: bool) -> Place {
        if is_inside { Place::Full } else { Place::Void }
    }

    /// Returns the classification relative to the complement if `is_negated`.
    pub(crate) fn negated_if(self, is_negated: bool) -> Place {
        match self {
            Place::Mixed => Place::Mixed,
            uniform => Place::uniform((uniform == Place::Full) != is_negated),
        }
    }
}
