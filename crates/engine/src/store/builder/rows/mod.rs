//! Builds the tree of one block of cells none of which is VOID: what most blocks of pictures are.
//!
//! As in [`block`](super::block), level after level is reduced to the next one in flat arrays. Without VOID all nodes of all
//! levels are there, so that levels can be rows as the input is, and as dense blocks are: cells come in and go out by
//! copying, and the kernels ([`means`], [`classes`], [`firsts`]) are loops over pairs of neighbours, which compilers make instructions
//! for many at a time of.

mod classes;
mod encode;
mod firsts;
mod means;
#[cfg(test)]
mod tests;

use zerocopy::FromBytes;

use super::part::Part;
use super::sink::BuiltBlock;
use super::tally;
use crate::store::records::{Record, RecordLayout, with_record_type};
use crate::tree::Child;
use spinney_base::TreeType;
use spinney_base::space::Code;
use spinney_base::value::{Mask, Rule, SampleType, Value, ValueType, with_native_type};
use spinney_container::{LevelCounts, Shape};

/// A block without VOID.
pub(super) struct RowBlock {
    form: TreeType,
    code: Code,
    /// Levels from the cells to the block's root.
    height: usize,
    /// From the cells up; those above them once the block is reduced. Invariant: every level has all of its
    /// nodes, and none is VOID. So the place of a node in its row tells where its children are, and no state
    /// has to be kept beside whether it is uniform. Of a block with VOID the means would be those of whatever
    /// stands there.
    levels: Vec<RowLevel>,
}

/// The nodes of a level in rows: x runs fastest, then y, then z.
struct RowLevel {
    /// The values' bytes.
    values: Vec<u8>,
    /// 1 where all cells of a node are alike, 0 where they differ.
    uniform: Vec<u8>,
}

impl RowLevel {
    /// The values, with their width known at compile time.
    #[inline]
    fn values_of<R: Record>(&self) -> &[R::Bytes] {
        <[R::Bytes]>::ref_from_bytes(&self.values).expect("whole values")
    }
}

impl RowBlock {
    /// Whether blocks without VOID and transparent cells can be built in rows by a rule.
    pub(super) fn supports(form: TreeType, rule: Rule, count_classes: bool) -> bool {
        match rule {
            // (Without VOID occupancy is the mean. And nothing is transparent.)
            Rule::Mean | Rule::Occupancy => !matches!(form.value.mask, Mask::Missing(_)) && !count_classes,
            // (Whose bytes are in the order of the values.)
            Rule::Majority => form.value == ValueType::new(SampleType::U8, 1),
            Rule::Nearest => count_classes && !form.value.sample.is_float(),
            Rule::Dominant | Rule::Min | Rule::Max => false,
        }
    }

    /// The block under `code`, of `height` levels, from all its cells in rows.
    pub(super) fn new(form: TreeType, code: Code, height: u8, cells: Vec<u8>) -> RowBlock {
        let uniform = vec![1; form.dimension.cells(height) as usize];
        debug_assert_eq!(cells.len(), uniform.len() * form.width());
        RowBlock { form, code, height: height.into(), levels: vec![RowLevel { values: cells, uniform }] }
    }

    /// The bytes of all cells, before the block is built.
    pub(super) fn cells_mut(&mut self) -> &mut [u8] {
        &mut self.levels[0].values
    }

    /// Condenses and averages the block and turns it into records, with dense blocks of so many levels at most. The rule must be
    /// one that is supported.
    pub(super) fn build(mut self, rule: Rule, shape: &Shape, most_dense: u8) -> BuiltBlock {
        let form = self.form;
        let tally = match rule {
            Rule::Majority => tally::of_classes(form.value, classes::majorities(&mut self)),
            Rule::Nearest => tally::of_classes(form.value, firsts::firsts(&mut self)),
            _ => with_native_type!(form.value, V => means::means::<V>(&mut self)),
        };
        let below = self.counts();
        let mut counts = LevelCounts::default();
        counts.merge_below(self.code.level(), &below);
        let child = self.root();
        // (Of the root, whoever merges it with its siblings counts all but what is below.)
        let total = below.records() + u64::from(child.is_inner());
        let records = self.encode(0, most_dense);
        let mut part = Part { code: self.code, child, total, records, tally };
        let sealed = part
            .seal_with(shape, |_, levels| self.encode(self.height.saturating_sub(levels.into()), most_dense));
        (part, sealed, counts)
    }

    /// Nodes along each axis, `up` levels above the cells.
    fn side(&self, up: usize) -> usize {
        1 << (self.height - up)
    }

    /// Adds the level above the last one, without values, and tells which nodes are uniform.
    fn push_level(&mut self) {
        let side = self.side(self.levels.len() - 1);
        let axes = self.form.axes();
        let below = self.levels.last().expect("there are cells");
        let nodes = below.uniform.len() >> axes;
        let mut uniform = vec![0; nodes];
        with_record_type!(RecordLayout::new(self.form), R => {
            mark_uniform(axes, side, (below.values_of::<R>(), &below.uniform), &mut uniform);
        });
        self.levels.push(RowLevel { values: vec![0; nodes * self.form.width()], uniform });
    }

