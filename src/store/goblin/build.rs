//! Builds Goblin files: from slabs of samples, or from any source.

use std::mem;

use super::assemble::{Assembler, SegmentSink};
use super::block::Block;
use super::cells::{Found, Slab, Slabs};
use super::copy::Copied;
use super::counts::LevelCounts;
use super::header::{Codec, Header};
use super::metadata::Metadata;
use super::part::{Part, Sealed};
use super::record::{LIGHT, Layout};
use super::shape::Shape;
use super::writer::Writer;
use crate::parallel;
use crate::space::Code;
use crate::store::Output;
use crate::tree::{Child, Source, Stored};
use crate::value::{Kind, Rule, Tally, Value};
use crate::{Error, Progress, Result};

/// What to build.
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
}

impl BuildOptions {
    fn count_classes(&self) -> bool {
        self.kind == Kind::Categorical || self.rule == Rule::Majority
    }

    fn shape<D: Layout>(&self) -> Result<Shape> {
        if self.depth > D::MAX_DEPTH {
            let expected = format!("at most {} for {}s", D::MAX_DEPTH, D::TREE_NAME);
            return Err(Error::invalid("depth", self.depth.to_string(), expected));
        }
        Ok(Shape { depth: self.depth, reach: D::REACH, stride: D::STRIDE, light: LIGHT })
    }

    fn header<D: Layout, V: Value>(&self, extent: [u64; 3]) -> Result<Header> {
        let shape = self.shape::<D>()?;
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
    let header = options.header::<D, V>(extent)?;
    let shape = header.shape;
    let total = extent.iter().product();
    let writer = Writer::new(output, &header, options.memory / 8)?;
    let mut builder = Builder::<D, V, _>::new(options, shape, extent, writer);
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
    builder.finish(options.metadata.clone())
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
    let header = options.header::<S::Dim, S::Value>(extent)?;
    let writer = Writer::new(output, &header, options.memory / 8)?;
    let Walked { sink: writer, root, counts } = walk(source, options, header.shape, true, writer, progress)?;
    let mut metadata = Metadata { counts, ..options.metadata.clone() };
    complete(&mut metadata);
    writer.finish(root.child, &metadata)?;
    Ok(root.tally)
}

/// What comes of walking a source.
pub(super) struct Walked<D: Layout, V: Value, K> {
    pub(super) sink: K,
    pub(super) root: Part<D, V>,
    pub(super) counts: LevelCounts,
}

/// Walks a whole source and hands the segments of its tree to a sink. With
/// `copy`, segments that the source has stored are taken as they are.
pub(super) fn walk<S, K>(
    source: &S,
    options: &BuildOptions,
    shape: Shape,
    copy: bool,
    sink: K,
    progress: &dyn Progress,
) -> Result<Walked<S::Dim, S::Value, K>>
where
    S: Source + Sync,
    S::Dim: Layout,
    K: SegmentSink<S::Dim, S::Value> + Send,
{
    if source.depth() != shape.depth {
        let expected = format!("{}, the source's", source.depth());
        return Err(Error::invalid("depth", shape.depth.to_string(), expected));
    }
    let mut builder = Builder::new(options, shape, [u64::MAX; 3], sink);
    builder.plan.copy = copy;
    let plan = builder.plan;
    let stored = |code: Code<S::Dim>, place: &Child<S::Value, S::Node>| {
        let Child::Inner { representative, node } = place else { return Ok(None) };
        let stored = plan.stored(source, node, shape.depth - code.level());
        stored.map_or(Ok(None), |stored| Copied::of(stored, code, *representative, &shape))
    };
    let mut pending = vec![(Code::ROOT, source.root()?)];
    let mut batch = Vec::new();
    let total = 1u64 << (<S::Dim as crate::space::Dimension>::AXES * shape.depth as usize).min(63);
    while let Some((code, place)) = pending.pop() {
        if let Some(copied) = stored(code, &place)? {
            builder.nodes(source, mem::take(&mut batch), total, progress)?;
            builder.copied(copied, total, progress)?;
            continue;
        }
        match place {
            Child::Inner { node, .. } if code.level() < shape.block_level() => {
                let children = source.children(&node)?;
                let below = children.into_iter().enumerate().map(|(i, child)| (code.child(i), child));
                pending.extend(below);
                let first = pending.len() - <S::Dim as crate::space::Dimension>::CHILDREN;
                pending[first..].reverse();
            }
            _ => batch.push((code, place)),
        }
        if batch.len() >= builder.batch {
            builder.nodes(source, mem::take(&mut batch), total, progress)?;
        }
    }
    builder.nodes(source, batch, total, progress)?;
    let Builder { assembler, sink, .. } = builder;
    let counts = assembler.counts.clone();
    Ok(Walked { sink, root: assembler.finish(), counts })
}

/// A block's part of the tree, its own segment, and its nodes per level.
type Built<D, V> = (Part<D, V>, Option<Sealed<D, V>>, LevelCounts);

/// How a block is built.
#[derive(Clone, Copy)]
struct Plan {
    shape: Shape,
    rule: Rule,
    count_classes: bool,
    /// Whether what sources have stored is taken as it is.
    copy: bool,
}

impl Plan {
    /// The node of a file that a source's node is, if its tree would look the same in the tree that is built, where its
    /// node has so many levels below it.
    fn stored<'s, S: Source>(
        &self,
        source: &'s S,
        node: &S::Node,
        levels: u8,
    ) -> Option<Stored<'s, S::Dim, S::Value>>
    where
        S::Dim: Layout,
    {
        source.stored(node).filter(|stored| self.fits(stored, levels))
    }

