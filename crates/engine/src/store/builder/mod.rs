//! Building: from slabs of samples, or from any source, to parts of a tree, whatever the format that they are
//! stored in.
//!
//! Building is bottom-up and streaming: blocks of cells become parts of the tree (`block`), and what makes a
//! file of parts, a `TreeSink`, merges them and writes what is finished.

mod averaging;
mod block;
mod boxes;
mod counts;
mod encode;
mod fold;
mod gather;
mod level;
mod masked;
mod merge;
mod options;
mod overlay;
mod packing;
mod part;
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
pub use merge::{
    FULL_COVERAGE, Join, MergeAction, MergeState, MergeTable, Merging, Overlay, joined_coverage,
};
pub use options::{BuildOptions, WriteOptions, depth_for};
pub use packing::Packing;
pub(super) use packing::no_segments;
pub(in crate::store) use part::{ALWAYS_HEAVY, Part, SealedSegment};
pub use reuse::ReusableSource;
pub(in crate::store) use sink::{BuiltBlock, Siblings, TreeSink};
pub use slab::{Slab, Slabs};
pub use stored_node::{RecordFile, RecordRef, StoredNode, Subtree};
pub(in crate::store) use upper::upper_levels;
pub(in crate::store) use walk::{Builder, walk};

use spinney_base::Result;
use spinney_container::Shape;

/// Hands parts of a tree to what makes a file of them; the shape says how large blocks are.
pub(in crate::store) type Fill<'a> = dyn FnMut(&mut dyn TreeSink, Shape) -> Result<()> + 'a;
