//! The Autumnal format: editable trees with history. `formats.md` is the specification.
//!
//! A record has the representative of a node and some levels below it, and points to deeper
//! records. Files are append-only and copy-on-write: an edit appends the changed records and the
//! path to a new root in checksummed *extents*. A commit makes them durable and then stores the new
//! root in one of two *meta slots*. So a crash at any time preserves the last commit, readers need
//! no locks, and every commit stays readable.

mod append;
mod archive;
mod box_contents;
mod builder;
mod built_node;
mod commit;
mod compact;
mod copied;
mod distinct;
mod editor;
mod extents;
mod history;
mod layout;
mod levels;
mod meta;
mod newest;
mod node;
mod packed;
mod pages;
mod reader;
mod recover;
mod remembered;
mod sectors;
mod share;
mod source;
mod verified;
mod verify;
mod write;
mod zone;

pub(crate) use box_contents::BoxContent;
pub use commit::{Commit, CommitLayer, Note, WriteSummary};
pub use compact::{CompactOptions, Keep, compact};
pub(crate) use distinct::OccurrenceVisitor;
pub use editor::Editor;
pub use history::History;
pub use node::AutumnalNode;
pub use reader::Autumnal;
pub use recover::recover;
pub(crate) use remembered::Remembered;
pub(in crate::store) use write::NewFile;
