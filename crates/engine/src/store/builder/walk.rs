//! Traverses slabs and sources, and builds their blocks, many at a time.

use std::mem;

use super::block::Block;
use super::encoded_subtree::EncodedSubtree;
use super::options::BuildOptions;
use super::reuse::ReusableSource;
use super::rounding::Rounding;
use super::rows::RowBlock;
use super::sink::{BuiltBlock, TreeSink};
use super::slab::{BlockContent, Slab};
use super::stored_node::StoredNode;
use crate::store::records::RecordLayout;
use crate::store::records::subtree::RECORDS_ARE_CHECKED;
use crate::tree::{Child, no_children};
use spinney_base::TreeType;
use spinney_base::io::batch;
use spinney_base::parallel;
use spinney_base::sort;
use spinney_base::space::{Bounds, Code, CodeRange};
use spinney_base::value::{Rule, Value};
use spinney_base::{Error, Progress, Result};
use spinney_container::MAX_DENSE_LEVELS;
use spinney_container::{Header, LevelCounts, Shape};

/// Traverses the nodes of a source in a run, which may be the whole space, and pushes the parts of
/// its tree to a sink. With `reuse`, stored subtrees are copied unchanged.
pub(in crate::store) fn walk<S: ReusableSource>(
    source: &S,
    options: &BuildOptions,
    (shape, run): (Shape, CodeRange),
    reuse: bool,
    sink: &mut dyn TreeSink,
    progress: &dyn Progress,
) -> Result<()> {
    if source.depth() != shape.depth {
        let expected = format!("{}, the depth of the source", source.depth());
        return Err(Error::invalid("depth", shape.depth.to_string(), expected));
    }
    let form = source.form();
    let mut builder = Builder::new(form, options, (shape, run), sink)?;
    // (Copied subtrees are not rounded.)
    let reuse = reuse && builder.plan.rounding.is_none();
    builder.plan.reuse = reuse;
    let mut pending = vec![(Code::root(form.dimension), source.root()?)];
    let mut children = no_children();
    let mut batch = Vec::new();
    let total = run.cells(form.dimension, shape.depth, &Bounds::space(form.dimension, shape.depth));
    while let Some((code, node)) = pending.pop() {
        if !run.touches(code) {
            continue;
        }
        let is_whole = run.contains(code);
        match if reuse && is_whole { builder.reuse(source, code, &node)? } else { Reuse::Nothing } {
            Reuse::Nothing => {}
            Reuse::AlreadyStored => {
                progress.advance(builder.cells(code), total);
                continue;
            }
            Reuse::Copy(representative, stored) => {
                // Invariant: output reaches the sink in FD order, however many parts are built at a
                // time: the nodes of the batch precede this node. Segments are written in the order
                // of arrival, so otherwise the file's bytes would depend on memory and threads.
                builder.nodes(source, mem::take(&mut batch), total, progress)?;
                builder.sink.copy(code, representative, &stored)?;
                progress.advance(builder.cells(code), total);
                continue;
            }
        }
        match node {
            Child::Inner { node, .. } if code.level() < shape.block_level() => {
                source.children(&node, &mut children)?;
                // Reversed, so that the first child is popped first.
                let below = children[..form.children()].iter_mut().enumerate().rev();
                pending.extend(below.map(|(i, child)| (code.child(i), mem::take(child))));
            }
            // Invariant: if several runs cover the whole space, exactly one of them pushes each
            // node. A uniform node that exceeds the run is divided until each fragment is inside or
            // outside of it.
            _ if !is_whole => {
                let children = (0..form.children()).rev();
                pending.extend(children.map(|child| (code.child(child), Child::uniform(node.value()))));
            }
            _ => batch.push((code, node)),
        }
        if batch.len() >= builder.batch {
            builder.nodes(source, mem::take(&mut batch), total, progress)?;
        }
    }
    builder.nodes(source, batch, total, progress)?;
    // A tree that mixes two states of a file must be discarded.
    source.check_unchanged()
}

/// Minimum and maximum number of blocks that are built at a time, whatever the memory.
const MIN_BATCH: u64 = 4;
const MAX_BATCH: u64 = 256;
/// Number of blocks if equal subtrees are stored once, whatever the memory. It determines which
/// nodes of another file have been copied when a node is looked up, and so the record counts that a
/// commit stores.
const SHARING_BATCH: u64 = 16;

/// Plan for building blocks.
#[derive(Clone, Copy)]
struct Plan {
    form: TreeType,
    shape: Shape,
    rule: Rule,
    count_classes: bool,
    /// Whether stored subtrees of sources are copied unchanged.
    reuse: bool,
    /// Maximum number of levels of dense blocks.
    most_dense: u8,
    /// How cells are rounded.
    rounding: Option<Rounding>,
}

