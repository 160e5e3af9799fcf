//! Goes through slabs and sources, and builds their blocks, many at a time.

use std::mem;

use super::BuildOptions;
use super::assembly::{Assembly, Built};
use super::block::Block;
use super::cells::{Found, Slab};
use super::counts::LevelCounts;
use super::part::Part;
use crate::parallel;
use crate::space::{Code, Dimension};
use crate::store::goblin::{Copied, Layout, Shape};
use crate::tree::{Child, Source, Stored};
use crate::value::{Rule, Value};
use crate::{Error, Progress, Result};

/// Walks a whole source and hands the parts of its tree over. With `reuse`, what the source has stored is taken as it is.
pub(in crate::store) fn walk<S>(
    source: &S,
    options: &BuildOptions,
    shape: Shape,
    reuse: bool,
    assembly: &mut dyn Assembly<S::Dim, S::Value>,
    progress: &dyn Progress,
) -> Result<()>
where
    S: Source + Sync,
    S::Dim: Layout,
{
    if source.depth() != shape.depth {
        let expected = format!("{}, the source's", source.depth());
        return Err(Error::invalid("depth", shape.depth.to_string(), expected));
    }
    let mut builder = Builder::new(options, shape, assembly);
    builder.plan.copy = reuse;
    let mut pending = vec![(Code::ROOT, source.root()?)];
    let mut batch = Vec::new();
    let total = builder.cells(Code::ROOT);
    while let Some((code, place)) = pending.pop() {
        let reused = if reuse { builder.reuse(source, code, &place)? } else { Reuse::Nothing };
        match reused {
            Reuse::Nothing => {}
            Reuse::Kept => {
                progress.advance(builder.cells(code), total);
                continue;
            }
            Reuse::Copied(copied) => {
                builder.nodes(source, mem::take(&mut batch), total, progress)?;
                builder.assembly.copy(copied)?;
                progress.advance(builder.cells(code), total);
                continue;
            }
        }
        match place {
            Child::Inner { node, .. } if code.level() < shape.block_level() => {
                let children = source.children(&node)?;
                let below = children.into_iter().enumerate().map(|(i, child)| (code.child(i), child));
                pending.extend(below);
                let first = pending.len() - S::Dim::CHILDREN;
                pending[first..].reverse();
            }
            _ => batch.push((code, place)),
        }
        if batch.len() >= builder.batch {
            builder.nodes(source, mem::take(&mut batch), total, progress)?;
        }
    }
    builder.nodes(source, batch, total, progress)
}

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
        let level = stored.node.code.level();
        // Below the level of blocks all of a node is in one segment, however the file is cut.
        self.copy
            && shape.depth - level == levels
            && (level >= shape.block_level() || shape.is_cut_like(&self.shape))
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

/// What is taken over of a node as it is.
enum Reuse<'s, D: Layout, V: Value> {
    Nothing,
    /// What the file that is made has already.
    Kept,
    /// Segments of a Goblin file.
    Copied(Copied<'s, D, V>),
}

/// Blocks in, parts out.
pub(in crate::store) struct Builder<'a, D: Layout, V: Value> {
    plan: Plan,
    assembly: &'a mut dyn Assembly<D, V>,
    /// Blocks built at a time.
    batch: usize,
}

impl<'a, D: Layout, V: Value> Builder<'a, D, V> {
    pub(in crate::store) fn new(
        options: &BuildOptions,
        shape: Shape,
        assembly: &'a mut dyn Assembly<D, V>,
    ) -> Self {
        let cells = 1u64 << (D::AXES * shape.reach as usize);
        let block_bytes = cells / (D::CHILDREN as u64 - 1) * size_of::<D::Record<V>>() as u64;
        Builder {
            plan: Plan { shape, rule: options.rule, count_classes: options.count_classes(), copy: false },
            assembly,
            batch: (options.memory / 8 / block_bytes).clamp(4, 256) as usize,
        }
    }

    /// All blocks of a slab.
    pub(in crate::store) fn slab(
        &mut self,
        slab: &Slab,
        nodata: Option<V>,
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
            built.into_iter().try_for_each(|built| self.assembly.push(built))?;
            let blocks = ((i + 1) * self.batch).min(codes.len()) as u64;
            let done = cells * blocks / count;
            progress.advance(done - reported, total);
            reported = done;
        }
        Ok(())
    }

    /// What is stored of an INNER node and can be taken over, so that nobody looks below it.
    fn reuse<'s, S>(
        &mut self,
        source: &'s S,
        code: Code<D>,
        place: &Child<V, S::Node>,
    ) -> Result<Reuse<'s, D, V>>
    where
        S: Source<Dim = D, Value = V>,
    {
        let Child::Inner { representative, node } = place else { return Ok(Reuse::Nothing) };
        let levels = self.plan.shape.depth - code.level();
        let kept = source.kept(node).filter(|kept| kept.height == levels);
        if let Some(kept) = kept
            && code.level() <= self.plan.shape.block_level()
            && self.assembly.keep(code, kept)?
        {
            return Ok(Reuse::Kept);
        }
        let Some(stored) = self.plan.stored(source, node, levels) else { return Ok(Reuse::Nothing) };
        let copied = self.assembly.copied(code, *representative, stored)?;
        Ok(copied.map_or(Reuse::Nothing, Reuse::Copied))
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
        built.into_iter().try_for_each(|built| self.assembly.push(built?))?;
        progress.advance(batch.iter().map(|(code, _)| self.cells(*code)).sum(), total);
        Ok(())
    }
}
