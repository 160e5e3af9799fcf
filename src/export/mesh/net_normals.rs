//! Normals of surface nets: against the gradient of coverage in the 4 x 4 x 4 cells around a vertex. (The eight around it alone
//! give a surface of full and empty cells but a few directions.)

use std::sync::Arc;

use glam::DVec3;

use crate::Result;
use crate::query::cell_blocks::{Block, CellBlocks, SIDE};

const CELLS: i64 = SIDE as i64;
/// Cells along an edge of a block, the two before them, and the one behind.
const WIDE: usize = SIDE as usize + 3;

/// Weights of the four cells along an axis: those of a binomial, and of its derivative.
const SMOOTH: [f64; 4] = [1.0, 3.0, 3.0, 1.0];
const SLOPE: [f64; 4] = [1.0, 1.0, -1.0, -1.0];

/// Coverage in a block and around it.
pub(super) struct NetNormals {
    /// 0 to 255: x runs fastest, then y, then z; from two cells before the block.
    coverage: Vec<u8>,
}

impl NetNormals {
    /// Reads the block at a place of those of its level, and its neighbours. Cells are full or empty unless their coverage is
    /// carried.
    pub(super) fn read(blocks: &mut dyn CellBlocks, at: [i64; 3], has_coverage: bool) -> Result<NetNormals> {
        let around: Result<Vec<Arc<Block>>> = (0..27i64)
            .map(|i| blocks.block([at[0] + i % 3 - 1, at[1] + i / 3 % 3 - 1, at[2] + i / 9 - 1]))
            .collect();
        let around = around?;
        // Number of the neighbour along an axis, and the cell there.
        let place = |cell: usize| {
            let cell = cell as i64 - 2;
            ((cell.div_euclid(CELLS) + 1) as usize, cell.rem_euclid(CELLS) as u32)
        };
        let mut coverage = Vec::with_capacity(WIDE * WIDE * WIDE);
        for z in 0..WIDE {
            let (block_z, z) = place(z);
            for y in 0..WIDE {
                let (block_y, y) = place(y);
                let row: [&Block; 3] =
                    std::array::from_fn(|block_x| &*around[block_x + 3 * block_y + 9 * block_z]);
                coverage.extend((0..WIDE).map(|x| {
                    let (block_x, x) = place(x);
                    match has_coverage {
                        true => row[block_x].attribute([x, y, z]) as u8,
                        false => u8::from(row[block_x].is_solid([x, y, z])) * u8::MAX,
                    }
                }));
            }
        }
        Ok(NetNormals { coverage })
    }

    /// The normal at a cube of cells, by the first of them from the layer before the block; zero where coverage is the same all
    /// around.
    pub(super) fn at(&self, first: [usize; 3]) -> [f64; 3] {
        let mut sum = DVec3::ZERO;
        for z in 0..4 {
            for y in 0..4 {
                let row = ((first[2] + z) * WIDE + first[1] + y) * WIDE + first[0];
                for (x, coverage) in self.coverage[row..row + 4].iter().enumerate() {
                    let slope = DVec3::new(
                        SLOPE[x] * SMOOTH[y] * SMOOTH[z],
                        SMOOTH[x] * SLOPE[y] * SMOOTH[z],
                        SMOOTH[x] * SMOOTH[y] * SLOPE[z],
                    );
                    sum += slope * f64::from(*coverage);
                }
            }
        }
        sum.normalize_or_zero().to_array()
    }
}
