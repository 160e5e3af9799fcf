//! Building: from slabs of samples, or from any source, to a tree file of either format.
//!
//! Building is bottom-up and streaming: blocks of cells become parts of the tree (`block`), and what makes a file of
//! parts (`assembly`) merges them and writes what is finished.

mod assembly;
mod averaging;
mod block;
mod cells;
mod counts;
mod gather;
mod part;
mod subtree;
mod take;
mod walk;

use std::mem;

pub(in crate::store) use assembly::{Assembly, Built, Siblings, state_of};
pub use cells::{Slab, Slabs};
pub use counts::LevelCounts;
pub(in crate::store) use part::{ENOUGH, Part, Sealed, trim};
pub(in crate::store) use subtree::count_nodes;
pub(crate) use subtree::{BadSkip, each_leaf};
pub(in crate::store) use walk::{Builder, walk};

use super::{Output, autumnal, goblin};
use crate::parallel;
use crate::store::TreeFormat;
use crate::store::goblin::{Codec, Header, Layout, Metadata, Shape};
use crate::tree::Source;
use crate::value::{Kind, Rule, Tally, Value};
use crate::{Error, Progress, Result};

/// What to build. The format is that of the output's name: see [`TreeFormat`].
#[derive(Clone, Debug)]
pub struct BuildOptions {
    /// How representatives are made.
    pub rule: Rule,
    /// What the values mean; classes are counted per zone for categorical ones.
    pub kind: Kind,
    /// Levels below the root.
    pub depth: u8,
    /// Bytes that building may use, beyond what the input itself holds.
    pub memory: u64,
    /// What to tell about the data. The level counts are filled in.
    pub metadata: Metadata,
    /// Whether equal subtrees are stored once; only Autumnal files can do that.
    pub share: bool,
}

impl BuildOptions {
    /// For a tree of the same kind as one that is there, with nothing told about its data.
    pub(crate) fn like(header: &Header, memory: u64) -> BuildOptions {
        let Header { rule, kind, shape, .. } = *header;
        let metadata = Metadata::default();
        BuildOptions { rule, kind, depth: shape.depth, memory, metadata, share: false }
    }

    pub(in crate::store) fn count_classes(&self) -> bool {
        self.kind == Kind::Categorical || self.rule == Rule::Majority
    }

    /// The header of the file, which a Goblin file has as it is.
    pub(in crate::store) fn header<D: Layout, V: Value>(&self, extent: [u64; 3]) -> Result<Header> {
        if self.depth > D::MAX_DEPTH {
            let expected = format!("at most {} for {}s", D::MAX_DEPTH, D::TREE_NAME);
            return Err(Error::invalid("depth", self.depth.to_string(), expected));
        }
        let shape = Shape { depth: self.depth, reach: D::REACH, stride: D::STRIDE, light: goblin::LIGHT };
        let side = 1u64 << self.depth;
        for (axis, cells) in extent.iter().enumerate() {
            let most = if axis < D::AXES { side } else { 1 };
            if *cells == 0 || *cells > most {
                let found = format!("{cells} cells along axis {axis}");
                return Err(Error::invalid("extent", found, format!("1 to {most} (2^depth)")));
            }
        }
        let (value, rule, kind) = (V::TYPE, self.rule, self.kind);
        Ok(Header { axes: D::AXES as u8, value, rule, kind, codec: Codec::Plain, shape, extent })
    }
}

/// The smallest depth whose space holds so many cells along every axis.
pub fn depth_for(extent: [u64; 3]) -> u8 {
    let most = extent.into_iter().max().unwrap_or(1).max(1);
    // (More than 2^63 fit in no tree, whatever is answered.)
    most.checked_next_power_of_two().map_or(64, |side| side.trailing_zeros() as u8)
}

/// Hands parts of a tree to what makes a file of them; the shape says how large blocks are.
pub(in crate::store) type Fill<'a, D, V> = dyn FnMut(&mut dyn Assembly<D, V>, Shape) -> Result<()> + 'a;

/// Builds a file from slabs of samples, in one pass; `nodata` is the value that means VOID (NaN always does).
///
/// Work is spread over the threads of the current rayon pool; the bytes written do not depend on their number.
/// Progress counts cells.
///
/// # Errors
/// If the input cannot be read, the output not be written, the depth does not hold the extent, or on interruption;
/// nothing is left behind then.
pub fn build_slabs<D: Layout, V: Value>(
    slabs: &mut dyn Slabs,
    nodata: Option<V>,
    options: &BuildOptions,
    output: Output,
    progress: &dyn Progress,
) -> Result<()> {
    let extent = slabs.extent();
    let total = extent.iter().product();
    let mut fill = |assembly: &mut dyn Assembly<D, V>, shape| {
        let mut builder = Builder::new(options, shape, assembly);
        let (mut current, mut next) = (Slab::default(), Slab::default());
        let mut more = slabs.next(&mut current)?;
        while more {
            // The next slab is read while this one is built.
            let (read, built) =
                parallel::join(|| slabs.next(&mut next), || builder.slab(&current, nodata, total, progress));
            built?;
            more = read?;
            mem::swap(&mut current, &mut next);
        }
        Ok(())
    };
    write_file(options, (extent, extent), output, &mut fill, &mut |_| {}).map(|_| ())
}

/// Builds a file from any source.
///
/// `extent` is what the header tells as the picture's size; cells outside must be VOID. Returns what is known of all
/// cells. What the source has stored in a file of the same rule is copied as it is.
///
/// # Errors
/// As [`build_slabs`].
pub fn build<S>(
    source: &S,
    extent: [u64; 3],
    options: &BuildOptions,
    output: Output,
    progress: &dyn Progress,
) -> Result<Tally<S::Value>>
where
    S: Source + Sync,
    S::Dim: Layout,
{
    build_with(source, extent, options, output, progress, |_| {})
}

/// The same; the metadata can be completed when the source has been walked.
///
/// # Errors
/// As [`build_slabs`].
pub fn build_with<S>(
    source: &S,
    extent: [u64; 3],
    options: &BuildOptions,
    output: Output,
    progress: &dyn Progress,
    complete: impl FnOnce(&mut Metadata),
) -> Result<Tally<S::Value>>
where
    S: Source + Sync,
    S::Dim: Layout,
{
    let mut fill = |assembly: &mut dyn Assembly<S::Dim, S::Value>, shape| {
        walk(source, options, shape, true, assembly, progress)
    };
    let mut complete = Some(complete);
    write_file(options, (extent, [u64::MAX; 3]), output, &mut fill, &mut |metadata| {
        complete.take().into_iter().for_each(|complete| complete(metadata));
    })
}

/// Starts a file, has it filled, and finishes it. Beside the picture's extent stands that of the parts that come; what is
/// outside is VOID.
fn write_file<D: Layout, V: Value>(
    options: &BuildOptions,
    (extent, covered): ([u64; 3], [u64; 3]),
    output: Output,
    fill: &mut Fill<'_, D, V>,
    complete: &mut dyn FnMut(&mut Metadata),
) -> Result<Tally<V>> {
    let header = options.header::<D, V>(extent)?;
    match TreeFormat::of(output.path()) {
        TreeFormat::Goblin if options.share => Err(Error::unsupported(
            output.path(),
            "storing equal subtrees once in a Goblin file",
            "give the output a name that ends with .autumn",
        )),
        TreeFormat::Goblin => goblin::write(options, header, covered, output, fill, complete),
        TreeFormat::Autumnal => autumnal::write(options, header, covered, output, fill, complete),
    }
}
