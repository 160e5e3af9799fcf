//! Encoding of point rows in shard summaries: blocks of columns, as in trees, with two more
//! columns: the input number of the point and the level of its node.

use crate::attribute::{POSITION_BYTES, PointAttribute, RowLayout};
use crate::build::{Encoder, MAX_NUMBERS, NUMBER_BYTES};
use crate::codec::{BlockLayout, columns_of, decode, encode};
use spinney_base::value::SampleType;

/// Maximum number of points in a block.
pub(super) const MAX_ROWS: usize = 1 << 16;

/// Codec between rows with input numbers and levels, and bytes.
pub(super) struct PackedRows<'a> {
    encoder: &'a Encoder,
    block: BlockLayout,
}

impl<'a> PackedRows<'a> {
    /// Creates the codec for an encoder's rows.
    pub(super) fn new(encoder: &'a Encoder) -> PackedRows<'a> {
        let mut attributes = encoder.layout.attributes.clone();
        // Blocks do not use the names.
        attributes.push(PointAttribute::new("", SampleType::I64));
        attributes.push(PointAttribute::new("", SampleType::U8));
        PackedRows { encoder, block: BlockLayout::of(&RowLayout::packed(attributes)) }
    }

    /// Encodes at most [`MAX_ROWS`] rows and their levels.
    pub(super) fn encode(&self, rows: &[u8], levels: &[u8]) -> Vec<u8> {
        let Encoder { layout, .. } = self.encoder;
        let all = rows.chunks_exact(self.encoder.stride());
        let mut columns = columns_of(all.clone(), layout);
        columns.push(all.map(|row| number_of(&row[layout.size..])).collect());
        columns.push(levels.iter().map(|level| i64::from(*level)).collect());
        encode(&columns, &self.block)
    }

    /// Decodes rows and their levels, and appends them. `None` if the bytes are corrupt.
    pub(super) fn decode(
        &self,
        bytes: &[u8],
        count: usize,
        rows: &mut Vec<u8>,
        levels: &mut Vec<u8>,
    ) -> Option<()> {
        let columns = decode(bytes, count, &self.block, &vec![true; self.block.columns])?;
        let Encoder { layout, grid, .. } = self.encoder;
        let (attributes, rest) = columns[3..].split_at(layout.attributes.len());
        for point in 0..count {
            let mut position = [0; 3];
            for axis in 0..3 {
                position[axis] = i32::try_from(columns[axis][point]).ok()?;
            }
            grid.code(position)?;
            let number = u64::try_from(rest[0][point]).ok().filter(|number| *number < MAX_NUMBERS)?;
            levels.push(rest[1][point].try_into().ok()?);
            let first = rows.len();
            rows.resize(first + self.encoder.stride(), 0);
            let (row, remaining) = rows[first..].split_at_mut(layout.size);
            for (bytes, step) in row[..POSITION_BYTES].chunks_exact_mut(4).zip(position) {
                bytes.copy_from_slice(&step.to_le_bytes());
            }
            for (attribute, column) in attributes.iter().enumerate() {
                layout.set_number(attribute, row, column[point]);
            }
            remaining.copy_from_slice(&number.to_le_bytes()[..NUMBER_BYTES]);
        }
        Some(())
    }
}

/// Returns the input number at the end of a row.
fn number_of(bytes: &[u8]) -> i64 {
    let mut number = [0; 8];
    number[..NUMBER_BYTES].copy_from_slice(&bytes[..NUMBER_BYTES]);
    i64::from_le_bytes(number)
}
