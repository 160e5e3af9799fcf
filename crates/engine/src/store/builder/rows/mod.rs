//! Builds the tree of one block of cells without VOID, as most blocks of rasters are.
//!
//! As in [`block`](super::block), each level is reduced to the next one in flat arrays. Without
//! VOID, every level has all of its nodes. So levels can be stored in rows, like the input and like
//! dense blocks: cells are copied in and out. The kernels ([`means`], [`classes`], [`firsts`]) are
//! loops over pairs of adjacent nodes, which compilers vectorize.

mod classes;
mod encode;
mod firsts;
mod means;
#[cfg(test)]
mod tests;

use zerocopy::FromBytes;

use super::encoded_subtree::EncodedSubtree;
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
    /// From the cells up; the levels above the cells exist once the block is reduced. Invariant:
    /// every level has all of its nodes, and none is VOID. So a node's position in its row
    /// determines the positions of its children, and the only state is whether it is uniform. In a
    /// block with VOID, means would include the bytes of VOID cells.
    levels: Vec<RowLevel>,
}

/// The nodes of a level in rows: x fastest, then y, then z.
struct RowLevel {
    /// The values' bytes.
    values: Vec<u8>,
    /// 1 where all cells of a node are equal, 0 where they differ.
    uniform: Vec<u8>,
}

impl RowLevel {
    /// Returns the values, with their width known at compile time.
    #[inline]
    fn values_of<R: Record>(&self) -> &[R::Bytes] {
        <[R::Bytes]>::ref_from_bytes(&self.values).expect("whole values")
    }
}

impl RowBlock {
    /// Returns whether blocks without VOID and transparent cells can be built in rows for a rule.
    pub(super) fn supports(form: TreeType, rule: Rule, count_classes: bool) -> bool {
        // (In browsers, where a smaller module is worth more than faster blocks, all are built
        // alike.)
        if cfg!(target_family = "wasm") {
            return false;
        }
        match rule {
            // (Without VOID, the occupancy is the mean. Transparent cells are excluded by the
            // caller.)
            Rule::Mean | Rule::Occupancy => !matches!(form.value.mask, Mask::Missing(_)) && !count_classes,
            // (Only for bytes, whose order is the order of the values.)
            Rule::Majority => form.value == ValueType::new(SampleType::U8, 1),
            Rule::Nearest => count_classes && !form.value.sample.is_float(),
            Rule::Dominant | Rule::Min | Rule::Max => false,
        }
    }

    /// Returns the block under `code`, of `height` levels, from all its cells in rows.
    pub(super) fn new(form: TreeType, code: Code, height: u8, cells: Vec<u8>) -> RowBlock {
        let uniform = vec![1; form.dimension.cells(height) as usize];
        debug_assert_eq!(cells.len(), uniform.len() * form.width());
        RowBlock { form, code, height: height.into(), levels: vec![RowLevel { values: cells, uniform }] }
    }

    /// Returns the bytes of all cells, before the block is built.
    pub(super) fn cells_mut(&mut self) -> &mut [u8] {
        &mut self.levels[0].values
    }

    /// Condenses the block, computes representatives, and encodes it as records, with dense blocks
    /// of at most `most_dense` levels. The rule must be a supported one.
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
        // (The root itself is counted where it is merged with its siblings, so `counts` gets only
        // the nodes below it.)
        let total = below.records() + u64::from(child.is_inner());
        let records = self.encode(0, most_dense);
        let mut part = EncodedSubtree { code: self.code, child, total, records, tally };
        let sealed = part
            .seal_with(shape, |_, levels| self.encode(self.height.saturating_sub(levels.into()), most_dense));
        (part, sealed, counts)
    }

    /// Returns the number of nodes along each axis, `up` levels above the cells.
    fn side(&self, up: usize) -> usize {
        1 << (self.height - up)
    }

    /// Adds the level above the last one, with zeros as values, and marks its uniform nodes.
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

    /// Returns the level below the last one, and the last one.
    fn last_two(&mut self) -> (&RowLevel, &mut RowLevel) {
        let last = self.levels.len() - 1;
        let (below, above) = self.levels.split_at_mut(last);
        (&below[last - 1], &mut above[0])
    }

    /// Returns the block's root, once the block is reduced.
    fn root(&self) -> Child<()> {
        let root = &self.levels[self.height];
        let value = Value::from_bytes(&root.values);
        if root.uniform[0] == 1 {
            Child::Leaf(value)
        } else {
            Child::Inner { representative: value, node: () }
        }
    }

    /// Returns the number of nodes of each level below the root, which is at level 0.
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

    /// Returns the records of the levels from the root down to the level `bottom` levels above the
    /// cells. Nodes there that are not uniform become CUT. Returns nothing if the root is uniform.
    fn encode(&self, bottom: usize, most_dense: u8) -> Vec<u8> {
        with_record_type!(RecordLayout::new(self.form), R => encode::encode::<R>(&self.levels, bottom, most_dense))
    }
}

/// Returns the rows of children of a row of nodes, in child order; quadtrees have two, and two
/// empty ones. `side` is the number of children along each axis.
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

/// [`child_rows`] as pairs of adjacent children.
#[inline]
fn child_pairs<T>(axes: usize, side: usize, children: &[T], row: usize) -> [&[[T; 2]]; 4] {
    let [a, b, c, d] = child_rows(axes, side, children, row);
    [a.as_chunks().0, b.as_chunks().0, c.as_chunks().0, d.as_chunks().0]
}

/// Returns pairs of adjacent bytes in a row as numbers of two bytes, with the first in the lower
/// byte. Shifting one byte onto the other joins them, for which there are vector instructions.
#[inline]
fn neighbours(row: &[u8]) -> impl Iterator<Item = u16> {
    row.as_chunks().0.iter().map(|pair| u16::from_le_bytes(*pair))
}

/// Marks the uniform nodes: those whose children are uniform and equal.
#[inline]
fn mark_uniform<B: Copy + PartialEq>(
    axes: usize,
    side: usize,
    (values, below): (&[B], &[u8]),
    uniform: &mut [u8],
) {
    // For each column: whether its cells are equal, and whether the first row's cell equals that of
    // the next column.
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

/// Combines all children of each node into one, in child order: adjacent ones along x, then along
/// y, then along z.
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
