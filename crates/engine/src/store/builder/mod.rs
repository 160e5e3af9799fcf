//! Building: converts slabs of samples, or any source, to encoded subtrees, for both file formats.
//!
//! Building is bottom-up and streaming:
//!
//! 1. An importer delivers slabs of samples (`Slabs`), or is a `Source`, such as a solid. Only the
//!    cells of a run of nodes are requested: all of them for a whole file, some for a shard
//!    (`TreeWriter::run`). `boxes` yields boxes that cover the run, and `walk` builds no blocks
//!    outside of it.
//! 2. `walk` processes blocks of 256 x 256 (64 x 64 x 64) cells in batches, one block per thread.
//!    `slab` converts a block's cells to Z order. `gather` collects a block from a source and
//!    copies stored subtrees record by record.
//! 3. `reduce` computes the block's levels from the bottom up, by the rule of `averaging` (`masked`
//!    if samples may be missing), and condenses uniform nodes. `tally` computes the block's
//!    statistics.
//! 4. `encode` writes the block in preorder, as records or as dense blocks where these are not much
//!    larger. The result is a `EncodedSubtree`, an encoded subtree.
//! 5. A `TreeSink` takes parts, merges complete siblings, and writes finished data:
//!    `goblin::segment_builder` writes segments, `autumnal::builder` the records that the file does
//!    not have yet. Sources deliver parts in FD order, slabs in any order. When a part's own
//!    segment is sealed, `upper` encodes the levels that coarser segments need again, because their
//!    bottom is another one.
//!
//! Blocks of slabs without VOID take a faster path for some rules and value types (`rows`): they
//! stay in rows instead of Z order, and kernels process many cells at a time. The records are the
//! same.

mod averaging;
mod block;
mod boxes;
mod counts;
mod encode;
mod encoded_subtree;
mod fold;
mod gather;
mod level;
mod masked;
mod merge;
mod options;
mod overlay;
mod packing;
mod reduce;
mod reuse;
mod reused;
mod rounding;
mod rows;
mod sink;
mod slab;
mod stored_node;
mod sums;
mod tally;
mod upper;
mod walk;

pub use boxes::{SlabBoxes, WantedCells};
pub(in crate::store) use encoded_subtree::{ALWAYS_HEAVY, EncodedSubtree, SealedSegment};
pub use merge::{
    FULL_COVERAGE, Join, MergeAction, MergeState, MergeTable, Merging, Overlay, joined_coverage,
};
pub use options::{BuildOptions, WriteOptions, depth_for};
pub use packing::Packing;
pub(super) use packing::no_segments;
pub use reuse::ReusableSource;
pub(in crate::store) use sink::{BuiltBlock, Siblings, TreeSink};
pub use slab::{Slab, Slabs};
pub use stored_node::{RecordFile, RecordRef, StoredNode, Subtree};
pub(in crate::store) use upper::upper_levels;
pub(in crate::store) use walk::{Builder, build_block, walk};

use spinney_base::Result;
use spinney_container::Shape;

/// Pushes parts of a tree to a sink; the shape determines the size of blocks.
pub(in crate::store) type Fill<'a> = dyn FnMut(&mut dyn TreeSink, Shape) -> Result<()> + 'a;
