//! Range of colour values in text formats, determined once per file.

/// Range of a file's colour values. Some files use 0 to 1, others 0 to 255. The range is 0 to 255
/// if any value of the file is 2 or more, else 0 to 1. (Values slightly above 1 are overshooting
/// lights.)
#[derive(Clone, Copy, Default)]
pub(super) struct ColourRange {
    has_bytes: bool,
}

impl ColourRange {
    /// Takes a value of the file into account.
    pub(super) fn add(&mut self, number: f64) {
        self.has_bytes |= number >= 2.0;
    }

    /// Whether colours range from 0 to 255.
    pub(super) fn has_bytes(self) -> bool {
        self.has_bytes
    }

    /// Converts a colour from its values.
    pub(super) fn colour(self, numbers: [f64; 3]) -> [u8; 3] {
        let factor = if self.has_bytes { 1.0 } else { 255.0 };
        numbers.map(|number| (number * factor).round() as u8)
    }
}
