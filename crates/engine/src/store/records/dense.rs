//! Dense blocks: nodes whose subtree is stored as rows of values instead of records.
//!
//! Where no two cells are alike, a tree needs a record for every four (or eight) of them. A node a
//! few levels above the bottom of its segment can be stored as a *dense block* instead: its record
//! as usual, with a mark, then the representatives of the inner levels and the values of the bottom
//! level, level by level in rows, without states and skips. This corresponds to the leaf nodes of
//! OpenVDB, but with levels of detail. The bottom nodes all have one state, or one of two, with a
//! mask of one bit per node. States above follow from these: a node is uniform if all values below
//! are equal.

use std::marker::PhantomData;

use zerocopy::{FromBytes, IntoBytes};

use super::record::{OctRecord, QuadRecord, Record};
use crate::tree::CellBlock;
use spinney_base::space::Dimension;
pub(crate) use spinney_container::DenseBlock;
use spinney_container::{DenseKind, INNER, LEAF, MAX_DENSE_LEVELS, VOID, dense_levels};

/// [`RecordLayout::dense_slots`] by presence of a mask and by levels, for a record type, so that
/// readers do not compute the sizes of blocks.
struct DenseSlots<R>(PhantomData<R>);

impl<R: Record> DenseSlots<R> {
    const TABLE: [[u32; MAX_DENSE_LEVELS as usize + 1]; 2] = {
        let mut table = [[0; MAX_DENSE_LEVELS as usize + 1]; 2];
        let mut levels = *dense_levels(R::DIMENSION).start();
        while levels <= *dense_levels(R::DIMENSION).end() {
            table[0][levels as usize] = R::RECORD_LAYOUT.dense_slots(DenseKind::ALL_LEAF, levels) as u32;
            table[1][levels as usize] = R::RECORD_LAYOUT.dense_slots(DenseKind::LEAF_OR_VOID, levels) as u32;
            let (start, here) = (*dense_levels(R::DIMENSION).start(), levels as usize);
            assert!(
                levels == start
                    || (table[0][here] > table[0][here - 1] && table[1][here] > table[1][here - 1])
            );
            levels += 1;
        }
        table
    };
}

/// Returns the dense block whose record has index `at`, which must exist; `None` if it is not a
/// dense block, or an incomplete one.
pub(crate) fn dense_block<R: Record>(records: &[R], at: usize) -> Option<DenseBlock<'_>> {
    let head = records[at].head();
    let kind = DenseKind::from_number(head.dense)?;
    // (The table has 0 for impossible numbers of levels.)
    let table = &DenseSlots::<R>::TABLE[usize::from(kind.has_mask())];
    let levels = table.iter().position(|slots| *slots > 0 && *slots + 1 == head.skip)? as u8;
    let bytes = records.get(at..at + head.skip as usize)?.as_bytes();
    Some(DenseBlock::new(R::RECORD_LAYOUT, kind, levels, bytes))
}

/// Access to dense blocks whose value width is known at compile time.
pub(crate) trait DenseRows<'r> {
    /// [`DenseBlock::values`] with a width known at compile time.
    fn values_of<R: Record>(&self, level: u8) -> &'r [R::Bytes];

    /// Passes the values of the LEAFs among the bottom nodes in a box to `leaf`. The box is given
    /// by its first position and its size along each axis. (Dynamic dispatch, because visitors are
    /// compiled for very many types.)
    fn each_leaf_in<R: Record>(&self, part: ([usize; 3], [usize; 3]), leaf: &mut dyn FnMut(R::Bytes));

    /// Passes the values of all bottom nodes in a box to `show`, row by row, whatever their states.
    fn rows_in<R: Record>(&self, part: ([usize; 3], [usize; 3]), show: &mut impl FnMut(&[R::Bytes]));

    /// Returns the bottom nodes as cells; `None` if some of them are CUT.
    fn cells(&self) -> Option<CellBlock>;

    /// Returns the states of all nodes below the root; [`DenseStates::level`] returns those of one
    /// level. Nodes below a uniform node have its state. Much faster than single queries.
    fn states<R: Record>(&self) -> DenseStates;
}

