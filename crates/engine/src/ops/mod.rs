//! Operations on trees: sources that derive from other sources.
//!
//! A [`View`] reads a file through a chain of windows, translations, scalings, mirrorings and
//! rotations. A [`Combined`] merges several views into one tree, by presence or by value. Both
//! compute nodes only on request, and can be queried, traversed and stored like any other source.
//! Edits of Autumnal files are such sources, too, and are stored in the file that they read
//! ([`edit()`]).

mod adjacent_index;
mod affine;
mod blame;
mod blocks;
mod blockwise;
mod calc;
mod coarse;
mod combine;
mod convert;
mod converted;
mod coverage;
mod crosstab;
mod data_box;
mod diff;
mod edit;
mod files;
mod layers;
mod mosaic;
mod operation;
mod overwritten;
mod patch;
mod patched;
mod reconcile;
mod regions;
mod tree_file;
mod universe;
mod updated_index;
mod view_operation;
mod view_operation_text;
mod view_source;
mod warp;

pub use affine::{AffineMap, Around, Axis, Sampling, View, ViewNode};
pub use blame::blame;
pub use blockwise::{BlockSource, Blockwise};
pub use calc::{Calculated, Calculation};
pub use coarse::{Coarse, CoarseNode};
pub use combine::{Combined, CombinedNode, build};
pub(crate) use convert::build_again;
pub use convert::convert;
pub use converted::Converted;
pub use crosstab::{Pair, crosstab};
pub use data_box::data_box;
pub use diff::{CompareReport, Difference, Differences, FdRange, diff, diff_files, diff_nodes, differences};
pub use edit::{CellValue, Edit, apply_edits, edit};
pub(crate) use files::void_advice;
pub use files::{
    FileView, MadeOperand, Outcome, PairOfSamples, combine, combine_with, crosstab_files, transform,
    transform_to,
};
pub use layers::{add_layer, drop_layer, layer_paths, only_layer};
pub use mosaic::{Mosaic, MosaicNode, list_files};
pub use operation::{CombineOperation, Prefer};
pub use overwritten::overwritten_input;
pub use patch::{CellPatch, Change, FillPatch, FillRegion, Patch};
pub use patched::{Patched, PatchedNode};
pub use reconcile::{ClassMatching, Conversion, OutputExtent, ReconcileOptions, grid_like};
pub(crate) use regions::find_labels;
pub use regions::{
    Connectivity, Label, LabelNeighbour, LabelRequest, LabelSummary, LabelVisitor, Regions, Sieve,
};
pub use tree_file::{LayerInfo, TreeFile, TreeFileNode};
pub use universe::{CombineOptions, Universe};
pub use updated_index::write_updated_layer;
pub use view_operation::{RotationAxis, ViewOperation};
pub use view_source::{MemoryTree, ViewSource, ViewSourceNode};
pub use warp::{MAX_ZOOM, Resampling, WarpGrid, WarpOptions, WarpTarget, Warped, warp};
