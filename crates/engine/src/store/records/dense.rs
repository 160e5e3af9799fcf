//! Dense blocks: nodes whose subtree stands as rows of values instead of records.
//!
//! Where no two cells are alike, a tree spends a record on every four (or eight) of them. A node a few levels above the
//! bottom of what its segment has can be stored as a *dense block* instead: its record as usual, with a mark, then the
//! representatives of the inner levels and the values of the bottom level, level by level in rows, without states
//! and skips: what the leaves of OpenVDB are, in the way of a tree with levels of detail. The bottom nodes all have one
//! state, or one of two, which a bit each tells then. States further up follow from those: nodes are uniform where all
//! values below are the same.

use std::marker::PhantomData;
use std::ops::RangeInclusive;

use zerocopy::{FromBytes, IntoBytes};

use super::record::{OctRecord, QuadRecord, Record, RecordHead, RecordLayout};
use crate::tree::CellBlock;
use spinney_base::space::{Cell, Dimension};
use spinney_base::value::Value;
use spinney_container::{CUT, INNER, LEAF, VOID};

/// Levels below the root of a dense block, at most.
pub(crate) const MAX_DENSE_LEVELS: u8 = 8;

/// The numbers of levels that dense blocks can have below their root: 8 to 256 values along each axis of a quadtree, 4 to 16
/// of an octree.
pub(crate) const fn dense_levels(dimension: Dimension) -> RangeInclusive<u8> {
    match dimension {
        Dimension::Quad => 3..=MAX_DENSE_LEVELS,
        Dimension::Oct => 2..=4,
    }
}

/// The states of the bottom nodes of a dense block: all have the first; or those whose bit is set have it, and the others
/// the second. The index is the number in the record; that of records that are no dense blocks is 0.
const BOTTOM_STATES: [Option<(u8, Option<u8>)>; 6] = [
    None,
    Some((LEAF, None)),
    Some((CUT, None)),
    Some((LEAF, Some(VOID))),
    Some((CUT, Some(VOID))),
    Some((CUT, Some(LEAF))),
];

/// The number of a kind of dense blocks: what the states of their bottom nodes are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct DenseKind(u8);

impl DenseKind {
    /// All bottom nodes are LEAFs.
    const ALL_LEAF: DenseKind = DenseKind(1);
    /// Bottom nodes are LEAFs or VOID.
    const LEAF_OR_VOID: DenseKind = DenseKind(3);

    /// Whether blocks have a bit for each bottom node.
    #[inline]
    const fn has_mask(self) -> bool {
        matches!(BOTTOM_STATES[self.0 as usize], Some((_, Some(_))))
    }

    /// Whether no bottom node is cut off.
    #[inline]
    pub(crate) fn is_leaves(self) -> bool {
        self == DenseKind::ALL_LEAF || self == DenseKind::LEAF_OR_VOID
    }

    /// The kind with a number, if there is one.
    #[inline]
    pub(crate) fn from_number(number: u8) -> Option<DenseKind> {
        BOTTOM_STATES.get(usize::from(number)).copied().flatten().map(|_| DenseKind(number))
    }

    /// The kind for bottom nodes of so many states: a bit for VOID, LEAF and CUT (1, 2 and 8) each. `None` if there are too
    /// many.
    pub(crate) fn of_states(states: u8) -> Option<DenseKind> {
        let of = |(first, second): (u8, Option<u8>)| 1 << first | second.map_or(0, |second| 1 << second);
        let number = BOTTOM_STATES.iter().position(|kind| kind.map(of) == Some(states));
        number.map(|number| DenseKind(number as u8))
    }

    /// The number in the record.
    #[inline]
    pub(crate) fn number(self) -> u8 {
        self.0
    }

    /// The state of bottom nodes, and the other state of those whose bit is not set.
    #[inline]
    pub(crate) fn states(self) -> (u8, Option<u8>) {
        BOTTOM_STATES[usize::from(self.0)].unwrap_or((VOID, None))
    }
}

impl RecordLayout {
    /// Nodes of the levels 2 to `levels` of a dense block.
    #[inline]
    const fn dense_nodes(&self, levels: u8) -> usize {
        // A geometric sum: c^2 + c^3 ... for c children.
        let children = self.children();
        (self.dimension.cells(levels + 1) as usize - children * children) / (children - 1)
    }

    /// Places of records that a dense block takes behind its own.
    pub(crate) const fn dense_places(&self, kind: DenseKind, levels: u8) -> usize {
        let mask = if kind.has_mask() { self.dimension.cells(levels) as usize / 8 } else { 0 };
        (self.dense_nodes(levels) * self.width + mask).div_ceil(self.size)
    }

    /// The dense block whose record has a number and this head; `None` if that is no dense block, or not a whole one.
    pub(crate) fn dense<'r>(&self, records: &'r [u8], at: usize, head: RecordHead) -> Option<DenseBlock<'r>> {
        let kind = DenseKind::from_number(head.dense)?;
        // Invariant: blocks of one kind with different numbers of levels are of different lengths, which
        // records need not tell therefore: each level more has four (or eight) times as many values as the
        // one before. See the table below.
        let levels = dense_levels(self.dimension)
            .find(|levels| self.dense_places(kind, *levels) + 1 == head.skip as usize)?;
        let bytes = self.subtree(records, at, head.skip)?;
        Some(DenseBlock { layout: *self, kind, levels, bytes })
    }
}

