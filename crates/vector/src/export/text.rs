//! Text output of formats that write points as text.

use std::io::Write;

use super::Geometry;
use spinney_base::io::Output;
use spinney_base::{Error, Result};

/// Bytes written at a time.
const BUFFER: usize = 1 << 16;

/// Buffered text output.
pub(super) struct Text {
    output: Output,
    buffer: Vec<u8>,
}

impl Text {
    pub(super) fn new(output: Output) -> Text {
        Text { output, buffer: Vec::with_capacity(2 * BUFFER) }
    }

    pub(super) fn push(&mut self, text: &str) {
        self.buffer.extend_from_slice(text.as_bytes());
    }

    /// Writes the shortest decimal string that parses to the same number; `null` for numbers that
    /// are not finite.
    pub(super) fn push_number(&mut self, number: f64) {
        // Normalizes negative zero.
        let number = if number == 0.0 { 0.0 } else { number };
        let written = serde_json::to_writer(&mut self.buffer, &number);
        debug_assert!(written.is_ok(), "memory takes everything");
        if self.buffer.ends_with(b".0") {
            self.buffer.truncate(self.buffer.len() - 2);
        }
    }

    /// Writes integers with a separator.
    pub(super) fn push_integers(&mut self, numbers: &[u64], between: &str) {
        for (index, number) in numbers.iter().enumerate() {
            if index > 0 {
                self.push(between);
            }
            self.push(&number.to_string());
        }
    }

    /// Writes a JSON string.
    pub(super) fn push_json(&mut self, text: &str) {
        let written = serde_json::to_writer(&mut self.buffer, text);
        debug_assert!(written.is_ok(), "memory takes everything");
    }

    /// Writes the points of a part, separated by commas. Each is `open`, its coordinates separated
    /// by `between`, and `close`.
    pub(super) fn push_points(
        &mut self,
        geometry: &dyn Geometry,
        part: usize,
        has_z: bool,
        [open, between, close]: [&str; 3],
    ) -> Result<()> {
        let mut is_first = true;
        geometry.points(part, &mut |points| {
            for point in points {
                if !std::mem::take(&mut is_first) {
                    self.push(",");
                }
                self.push(open);
                for (axis, number) in point[..if has_z { 3 } else { 2 }].iter().enumerate() {
                    if axis > 0 {
                        self.push(between);
                    }
                    self.push_number(*number);
                }
                self.push(close);
                self.flush_some()?;
            }
            Ok(())
        })
    }

    /// Flushes the buffer if it is large.
    pub(super) fn flush_some(&mut self) -> Result<()> {
        if self.buffer.len() >= BUFFER { self.flush() } else { Ok(()) }
    }

    fn flush(&mut self) -> Result<()> {
        let written = self.output.write_all(&self.buffer);
        written.map_err(|cause| Error::io(self.output.path(), "write")(cause))?;
        self.buffer.clear();
        Ok(())
    }

    pub(super) fn finish(mut self) -> Result<()> {
        self.flush()?;
        self.output.commit()
    }
}