impl Plan {
    /// Returns whether a stored node with `levels` levels below it would have the same subtree if
    /// it were built.
    fn fits(&self, stored: &StoredNode<'_>, levels: u8) -> bool {
        let header = stored.file.file_header();
        let shape = header.shape;
        let level = shape.depth.saturating_sub(stored.height);
        // Invariant: records are copied only if building would yield the same records for these
        // cells. So everything that determines them must agree: type and rule, what is counted and
        // what is missing, levels, the maximum size of dense blocks, and how the tree is cut,
        // unless all of the node is in one segment (which is the case below the block level).
        // Otherwise the bytes would depend on the origin of a tree.
        self.reuse
            && stored.height == levels
            // (Larger nodes may have larger dense blocks.)
            && (levels <= self.most_dense || self.most_dense == MAX_DENSE_LEVELS)
            && (level >= shape.block_level() || shape.is_cut_like(&self.shape))
            && header.rule == self.rule
            && header.form.value == self.form.value
            && header.counts_classes() == self.count_classes
    }

    /// Returns the block of an INNER node at the block level.
    fn block<S: ReusableSource>(
        &self,
        source: &S,
        code: Code,
        (representative, node): (Value, &S::Node),
    ) -> Result<BlockContent> {
        let height = self.shape.depth - self.shape.block_level();
        if let Some(cells) = source.cells(node, height)? {
            let slab = Slab::of_block(self.form, code, height, cells);
            return Ok(slab.classify(self.form, code, height, None, self.in_rows()));
        }
        let fits = |node: &Child<StoredNode<'_>>| match node {
            Child::Inner { node, .. } => self.fits(node, height),
            _ => true,
        };
        let overlay = source.overlay(node).filter(|overlay| overlay.nodes.iter().all(fits));
        if let Some(overlay) = overlay
            && let Some(block) = Block::from_overlay(self.form, &overlay, code, height)?
        {
            return Ok(BlockContent::Mixed(block));
        }
        let may_reuse = |stored: &StoredNode<'_>, levels| self.fits(stored, levels);
        let block = Block::from_source(source, code, height, (representative, node), &may_reuse)?;
        Ok(BlockContent::Mixed(block))
    }

    fn mixed(&self, block: Block) -> BuiltBlock {
        let mut counts = LevelCounts::default();
        let mut part = block.build(self.rule, self.count_classes, self.most_dense, &mut counts);
        let sealed = part.seal(&self.shape).expect(RECORDS_ARE_CHECKED);
        (part, sealed, counts)
    }

    fn built(&self, code: Code, mut content: BlockContent) -> BuiltBlock {
        if let Some(rounding) = &self.rounding {
            content.round(rounding);
        }
        match content {
            BlockContent::Uniform(value) => self.uniform(code, value),
            BlockContent::Mixed(block) => self.mixed(block),
            BlockContent::Full(block) if cfg!(not(target_family = "wasm")) => {
                block.build(self.rule, &self.shape, self.most_dense)
            }
            BlockContent::Full(_) => unreachable!("no block is built in rows in browsers"),
        }
    }

    /// Returns whether blocks without VOID are built in rows.
    fn in_rows(&self) -> bool {
        RowBlock::supports(self.form, self.rule, self.count_classes)
    }

    fn uniform(&self, code: Code, value: Option<Value>) -> BuiltBlock {
        let part =
            EncodedSubtree::uniform(code, self.shape.depth, self.form.value, value, self.count_classes);
        (part, None, LevelCounts::default())
    }
}

/// Builds a block of a tree with this header from a slab that has all its cells. `nodata` is the
/// value that means VOID.
pub(in crate::store) fn build_block(
    header: &Header,
    code: Code,
    slab: &Slab,
    nodata: Option<Value>,
) -> BuiltBlock {
    // Invariant: these are the options with which the index was built. Others would change the
    // plain segment, and with it the checksum of the reference.
    let plan = Plan {
        form: header.form,
        shape: header.shape,
        rule: header.rule,
        count_classes: header.counts_classes(),
        reuse: false,
        most_dense: MAX_DENSE_LEVELS,
        rounding: None,
    };
    let height = header.depth() - code.level();
    plan.built(code, slab.classify(header.form, code, height, nodata, plan.in_rows()))
}

/// How a node is reused without being built.
enum Reuse<'s> {
    Nothing,
    /// The output already has the node.
    AlreadyStored,
    /// Segments of another file are copied; the node has this representative.
    Copy(Value, StoredNode<'s>),
}

/// Builds blocks and pushes their parts to a sink.
pub(in crate::store) struct Builder<'a> {
    plan: Plan,
    /// The run of nodes that is built.
    run: CodeRange,
    sink: &'a mut dyn TreeSink,
    /// Blocks that are built at a time.
    batch: usize,
}

