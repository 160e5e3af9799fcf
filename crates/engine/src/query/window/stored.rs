//! Zero-copy windows: boxes of cells that a mapped file stores as contiguous rows.

use crate::query::check_level;
use crate::store::goblin::{Goblin, Located};
use crate::tree::Child;
use spinney_base::Result;
use spinney_base::space::{Bounds, Code};

/// Values of a box of cells within a file. None of them is VOID.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StoredRows<'a> {
    /// Bytes from the box's first value to its last. Values are little-endian and need not be
    /// aligned.
    pub bytes: &'a [u8],
    /// Bytes from a cell to the one in the next row.
    pub row: usize,
    /// Bytes from a cell to the one in the next layer.
    pub layer: usize,
}

impl Goblin {
    /// Returns the values of a box of cells of `level` without copying, if the file is mapped and
    /// the box is in one dense block without VOID. Where no two cells are equal, this holds for
    /// most boxes within an aligned box of 256 x 256 cells (16 x 16 x 16 in octrees). Takes two
    /// searches in the segment index.
    ///
    /// # Errors
    /// If the file is corrupt there, or `level` is deeper than the tree.
    pub fn stored_rows(&self, level: u8, bounds: &Bounds) -> Result<Option<StoredRows<'_>>> {
        let header = self.header();
        check_level(level, header.depth())?;
        let dimension = header.form.dimension;
        if bounds.is_empty() || level == 0 || !Bounds::space(dimension, level).contains(bounds) {
            return Ok(None);
        }
        let corner = |cell: [u64; 3]| {
            Code::from_cell(dimension, level, cell.map(|at| at as u32)).expect("inside the space")
        };
        let (first, last) = (corner(bounds.min), corner(bounds.max.map(|end| end - 1)));
        let above = first.common_ancestor(last);
        let above = above.ancestor(above.level().min(level - 1));
        let Child::Inner { node: Located { segment, record, level: top }, .. } = self.locate(above)? else {
            return Ok(None);
        };
        let Some(records) = segment.mapped_records() else { return Ok(None) };
        let layout = self.layout();
        let head = layout.head(records, record).ok_or_else(|| self.bad_skip(&segment, record))?;
        let block = layout.dense(records, record, head);
        let Some(block) = block.filter(|block| block.is_full() && top + block.levels >= level) else {
            return Ok(None);
        };
        let below = level - top;
        let origin = above.ancestor(top).bounds(level).min;
        let place = |cell: [u64; 3]| {
            let place = std::array::from_fn(|axis| (cell[axis] - origin[axis]) as usize);
            block.index(below, place) * layout.width
        };
        let last = bounds.max.map(|end| end - 1);
        let bytes = &block.values(below)[place(bounds.min)..place(last) + layout.width];
        let row = layout.width << below;
        Ok(Some(StoredRows { bytes, row, layer: row << below }))
    }
}