impl<'r> DenseRows<'r> for DenseBlock<'r> {
    #[inline]
    fn values_of<R: Record>(&self, level: u8) -> &'r [R::Bytes] {
        <[R::Bytes]>::ref_from_bytes(self.values(level)).unwrap_or(&[])
    }

    #[inline(never)]
    fn each_leaf_in<R: Record>(
        &self,
        (first, size): ([usize; 3], [usize; 3]),
        leaf: &mut dyn FnMut(R::Bytes),
    ) {
        let values = self.values_of::<R>(self.levels);
        for z in 0..size[2] {
            for y in 0..size[1] {
                let start = self.index(self.levels, [first[0], first[1] + y, first[2] + z]);
                for (at, value) in (start..).zip(&values[start..start + size[0]]) {
                    if self.bottom_state(at) == LEAF {
                        leaf(*value);
                    }
                }
            }
        }
    }

    #[inline]
    fn rows_in<R: Record>(
        &self,
        (first, size): ([usize; 3], [usize; 3]),
        show: &mut impl FnMut(&[R::Bytes]),
    ) {
        let values = self.values_of::<R>(self.levels);
        for z in 0..size[2] {
            for y in 0..size[1] {
                let start = self.index(self.levels, [first[0], first[1] + y, first[2] + z]);
                show(&values[start..start + size[0]]);
            }
        }
    }

    fn cells(&self) -> Option<CellBlock> {
        if !self.kind.is_leaves() {
            return None;
        }
        let values = self.values(self.levels).to_vec();
        let cells = values.len() / self.layout.width;
        let present = match self.mask() {
            None => vec![true; cells],
            Some(_) => (0..cells).map(|index| self.bottom_state(index) == LEAF).collect(),
        };
        Some(CellBlock { present, values })
    }

    fn states<R: Record>(&self) -> DenseStates {
        let mut states = DenseStates::new(R::AXES as u8, self.levels);
        let bottom = states.level_mut(self.levels);
        match self.mask() {
            None => bottom.fill(self.kind.states().0),
            Some(_) => (0..).zip(bottom).for_each(|(index, state)| *state = self.bottom_state(index)),
        }
        // The first bottom value below each node represents the node's values where these are all
        // equal.
        let mut first: Vec<R::Bytes> = Vec::new();
        for level in (1..self.levels).rev() {
            let values = if first.is_empty() { self.values_of::<R>(self.levels) } else { &first[..] };
            let side = 1usize << level;
            let depth = if R::AXES > 2 { side } else { 1 };
            let mut above = Vec::with_capacity(side * side * depth);
            let (upper, lower) = states.levels_mut(level);
            for z in 0..depth {
                for y in 0..side {
                    let row = (z * side + y) * side;
                    for x in 0..side {
                        let corner = ((4 * z * side) + 2 * y) * 2 * side + 2 * x;
                        let (state, value) = (lower[corner], values[corner]);
                        let mut alike = state <= LEAF;
                        for step in 1..R::CHILDREN {
                            let child = corner
                                + (step & 1)
                                + (step >> 1 & 1) * 2 * side
                                + (step >> 2) * 4 * side * side;
                            alike &= lower[child] == state && (state == VOID || values[child] == value);
                        }
                        upper[row + x] = if alike { state } else { INNER };
                        above.push(value);
                    }
                }
            }
            first = above;
        }
        states
    }
}

/// The states of all nodes of a dense block: see [`DenseBlock::states`].
pub(crate) struct DenseStates {
    axes: u8,
    /// Levels below the root.
    levels: u8,
    states: Vec<u8>,
}

impl DenseStates {
    fn new(axes: u8, levels: u8) -> DenseStates {
        let mut states = DenseStates { axes, levels, states: Vec::new() };
        states.states.resize(states.range(levels).end, VOID);
        states
    }

