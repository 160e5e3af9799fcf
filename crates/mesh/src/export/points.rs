//! Sets of grid points of blocks.

use spinney_engine::query::cell_blocks::SIDE;

/// Grid points along a side of a block.
pub(super) const POINTS: usize = SIDE as usize + 1;
/// Cells along a side, as an index.
pub(super) const CELLS: usize = SIDE as usize;

/// Set of grid points of a block: bit x of row `z * POINTS + y`.
#[derive(Clone)]
pub(super) struct Points(Box<[u64]>);

impl Points {
    pub(super) fn none() -> Points {
        Points(vec![0; POINTS * POINTS].into())
    }

    pub(super) fn add(&mut self, [x, y, z]: [u8; 3]) {
        self.0[z as usize * POINTS + y as usize] |= 1 << x;
    }

    pub(super) fn has(&self, [x, y, z]: [u8; 3]) -> bool {
        self.0[z as usize * POINTS + y as usize] >> x & 1 > 0
    }

    /// Adds the points that the block shares with a neighbour at offset `by`, in blocks.
    pub(super) fn add_shared(&mut self, other: &Points, by: [i64; 3]) {
        // Source range and first target row: all rows, or the single shared row.
        let rows = |by: i64| match by {
            -1 => (CELLS..=CELLS, 0),
            0 => (0..=CELLS, 0),
            _ => (0..=0, CELLS),
        };
        let ((ys, to_y), (zs, to_z)) = (rows(by[1]), rows(by[2]));
        for (i, z) in zs.enumerate() {
            for (j, y) in ys.clone().enumerate() {
                let row = other.0[z * POINTS + y];
                self.0[(to_z + i) * POINTS + to_y + j] |= match by[0] {
                    -1 => row >> CELLS,
                    0 => row,
                    _ => (row & 1) << CELLS,
                };
            }
        }
    }
}