/// [`RecordLayout::dense_places`] by whether there is a mask, and by levels, for a type of records: so that no size of a block is
/// computed while blocks are read.
struct DensePlaces<R>(PhantomData<R>);

impl<R: Record> DensePlaces<R> {
    const TABLE: [[u32; MAX_DENSE_LEVELS as usize + 1]; 2] = {
        let mut table = [[0; MAX_DENSE_LEVELS as usize + 1]; 2];
        let mut levels = *dense_levels(R::DIMENSION).start();
        while levels <= *dense_levels(R::DIMENSION).end() {
            table[0][levels as usize] = R::RECORD_LAYOUT.dense_places(DenseKind::ALL_LEAF, levels) as u32;
            table[1][levels as usize] = R::RECORD_LAYOUT.dense_places(DenseKind::LEAF_OR_VOID, levels) as u32;
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

/// The dense block whose record has a number, which must be there; `None` if it is none, or not a whole one.
pub(crate) fn dense_block<R: Record>(records: &[R], at: usize) -> Option<DenseBlock<'_>> {
    let head = records[at].head();
    let kind = DenseKind::from_number(head.dense)?;
    // (What cannot be is 0.)
    let table = &DensePlaces::<R>::TABLE[usize::from(kind.has_mask())];
    let levels = table.iter().position(|places| *places > 0 && *places + 1 == head.skip)? as u8;
    let bytes = records.get(at..at + head.skip as usize)?.as_bytes();
    Some(DenseBlock { layout: R::RECORD_LAYOUT, kind, levels, bytes })
}

/// A dense block in a run of records.
#[derive(Clone, Copy)]
pub(crate) struct DenseBlock<'r> {
    layout: RecordLayout,
    pub kind: DenseKind,
    /// Levels below the root.
    pub levels: u8,
    /// The record and the payload.
    bytes: &'r [u8],
}

impl<'r> DenseBlock<'r> {
    /// The values of all nodes of a level below the root, in rows: x fastest, then y, then z. Zeros where nodes are VOID.
    #[inline]
    pub(crate) fn values(&self, level: u8) -> &'r [u8] {
        let layout = &self.layout;
        let nodes = layout.dimension.cells(level) as usize;
        // (The children of the root are in its record: Z order of two along each axis is that of rows.)
        let start = if level > 1 { layout.size + layout.dense_nodes(level - 1) * layout.width } else { 0 };
        &self.bytes[start..start + nodes * layout.width]
    }

