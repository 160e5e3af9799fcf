//! Dense blocks: nodes whose subtree stands as rows of values instead of records (section 6 of formats.md).

use std::ops::RangeInclusive;

use spinney_base::space::{Cell, Dimension};
use spinney_base::value::Value;

use super::record_layout::{RecordHead, RecordLayout};
use super::state::{CUT, INNER, LEAF, VOID};

/// Levels below the root of a dense block, at most.
pub const MAX_DENSE_LEVELS: u8 = 8;

/// The numbers of levels that dense blocks can have below their root: 8 to 256 values along each axis of a quadtree, 4 to 16
/// of an octree.
pub const fn dense_levels(dimension: Dimension) -> RangeInclusive<u8> {
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
pub struct DenseKind(u8);

impl DenseKind {
    /// All bottom nodes are LEAFs.
    pub const ALL_LEAF: DenseKind = DenseKind(1);
    /// Bottom nodes are LEAFs or VOID.
    pub const LEAF_OR_VOID: DenseKind = DenseKind(3);

    /// Whether blocks have a bit for each bottom node.
    #[inline]
    pub const fn has_mask(self) -> bool {
        matches!(BOTTOM_STATES[self.0 as usize], Some((_, Some(_))))
    }

    /// Whether no bottom node is cut off.
    #[inline]
    pub fn is_leaves(self) -> bool {
        self == DenseKind::ALL_LEAF || self == DenseKind::LEAF_OR_VOID
    }

    /// The kind with a number, if there is one.
    #[inline]
    pub fn from_number(number: u8) -> Option<DenseKind> {
        BOTTOM_STATES.get(usize::from(number)).copied().flatten().map(|_| DenseKind(number))
    }

    /// The kind for bottom nodes of so many states: a bit for VOID, LEAF and CUT (1, 2 and 8) each. `None` if there are too
    /// many.
    #[inline]
    pub fn of_states(states: u8) -> Option<DenseKind> {
        let of = |(first, second): (u8, Option<u8>)| 1 << first | second.map_or(0, |second| 1 << second);
        let number = BOTTOM_STATES.iter().position(|kind| kind.map(of) == Some(states));
        number.map(|number| DenseKind(number as u8))
    }

    /// The number in the record.
    #[inline]
    pub fn number(self) -> u8 {
        self.0
    }

    /// The state of bottom nodes, and the other state of those whose bit is not set.
    #[inline]
    pub fn states(self) -> (u8, Option<u8>) {
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
    #[inline]
    pub const fn dense_places(&self, kind: DenseKind, levels: u8) -> usize {
        let mask = if kind.has_mask() { self.dimension.cells(levels) as usize / 8 } else { 0 };
        (self.dense_nodes(levels) * self.width + mask).div_ceil(self.size)
    }

    /// Kind and levels of the dense block that a record begins by its head; `None` if that is none.
    #[inline]
    fn dense_kind(&self, head: RecordHead) -> Option<(DenseKind, u8)> {
        let kind = DenseKind::from_number(head.dense)?;
        // Invariant: blocks of one kind with different numbers of levels are of different lengths, which
        // records need not tell therefore: each level more has four (or eight) times as many values as the
        // one before.
        let levels = dense_levels(self.dimension)
            .find(|levels| self.dense_places(kind, *levels) + 1 == head.skip as usize)?;
        Some((kind, levels))
    }

    /// The dense block whose record has a number and this head; `None` if that is no dense block, or not a whole one.
    #[inline]
    pub fn dense<'r>(&self, records: &'r [u8], at: usize, head: RecordHead) -> Option<DenseBlock<'r>> {
        let (kind, levels) = self.dense_kind(head)?;
        let bytes = self.subtree(records, at, head.skip)?;
        Some(DenseBlock { layout: *self, kind, levels, bytes })
    }

    /// Offset of the values of a level below a dense block's root, from the block's first byte on.
    #[inline]
    pub const fn dense_values_at(&self, level: u8) -> usize {
        // (The children of the root are in its record: Z order of two along each axis is that of rows.)
        if level > 1 { self.size + self.dense_nodes(level - 1) * self.width } else { 0 }
    }

    /// Offset of the bits of the bottom nodes of a dense block with so many levels, if it has some.
    #[inline]
    pub const fn dense_mask_at(&self, levels: u8) -> usize {
        self.size + self.dense_nodes(levels) * self.width
    }
}

/// The index in its level of a dense block of the node at a place there: x fastest, then y, then z.
#[inline]
const fn dense_index(level: u8, [x, y, z]: [usize; 3]) -> usize {
    // (In quadtrees z is 0.)
    (z << level | y) << level | x
}