    fn fits<D: Layout, V: Value>(&self, stored: &Stored<'_, D, V>, levels: u8) -> bool {
        let (header, shape) = (stored.file.header(), stored.file.header().shape);
        self.copy
            && shape.depth - stored.node.code.level() == levels
            && (shape.reach, shape.stride, shape.light)
                == (self.shape.reach, self.shape.stride, self.shape.light)
            && header.rule == self.rule
            && stored.file.counts_classes() == self.count_classes
    }

    /// The block of an INNER node, which is at the level of blocks.
    fn block<S>(
        &self,
        source: &S,
        code: Code<S::Dim>,
        (representative, node): (S::Value, &S::Node),
    ) -> Result<Block<S::Dim, S::Value>>
    where
        S: Source<Dim: Layout>,
    {
        let height = self.shape.depth - self.shape.block_level();
        let fits = |place: &Child<S::Value, Stored<'_, S::Dim, S::Value>>| match place {
            Child::Inner { node, .. } => self.fits(node, height),
            _ => true,
        };
        let overlay = source.overlay(node).filter(|overlay| overlay.places.iter().all(fits));
        if let Some(overlay) = overlay
            && let Some(block) = Block::from_overlay(&overlay, code, height)?
        {
            return Ok(block);
        }
        let stored = |source, node: &S::Node, levels| self.stored(source, node, levels);
        Block::from_source(source, code, height, (representative, node.clone()), stored)
    }

    fn mixed<D: Layout, V: Value>(&self, block: Block<D, V>) -> Built<D, V> {
        let mut counts = LevelCounts::default();
        let mut part = block.build(self.rule, self.count_classes, &mut counts);
        let sealed = part.seal(&self.shape);
        (part, sealed, counts)
    }

    fn uniform<D: Layout, V: Value>(&self, code: Code<D>, value: Option<V>) -> Built<D, V> {
        let part = Part::uniform(code, self.shape.depth, value, self.count_classes);
        (part, None, LevelCounts::default())
    }
}

/// Blocks in, segments out.
struct Builder<D: Layout, V: Value, K> {
    plan: Plan,
    assembler: Assembler<D, V>,
    sink: K,
    /// Blocks built at a time.
    batch: usize,
}

impl<D: Layout, V: Value, K: SegmentSink<D, V> + Send> Builder<D, V, K> {
    fn new(options: &BuildOptions, shape: Shape, extent: [u64; 3], sink: K) -> Self {
        let cells = 1u64 << (D::AXES * shape.reach as usize);
        let block_bytes = cells / (D::CHILDREN as u64 - 1) * size_of::<D::Record<V>>() as u64;
        Builder {
            plan: Plan { shape, rule: options.rule, count_classes: options.count_classes(), copy: false },
            assembler: Assembler::new(shape, options.rule, extent),
            sink,
            batch: (options.memory / 8 / block_bytes).clamp(4, 256) as usize,
        }
    }

