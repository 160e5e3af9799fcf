//! Commits: the states of a file that stay readable.

use std::collections::HashSet;

use serde::{Deserialize, Serialize};

use super::extents::{ExtentKind, Extents};
use spinney_base::{Error, Result};
use spinney_container::MAX_LAYERS;

/// A note on a commit by its author.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Note {
    /// Seconds since 1970-01-01 00:00 UTC, if known.
    pub time: Option<i64>,
    /// Name of the author.
    pub author: String,
    /// Message: the change and its reason.
    pub message: String,
}

/// Numbers of records and bytes that a commit wrote, or did not write because it shares them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct WriteSummary {
    /// Autumnal records written.
    pub records: u64,
    /// Their bytes, and those of extent heads, metadata and alignment.
    pub bytes: u64,
    /// Records not written because the same editor had written an equal one before, for another
    /// node. Only in files that store equal subtrees once. (Records of unchanged nodes, which an
    /// edit keeps, do not count.)
    pub shared: u64,
    /// Bytes that these would have taken.
    pub spared: u64,
}

impl WriteSummary {
    /// Returns the sum of both.
    pub(super) fn and(self, other: WriteSummary) -> WriteSummary {
        WriteSummary {
            records: self.records + other.records,
            bytes: self.bytes + other.bytes,
            shared: self.shared + other.shared,
            spared: self.spared + other.spared,
        }
    }
}

/// The root of a commit's tree.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Root {
    /// VOID, LEAF or INNER.
    pub(super) state: u8,
    /// Value or representative in its stored form.
    pub(super) value: Vec<u8>,
    /// Offset of the record if the root is INNER, else 0.
    pub(super) address: u64,
}

/// A tree of a commit: one layer of the file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct CommitLayer {
    /// Name of the layer; empty if it is the only one and needs none.
    pub name: String,
    /// Number of cells that are not VOID.
    pub cells: u64,
    /// Number of INNER nodes. Nodes of shared subtrees count once per occurrence.
    pub inner_nodes: u64,
    /// The tree's header in its stored form.
    pub(super) header: Vec<u8>,
    pub(super) root: Root,
    /// Offset of the metadata's extent.
    pub(super) metadata: u64,
}

/// A state of a file: of all its layers.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Commit {
    /// Commit number. The first is 1, and each is larger than the one before.
    pub number: u64,
    /// Note by the author.
    pub note: Note,
    /// Number of cells of all layers that are not VOID.
    pub cells: u64,
    /// Number of INNER nodes of all layers. Nodes of shared subtrees count once per occurrence.
    pub inner_nodes: u64,
    /// Summary of what the commit wrote.
    pub written: WriteSummary,
    /// Number of commits in the file up to this one.
    pub(super) sequence: u64,
    pub(super) layers: Vec<CommitLayer>,
    /// Offset of the commit before this one; 0 for the first.
    pub(super) previous: u64,
    /// Sequence and offset of an older commit, for finding any commit in a logarithmic number of
    /// reads (skew-binary jump pointers, after Myers).
    pub(super) jump: (u64, u64),
}

/// Maximum size of a commit in bytes.
const LIMIT: usize = 1 << 24;
/// Version, the first field of the extent.
const VERSION: u32 = 1;

fn config() -> impl bincode::config::Config {
    bincode::config::standard().with_limit::<LIMIT>()
}

impl Commit {
    pub(super) fn to_bytes(&self) -> Result<Vec<u8>> {
        let bytes = bincode::serde::encode_to_vec((VERSION, self), config()).ok();
        bytes.filter(|bytes| bytes.len() <= LIMIT).ok_or_else(|| {
            let found = format!("{} bytes", self.note.author.len() + self.note.message.len());
            Error::invalid(
                "author and message",
                found,
                "less than 16 million bytes, together with all layers",
            )
        })
    }

    /// Reads the commit whose extent starts at an offset.
    pub(super) fn read(extents: &Extents, start: u64) -> Result<Commit> {
        let bytes = extents.whole(ExtentKind::Commit, start)?;
        let decoded = bincode::serde::decode_from_slice::<(u32, Commit), _>(&bytes, config());
        let corrupt = |found: String| {
            extents.corrupt(format!("commit at {start}"), found, "a valid commit (formats.md, section 23)")
        };
        let ((version, commit), _) = decoded.map_err(|error| corrupt(error.to_string()))?;
        if version != VERSION {
            let advice = "install the version of Spinney that wrote the file, or a newer one";
            return Err(Error::unsupported(&extents.path, format!("commit version {version}"), advice));
        }
        // Everything is written before what points to it, so following pointers terminates.
        let of_layers = commit.layers.iter().flat_map(|layer| [layer.metadata, layer.root.address]);
        if of_layers.chain([commit.previous, commit.jump.1]).any(|offset| offset >= start) {
            return Err(corrupt("a pointer that does not point backwards".into()));
        }
        commit.check_layers().map_err(corrupt)?;
        Ok(commit)
    }

    /// Returns the layers of the file.
    pub fn layers(&self) -> &[CommitLayer] {
        &self.layers
    }

    /// Returns the number of the layer with a name.
    pub fn layer_named(&self, name: &str) -> Option<usize> {
        self.layers.iter().position(|layer| layer.name == name)
    }

    /// Returns an error if the list of layers is invalid.
    fn check_layers(&self) -> std::result::Result<(), String> {
        let count = self.layers.len();
        if count == 0 || count > MAX_LAYERS as usize {
            return Err(format!("{count} layers"));
        }
        let mut seen = HashSet::new();
        let bad = self
            .layers
            .iter()
            .find(|layer| count > 1 && (layer.name.is_empty() || !seen.insert(&layer.name)));
        bad.map_or(Ok(()), |layer| Err(format!("an empty or duplicate layer name `{}`", layer.name)))
    }

    /// Replaces or appends one layer, and recomputes the totals.
    pub(super) fn with_layer(&self, number: usize, layer: CommitLayer) -> Commit {
        let mut commit = self.clone();
        match commit.layers.get_mut(number) {
            Some(place) => *place = layer,
            None => commit.layers.push(layer),
        }
        commit.count();
        commit
    }

    /// Recomputes the totals of all layers.
    pub(super) fn count(&mut self) {
        self.cells = self.layers.iter().fold(0, |sum, layer| sum.saturating_add(layer.cells));
        self.inner_nodes = self.layers.iter().fold(0, |sum, layer| sum.saturating_add(layer.inner_nodes));
    }

    /// Returns the jump of the commit after this one. This one is at `start`.
    pub(super) fn next_jump(&self, extents: &Extents, start: u64) -> Result<(u64, u64)> {
        if self.jump.1 == 0 {
            return Ok((self.sequence, start));
        }
        let jump = Commit::read(extents, self.jump.1)?;
        // Two consecutive jumps of equal length merge into one of twice the length. (Sequences of
        // an untrusted file need not descend.)
        let length = self.sequence.checked_sub(jump.sequence);
        let equal = length == Some(jump.sequence.saturating_sub(jump.jump.0));
        Ok(if equal && jump.jump.1 != 0 { jump.jump } else { (self.sequence, start) })
    }
}