    /// [`DenseBlock::values`] of a width that is known.
    #[inline]
    pub(crate) fn values_of<R: Record>(&self, level: u8) -> &'r [R::Bytes] {
        <[R::Bytes]>::ref_from_bytes(self.values(level)).unwrap_or(&[])
    }

    /// One bit per bottom node, if these have one of two states.
    pub(crate) fn mask(&self) -> Option<&'r [u8]> {
        self.kind.states().1?;
        let layout = &self.layout;
        let start = layout.size + layout.dense_nodes(self.levels) * layout.width;
        Some(&self.bytes[start..start + layout.dimension.cells(self.levels) as usize / 8])
    }

    /// Children of a node.
    pub(crate) fn children(&self) -> usize {
        self.layout.children()
    }

    /// Whether all nodes below are other than VOID.
    #[inline]
    pub(crate) fn is_full(&self) -> bool {
        self.kind.states().1 != Some(VOID)
    }

    /// The state of a bottom node: VOID, LEAF or CUT.
    #[inline]
    pub(crate) fn bottom_state(&self, index: usize) -> u8 {
        match (self.kind.states(), self.mask()) {
            ((_, Some(other)), Some(mask)) if mask[index / 8] >> (index % 8) & 1 == 0 => other,
            ((state, _), _) => state,
        }
    }

    /// The index in its level of the node at a place there.
    #[inline]
    pub(crate) fn index(&self, level: u8, [x, y, z]: [usize; 3]) -> usize {
        // (In quadtrees z is 0.)
        (z << level | y) << level | x
    }

    /// The place of the node with an index in its level.
    #[inline]
    pub(crate) fn place(&self, level: u8, index: usize) -> [usize; 3] {
        let mask = (1 << level) - 1;
        [index & mask, index >> level & mask, index >> (2 * level)]
    }

    /// The state of a node of a level below the root.
    pub(crate) fn state(&self, level: u8, index: usize) -> u8 {
        let below = self.levels - level;
        if below == 0 {
            return self.bottom_state(index);
        }
        let width = self.layout.width;
        let values = self.values(self.levels);
        let value_at = |index: usize| &values[index * width..(index + 1) * width];
        let [x, y, z] = self.place(level, index).map(|cell| cell << below);
        let depth = if self.layout.dimension == Dimension::Oct { 1 << below } else { 1 };
        let first = self.index(self.levels, [x, y, z]);
        let (state, value) = (self.bottom_state(first), value_at(first));
        let rows = (z..z + depth).flat_map(|z| (y..y + (1 << below)).map(move |y| (y, z)));
        for (y, z) in rows {
            let start = self.index(self.levels, [x, y, z]);
            for index in start..start + (1 << below) {
                // (Nodes that are cut off differ below.)
                let is_same = state != CUT
                    && self.bottom_state(index) == state
                    && (state == VOID || value_at(index) == value);
                if !is_same {
                    return INNER;
                }
            }
        }
        state
    }

    /// Whether nothing but VOID is below a node of a level below the root.
    pub(crate) fn is_void(&self, level: u8, index: usize) -> bool {
        if self.is_full() {
            return false;
        }
        let below = self.levels - level;
        let [x, y, z] = self.place(level, index).map(|cell| cell << below);
        let depth = if self.layout.dimension == Dimension::Oct { 1 << below } else { 1 };
        let mut rows = (z..z + depth).flat_map(|z| (y..y + (1 << below)).map(move |y| (y, z)));
        rows.all(|(y, z)| {
            let start = self.index(self.levels, [x, y, z]);
            (start..start + (1 << below)).all(|index| self.bottom_state(index) == VOID)
        })
    }

    /// The value of a node of a level below the root.
    #[inline]
    pub(crate) fn value(&self, level: u8, index: usize) -> Value {
        let width = self.layout.width;
        Value::read(&self.values(level)[index * width..], width).expect("a value for each node")
    }

    /// The value of the node at some level below the root that has these coordinates among all nodes of that level; `None` is
    /// VOID.
    pub(crate) fn value_at(&self, level: u8, cell: Cell) -> Option<Value> {
        let index = self.index(level, cell.map(|cell| cell as usize & ((1 << level) - 1)));
        (!self.is_void(level, index)).then(|| self.value(level, index))
    }

    /// The index in its level of a child of a node of the level above (0 is the root, whose index is 0).
    #[inline]
    pub(crate) fn child(&self, level: u8, parent: usize, step: usize) -> usize {
        let place = self.place(level - 1, parent);
        self.index(level, std::array::from_fn(|axis| place[axis] << 1 | step >> axis & 1))
    }

    /// Shows the values of those bottom nodes that are LEAFs in a box: the first place, and places along each axis. (By a
    /// pointer: what is done with them is compiled for very many types.)
    #[inline(never)]
    pub(crate) fn each_leaf_in<R: Record>(
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

    /// Shows the values of all bottom nodes in a box, row by row, whatever their states.
    #[inline]
    pub(crate) fn rows_in<R: Record>(
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

    /// All of the block's bottom: the first place, and places along each axis.
    pub(crate) fn whole(&self) -> ([usize; 3], [usize; 3]) {
        let side = 1 << self.levels;
        ([0; 3], [side, side, if self.layout.dimension == Dimension::Oct { side } else { 1 }])
    }

    /// The bottom nodes as cells; `None` if some of them are cut off.
    pub(crate) fn cells(&self) -> Option<CellBlock> {
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

    /// The states of all nodes below the root: of a level those that [`DenseStates::level`] has. Nodes below uniform ones are
    /// as these. Much faster than asking for each.
    pub(crate) fn states<R: Record>(&self) -> DenseStates {
        let mut states = DenseStates::new(R::AXES as u8, self.levels);
        let bottom = states.level_mut(self.levels);
        match self.mask() {
            None => bottom.fill(self.kind.states().0),
            Some(_) => (0..).zip(bottom).for_each(|(index, state)| *state = self.bottom_state(index)),
        }
        // The first bottom value below each node stands for all, where these are alike.
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

    /// LEAF nodes (in the lower half) and INNER ones (in the upper half) of each level below the root.
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
                        // (Nodes below uniform ones are none. The root is not among the states.)
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

    /// The states of the nodes of a level, in rows.
    #[inline]
    pub(crate) fn level(&self, level: u8) -> &[u8] {
        &self.states[self.range(level)]
    }

    /// The states of a level, and those of the next one.
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

/// Bits of a number with gaps for those of one other axis, or of two.
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

/// Shows the index of each node of a level of a block in Z order, and in rows.
#[inline(always)]
pub(crate) fn from_z_order<R: Record, F: FnMut(usize, usize)>(level: usize, mut show: F) {
    // Invariant: the spread coordinates fit 16 bits, in octrees up to 6 levels, which is what blocks have.
    // Others would be cut off by the table, and show other nodes.
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

/// [`from_z_order`] by a pointer, where a call for each node is little beside what is done with it: compiled once.
#[inline(never)]
pub(crate) fn for_z_order(dimension: Dimension, levels: u8, show: &mut dyn FnMut(usize, usize)) {
    let levels = usize::from(levels);
    match dimension {
        Dimension::Quad => from_z_order::<QuadRecord<1>, _>(levels, show),
        Dimension::Oct => from_z_order::<OctRecord<1>, _>(levels, show),
    }
}
