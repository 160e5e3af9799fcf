//! Files of exact models: see `formats.md`.

pub(crate) mod block;
mod block_subset;
pub(crate) mod chunks;
mod copy;
pub(super) mod exact;
pub(crate) mod exact_lists;
mod exact_subset;
mod face_values;
mod faces_of_parts;
pub(crate) mod formula;
pub(crate) mod levels;
pub(crate) mod node;
pub(crate) mod objects;
mod open;
mod packed;
mod reader;
pub(crate) mod segment;
pub(crate) mod summary;
pub(crate) mod sums;
mod surface;
pub(crate) mod table;
mod used_entries;
mod verify;
pub(crate) mod writer;

pub use block::FaceBuffer;
pub use levels::DetailLevel;
pub use node::{ModelNode, ModelNodeState};
pub use open::is_model_file;
pub use reader::ExactModel;
pub use segment::{LeafRule, NodeKind};
pub use summary::NodeCounts;