    fn push(&mut self, (part, sealed, counts): Built<D, V>) -> Result<()> {
        self.assembler.counts.merge(&counts);
        if let Some(sealed) = sealed {
            self.sink.segment(sealed)?;
        }
        self.assembler.push(part, &mut self.sink)
    }

    /// All blocks of a slab.
    fn slab(&mut self, slab: &Slab, nodata: Option<V>, total: u64, progress: &dyn Progress) -> Result<()> {
        let level = self.plan.shape.block_level();
        let height = self.plan.shape.depth - level;
        let blocks = |axis: usize| {
            let first = slab.origin[axis] >> height;
            let end = (slab.origin[axis] + slab.size[axis] + (1 << height) - 1) >> height;
            first as u32..end as u32
        };
        let mut codes: Vec<Code<D>> = Vec::new();
        for z in blocks(2) {
            for y in blocks(1) {
                codes.extend(blocks(0).filter_map(|x| Code::from_cell(level, [x, y, z])));
            }
        }
        codes.sort_unstable();
        let cells = slab.size.iter().product::<u64>();
        let mut reported = 0;
        let count = codes.len() as u64;
        for (i, batch) in codes.chunks(self.batch).enumerate() {
            progress.check()?;
            let plan = self.plan;
            let find = |code: &Code<D>| match slab.find::<D, V>(*code, height, nodata) {
                Found::Uniform(value) => plan.uniform(*code, value),
                Found::Mixed(block) => plan.mixed(block),
            };
            let built: Vec<Built<D, V>> = parallel::map(batch, find);
            built.into_iter().try_for_each(|built| self.push(built))?;
            let blocks = ((i + 1) * self.batch).min(codes.len()) as u64;
            let done = cells * blocks / count;
            progress.advance(done - reported, total);
            reported = done;
        }
        Ok(())
    }

    /// What is stored somewhere below one node.
    fn copied(&mut self, copied: Copied<'_, D, V>, total: u64, progress: &dyn Progress) -> Result<()> {
        let counts = copied.send(&mut self.sink)?;
        let cells = self.cells(copied.part.code);
        self.assembler.counts.merge(&counts);
        self.assembler.push(copied.part, &mut self.sink)?;
        progress.advance(cells, total);
        Ok(())
    }

    /// Cells of a node, for the progress.
    fn cells(&self, code: Code<D>) -> u64 {
        1 << (D::AXES * (self.plan.shape.depth - code.level()) as usize).min(63)
    }

    /// Some nodes of a source, at the level of blocks or uniform above it.
    #[allow(clippy::type_complexity)] // a list of places: a name for it would hide more than it says
    fn nodes<S>(
        &mut self,
        source: &S,
        batch: Vec<(Code<D>, Child<V, S::Node>)>,
        total: u64,
        progress: &dyn Progress,
    ) -> Result<()>
    where
        S: Source<Dim = D, Value = V> + Sync,
    {
        progress.check()?;
        let plan = self.plan;
        let build = |(code, place): &(Code<D>, Child<V, S::Node>)| match place {
            Child::Inner { representative, node } if code.level() < plan.shape.depth => {
                Ok(plan.mixed(plan.block(source, *code, (*representative, node))?))
            }
            _ => Ok(plan.uniform(*code, place.value().filter(|value| !value.is_nan()))),
        };
        let built: Vec<Result<Built<D, V>>> = parallel::map(&batch, build);
        built.into_iter().try_for_each(|built| self.push(built?))?;
        progress.advance(batch.iter().map(|(code, _)| self.cells(*code)).sum(), total);
        Ok(())
    }
}

impl<D: Layout, V: Value> Builder<D, V, Writer> {
    fn finish(self, metadata: Metadata) -> Result<()> {
        let counts = self.assembler.counts.clone();
        let root = self.assembler.finish().child;
        self.sink.finish(root, &Metadata { counts, ..metadata })
    }
}
