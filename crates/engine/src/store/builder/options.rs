//! Options of building.

use super::packing::Packing;
use spinney_base::TreeType;
use spinney_base::value::{DataKind, Rule};
use spinney_base::{Error, Result};
use spinney_container::{HEAVY_THRESHOLD, Header, Metadata, STRIDE, Shape, reach};

/// Options of building. The format is that of the output's name: see
/// [`TreeFormat`](spinney_container::TreeFormat).
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct BuildOptions {
    /// Rule of the representatives.
    pub rule: Rule,
    /// The meaning of the values; classes are counted per zone for categorical ones.
    pub kind: DataKind,
    /// Levels below the root.
    pub depth: u8,
    /// Bytes that building may use, beyond what the input itself holds.
    pub memory: u64,
    /// The metadata of the file. The level counts are filled in.
    pub metadata: Metadata,
    /// Whether equal subtrees are stored once; only Autumnal files can do that.
    pub share: bool,
    /// Time of the commit that an Autumnal file begins with, in seconds since the beginning of 1970.
    pub time: Option<i64>,
    /// How few bytes the file is to take, and what it may lose for that.
    pub packing: Packing,
}

/// Options of writing a tree of another one: what that may use, and how few bytes it is to take.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct WriteOptions {
    /// Bytes that writing may use.
    pub memory: u64,
    /// How few bytes the file is to take, and what it may lose for that.
    pub packing: Packing,
}

impl WriteOptions {
    /// Plain segments, and so many bytes of memory.
    pub fn new(memory: u64) -> WriteOptions {
        WriteOptions { memory, packing: Packing::default() }
    }

    /// Chooses how segments are packed.
    #[must_use]
    pub fn packing(self, packing: Packing) -> WriteOptions {
        WriteOptions { packing, ..self }
    }
}

/// Bytes that building may use if nothing is said.
const DEFAULT_MEMORY: u64 = 256 << 20;

impl BuildOptions {
    /// A tree of so many levels; the rule is the usual one for values of this kind, nothing is told about the
    /// data.
    pub fn new(kind: DataKind, depth: u8) -> BuildOptions {
        let metadata = Metadata::default();
        BuildOptions {
            rule: kind.default_rule(),
            kind,
            depth,
            memory: DEFAULT_MEMORY,
            metadata,
            share: false,
            time: None,
            packing: Packing::default(),
        }
    }

    /// For a tree of the same kind as one that is there, with nothing told about its data.
    pub fn like(header: &Header, memory: u64) -> BuildOptions {
        let Header { rule, kind, shape, .. } = *header;
        BuildOptions { rule, memory, ..BuildOptions::new(kind, shape.depth) }
    }

    /// [`BuildOptions::like`], written as is asked for.
    pub(crate) fn written_like(header: &Header, how: WriteOptions) -> BuildOptions {
        BuildOptions::like(header, how.memory).written(how)
    }

    /// Chooses all that is asked for of writing.
    #[must_use]
    pub fn written(self, how: WriteOptions) -> BuildOptions {
        let WriteOptions { memory, packing } = how;
        BuildOptions { memory, packing, ..self }
    }

    /// Chooses how representatives are made.
    #[must_use]
    pub fn rule(self, rule: Rule) -> BuildOptions {
        BuildOptions { rule, ..self }
    }

    /// Chooses the bytes that building may use.
    #[must_use]
    pub fn memory(self, memory: u64) -> BuildOptions {
        BuildOptions { memory, ..self }
    }

    /// Chooses what is told about the data.
    #[must_use]
    pub fn metadata(self, metadata: Metadata) -> BuildOptions {
        BuildOptions { metadata, ..self }
    }

    /// Chooses whether equal subtrees are stored once.
    #[must_use]
    pub fn share(self, share: bool) -> BuildOptions {
        BuildOptions { share, ..self }
    }

    /// Chooses the time of the commit that an Autumnal file begins with.
    #[must_use]
    pub fn time(self, time: Option<i64>) -> BuildOptions {
        BuildOptions { time, ..self }
    }

    /// Chooses how segments are packed.
    #[must_use]
    pub fn packing(self, packing: Packing) -> BuildOptions {
        BuildOptions { packing, ..self }
    }

    pub(in crate::store) fn count_classes(&self) -> bool {
        self.kind == DataKind::Categorical || self.rule == Rule::Majority
    }

    /// The header of the file, which a Goblin file has as it is.
    ///
    /// # Errors
    /// If trees cannot be so deep, or have no room for so many cells; or if cells are to be rounded that cannot be.
    pub fn header(&self, form: TreeType, extent: [u64; 3]) -> Result<Header> {
        let dimension = form.dimension;
        if self.depth > dimension.max_depth() {
            let expected = format!("at most {} for {}s", dimension.max_depth(), dimension.tree_name());
            return Err(Error::invalid("depth", self.depth.to_string(), expected));
        }
        self.packing.rounding(form.value, self.kind)?;
        let side = 1u64 << self.depth;
        for (axis, cells) in extent.iter().enumerate() {
            let most = if axis < form.axes() { side } else { 1 };
            if *cells == 0 || *cells > most {
                let found = format!("{cells} cells along axis {axis}");
                return Err(Error::invalid("extent", found, format!("1 to {most} (2^depth)")));
            }
        }
        let shape = Shape {
            depth: self.depth,
            reach: reach(dimension),
            stride: STRIDE,
            heavy_threshold: HEAVY_THRESHOLD,
        };
        Ok(Header { form, rule: self.rule, kind: self.kind, codec: self.packing.codec, shape, extent })
    }
}

/// The smallest depth whose space holds so many cells along every axis.
pub fn depth_for(extent: [u64; 3]) -> u8 {
    let most = extent.into_iter().max().unwrap_or(1).max(1);
    // (More than 2^63 fit in no tree, whatever is answered.)
    most.checked_next_power_of_two().map_or(64, |side| side.trailing_zeros() as u8)
}