/// The place in its level of a dense block of the node with an index.
#[inline]
const fn dense_place(level: u8, index: usize) -> [usize; 3] {
    let mask = (1 << level) - 1;
    [index & mask, index >> level & mask, index >> (2 * level)]
}

/// The index in its level of a dense block of a child of a node of the level above (0 is the root, whose index is 0).
#[inline]
pub const fn dense_child(level: u8, parent: usize, step: usize) -> usize {
    let [x, y, z] = dense_place(level - 1, parent);
    dense_index(level, [x << 1 | step & 1, y << 1 | step >> 1 & 1, z << 1 | step >> 2])
}

/// A dense block in a run of records.
#[derive(Clone, Copy)]
pub struct DenseBlock<'r> {
    /// Layout of its record.
    pub layout: RecordLayout,
    /// Which states its bottom nodes have.
    pub kind: DenseKind,
    /// Levels below the root.
    pub levels: u8,
    /// The record and the payload.
    bytes: &'r [u8],
}

impl<'r> DenseBlock<'r> {
    /// A block of so many levels, of which these are all bytes: those of its record, and all behind it.
    #[inline]
    pub fn new(layout: RecordLayout, kind: DenseKind, levels: u8, bytes: &'r [u8]) -> DenseBlock<'r> {
        DenseBlock { layout, kind, levels, bytes }
    }

    /// The values of all nodes of a level below the root, in rows: x fastest, then y, then z. Zeros where nodes are VOID.
    #[inline]
    pub fn values(&self, level: u8) -> &'r [u8] {
        let layout = &self.layout;
        let nodes = layout.dimension.cells(level) as usize;
        let start = layout.dense_values_at(level);
        &self.bytes[start..start + nodes * layout.width]
    }

    /// One bit per bottom node, if these have one of two states.
    #[inline]
    pub fn mask(&self) -> Option<&'r [u8]> {
        self.kind.states().1?;
        let layout = &self.layout;
        let start = layout.dense_mask_at(self.levels);
        Some(&self.bytes[start..start + layout.dimension.cells(self.levels) as usize / 8])
    }

    /// Children of a node.
    #[inline]
    pub fn children(&self) -> usize {
        self.layout.children()
    }

    /// Whether all nodes below are other than VOID.
    #[inline]
    pub fn is_full(&self) -> bool {
        self.kind.states().1 != Some(VOID)
    }

    /// The state of a bottom node: VOID, LEAF or CUT.
    #[inline]
    pub fn bottom_state(&self, index: usize) -> u8 {
        match (self.kind.states(), self.mask()) {
            ((_, Some(other)), Some(mask)) if mask[index / 8] >> (index % 8) & 1 == 0 => other,
            ((state, _), _) => state,
        }
    }

    /// The index in its level of the node at a place there.
    #[inline]
    pub fn index(&self, level: u8, place: [usize; 3]) -> usize {
        dense_index(level, place)
    }

    /// The place of the node with an index in its level.
    #[inline]
    pub fn place(&self, level: u8, index: usize) -> [usize; 3] {
        dense_place(level, index)
    }

    /// The state of a node of a level below the root.
    #[inline]
    pub fn state(&self, level: u8, index: usize) -> u8 {
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
    #[inline]
    pub fn is_void(&self, level: u8, index: usize) -> bool {
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
    pub fn value(&self, level: u8, index: usize) -> Value {
        let width = self.layout.width;
        Value::read(&self.values(level)[index * width..], width).expect("a value for each node")
    }

    /// The value of the node at some level below the root that has these coordinates among all nodes of that level; `None` is
    /// VOID.
    #[inline]
    pub fn value_at(&self, level: u8, cell: Cell) -> Option<Value> {
        let index = self.index(level, cell.map(|cell| cell as usize & ((1 << level) - 1)));
        (!self.is_void(level, index)).then(|| self.value(level, index))
    }

    /// The index in its level of a child of a node of the level above (0 is the root, whose index is 0).
    #[inline]
    pub fn child(&self, level: u8, parent: usize, step: usize) -> usize {
        dense_child(level, parent, step)
    }

    /// All of the block's bottom: the first place, and places along each axis.
    #[inline]
    pub fn whole(&self) -> ([usize; 3], [usize; 3]) {
        let side = 1 << self.levels;
        ([0; 3], [side, side, if self.layout.dimension == Dimension::Oct { side } else { 1 }])
    }
}
