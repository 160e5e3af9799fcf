//! Input of cells: slabs of samples are cut into blocks, classified as VOID or data, and put into Z
//! order.

use std::ops::Range;

use zerocopy::FromBytes;

use super::averaging::{decode, from_value};
use super::block::Block;
use super::rounding::Rounding;
use super::rows::RowBlock;
use crate::store::records::{Record, with_block_type};
use crate::tree::CellBlock;
use spinney_base::Result;
use spinney_base::TreeType;
use spinney_base::space::{Code, Dimension, morton_encode};
use spinney_base::value::{Mask, Native, Value};
use spinney_container::{LEAF, VOID};

/// A box of cells: x fastest, then y, then z; the samples of a cell are consecutive and
/// little-endian.
#[derive(Clone, Debug, Default)]
pub struct Slab {
    /// First cell along each axis.
    pub origin: [u64; 3],
    /// Cells along each axis; 1 along the third for a raster.
    pub size: [u64; 3],
    /// The samples.
    pub bytes: Vec<u8>,
    /// One flag per cell, `false` is VOID; `None` if no cell is VOID by flag.
    pub valid: Option<Vec<bool>>,
}

/// Samples that are delivered slab by slab.
pub trait Slabs: Send {
    /// Returns the number of cells along each axis of the whole; the last is 1 for a raster.
    fn extent(&self) -> [u64; 3];

    /// Returns whether slabs are delivered in FD order, so that all cells of a node arrive before
    /// any cell after it. The resulting file is the same in any order, but in another order
    /// segments wait in a temporary file.
    fn are_in_order(&self) -> bool {
        false
    }

    /// Reads the next slab, reusing the buffers of `slab`; returns `false` if none is left.
    ///
    /// Slabs start at multiples of the block size (256 cells for quadtrees, 64 for octrees), end at
    /// such multiples or at the extent's end, and together cover the extent once.
    ///
    /// # Errors
    /// If the input cannot be read.
    fn next(&mut self, slab: &mut Slab) -> Result<bool>;
}

/// The cells of a block in the input.
pub(super) enum BlockContent {
    /// All cells are equal.
    Uniform(Option<Value>),
    /// Cells that differ, none of which is VOID, to be built in rows.
    Full(RowBlock),
    /// Cells that differ, or a block that reaches beyond the data.
    Mixed(Block),
}

impl BlockContent {
    /// Rounds all cells.
    pub(super) fn round(&mut self, rounding: &Rounding) {
        match self {
            BlockContent::Uniform(value) => *value = value.map(|value| rounding.rounded(value)),
            BlockContent::Full(block) => rounding.round(block.cells_mut()),
            // (VOID nodes have zeros, which rounding preserves. INNER nodes are computed from the
            // rounded cells.)
            BlockContent::Mixed(block) => {
                block.levels.iter_mut().for_each(|level| rounding.round(&mut level.values));
            }
        }
    }
}

/// The cells of a block that are in a slab.
struct BlockCells {
    /// The first cell, relative to the slab.
    first: [u64; 3],
    /// Cells along each axis.
    size: [usize; 3],
}

impl Slab {
    /// Returns the cells of one block as a slab.
    pub(super) fn of_block(form: TreeType, code: Code, height: u8, cells: CellBlock) -> Slab {
        let side = |axis: usize| if axis < form.axes() { 1u64 << height } else { 1 };
        let cell = code.cell();
        Slab {
            origin: std::array::from_fn(|axis| u64::from(cell[axis]) * side(axis)),
            size: std::array::from_fn(side),
            valid: cells.present.contains(&false).then_some(cells.present),
            bytes: cells.values,
        }
    }

