//! Operations on trees: sources made of sources.
//!
//! A [`View`] shows a source through any chain of windows, translations, scalings, mirrorings and rotations; a
//! [`Combined`] settles several sources into one, by presence or by value. Both read only what somebody asks for, and
//! can be asked, walked and stored like any other source. Edits of Autumnal files are such sources, too, stored where they came
//! from ([`edit()`]).

mod align;
mod area;
mod block;
mod combine;
mod convert;
mod cross;
mod data_box;
mod diff;
mod edit;
mod files;
mod look;
mod map;
mod patch;
mod step;
mod view;
mod viewed;

pub use align::{Alignment, align};
pub use combine::{Combined, CombinedNode, Operation, Prefer};
pub use convert::{compact_file, convert};
pub use cross::{Pair, cross};
pub use data_box::data_box;
pub use diff::{Difference, Differences, FdRange, diff, diff_files};
pub use edit::{CellValue, Edit, edit};
pub use files::{Chain, Outcome, PairOfSamples, combine, cross_files, open_view, transform};
pub use look::{Around, ViewNode};
pub use map::{Axis, Map};
pub use patch::{CellPatch, FillPatch, FillRegion, Polygon};
pub use step::{Step, Turn};
pub use view::{Sampling, View};
