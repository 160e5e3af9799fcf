//! Cells under output pixels, along one axis.

/// Share of a cell that counts where rounding leaves nothing of one that is in a span: more than 0, and less than what adding the
/// shares of all cells of a pixel can tell.
const MIN_SHARE: f64 = 1e-12;

/// The cells that an output pixel covers along one axis.
pub(super) struct Span {
    pub(super) from: f64,
    pub(super) to: f64,
    pub(super) first: u64,
    pub(super) end: u64,
}

impl Span {
    /// All cells from `from` on for `length`, or only the one in the middle.
    pub(super) fn new(from: f64, length: f64, all: bool, min: u64, max: u64) -> Span {
        let (from, to) = if all { (from, from + length) } else { (from + length / 2.0, from + length / 2.0) };
        let first = (from.floor() as u64).clamp(min, max - 1);
        Span { from, to, first, end: (to.ceil() as u64).clamp(first + 1, max.max(first + 1)) }
    }

    /// Length of a cell that is covered; 1 for the one in the middle.
    pub(super) fn share(&self, cell: u64) -> f64 {
        if self.from == self.to {
            return 1.0;
        }
        // Rounding may leave a cell that is in the span by its number without any of its length: it still has
        // to have a weight, or a pixel of such cells alone would be VOID.
        (self.to.min(cell as f64 + 1.0) - self.from.max(cell as f64)).max(MIN_SHARE)
    }
}