    /// Classifies the cells under a node. If they differ, puts them into Z order, or into rows if
    /// `in_rows` allows it and none is VOID. `nodata` is the value that means VOID; NaN always
    /// does.
    pub(super) fn classify(
        &self,
        form: TreeType,
        code: Code,
        height: u8,
        nodata: Option<Value>,
        in_rows: bool,
    ) -> BlockContent {
        let side = 1u64 << height;
        let axes = form.axes();
        let cell = code.cell();
        let first: [u64; 3] = std::array::from_fn(|axis| ((cell[axis] as u64) << height) - self.origin[axis]);
        let size: [usize; 3] = std::array::from_fn(|axis| {
            let most = if axis < axes { side } else { 1 };
            (self.size[axis] - first[axis]).min(most) as usize
        });
        let is_whole = size.iter().take(axes).all(|cells| *cells as u64 == side);
        let part = BlockCells { first, size };
        let width = form.width();
        if self.is_uniform(self.rows(&part).map(|(_, _, row)| row), width) {
            let start = self.rows(&part).next().map_or(0, |(_, _, row)| row.start);
            let value = Value::from_bytes(&self.bytes[start * width..][..width]);
            let is_void = form.value.is_nan(value) || nodata == Some(value);
            let valid = self.valid.as_ref().is_none_or(|valid| valid[start]) && !is_void;
            if is_whole || !valid {
                return BlockContent::Uniform(valid.then_some(value));
            }
        }
        let has_void = || with_block_type!(form, V, R => self.has_void::<V, R>(&part, nodata));
        if is_whole && in_rows && !self.has_transparent(form, &part) && !has_void() {
            let rows = self.rows(&part).map(|(_, _, row)| &self.bytes[row.start * width..row.end * width]);
            return BlockContent::Full(RowBlock::new(form, code, height, rows.collect::<Vec<_>>().concat()));
        }
        let (states, values) = with_block_type!(form, V, R => self.in_z_order::<V, R>(&part, height, nodata));
        BlockContent::Mixed(Block::from_cells(form, code, height, states, values))
    }

    /// Returns whether some cells of a block are transparent.
    fn has_transparent(&self, form: TreeType, part: &BlockCells) -> bool {
        let (mask, size, width) = (form.value.mask, form.value.sample.size(), form.width());
        let is_transparent = |value: &[u8]| !mask.present(size, value)[0];
        mask == Mask::Alpha
            && self.rows(part).any(|(_, _, row)| {
                self.bytes[row.start * width..row.end * width].chunks_exact(width).any(is_transparent)
            })
    }

