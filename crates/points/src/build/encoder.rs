//! Blocks of bytes of the points of nodes.

use super::NUMBER_BYTES;
use crate::attribute::{RowLayout, place_of};
use crate::codec::{BlockLayout, columns_of, encode};
use crate::grid::PointGrid;
use crate::statistics::Statistics;
use spinney_packing::{LOG_BITS, log2};

/// A block, ready to be written.
pub(crate) struct EncodedBlock {
    /// The bytes.
    pub bytes: Vec<u8>,
    /// What is known of its points.
    pub statistics: Statistics,
}

/// What encoding needs to know of points.
pub(crate) struct Encoder {
    pub layout: RowLayout,
    pub block: BlockLayout,
    pub grid: PointGrid,
}

/// Pairs of neighbours that tell which order suits a block.
const TRIED: usize = 512;
/// Bits that a time takes where points do not stand in its order.
const TIME_BITS: u64 = 14;

impl Encoder {
    pub(crate) fn new(layout: RowLayout, grid: PointGrid) -> Encoder {
        Encoder { block: BlockLayout::of(&layout), layout, grid }
    }

    /// Bytes of a row with its number.
    pub(crate) fn stride(&self) -> usize {
        self.layout.size + NUMBER_BYTES
    }

    /// Makes a block of rows with their numbers. They are put in the order in which they came in, or in that of their codes, which
    /// costs fewer bits where they came in no order.
    pub(crate) fn encode(&self, rows: &[u8]) -> EncodedBlock {
        let stride = self.stride();
        let came = self.ordered(rows, |row| number_of(row, self.layout.size));
        let by_code = || self.ordered(rows, |row| self.grid.code(place_of(row)).map_or(0, |code| code.bits()));
        let rows = match self.jumps(&came) > TIME_BITS * u64::from(self.block.clock.is_some()) + self.usual_jump(rows) {
            false => came,
            true => {
                let other = by_code();
                let time = TIME_BITS * u64::from(self.block.clock.is_some());
                if self.jumps(&other) + time < self.jumps(&came) { other } else { came }
            }
        };
        let columns = columns_of(&rows, stride, &self.layout);
        let statistics = Statistics::of(&columns, &self.layout.attributes);
        EncodedBlock { bytes: encode(&columns, &self.block), statistics }
    }

    /// The rows in the order of a key, those with equal ones as they are.
    fn ordered(&self, rows: &[u8], key: impl Fn(&[u8]) -> u64) -> Vec<u8> {
        let stride = self.stride();
        let mut order: Vec<u128> = rows
            .chunks_exact(stride)
            .enumerate()
            .map(|(index, row)| u128::from(key(row)) << 32 | index as u128)
            .collect();
        spinney_base::sort::numbers128(&mut order);
        let mut sorted = Vec::with_capacity(rows.len());
        for place in order {
            let at = (place as u32) as usize * stride;
            sorted.extend_from_slice(&rows[at..at + stride]);
        }
        sorted
    }

    /// Bits, on average, of how far it is from point to point.
    fn jumps(&self, rows: &[u8]) -> u64 {
        let stride = self.stride();
        let count = rows.len() / stride;
        let step = (count / TRIED).max(1);
        let (mut bits, mut pairs) = (0, 0);
        for index in (1..count).step_by(step) {
            let [before, here] = [index - 1, index].map(|index| place_of(&rows[index * stride..]));
            for axis in 0..3 {
                bits += log2(u64::from(before[axis].abs_diff(here[axis])) + 1);
            }
            pairs += 1;
        }
        (bits >> LOG_BITS).checked_div(pairs).unwrap_or(0)
    }

    /// Bits of how far it would be between neighbours in a plane, of as many points as there are in their box.
    fn usual_jump(&self, rows: &[u8]) -> u64 {
        let stride = self.stride();
        let (mut least, mut most) = ([i32::MAX; 3], [i32::MIN; 3]);
        for row in rows.chunks_exact(stride) {
            let place = place_of(row);
            for axis in 0..3 {
                least[axis] = least[axis].min(place[axis]);
                most[axis] = most[axis].max(place[axis]);
            }
        }
        let bits: u64 = (0..3).map(|axis| log2(u64::from(least[axis].abs_diff(most[axis])) + 1)).sum();
        let points = log2((rows.len() / stride) as u64);
        (bits.saturating_sub(points)) >> LOG_BITS
    }
}

/// The number behind a row of so many bytes.
#[inline]
pub(crate) fn number_of(row: &[u8], size: usize) -> u64 {
    let mut bytes = [0; 8];
    bytes[..NUMBER_BYTES].copy_from_slice(&row[size..size + NUMBER_BYTES]);
    u64::from_le_bytes(bytes)
}
