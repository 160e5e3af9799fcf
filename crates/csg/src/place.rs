//! Where a box lies, as far as it is known.

/// Whether a box lies inside of a solid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Place {
    /// All of it is outside.
    Void,
    /// All of it is inside.
    Full,
    /// Neither is sure.
    Mixed,
}

impl Place {
    /// That of what is all inside or all outside.
    pub(crate) fn uniform(is_inside: bool) -> Place {
        if is_inside { Place::Full } else { Place::Void }
    }

    /// That of the complement, if it is asked for.
    pub(crate) fn negated_if(self, is_negated: bool) -> Place {
        match self {
            Place::Mixed => Place::Mixed,
            uniform => Place::uniform((uniform == Place::Full) != is_negated),
        }
    }
}
