//! Range of the colours that a text file has: one for the whole file.

/// Numbers of colours are from 0 to 1 in some files and from 0 to 255 in others. Those of a file have one range: 0 to 255 if any number is 2 or more, else 0
/// to 1. (Numbers slightly above 1 are lights that overshoot.)
#[derive(Clone, Copy, Default)]
pub(super) struct ColourRange {
    has_bytes: bool,
}

impl ColourRange {
    /// Takes a number of the file into account.
    pub(super) fn add(&mut self, number: f64) {
        self.has_bytes |= number >= 2.0;
    }

    /// Whether colours are from 0 to 255.
    pub(super) fn has_bytes(self) -> bool {
        self.has_bytes
    }

    /// A colour from its numbers.
    pub(super) fn colour(self, numbers: [f64; 3]) -> [u8; 3] {
        let factor = if self.has_bytes { 1.0 } else { 255.0 };
        numbers.map(|number| (number * factor).round() as u8)
    }
}
