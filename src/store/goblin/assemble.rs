//! Puts blocks together to a Goblin file, in whatever order they come.

use super::copy::Copied;
use super::directory::Entry;
use super::header::Header;
use super::metadata::Metadata;
use super::record::Layout;
use super::segment::Segment;
use super::shape::Shape;
use super::writer::Writer;
use crate::Result;
use crate::space::Code;
use crate::store::Output;
use crate::store::build::{
    Assembly, BuildOptions, Built, Fill, LevelCounts, Part, Sealed, Siblings, state_of,
};
use crate::tree::Stored;
use crate::value::{Rule, Tally, Value};

/// Receives the segments of a tree as they are finished, a node's before its ancestors'.
pub(in crate::store) trait SegmentSink<D: Layout, V: Value> {
    /// Takes one segment.
    fn segment(&mut self, segment: Sealed<D, V>) -> Result<()>;

    /// Takes one segment of another file as it is; the entry has the code it gets.
    fn copy(&mut self, segment: &Segment<'_, D, V>, entry: Entry<D, V>) -> Result<()>;
}

/// Merges parts whose siblings are complete, seals segments, and hands them to a sink.
pub(in crate::store) struct Assembler<D: Layout, V: Value, K> {
    shape: Shape,
    rule: Rule,
    siblings: Siblings<D, Part<D, V>>,
    root: Option<Part<D, V>>,
    counts: LevelCounts,
    sink: K,
}

/// What comes of all parts.
pub(in crate::store) struct Assembled<D: Layout, V: Value, K> {
    pub(in crate::store) sink: K,
    pub(in crate::store) root: Part<D, V>,
    pub(in crate::store) counts: LevelCounts,
}

impl<D: Layout, V: Value, K: SegmentSink<D, V> + Send> Assembler<D, V, K> {
    /// `covered` is the extent of the parts that will come; what is outside is VOID.
    pub(in crate::store) fn new(shape: Shape, rule: Rule, covered: [u64; 3], sink: K) -> Self {
        let siblings = Siblings::new(shape.depth, covered);
        Assembler { shape, rule, siblings, root: None, counts: LevelCounts::default(), sink }
    }

    /// Takes a part whose own segment is already taken off.
    fn join(&mut self, mut part: Part<D, V>) -> Result<()> {
        loop {
            let Some(parent) = part.code.parent() else {
                let mut root = [0; 3];
                root[usize::from(state_of(&part.child))] = 1;
                self.counts.add(0, root);
                self.root = Some(part);
                return Ok(());
            };
            let depth = self.shape.depth;
            let step = part.code.step(parent.level());
            let void = |code| Part::uniform(code, depth, None, false);
            let Some(parts) = self.siblings.join(parent, step, part, void) else { return Ok(()) };
            part = Part::merge(parent, &parts, depth, self.rule, &mut self.counts);
            if let Some(sealed) = part.seal(&self.shape) {
                self.sink.segment(sealed)?;
            }
        }
    }

    /// What has become of everything, once it has come.
    pub(in crate::store) fn finish(self) -> Assembled<D, V, K> {
        let root = self.root.expect("all blocks were pushed");
        Assembled { sink: self.sink, root, counts: self.counts }
    }
}

impl<D: Layout, V: Value, K: SegmentSink<D, V> + Send> Assembly<D, V> for Assembler<D, V, K> {
    fn push(&mut self, (part, sealed, counts): Built<D, V>) -> Result<()> {
        self.counts.merge(&counts);
        if let Some(sealed) = sealed {
            self.sink.segment(sealed)?;
        }
        self.join(part)
    }

    fn copied<'s>(
        &self,
        code: Code<D>,
        representative: V,
        stored: Stored<'s, D, V>,
    ) -> Result<Option<Copied<'s, D, V>>> {
        if !stored.file.header().shape.is_cut_like(&self.shape) {
            return Ok(None);
        }
        Copied::of(stored, code, representative, &self.shape)
    }

    fn copy(&mut self, copied: Copied<'_, D, V>) -> Result<()> {
        let counts = copied.send(&mut self.sink)?;
        self.counts.merge(&counts);
        self.join(copied.part)
    }
}

/// Makes a Goblin file of the parts of a tree.
pub(in crate::store) fn write<D: Layout, V: Value>(
    options: &BuildOptions,
    header: Header,
    covered: [u64; 3],
    output: Output,
    fill: &mut Fill<'_, D, V>,
    complete: &mut dyn FnMut(&mut Metadata),
) -> Result<Tally<V>> {
    let writer = Writer::new(output, &header, options.memory / 8)?;
    let mut assembler = Assembler::<D, V, _>::new(header.shape, options.rule, covered, writer);
    fill(&mut assembler, header.shape)?;
    let Assembled { sink: writer, root, counts } = assembler.finish();
    let mut metadata = Metadata { counts, ..options.metadata.clone() };
    complete(&mut metadata);
    writer.finish(root.child, &metadata)?;
    Ok(root.tally)
}
