//! The Goblin format: read-only trees, written once. `formats.md` is its specification.
//!
//! A tree is cut into *segments*, preorder runs of fixed-size records under one node, which are
//! found through the segment index (`directory`, `pages`, `index`), sorted by FD code. Building is
//! bottom-up and streaming: blocks of cells become parts of the tree, parts are merged and sealed
//! into segments, and segments are appended to the file.
//!
//! # Writing a file
//!
//! 1. `segment_builder` merges parts and seals heavy nodes into segments. If the file is packed,
//!    all threads pack the segments of a batch (`packed`).
//! 2. `layer_writer` appends segments. Those that are not in file order, and those of the top
//!    levels, wait in `deferred`. The segment index ends the layer (`directory_writer`).
//! 3. `file_writer` ends the file with metadata, tops of the page indexes, table of layers and
//!    trailer. The output is then moved to its final path.
//!
//! # Shards
//!
//! 1. A plan is an import into a file without cells, the *head* (`TreeWriter::head`). It has header
//!    and metadata of each layer, written by the same code as for other files. The nodes at each
//!    layer's shard level (`Shape::shard_level`) are divided into runs, numbered consecutively
//!    across layers.
//! 2. A shard is the same import into a `TreeWriter::shard`, which requests only the cells of its
//!    runs. `segment_builder` merges parts up to the shard level and no further. `shard_writer`
//!    writes the segments to a run file per layer. It writes their entries and the parts at the
//!    shard level to a *shard summary* (`summary_items`, `entry_columns`).
//! 3. `shard_merge` copies the segments of all shards in order and pushes the parts into a
//!    `segment_builder` of the whole tree, which builds the top levels. Levels above the shard
//!    level depend only on these parts, so the merged file is byte-identical to one that was built
//!    in a single process.
//! 4. With `MergeOutput::Remove`, each run file is removed when its bytes are durable in the
//!    output. A merge that was aborted is restarted with the same output: it writes the same bytes
//!    again, and reads those of removed run files from the output.

mod deferred;
mod directory;
mod directory_writer;
mod entry_columns;
mod file_writer;
mod index;
mod layer_writer;
mod load;
mod locate;
mod open;
mod packed;
mod pages;
mod reader;
mod reference;
mod segment;
mod segment_builder;
mod segment_copy;
mod segment_sink;
mod shard_merge;
mod shard_writer;
mod sizes;
mod source;
mod summary_items;
mod verify;

pub use directory::Entry;
pub(in crate::store) use file_writer::FileWriter;
pub(crate) use locate::Located;
pub use reader::Goblin;
pub use reference::{ReferencedCells, ReferringFile, register_references};
pub use segment::Segment;
pub use shard_merge::{MergeOutput, merge_index_shards, merge_shards};
pub(in crate::store) use shard_writer::ShardWriter;
pub use sizes::LevelBytes;
pub use source::GoblinNode;
pub use spinney_container::{Shard, ShardRange};
