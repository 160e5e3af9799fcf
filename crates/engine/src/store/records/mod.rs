//! Records: the nodes of a segment, single or in dense blocks, and traversals of runs of records.

pub mod dense;
pub mod record;
pub mod run;
pub mod subtree;

pub(crate) use record::{Record, child_record};
pub(crate) use record::{with_block_type, with_form_type, with_record_type};
pub(in crate::store) use run::{Descend, Descent, descend_in};
pub(crate) use run::{RunChild, RunChildren, RunNode, Runs};
pub use spinney_container::{RecordHead, RecordLayout};
