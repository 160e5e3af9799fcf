//! Options of building.

use super::packing::Packing;
use spinney_base::TreeType;
use spinney_base::value::{DataKind, Rule};
use spinney_base::{Error, Result};
use spinney_container::{Codec, HEAVY_THRESHOLD, Header, Metadata, STRIDE, Shape, reach};

/// Options of building. The name of the output determines the format: see
/// [`TreeFormat`](spinney_container::TreeFormat).
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct BuildOptions {
    /// Rule of the representatives.
    pub rule: Rule,
    /// The meaning of the values. For categorical ones, classes are counted per zone.
    pub kind: DataKind,
    /// Levels below the root.
    pub depth: u8,
    /// Maximum memory of building in bytes, in addition to what the input uses.
    pub memory: u64,
    /// The metadata of the file. Level counts are filled in.
    pub metadata: Metadata,
    /// Whether equal subtrees are stored once; only Autumnal files support that.
    pub share: bool,
    /// Time of an Autumnal file's first commit, in seconds since the beginning of 1970.
    pub time: Option<i64>,
    /// How the file is packed, and how much precision may be lost.
    pub packing: Packing,
    /// Levels between the cells and the finest level that is stored, if the cells stay in other
    /// files: 1, 2 or 4.
    pub referenced: Option<u8>,
}

/// Options of writing a tree that is derived from another one: memory and packing.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct WriteOptions {
    /// Maximum memory of writing in bytes.
    pub memory: u64,
    /// How the file is packed, and how much precision may be lost.
    pub packing: Packing,
}

impl WriteOptions {
    /// Returns options for plain segments, with `memory` bytes of memory.
    pub fn new(memory: u64) -> WriteOptions {
        WriteOptions { memory, packing: Packing::default() }
    }

    /// Sets the packing of segments.
    #[must_use]
    pub fn packing(self, packing: Packing) -> WriteOptions {
        WriteOptions { packing, ..self }
    }
}

/// Default of the memory that building may use, in bytes.
const DEFAULT_MEMORY: u64 = 256 << 20;

impl BuildOptions {
    /// Returns options for a tree of `depth` levels. The rule is the usual one for values of this
    /// kind; the metadata are empty.
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
            referenced: None,
        }
    }

    /// Returns options for a tree with the properties of an existing one, with empty metadata.
    pub fn like(header: &Header, memory: u64) -> BuildOptions {
        let Header { rule, kind, shape, .. } = *header;
        BuildOptions { rule, memory, ..BuildOptions::new(kind, shape.depth) }
    }

    /// [`BuildOptions::like`] with options of writing.
    pub(crate) fn written_like(header: &Header, how: WriteOptions) -> BuildOptions {
        BuildOptions::like(header, how.memory).written(how)
    }

    /// Sets all options of writing.
    #[must_use]
    pub fn written(self, how: WriteOptions) -> BuildOptions {
        let WriteOptions { memory, packing } = how;
        BuildOptions { memory, packing, ..self }
    }

    /// Sets the rule of the representatives.
    #[must_use]
    pub fn rule(self, rule: Rule) -> BuildOptions {
        BuildOptions { rule, ..self }
    }

    /// Sets the maximum memory of building, in bytes.
    #[must_use]
    pub fn memory(self, memory: u64) -> BuildOptions {
        BuildOptions { memory, ..self }
    }

    /// Sets the metadata.
    #[must_use]
    pub fn metadata(self, metadata: Metadata) -> BuildOptions {
        BuildOptions { metadata, ..self }
    }

    /// Sets whether equal subtrees are stored once.
    #[must_use]
    pub fn share(self, share: bool) -> BuildOptions {
        BuildOptions { share, ..self }
    }

    /// Sets the time of an Autumnal file's first commit.
    #[must_use]
    pub fn time(self, time: Option<i64>) -> BuildOptions {
        BuildOptions { time, ..self }
    }

    /// Sets the packing of segments.
    #[must_use]
    pub fn packing(self, packing: Packing) -> BuildOptions {
        BuildOptions { packing, ..self }
    }

    /// Sets the number of levels between the cells and the finest level that is stored, 1, 2 or 4,
    /// if the cells stay in other files.
    #[must_use]
    pub fn referenced(self, levels: impl Into<Option<u8>>) -> BuildOptions {
        BuildOptions { referenced: levels.into(), ..self }
    }

    pub(in crate::store) fn count_classes(&self) -> bool {
        self.kind == DataKind::Categorical || self.rule == Rule::Majority
    }

    /// Returns the header of the file, which a Goblin file stores unchanged.
    ///
    /// # Errors
    /// If the depth exceeds the maximum or the extent does not fit the depth; or if rounding is
    /// requested for values that cannot be rounded.
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
        let (stride, heavy_threshold, codec) = match self.referenced {
            None => (STRIDE, HEAVY_THRESHOLD, self.packing.codec),
            // Every INNER block owns a segment, which is a reference. The segments above it end
            // `stride` levels above the cells.
            Some(stride) => (stride, 0, Codec::Reference),
        };
        let reach = reach(dimension);
        let shape = Shape { depth: self.depth, reach, stride, heavy_threshold };
        Ok(Header { form, rule: self.rule, kind: self.kind, codec, shape, extent })
    }
}

/// Returns the minimum depth whose space has the extent's number of cells along every axis.
pub fn depth_for(extent: [u64; 3]) -> u8 {
    let most = extent.into_iter().max().unwrap_or(1).max(1);
    // (No tree has more than 2^63 cells along an axis, so the result for these only has to be too
    // large.)
    most.checked_next_power_of_two().map_or(64, |side| side.trailing_zeros() as u8)
}
