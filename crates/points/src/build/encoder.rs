//! Encodes the points of nodes as blocks.

use super::NUMBER_BYTES;
use super::order::order_of;
use crate::attribute::{RowLayout, position_of};
use crate::codec::{BlockLayout, columns_of, encode};
use crate::grid::PointGrid;
use crate::statistics::Statistics;
use spinney_packing::{LOG_BITS, log2};

/// Encoded block.
pub(crate) struct EncodedBlock {
    /// Bytes of the block.
    pub bytes: Vec<u8>,
    /// Statistics of its points.
    pub statistics: Statistics,
}

/// Converts rows of points to blocks.
pub(crate) struct Encoder {
    pub layout: RowLayout,
    pub block: BlockLayout,
    pub grid: PointGrid,
}

/// Number of neighbour pairs sampled to choose the point order of a block.
const TRIED: usize = 512;
/// Cost in bits of a time stamp if points are not ordered by time.
const TIME_BITS: u64 = 14;

impl Encoder {
    pub(crate) fn new(layout: RowLayout, grid: PointGrid) -> Encoder {
        Encoder { block: BlockLayout::of(&layout), layout, grid }
    }

    /// Bytes per row, including its input number.
    pub(crate) fn stride(&self) -> usize {
        self.layout.size + NUMBER_BYTES
    }

    /// Encodes rows with their input numbers as a block. The points keep their input order, or are
    /// sorted by code where that takes fewer bits.
    pub(crate) fn encode(&self, rows: &[u8]) -> EncodedBlock {
        let stride = self.stride();
        let keys = |key: &dyn Fn(&[u8]) -> u64| rows.chunks_exact(stride).map(key).collect::<Vec<u64>>();
        let mut order = order_of(&keys(&|row| number_of(row, self.layout.size)));
        // Most points come along scan lines, so the code order is tried only where it may gain.
        let time = TIME_BITS * u64::from(self.block.clock.is_some());
        let jumps = self.jumps(rows, &order);
        if jumps > time + self.usual_jump(rows) {
            let by_code =
                order_of(&keys(&|row| self.grid.code(position_of(row)).map_or(0, |code| code.bits() >> 5)));
            if self.jumps(rows, &by_code) + time < jumps {
                order = by_code;
            }
        }
        let ordered = order.iter().map(|row| &rows[*row as usize * stride..][..stride]);
        let columns = columns_of(ordered, &self.layout);
        let statistics = Statistics::of(&columns, &self.layout.attributes);
        EncodedBlock { bytes: encode(&columns, &self.block), statistics }
    }

    /// Average number of bits of the coordinate differences between consecutive points.
    fn jumps(&self, rows: &[u8], order: &[u32]) -> u64 {
        let stride = self.stride();
        let step = (order.len() / TRIED).max(1);
        let (mut bits, mut pairs) = (0, 0);
        for pair in order.windows(2).step_by(step) {
            let [before, here] = [pair[0], pair[1]].map(|row| position_of(&rows[row as usize * stride..]));
            for axis in 0..3 {
                bits += log2(u64::from(before[axis].abs_diff(here[axis])) + 1);
            }
            pairs += 1;
        }
        (bits >> LOG_BITS).checked_div(pairs).unwrap_or(0)
    }

    /// Expected bits of the differences between neighbours, if as many points lay on a plane in the
    /// same box.
    fn usual_jump(&self, rows: &[u8]) -> u64 {
        let stride = self.stride();
        let (mut least, mut most) = ([i32::MAX; 3], [i32::MIN; 3]);
        for row in rows.chunks_exact(stride) {
            let position = position_of(row);
            for axis in 0..3 {
                least[axis] = least[axis].min(position[axis]);
                most[axis] = most[axis].max(position[axis]);
            }
        }
        let bits: u64 = (0..3).map(|axis| log2(u64::from(least[axis].abs_diff(most[axis])) + 1)).sum();
        let points = log2((rows.len() / stride) as u64);
        (bits.saturating_sub(points)) >> LOG_BITS
    }
}

/// Returns the input number after a row of `size` bytes.
#[inline]
pub(crate) fn number_of(row: &[u8], size: usize) -> u64 {
    let mut bytes = [0; 8];
    bytes[..NUMBER_BYTES].copy_from_slice(&row[size..size + NUMBER_BYTES]);
    u64::from_le_bytes(bytes)
}