    /// Returns the rows of a block: y and z in the block, and the range of the slab's cells.
    fn rows<'a>(
        &self,
        part: &'a BlockCells,
    ) -> impl Iterator<Item = (usize, usize, Range<usize>)> + Clone + use<'a> {
        let [width, height, _] = self.size;
        let BlockCells { first, size } = part;
        (0..size[2]).flat_map(move |z| (0..size[1]).map(move |y| (y, z))).map(move |(y, z)| {
            let row = ((first[2] + z as u64) * height + first[1] + y as u64) * width + first[0];
            (y, z, row as usize..row as usize + size[0])
        })
    }

    /// Returns whether some cells of a block are VOID. A kernel, compiled for each type.
    fn has_void<V: Native, R: Record>(&self, part: &BlockCells, nodata: Option<Value>) -> bool {
        if self.valid.is_none() && nodata.is_none() && !V::TYPE.sample.is_float() {
            return false;
        }
        let cells = <[R::Bytes]>::ref_from_bytes(&self.bytes).expect("whole values");
        let nodata = nodata.map(from_value::<R>);
        for (_, _, row) in self.rows(part) {
            if self.valid.as_ref().is_some_and(|valid| valid[row.clone()].contains(&false)) {
                return true;
            }
            // No early exit within a row, so that many cells are checked at a time.
            let mut is_void = false;
            for bytes in &cells[row] {
                is_void |= decode::<R, V>(*bytes).is_nan() | (nodata == Some(*bytes));
            }
            if is_void {
                return true;
            }
        }
        false
    }

    /// Returns states and values of a block's cells in Z order. A kernel, compiled for each type.
    fn in_z_order<V: Native, R: Record>(
        &self,
        part: &BlockCells,
        height: u8,
        nodata: Option<Value>,
    ) -> (Vec<u8>, Vec<u8>) {
        let cells = <[R::Bytes]>::ref_from_bytes(&self.bytes).expect("whole values");
        let nodata = nodata.map(from_value::<R>);
        let is_void = |bytes: R::Bytes| decode::<R, V>(bytes).is_nan() || nodata == Some(bytes);
        let never_void = self.valid.is_none() && nodata.is_none() && !V::TYPE.sample.is_float();
        let by_flags_alone = nodata.is_none()
            && !V::TYPE.sample.is_float()
            && part.size[..R::AXES] == [1 << height; 3][..R::AXES];
        let cells_in_block = 1 << (R::AXES * height as usize);
        let is_whole = never_void && part.size[0] * part.size[1] * part.size[2] == cells_in_block;
        let mut states = vec![if is_whole { LEAF } else { VOID }; cells_in_block];
        let mut bytes = vec![0; cells_in_block * size_of::<R::Bytes>()];
        let values = <[R::Bytes]>::mut_from_bytes(&mut bytes).expect("whole values");
        let encoded = z_order_of_axis(R::DIMENSION, height);
        for (y, z, row) in self.rows(part) {
            let row_index = encoded[y] << 1 | if R::AXES > 2 { encoded[z] << 2 } else { 0 };
            // Pairs along x stay adjacent in Z order.
            if is_whole {
                for (i, pair) in cells[row].chunks(2).enumerate() {
                    for (value, cell) in values[row_index | encoded[2 * i]..].iter_mut().zip(pair) {
                        *value = *cell;
                    }
                }
                continue;
            }
            let valid = self.valid.as_ref().map(|valid| &valid[row.clone()]);
            if let (Some(valid), true) = (valid, by_flags_alone) {
                let (cells, valid) = (cells[row].as_chunks::<2>().0, valid.as_chunks::<2>().0);
                for (i, (cells, valid)) in cells.iter().zip(valid).enumerate() {
                    let index = row_index | encoded[2 * i];
                    let (values, states) = (&mut values[index..index + 2], &mut states[index..index + 2]);
                    for j in 0..2 {
                        values[j] = if valid[j] { cells[j] } else { R::ZERO };
                        states[j] = if valid[j] { LEAF } else { VOID };
                    }
                }
                continue;
            }
            for (i, pair) in cells[row].chunks(2).enumerate() {
                let index = row_index | encoded[2 * i];
                for (j, cell) in pair.iter().enumerate() {
                    if never_void || valid.is_none_or(|valid| valid[2 * i + j]) && !is_void(*cell) {
                        values[index + j] = *cell;
                        states[index + j] = LEAF;
                    }
                }
            }
        }
        (states, bytes)
    }

    /// Returns whether all cells of these rows are equal, in every bit and in validity.
    fn is_uniform(&self, rows: impl Iterator<Item = Range<usize>>, size: usize) -> bool {
        let (mut first, mut first_valid): (Option<&[u8]>, Option<bool>) = (None, None);
        for row in rows {
            if let Some(valid) = &self.valid {
                let valid = &valid[row.clone()];
                let expected = *first_valid.get_or_insert(valid[0]);
                if valid.iter().any(|flag| *flag != expected) {
                    return false;
                }
            }
            let bytes = &self.bytes[row.start * size..row.end * size];
            let alike = match first {
                // A row of equal cells equals itself shifted by one.
                None => bytes[size..] == bytes[..bytes.len() - size],
                Some(first) => bytes == first,
            };
            if !alike {
                return false;
            }
            first = first.or(Some(bytes));
        }
        first.is_some()
    }
}

/// Returns the Z-order indices of the cells along the x axis of a block.
fn z_order_of_axis(dimension: Dimension, height: u8) -> Vec<usize> {
    (0..1 << height).map(|x| morton_encode(dimension, x) as usize).collect()
}
