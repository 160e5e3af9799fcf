//! Blocks that a surface may cross, in Z order.

use spinney_base::{Progress, Result};
use spinney_engine::query::cell_blocks::{BlockState, CellBlocks};

/// Criterion for the blocks of a surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Reach {
    /// Blocks whose solid cells have exposed faces: mixed blocks, and solid blocks with a face
    /// neighbour that is not solid.
    Faces,
    /// Blocks that are not uniform together with the layer of cells before them along each axis.
    /// This includes the layer of blocks beyond the space.
    Nets,
}

/// Passes all blocks of a surface to `each`.
pub(super) fn visit(
    blocks: &mut dyn CellBlocks,
    reach: Reach,
    progress: &dyn Progress,
    mut each: impl FnMut(&mut dyn CellBlocks, [u32; 3]) -> Result<()>,
) -> Result<()> {
    let (deepest, cells) = (blocks.block_level(), blocks.level());
    let total = 1u64 << (3 * cells);
    // A stack: the last node is the next one.
    let mut pending = match reach {
        Reach::Faces => vec![(0, [0; 3])],
        Reach::Nets => {
            let ends = blocks.ends();
            let is_ours = |step: &u32| (0..3).all(|axis| step >> axis & 1 == 0 || ends[axis]);
            (0..8).rev().filter(is_ours).map(|step| (0, child([0; 3], step))).collect()
        }
    };
    while let Some((level, node)) = pending.pop() {
        let inside = node.iter().all(|cell| *cell < 1 << level);
        let is_wanted = reach.wants(blocks, level, node)?;
        if is_wanted && level < deepest {
            pending.extend((0..8).rev().map(|step| (level + 1, child(node, step))));
            continue;
        }
        progress.check()?;
        if is_wanted {
            each(blocks, node)?;
        }
        if inside {
            progress.advance(1 << (3 * (cells - level)), total);
        }
    }
    Ok(())
}

fn child(node: [u32; 3], step: u32) -> [u32; 3] {
    std::array::from_fn(|axis| node[axis] << 1 | step >> axis & 1)
}

impl Reach {
    /// Whether a surface may cross a node.
    pub(super) fn wants(self, blocks: &mut dyn CellBlocks, level: u8, node: [u32; 3]) -> Result<bool> {
        let node = node.map(i64::from);
        let state = blocks.state(level, node)?;
        if state == BlockState::Mixed {
            return Ok(true);
        }
        if self == Reach::Faces && state == BlockState::Uniform(false) {
            return Ok(false);
        }
        let mut differs = |by: [i64; 3]| {
            Ok(blocks.state(level, std::array::from_fn(|axis| node[axis] + by[axis]))? != state)
        };
        let around: &mut dyn Iterator<Item = [i64; 3]> = match self {
            Reach::Faces => &mut FACES.into_iter(),
            Reach::Nets => &mut (1..8).map(|step| [0, 1, 2].map(|axis| -(step >> axis & 1))),
        };
        for by in around {
            if differs(by)? {
                return Ok(true);
            }
        }
        Ok(false)
    }
}

/// Offsets of a block's face neighbours: -x, +x, -y and so on.
pub(super) const FACES: [[i64; 3]; 6] = [[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]];
