//! Normals of surface nets: the negative gradient of coverage in the 4 x 4 x 4 cells around a
//! vertex. (The eight cells around the vertex would give surfaces of full and empty cells only a
//! few distinct normals.)

use std::sync::Arc;

use glam::DVec3;

use spinney_base::Result;
use spinney_engine::query::cell_blocks::{Block, BlockAttributeValues, CellBlocks, SIDE};

const CELLS: i64 = SIDE as i64;
/// Cells along a side of a block, plus two cells before it and one after it.
const WIDE: usize = SIDE as usize + 3;

/// Weights of the four cells along an axis: binomial smoothing, and its derivative.
const SMOOTH: [i32; 4] = [1, 3, 3, 1];
const SLOPE: [i32; 4] = [1, 1, -1, -1];

/// Coverage in a block and around it.
pub(super) struct NetNormals {
    /// Coverage, 0 to 255: x runs fastest, then y, then z; starts two cells before the block.
    coverage: Vec<u8>,
}

impl NetNormals {
    /// Reads the block at a position of the block level, and its neighbours. Without
    /// `has_coverage`, cells are full or empty.
    pub(super) fn read(blocks: &mut dyn CellBlocks, at: [i64; 3], has_coverage: bool) -> Result<NetNormals> {
        let around: Result<Vec<Arc<Block>>> = (0..27i64)
            .map(|i| blocks.block([at[0] + i % 3 - 1, at[1] + i / 3 % 3 - 1, at[2] + i / 9 - 1]))
            .collect();
        let around = around?;
        // Index of the neighbour along an axis, and the cell in it.
        let place = |cell: usize| {
            let cell = cell as i64 - 2;
            ((cell.div_euclid(CELLS) + 1) as usize, cell.rem_euclid(CELLS) as usize)
        };
        let mut coverage = Vec::with_capacity(WIDE * WIDE * WIDE);
        for z in 0..WIDE {
            let (block_z, z) = place(z);
            for y in 0..WIDE {
                let (block_y, y) = place(y);
                let row = z * SIDE as usize + y;
                let first = 3 * block_y + 9 * block_z;
                for (block, cells) in around[first..first + 3].iter().zip([30..32, 0..32, 0..1]) {
                    match &block.carried {
                        BlockAttributeValues::Coverage(coverages) if has_coverage => {
                            coverage.extend_from_slice(&coverages[row * SIDE as usize..][cells]);
                        }
                        BlockAttributeValues::Same(same) if has_coverage => {
                            coverage.extend(std::iter::repeat_n(*same as u8, cells.len()));
                        }
                        _ => {
                            let solid = block.solid[row];
                            coverage.extend(cells.map(|x| if solid >> x & 1 > 0 { u8::MAX } else { 0 }));
                        }
                    }
                }
            }
        }
        Ok(NetNormals { coverage })
    }

    /// Normal at a cube of cells, where `first` is the cube's first cell counted from the layer
    /// before the block. Zero where the coverage is constant.
    pub(super) fn at(&self, first: [usize; 3]) -> [f64; 3] {
        let mut sum = [0; 3];
        for z in 0..4 {
            for y in 0..4 {
                let row = ((first[2] + z) * WIDE + first[1] + y) * WIDE + first[0];
                let row = &self.coverage[row..row + 4];
                let weigh = |weights: [i32; 4]| (0..4).map(|x| weights[x] * i32::from(row[x])).sum::<i32>();
                let (smooth, slope) = (weigh(SMOOTH), weigh(SLOPE));
                sum[0] += slope * SMOOTH[y] * SMOOTH[z];
                sum[1] += smooth * SLOPE[y] * SMOOTH[z];
                sum[2] += smooth * SMOOTH[y] * SLOPE[z];
            }
        }
        DVec3::from_array(sum.map(f64::from)).normalize_or_zero().to_array()
    }
}