impl<'a> Builder<'a> {
    pub(in crate::store) fn new(
        form: TreeType,
        options: &BuildOptions,
        (shape, run): (Shape, CodeRange),
        sink: &'a mut dyn TreeSink,
    ) -> Result<Self> {
        // A block without uniform nodes has (cells - 1) / (children - 1) INNER ones, with a record
        // each.
        let record = RecordLayout::new(form).size as u64;
        let block_bytes = form.dimension.cells(shape.reach) / (form.children() as u64 - 1) * record;
        let (rule, count_classes) = (options.rule, options.count_classes());
        let most_dense = sink.dense_levels();
        let batch = match options.share {
            true => SHARING_BATCH,
            false => (options.memory / 8 / block_bytes).clamp(MIN_BATCH, MAX_BATCH),
        };
        let rounding = options.packing.rounding(form.value, options.kind)?;
        Ok(Builder {
            plan: Plan { form, shape, rule, count_classes, reuse: false, most_dense, rounding },
            run,
            sink,
            batch: batch as usize,
        })
    }

    /// Builds all blocks of a slab that are in the run.
    pub(in crate::store) fn slab(
        &mut self,
        slab: &Slab,
        nodata: Option<Value>,
        total: u64,
        progress: &dyn Progress,
    ) -> Result<()> {
        let level = self.plan.shape.block_level();
        let height = self.plan.shape.depth - level;
        let blocks = |axis: usize| {
            let first = slab.origin[axis] >> height;
            let end = (slab.origin[axis] + slab.size[axis] + (1 << height) - 1) >> height;
            first as u32..end as u32
        };
        let dimension = self.plan.form.dimension;
        let mut codes: Vec<Code> = Vec::new();
        for z in blocks(2) {
            for y in blocks(1) {
                codes.extend(blocks(0).filter_map(|x| Code::from_cell(dimension, level, [x, y, z])));
            }
        }
        let all = codes.len().max(1) as u128;
        codes.retain(|code| self.run.contains(*code));
        sort::by_key(&mut codes, |code| code.bits());
        let cells = slab.size.iter().product::<u64>();
        let cells = (u128::from(cells) * codes.len() as u128 / all) as u64;
        let mut reported = 0;
        let count = codes.len() as u64;
        for (i, batch) in codes.chunks(self.batch).enumerate() {
            progress.check()?;
            let plan = self.plan;
            let build = |code: &Code| {
                let content = slab.classify(plan.form, *code, height, nodata, plan.in_rows());
                plan.built(*code, content)
            };
            let built: Vec<BuiltBlock> = parallel::map(batch, build);
            self.sink.push_all(built)?;
            let blocks = ((i + 1) * self.batch).min(codes.len()) as u64;
            let done = cells * blocks / count;
            progress.advance(done - reported, total);
            reported = done;
        }
        Ok(())
    }

    /// Returns whether an INNER node can be reused as it is stored, without visiting nodes below
    /// it.
    fn reuse<'s, S: ReusableSource>(
        &mut self,
        source: &'s S,
        code: Code,
        node: &Child<S::Node>,
    ) -> Result<Reuse<'s>> {
        let Child::Inner { representative, node } = node else { return Ok(Reuse::Nothing) };
        let levels = self.plan.shape.depth - code.level();
        let kept = source.kept(node).filter(|kept| kept.height == levels);
        if let Some(kept) = kept
            && code.level() <= self.plan.shape.block_level()
            && self.sink.keep(code, kept)?
        {
            return Ok(Reuse::AlreadyStored);
        }
        let stored = source.stored(node).filter(|stored| self.plan.fits(stored, levels));
        let Some(stored) = stored else { return Ok(Reuse::Nothing) };
        let can_copy = self.sink.can_copy(code, &stored)?;
        Ok(if can_copy { Reuse::Copy(*representative, stored) } else { Reuse::Nothing })
    }

    /// Returns the number of cells of a node, for the progress.
    fn cells(&self, code: Code) -> u64 {
        code.dimension().cells(self.plan.shape.depth - code.level())
    }

    /// Builds some nodes of a source, at the block level or uniform above it.
    fn nodes<S: ReusableSource>(
        &mut self,
        source: &S,
        batch: Vec<(Code, Child<S::Node>)>,
        total: u64,
        progress: &dyn Progress,
    ) -> Result<()> {
        let plan = self.plan;
        let build = |(code, node): &(Code, Child<S::Node>)| {
            // (Checked per node, because a batch of blocks of a view can take long.)
            progress.check()?;
            match node {
                Child::Inner { representative, node } if code.level() < plan.shape.depth => {
                    Ok(plan.built(*code, plan.block(source, *code, (*representative, node))?))
                }
                _ => {
                    let value = node.value().filter(|value| !plan.form.value.is_nan(*value));
                    Ok(plan.built(*code, BlockContent::Uniform(value)))
                }
            }
        };
        self.sink.push_all(batch::map(&batch, build)?)?;
        progress.advance(batch.iter().map(|(code, _)| self.cells(*code)).sum(), total);
        Ok(())
    }
}