    /// The level that was added last, and the one below it.
    fn last_two(&mut self) -> (&RowLevel, &mut RowLevel) {
        let last = self.levels.len() - 1;
        let (below, above) = self.levels.split_at_mut(last);
        (&below[last - 1], &mut above[0])
    }

    /// The block's root, once it is reduced.
    fn root(&self) -> Child<()> {
        let root = &self.levels[self.height];
        let value = Value::from_bytes(&root.values);
        if root.uniform[0] == 1 {
            Child::Leaf(value)
        } else {
            Child::Inner { representative: value, node: () }
        }
    }

    /// Nodes of each level below the root, which is at level 0.
    fn counts(&self) -> LevelCounts {
        let mut counts = LevelCounts::default();
        let mut parents = 0;
        for (up, level) in self.levels.iter().enumerate().rev() {
            let uniform: usize =
                level.uniform.chunks(128).map(|flags| usize::from(flags.iter().sum::<u8>())).sum();
            let inner = (level.uniform.len() - uniform) as u64;
            if up < self.height {
                let nodes = parents * self.form.children() as u64;
                counts.add((self.height - up) as u8, [0, nodes - inner, inner]);
            }
            parents = inner;
        }
        counts
    }

    /// The records of the levels from the root down to that `bottom` levels above the cells, where nodes that are not uniform
    /// are cut off. Nothing if the root is uniform.
    fn encode(&self, bottom: usize, most_dense: u8) -> Vec<u8> {
        with_record_type!(RecordLayout::new(self.form), R => encode::encode::<R>(&self.levels, bottom, most_dense))
    }
}

/// The rows of children of a row of nodes, in child order; quadtrees have two, and two empty ones. `side` is the number of
/// children along each axis.
#[inline]
fn child_rows<T>(axes: usize, side: usize, children: &[T], row: usize) -> [&[T]; 4] {
    let row_at = |row: usize| &children[row * side..][..side];
    if axes == 2 {
        return [row_at(2 * row), row_at(2 * row + 1), &[], &[]];
    }
    // Rows of parents are numbered along y first.
    let (y, z) = (2 * row % side, 2 * row / side * 2);
    let at = |dy, dz| row_at((z + dz) * side + y + dy);
    [at(0, 0), at(1, 0), at(0, 1), at(1, 1)]
}

/// [`child_rows`] as pairs of neighbours.
#[inline]
fn child_pairs<T>(axes: usize, side: usize, children: &[T], row: usize) -> [&[[T; 2]]; 4] {
    let [a, b, c, d] = child_rows(axes, side, children, row);
    [a.as_chunks().0, b.as_chunks().0, c.as_chunks().0, d.as_chunks().0]
}

/// Neighbours in a row of bytes, as numbers of two bytes whose lower ones are the first: to join them one is moved to the
/// other, for which there are instructions for many at a time.
#[inline]
fn neighbours(row: &[u8]) -> impl Iterator<Item = u16> {
    row.as_chunks().0.iter().map(|pair| u16::from_le_bytes(*pair))
}

/// Tells which nodes are uniform: those whose children are, and are alike.
#[inline]
fn mark_uniform<B: Copy + PartialEq>(
    axes: usize,
    side: usize,
    (values, below): (&[B], &[u8]),
    uniform: &mut [u8],
) {
    // Whether the cells of a column are alike, and those of two columns in the first row.
    let (mut columns, mut alike) = (vec![0; side], vec![0; side]);
    for (row, uniform) in uniform.chunks_exact_mut(side / 2).enumerate() {
        columns.fill(1);
        for flags in child_rows(axes, side, below, row) {
            columns.iter_mut().zip(flags).for_each(|(column, flag)| *column &= flag);
        }
        let [first, others @ ..] = child_rows(axes, side, values, row);
        for other in others {
            let pairs = first.iter().zip(other);
            columns.iter_mut().zip(pairs).for_each(|(column, (a, b))| *column &= u8::from(a == b));
        }
        let pairs = first.iter().zip(&first[1..]);
        alike.iter_mut().zip(pairs).for_each(|(alike, (a, b))| *alike = u8::from(a == b));
        for ((uniform, columns), alike) in
            uniform.iter_mut().zip(neighbours(&columns)).zip(neighbours(&alike))
        {
            *uniform = (columns & columns >> 8 & alike) as u8;
        }
    }
}

/// Makes one of all the children of each node, in child order: neighbours along x, then along y, then along z.
#[inline]
fn reduce<T: Copy, S: Copy>(
    axes: usize,
    side: usize,
    children: &[T],
    sums: &mut [S],
    of: impl Fn(T) -> S + Copy,
    add: impl Fn(S, S) -> S + Copy,
) {
    let pair = |pair: &[T; 2]| add(of(pair[0]), of(pair[1]));
    for (row, sums) in sums.chunks_exact_mut(side / 2).enumerate() {
        let [a, b, c, d] = child_pairs(axes, side, children, row);
        for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
            *sum = add(pair(a), pair(b));
        }
        for ((sum, c), d) in sums.iter_mut().zip(c).zip(d) {
            *sum = add(*sum, add(pair(c), pair(d)));
        }
    }
}
