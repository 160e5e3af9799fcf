//! Cells on their way in: slabs of samples, cut into blocks, told VOID from data, put into Z order.

use zerocopy::FromBytes;

use super::block::Block;
use crate::Result;
use crate::space::{Code, spread};
use crate::store::goblin::{LEAF, Layout, VOID};
use crate::value::Value;

/// A box of cells: x runs fastest, then y, then z; a cell's samples together, little-endian.
#[derive(Clone, Debug, Default)]
pub struct Slab {
    /// First cell along each axis.
    pub origin: [u64; 3],
    /// Cells along each axis; 1 along the third for a picture.
    pub size: [u64; 3],
    /// The samples.
    pub bytes: Vec<u8>,
    /// One flag per cell, `false` is VOID; nothing if no cell is VOID by this measure.
    pub valid: Option<Vec<bool>>,
}

/// Samples that come slab by slab.
pub trait Slabs: Send {
    /// Cells along each axis of the whole; the last is 1 for a picture.
    fn extent(&self) -> [u64; 3];

    /// Reads the next slab, reusing the one given; `false` if there is none left.
    ///
    /// Slabs start at multiples of the block size (256 cells for quadtrees, 64 for octrees), end at such multiples
    /// or at the extent's end, and together cover the extent once.
    ///
    /// # Errors
    /// If the input cannot be read.
    fn next(&mut self, slab: &mut Slab) -> Result<bool>;
}

/// A block as found in the input.
pub(in crate::store) enum Found<D: Layout, V: Value> {
    /// All cells alike.
    Uniform(Option<V>),
    /// Something else.
    Mixed(Block<D, V>),
}

impl Slab {
    /// What the cells under a node look like. `nodata` is the value that means VOID; NaN always does.
    pub(in crate::store) fn find<D: Layout, V: Value>(
        &self,
        code: Code<D>,
        height: u8,
        nodata: Option<V>,
    ) -> Found<D, V> {
        let cells = <[V::Wire]>::ref_from_bytes(&self.bytes).expect("whole values");
        let side = 1u64 << height;
        let first: [u64; 3] =
            std::array::from_fn(|axis| ((code.cell()[axis] as u64) << height) - self.origin[axis]);
        let size: [usize; 3] = std::array::from_fn(|axis| {
            let most = if axis < D::AXES { side } else { 1 };
            (self.size[axis] - first[axis]).min(most) as usize
        });
        // Rows of the block, as ranges of the slab's cells.
        let rows = (0..size[2]).flat_map(move |z| (0..size[1]).map(move |y| (y, z))).map(|(y, z)| {
            let row = ((first[2] + z as u64) * self.size[1] + first[1] + y as u64) * self.size[0] + first[0];
            (y, z, row as usize..row as usize + size[0])
        });
        let is_void = |value: V| value.is_nan() || nodata.is_some_and(|nodata| nodata.same(value));
        if self.is_uniform(rows.clone().map(|(_, _, row)| row), size_of::<V::Wire>()) {
            let start = rows.clone().next().map_or(0, |(_, _, row)| row.start);
            let value = V::from_wire(cells[start]);
            let valid = self.valid.as_ref().is_none_or(|valid| valid[start]) && !is_void(value);
            let is_whole = size.iter().take(D::AXES).all(|cells| *cells as u64 == side);
            if is_whole || !valid {
                return Found::Uniform(valid.then_some(value));
            }
        }
        let never_void = self.valid.is_none() && nodata.is_none() && !V::TYPE.sample.is_float();
        let cells_in_block = 1 << (D::AXES * height as usize);
        let whole = never_void && size.iter().product::<usize>() == cells_in_block;
        let mut state = vec![if whole { LEAF } else { VOID }; cells_in_block];
        let mut value = vec![V::default(); cells_in_block];
        // Places of pairs along x, which stay together in Z order.
        let spread: Vec<u32> = (0..side as u32).map(|x| spread::<D>(x) as u32).collect();
        for (y, z, row) in rows {
            let row_place = spread[y] << 1 | if D::AXES > 2 { spread[z] << 2 } else { 0 };
            let pairs = spread.iter().step_by(2).map(|x| (row_place | x) as usize);
            if whole {
                for (place, pair) in pairs.zip(cells[row].chunks(2)) {
                    for (value, wire) in value[place..].iter_mut().zip(pair) {
                        *value = V::from_wire(*wire);
                    }
                }
                continue;
            }
            let valid = self.valid.as_ref().map(|valid| &valid[row.clone()]);
            for (i, (place, pair)) in pairs.zip(cells[row].chunks(2)).enumerate() {
                for (j, wire) in pair.iter().enumerate() {
                    let cell = V::from_wire(*wire);
                    if never_void || valid.is_none_or(|valid| valid[2 * i + j]) && !is_void(cell) {
                        value[place + j] = cell;
                        state[place + j] = LEAF;
                    }
                }
            }
        }
        Found::Mixed(Block::from_cells(code, height, state, value))
    }

    /// Whether all cells of these rows are alike, in every bit and in validity.
    fn is_uniform(&self, rows: impl Iterator<Item = std::ops::Range<usize>>, size: usize) -> bool {
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
