//! The cells under an output pixel, along one axis.

/// Share of a cell in a span if rounding leaves none of its length: more than 0, but negligible in
/// the sum of the shares of a pixel's cells.
const MIN_SHARE: f64 = 1e-12;

/// The cells that an output pixel covers along one axis.
pub(super) struct Span {
    pub(super) from: f64,
    pub(super) to: f64,
    pub(super) first: u64,
    pub(super) end: u64,
}

impl Span {
    /// All cells from `from` on for `length`, or only the cell in the middle.
    pub(super) fn new(from: f64, length: f64, all: bool, min: u64, max: u64) -> Span {
        let (from, to) = if all { (from, from + length) } else { (from + length / 2.0, from + length / 2.0) };
        let first = (from.floor() as u64).clamp(min, max - 1);
        Span { from, to, first, end: (to.ceil() as u64).clamp(first + 1, max.max(first + 1)) }
    }

    /// Covered length of a cell; 1 for the cell in the middle.
    pub(super) fn share(&self, cell: u64) -> f64 {
        if self.from == self.to {
            return 1.0;
        }
        // Rounding may leave a cell of the span without length. It still needs a weight: a pixel
        // that covers only such cells would be VOID otherwise.
        (self.to.min(cell as f64 + 1.0) - self.from.max(cell as f64)).max(MIN_SHARE)
    }
}
