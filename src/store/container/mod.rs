//! Common parts of both formats: header, metadata, records, how trees are cut into segments.

mod cache;
pub(crate) mod dense;
mod finding;
mod format;
mod header;
mod level_counts;
mod metadata;
mod options;
pub(crate) mod record;
pub(crate) mod run;
mod shape;
pub(crate) mod subtree;
mod trailer;

pub(crate) use cache::SegmentCache;
pub use finding::Finding;
pub(in crate::store) use finding::MAX_FINDINGS;
pub use format::{TreeFormat, file_is_tree, split_commit};
pub(crate) use header::HEADER_SIZE;
pub use header::{Codec, Header};
pub use level_counts::LevelCounts;
pub use metadata::{Metadata, ScopedTags, TagScope};
pub use options::OpenOptions;
pub use record::{CUT, INNER, LEAF, RecordHead, RecordLayout, VOID};
pub(crate) use record::{
    HEAVY_THRESHOLD, Record, STRIDE, child_record, reach, with_form_type, with_record_type,
};
pub(in crate::store) use run::{Descend, Descent, descend_in};
pub(crate) use run::{RunChild, RunChildren, RunNode};
pub use shape::Shape;
pub(crate) use trailer::{Section, SectionWriter, TAIL, Trailer};
