//! Windows: the values of any box of cells at any level.

mod autumnal;
mod goblin;
mod painter;
mod source;
mod stored;

pub use source::Canvas;
pub use stored::StoredRows;

use spinney_base::space::Bounds;
use spinney_base::value::ValueType;
use spinney_base::{Error, Result};

/// Fails unless a window's buffers have one value, and one flag, for each cell of its box.
fn check_buffers(
    value_type: ValueType,
    bounds: &Bounds,
    values: &[u8],
    valid: Option<&[bool]>,
) -> Result<()> {
    let (cells, width) = (bounds.volume(), value_type.size());
    let count = values.len() / width;
    if count as u64 != cells || !values.len().is_multiple_of(width) {
        let found = format!("{} bytes", values.len());
        return Err(Error::invalid("window buffer", found, format!("{cells} values of {value_type}")));
    }
    let flags = valid.map_or(count, <[bool]>::len);
    if flags != count {
        let found = format!("{count} values and {flags} flags");
        return Err(Error::invalid("window buffer", found, format!("{cells} of each")));
    }
    Ok(())
}
