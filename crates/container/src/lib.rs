//! The container that all tree files share (header, metadata, sections, trailer), and the layout of
//! records in segments.

mod block_file;
mod colour_roles;
mod dense;
mod file_header;
mod finding;
mod format;
mod header;
mod layer;
mod level_counts;
mod list;
mod metadata;
mod options;
mod other_formats;
mod record_layout;
mod shape;
mod shard;
mod state;
mod tag;
mod trailer;
mod unit;
mod versioned;

pub use block_file::{BlockEntry, BlockFile, BlockLocation, BlockWriter};
pub use dense::{DenseBlock, DenseKind, MAX_DENSE_LEVELS, dense_child, dense_levels};
pub use file_header::{Content, FileHeader, HEADER_SIZE, MAX_LAYERS};
pub use finding::{Finding, MAX_FINDINGS};
pub use format::{FileReference, TreeFormat, file_is_tree, file_of};
pub use header::{Codec, Header};
pub use layer::{Layer, LayerTable};
pub use level_counts::LevelCounts;
pub use list::List;
pub use metadata::{Metadata, ScopedTags, TagScope};
pub use options::{ByteSource, OpenOptions};
pub use other_formats::{
    FIRST_BYTES, OtherFormat, check_goblin_name, check_tree_name, create_tree_file, shell_word,
};
pub use record_layout::{RecordHead, RecordLayout, STATE_BITS, state_of};
pub use shape::{HEAVY_THRESHOLD, STRIDE, Shape, reach};
pub use shard::{
    RangeSummary, RunFile, Shard, ShardRange, ShardSummary, SummaryBytes, SummaryWriter, check_cover,
};
pub use state::{CUT, INNER, LEAF, VOID};
pub use tag::Tag;
pub use trailer::{Section, SectionWriter, TAIL, Trailer};
pub use unit::Unit;
pub use versioned::VersionedSection;