    /// Returns the numbers of LEAF nodes (in the lower 32 bits) and INNER nodes (in the upper 32
    /// bits) of each level below the root.
    pub(crate) fn nodes_per_level(&self) -> [u64; MAX_DENSE_LEVELS as usize + 1] {
        let children = 1usize << self.axes;
        let mut nodes = [0; MAX_DENSE_LEVELS as usize + 1];
        for level in 1..=self.levels {
            let here = self.level(level);
            let side = 1usize << (level - 1);
            let depth = if self.axes > 2 { side } else { 1 };
            let (mut leaves, mut inner) = (0u64, 0u64);
            for z in 0..depth {
                for y in 0..side {
                    for x in 0..side {
                        // (Nodes below uniform ones do not exist. The states do not include the
                        // root.)
                        if level > 1 && self.level(level - 1)[(z * side + y) * side + x] != INNER {
                            continue;
                        }
                        let corner = ((4 * z * side) + 2 * y) * 2 * side + 2 * x;
                        for step in 0..children {
                            let child = corner
                                + (step & 1)
                                + (step >> 1 & 1) * 2 * side
                                + (step >> 2) * 4 * side * side;
                            leaves += u64::from(here[child] == LEAF);
                            inner += u64::from(here[child] == INNER);
                        }
                    }
                }
            }
            nodes[usize::from(level)] = leaves | inner << 32;
        }
        nodes
    }

    fn range(&self, level: u8) -> std::ops::Range<usize> {
        let nodes = 1usize << (self.axes * level);
        let children = 1usize << self.axes;
        let start = (nodes - children) / (children - 1);
        start..start + nodes
    }

    /// Returns the states of a level's nodes, in rows.
    #[inline]
    pub(crate) fn level(&self, level: u8) -> &[u8] {
        &self.states[self.range(level)]
    }

    /// Returns the states of a level, and those of the next one.
    fn levels_mut(&mut self, level: u8) -> (&mut [u8], &mut [u8]) {
        let (upper, lower) = (self.range(level), self.range(level + 1));
        let (above, below) = self.states.split_at_mut(lower.start);
        (&mut above[upper], &mut below[..lower.len()])
    }

    #[inline]
    fn level_mut(&mut self, level: u8) -> &mut [u8] {
        let range = self.range(level);
        &mut self.states[range]
    }
}

/// The bits of a number, spread to leave gaps for one other axis, or for two.
const SPREAD: [[u16; 1 << MAX_DENSE_LEVELS]; 2] = {
    let mut spread = [[0; 1 << MAX_DENSE_LEVELS]; 2];
    let mut number = 0;
    while number < 1 << MAX_DENSE_LEVELS {
        let mut bit = 0;
        while bit < MAX_DENSE_LEVELS as usize {
            spread[0][number] |= ((number >> bit & 1) << (2 * bit)) as u16;
            spread[1][number] |= ((number >> bit & 1) << (3 * bit)) as u16;
            bit += 1;
        }
        number += 1;
    }
    spread
};

/// Passes each node of a block's level to `show`: its index in Z order, and its index in rows.
#[inline(always)]
pub(crate) fn from_z_order<R: Record, F: FnMut(usize, usize)>(level: usize, mut show: F) {
    // Invariant: spread coordinates fit into 16 bits for up to 6 levels in octrees, the maximum of
    // blocks. Beyond that, the table would truncate them and yield other nodes.
    debug_assert!(R::AXES * level < 16 + R::AXES);
    let side = 1 << level;
    let spread = &SPREAD[R::AXES - 2][..side];
    let is_octree = R::DIMENSION == Dimension::Oct;
    let mut row = 0;
    for z in &spread[..if is_octree { side } else { 1 }] {
        for y in spread {
            let here = usize::from(*y) << 1 | usize::from(*z) << 2;
            for x in spread {
                show(here | usize::from(*x), row);
                row += 1;
            }
        }
    }
}

/// [`from_z_order`] with dynamic dispatch, compiled once. For visitors that take much longer than a
/// call.
#[inline(never)]
pub(crate) fn for_z_order(dimension: Dimension, levels: u8, show: &mut dyn FnMut(usize, usize)) {
    let levels = usize::from(levels);
    match dimension {
        Dimension::Quad => from_z_order::<QuadRecord<1>, _>(levels, show),
        Dimension::Oct => from_z_order::<OctRecord<1>, _>(levels, show),
    }
}
