//! Value masks of a layer.

/// Inclusive ranges of values.
pub(super) type Ranges = Vec<[f64; 2]>;

/// The values that a layer shows: those in `show` (all if `None`) except those in `hide`.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Mask {
    pub(super) show: Option<Ranges>,
    pub(super) hide: Ranges,
}

impl Mask {
    /// Returns whether all values are shown.
    pub(super) fn is_empty(&self) -> bool {
        self.show.is_none() && self.hide.is_empty()
    }

    /// Returns whether a value is shown.
    #[inline]
    pub(super) fn shows(&self, number: f64) -> bool {
        let is_in = |ranges: &Ranges| ranges.iter().any(|[low, high]| (*low..=*high).contains(&number));
        self.show.as_ref().is_none_or(is_in) && !is_in(&self.hide)
    }
}
