//! Writer of raw samples.

use std::io::Write;

use super::{ImageSpec, RowWriter, Rows};
use spinney_base::io::Output;
use spinney_base::{Error, Result};

/// Writes rows unchanged, after any header that is already in the output.
pub(super) struct Raw {
    output: Output,
    rows: Rows,
}

pub(super) fn create(output: Output, spec: &ImageSpec) -> Result<Box<dyn RowWriter>> {
    Ok(Box::new(Raw { output, rows: Rows::new(spec) }))
}

impl RowWriter for Raw {
    fn write_rows(&mut self, bytes: &[u8], _: Option<&[bool]>) -> Result<()> {
        self.rows.take(bytes)?;
        self.output.write_all(bytes).map_err(Error::io(self.output.path(), "write"))
    }

    fn finish(self: Box<Self>) -> Result<()> {
        self.rows.finish()?;
        self.output.commit()
    }
}
